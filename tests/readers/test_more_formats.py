"""TDMS, HDF5, universal files, numpy files, JSON lines, Excel sheets, bags of ROS 1 and folders of ROS 2: what was written is
read, damaged and swollen files are one sentence."""

import bz2
import io
import json
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pytest
import pyuff
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsWriter
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from hexsim import HexsimError, readers
from hexsim.readers import files

CLEAN = Path(__file__).resolve().parents[1] / "data" / "bench_none" / "fit.csv.gz"
FORMATS = ("tdms", "h5", "npz", "jsonl", "xlsx", "uff")
PRESSURE = "sensor_msgs/msg/FluidPressure"


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    """Two seconds of a bench log."""
    table = pl.read_csv(CLEAN).slice(4000, 2000)
    return {name: table[name].to_numpy() for name in table.columns}


def write(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """The columns as a file of the format that the suffix names."""
    time = columns["time_s"]
    if path.suffix == ".tdms":
        with TdmsWriter(path) as file:
            file.write_segment([ChannelObject("bench", name, values) for name, values in columns.items()])
    elif path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            for name, values in columns.items():
                file[f"run/{name}"] = values
    elif path.suffix == ".npz":
        np.savez(path, **columns)
    elif path.suffix == ".jsonl":
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        path.write_text("\n".join(json.dumps(dict(zip(columns, row, strict=True))) for row in rows))
    elif path.suffix == ".xlsx":
        pl.DataFrame(columns).write_excel(path)
    elif path.suffix == ".uff":
        sets = [
            {
                "type": 58,
                "func_type": 1,
                "data": values,
                "x": time,
                "binary": 0,
                "id1": name,
                "ord_data_type": 4,
                "abscissa_spacing": 1,
                "rsp_node": 1,
                "rsp_dir": 1,
                "ref_node": 1,
                "ref_dir": 1,
                "abscissa_spec_data_type": 17,
                "ordinate_spec_data_type": 0,
                "orddenom_spec_data_type": 0,
                "z_axis_spec_data_type": 0,
            }
            for name, values in columns.items()
            if name != "time_s"
        ]
        pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    return path


@pytest.mark.parametrize("suffix", FORMATS)
def test_what_was_written_is_read(columns, tmp_path, suffix):
    """A bench log through each format: all signals, times within 1 us (the single precision of UFF: 1e-5 of the position),
    1000 Hz, nothing missing; and the name is found in its folder."""
    write(tmp_path / f"run.{suffix}", columns)
    log = readers.read_log(readers.log_files(tmp_path, "run"))
    want = pl.DataFrame(columns)
    for stem in ("setpoint_m", "position_m", "valve_V", "pressure_bottom_Pa", "acceleration_m_s2"):
        found = np.ravel(log.signal(stem.rpartition("_")[0] if stem != "acceleration_m_s2" else "acceleration"))
        np.testing.assert_allclose(found, want[stem].to_numpy(), rtol=1e-5 if suffix == "uff" else 1e-12, atol=1e-9)
    assert 1.0 / np.diff(log.time).mean() == pytest.approx(1000.0, rel=1e-6)


def test_channels_with_clocks_of_their_own(columns, tmp_path):
    """Waveforms of TDMS by their start and increment, groups of HDF5 and arrays of .npz by the time of their length: a pressure
    at half the rate, 3 ms later in TDMS, is within its curvature of the full one."""
    slow = slice(None, None, 2)
    pressure, time = columns["pressure_bottom_Pa"][slow], columns["time_s"]
    fast = {name: values for name, values in columns.items() if name not in ("time_s", "pressure_bottom_Pa")}
    begin = np.datetime64("2026-01-02T03:04:05.000000")
    with TdmsWriter(tmp_path / "wave.tdms") as file:
        file.write_segment(
            [
                ChannelObject("a", n, v, properties={"wf_increment": 1e-3, "wf_start_time": begin})
                for n, v in fast.items()
            ]
            + [
                ChannelObject(
                    "b",
                    "pressure_bottom_Pa",
                    pressure[2:],
                    properties={"wf_increment": 2e-3, "wf_start_time": begin + np.timedelta64(4, "ms")},
                )
            ]
        )
    with h5py.File(tmp_path / "groups.h5", "w") as file:
        file["a/t"], file["b/t_ms"] = time, 1e3 * time[slow]
        file["b/pressure_bottom"] = 1e-5 * pressure
        file["b/pressure_bottom"].attrs["units"] = "bar"
        for name, values in fast.items():
            file[f"a/{name}"] = values
    bar = readers.Mapping.model_validate(
        {"columns": {"pressure_bottom_Pa": {"from": "b.pressure_bottom", "unit": "bar"}}}
    )
    for path, mapping in ((tmp_path / "wave.tdms", None), (tmp_path / "groups.h5", bar)):
        log = readers.read_log(path, mapping)
        found, at = np.ravel(log.signal("pressure_bottom")), np.round(1e3 * log.time).astype(int)
        begins = round(1e3 * (time[0] if "h5" in path.name else 0.0))
        whole = columns["pressure_bottom_Pa"][at - begins]
        noise = np.std(np.diff(columns["pressure_bottom_Pa"], 2)) / np.sqrt(6.0)
        assert np.sqrt(np.mean((found - whole) ** 2)) < 3.0 * noise


def message(stamp_ns: int, value: float, store: object) -> object:
    """A pressure with its time of measurement."""
    types = store.types
    header = types["std_msgs/msg/Header"]
    keys = {
        "stamp": types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9),
        "frame_id": "",
    }
    if "seq" in header.__dataclass_fields__:
        keys["seq"] = 0
    return types[PRESSURE](header=header(**keys), fluid_pressure=value, variance=0.0)


@pytest.mark.parametrize("kind", ("sqlite", "mcap", "file", "message", "ros1", "ros1 bz2", "ros1 lz4"))
def test_bags_of_every_kind(columns, tmp_path, kind):
    """Two topics with header stamps, received up to 4 ms later: folders in SQLite, MCAP, compressed by file or message, and
    bags of ROS 1; positions and pressures stand at their header's time."""
    ros1 = kind.startswith("ros1")
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    random = np.random.default_rng(1)
    path = tmp_path / ("bag.bag" if ros1 else "bag")
    if ros1:
        bag = rosbag1.Writer(path)
        if " " in kind:
            bag.set_compression(rosbag1.Writer.CompressionFormat[kind.split()[1].upper()])
    else:
        storage = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        bag = rosbag2.Writer(path, version=9, storage_plugin=storage)
        if kind in ("file", "message"):
            bag.set_compression(rosbag2.CompressionMode[kind.upper()], rosbag2.CompressionFormat.ZSTD)
    names = {"/position": "position_m", "/pressure": "pressure_bottom_Pa"}
    with bag:
        for topic, column in names.items():
            connection = bag.add_connection(topic, PRESSURE, typestore=store)
            for k, value in enumerate(columns[column][:500]):
                stamp = 1_700_000_000_000_000_000 + k * 1_000_000
                serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
                data = serialize(message(stamp, float(value), store), PRESSURE)
                bag.write(connection, stamp + int(random.integers(0, 4_000_000)), data)
    mapping = readers.Mapping.model_validate(
        {"kind": "bench", "columns": {c: {"from": f"{t[1:]}.fluid_pressure"} for t, c in names.items()}}
    )
    log = readers.read_log(path, mapping)
    for column in names.values():
        found = np.ravel(log.signal(column.rpartition("_")[0]))
        np.testing.assert_allclose(found, columns[column][: len(found)], rtol=1e-12)
    assert 1.0 / np.diff(log.time).mean() == pytest.approx(1000.0, rel=1e-6)


def swollen(kind: str, path: Path) -> Path:
    """A small file that claims or unpacks to more than 5 GB."""
    if kind == "h5":
        with h5py.File(path, "w") as file:
            file.create_dataset("position_m", shape=(700_000_000,), dtype="f8", chunks=(1_000_000,), compression="gzip")
    elif kind == "npz":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            head = io.BytesIO()
            np.lib.format.write_array_header_1_0(
                head, {"descr": "<f8", "fortran_order": False, "shape": (700_000_000,)}
            )
            archive.writestr("position_m.npy", head.getvalue() + bytes(1_000_000))
    elif kind == "uff":
        write(path, {"time_s": np.arange(9.0), "position_m": np.arange(9.0)})
        path.write_bytes(path.read_bytes().replace(b"         9", b" 700000000"))
    elif kind == "xlsx":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("xl/worksheets/sheet1.xml", bytes(200_000_000))
    elif kind == "tdms":
        write(path, {"time_s": np.arange(9.0), "position_m": np.arange(9.0)})
        content = path.read_bytes()
        path.write_bytes(content.replace(struct.pack("<Q", 9), struct.pack("<Q", 700_000_000)))
    elif kind == "bag":
        store = get_typestore(Stores.ROS1_NOETIC)
        bag = rosbag1.Writer(path)
        bag.set_compression(rosbag1.Writer.CompressionFormat.BZ2)
        with bag:
            connection = bag.add_connection("/p", PRESSURE, typestore=store)
            bag.write(connection, 1, store.serialize_ros1(message(1, 1.0, store), PRESSURE))
        packed = path.read_bytes()
        start = packed.index(b"BZh")
        bomb = bz2.compress(bytes(1 << 27))  # twice what a chunk may hold
        path.write_bytes(
            packed[:start] + bomb + packed[start + len(bomb) :] if len(bomb) < 200 else packed[:start] + bomb
        )
    return path


LIMITED = """
import resource, sys, time
from pathlib import Path
from hexsim import HexsimError
from hexsim.readers.files import raw_log
begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for path in sys.argv[1:]:
    said = "was read"
    try:
        raw_log(Path(path))
    except HexsimError as error:
        said = str(error).replace(chr(10), " ")
    print(said)
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - begun
    assert more < 1_000_000, f"{path}: {more} kB"
"""


@pytest.mark.skipif(sys.platform == "win32", reason="resource is not on Windows")
def test_a_swollen_file_is_refused_before_it_is_unpacked(tmp_path):
    """Small files that claim 700 million numbers, or unpack to hundreds of MB, one after another: one sentence each, less than 1 GB
    taken (a TDMS file is read as far as it goes)."""
    paths = [swollen(kind, tmp_path / f"bomb.{kind}") for kind in ("h5", "npz", "uff", "xlsx", "tdms", "bag")]
    assert max(path.stat().st_size for path in paths) < 10_000_000
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, *map(str, paths)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr[-500:]
    for path, said in zip(paths, done.stdout.splitlines(), strict=True):
        wanted = {".bag": "a chunk of the bag unpacks to more than", ".xlsx": f"{path} unpacks to 200 MB"}
        assert path.suffix == ".tdms" or wanted.get(path.suffix, str(path)) in said, said


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data(), suffix=st.sampled_from((*FORMATS, "bag")))
def test_damaged_files_are_a_sentence_or_a_log(tmp_path_factory, data, suffix):
    """Valid files cut anywhere, or with bytes changed anywhere: signals or a HexsimError, nothing else."""
    small = {"time_s": np.arange(20) * 1e-3, "position_m": np.linspace(0.1, 0.2, 20)}
    folder = tmp_path_factory.mktemp("damaged")
    path = write(folder / f"run.{suffix}", small)
    if suffix == "bag":
        store = get_typestore(Stores.ROS1_NOETIC)
        with rosbag1.Writer(path) as bag:
            connection = bag.add_connection("/p", PRESSURE, typestore=store)
            for k in range(5):
                bag.write(connection, k + 1, store.serialize_ros1(message(k + 1, 1.0, store), PRESSURE))
    content, share = bytearray(path.read_bytes()), st.floats(0.0, 1.0)  # shares: its length varies with the date in it
    for _ in range(data.draw(st.integers(0, 6))):
        content[int(data.draw(share) * (len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: int(data.draw(share) * len(content))] if data.draw(st.booleans()) else content)
    try:
        raw = files.raw_log(path)
    except HexsimError as error:
        assert "\n" not in str(error).strip()
    else:
        assert all(len(signal.values) < 1_000_000 for signal in raw.signals)


def test_pickled_objects_are_never_read(tmp_path):
    """An .npz with an array of objects, which numpy would unpickle: left out, with the others read."""
    np.savez(
        tmp_path / "run.npz", time_s=np.arange(5.0), position_m=np.arange(5.0), evil=np.array([print, {}], dtype=object)
    )
    raw = files.raw_log(tmp_path / "run.npz")
    assert {signal.name for signal in raw.signals} == {"time_s", "position_m"}
    assert "array evil holds objects" in raw.left_out[0]


def test_six_legs_in_few_lines_counters_and_rows(tmp_path):
    """A foreign hexapod log with a preamble, names in line 4, units in line 5: twelve lines of mapping for six legs by {leg} and
    {leg0}; a position that wraps at 65536 counts goes on; markers are missing."""
    n = 800
    time = np.arange(n) * 2e-3
    true = {leg: 0.3 + 0.01 * leg + 0.2 * np.sin(2 * np.pi * 0.7 * time) for leg in range(1, 7)}
    counts = {leg: np.rint(true[leg] / 4e-6) % 65536 for leg in true}
    table = pl.DataFrame(
        {"T": 1e3 * time}
        | {f"enc[{leg - 1}]": counts[leg] for leg in true}
        | {f"P{leg}": 35.0 + 0.01 * leg + np.sin(3.0 * time) for leg in true}
    )
    text = table.write_csv(separator=";", include_header=False)
    names = ";".join(table.columns)
    units = ";".join(["ms", *["-"] * 6, *["bar"] * 6])
    (tmp_path / "run.csv").write_text(f"rig 7\n1;2;3\n\n{names}\n{units}\n{text}")
    (tmp_path / "mapping.toml").write_text(
        """kind = "hexapod"
[file]
header_row = 4
[columns]
time_s = {from = "T"}
"position_{leg}_m" = {from = "enc[{leg0}]", factor = 4e-6, unwrap = 65536.0}
"pressure_bottom_{leg}_Pa" = {from = "P{leg}"}
"""
    )
    log = readers.read_log(tmp_path / "run.csv")
    for leg in true:
        found = np.asarray(log.columns[f"position_{leg}_m"])
        assert np.ptp(found - true[leg]) < 8e-6  # two counts; a counter does not know its turn
        bar = 35.0 + 0.01 * leg + np.sin(3.0 * time)
        assert log.columns[f"pressure_bottom_{leg}_Pa"] == pytest.approx(1e5 * bar, rel=1e-9)


@pytest.mark.parametrize(
    ("line", "sentence"),
    (
        ('position_1_m = {from = "a"}\n"position_{leg}_m" = {from = "b{leg}"}', "position_1_m stands twice"),
        ('position_m = {from = "x", unwrap = -1.0}', "unwrap"),
        ('position_m = {from = "x", unwrap = nan}', "unwrap"),
    ),
)
def test_mappings_that_make_no_sense_are_refused(tmp_path, line, sentence):
    """One sentence that names the file and the key."""
    (tmp_path / "run.csv").write_text("time_s,x\n0,1\n1,2\n2,3\n")
    (tmp_path / "mapping.toml").write_text(f"[columns]\n{line}\n")
    with pytest.raises(HexsimError, match=sentence) as refused:
        readers.read_log(tmp_path / "run.csv")
    assert str(tmp_path / "mapping.toml") in str(refused.value)


def test_results_of_modelica_tools_by_name(tmp_path):
    """As Dymola writes them: names as columns of letters, a sign in dataInfo, constants in data_1; an alias with a minus."""
    time = np.linspace(0.0, 2.0, 2001)
    position, pressure = 0.1 + 0.03 * np.sin(4.0 * time), 3e6 + 1e5 * np.cos(4.0 * time)
    names = ["time", "cylinder.s", "volume.p", "volume.minus_p", "mass.m"]
    letters = np.array([list(name.ljust(16)) for name in names]).T
    letters = (
        letters.ravel().reshape(letters.shape[::-1]).T
    )  # scipy writes letters of version 4 by rows, reads by columns
    info = np.array([[0, 1, 0, -1], [2, 2, 0, -1], [2, 3, 0, -1], [2, -3, 0, -1], [1, 2, 0, 0]], dtype=np.int32).T
    kinds = np.array(["Atrajectory", "1.1        ", "           ", "binTrans   "])
    tables = {
        "Aclass": kinds,
        "name": letters,
        "description": letters,
        "dataInfo": info,
        "data_1": np.array([[0.0, 2.0], [40.0, 40.0]]),
        "data_2": np.array([time, position, pressure]),
    }
    scipy.io.savemat(tmp_path / "run.mat", tables, format="4")
    signals = {"position_m": {"from": "cylinder.s"}, "pressure_bottom_Pa": {"from": "volume.p"}}
    log = readers.read_log(tmp_path / "run.mat", readers.Mapping.model_validate({"kind": "bench", "columns": signals}))
    np.testing.assert_allclose(log.columns["position_m"], position[: log.n], atol=1e-9)
    np.testing.assert_allclose(log.columns["pressure_bottom_Pa"], pressure[: log.n], rtol=1e-9)
    found = {signal.name: signal.values for signal in files.raw_log(tmp_path / "run.mat").signals}
    np.testing.assert_allclose(found["volume.minus_p"], -pressure)
    assert "mass.m" not in found


def test_twincat_scope_has_a_time_for_each_channel(tmp_path):
    """An export with two channels of 1 and 2 ms, each behind its own time in ms, under a block of lines about them: both stand on
    their own clock, the slower one with half the weight."""
    time = np.arange(3000) * 1e-3
    position, pressure = 100.0 + 30.0 * np.sin(4.0 * time), 34.0 + np.cos(4.0 * time)
    lines = [
        "Name\tScope",
        "File\tC:\\a.svdx",
        "",
        "Name\tPos\tName\tPressure",
        "Data-Type\tREAL64\tData-Type\tREAL64",
        "SampleTime[ms]\t1\tSampleTime[ms]\t2",
        "SymbolName\tMAIN.Pos\tSymbolName\tMAIN.p",
        "VariableSize\t8\tVariableSize\t8",
    ]
    for k in range(3000):
        slow = f"\t{2 * k}\t{pressure[2 * k]:.6f}" if 2 * k < 3000 else "\t\t"
        lines.append(f"{k}\t{position[k]:.6f}{slow}")
    (tmp_path / "run.txt").write_text("\n".join(lines))
    columns = {
        "position_m": {"from": "MAIN.Pos", "unit": "mm"},
        "pressure_bottom_Pa": {"from": "MAIN.p", "unit": "bar"},
    }
    log = readers.read_log(tmp_path / "run.txt", readers.Mapping.model_validate({"kind": "bench", "columns": columns}))
    np.testing.assert_allclose(log.columns["position_m"], 1e-3 * position[: log.n], atol=1e-8)
    np.testing.assert_allclose(log.columns["pressure_bottom_Pa"], 1e5 * pressure[: log.n], atol=2.0)
    assert log.weight("pressure_bottom_Pa").mean() == pytest.approx(0.5, abs=0.01)
