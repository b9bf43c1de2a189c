"""Files that are damaged or made to harm: one sentence, within bounds, whatever the library raises."""

from __future__ import annotations

import gzip
import sqlite3
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hexsim import HexsimError, readers
from hexsim.readers import files, reader

T = np.arange(600) / 500.0
COLUMNS = {
    "time_s": T,
    "position_m": 0.1 + 0.038 * np.sin(4.4 * T),
    "valve_V": np.cos(4.4 * T),
    "pressure_bottom_Pa": 3.4e6 + 3e5 * np.sin(4.4 * T),
}
MEMORY_MB = 1000  # beyond what an empty interpreter with the readers takes
PROGRAM = """
import resource, sys
from hexsim import HexsimError
from hexsim.readers import read_log
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    read_log(sys.argv[1])
    print("read")
except HexsimError as error:
    print("refused:", error)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


def answer(path: Path) -> str:
    """What reading says, in a process of its own, within memory."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(path)], capture_output=True, text=True, timeout=120, check=True
    )
    said, memory = done.stdout.strip().rsplit("\n", 1)
    assert int(memory) < MEMORY_MB, (said, memory)
    return said


def db3(path: Path, script: str) -> Path:
    """A bag with one topic, and what else a script makes."""
    bag = sqlite3.connect(path)
    bag.executescript(
        "create table topics(id, name, type); insert into topics values(1, '/t', 'std_msgs/msg/Float64');" + script
    )
    bag.commit()
    bag.close()
    return path


def view_without_end(folder: Path) -> Path:
    return db3(
        folder / "view.db3",
        "create view messages as with recursive c(x) as (select 1 union all select x + 1 from c) "
        "select 1 as topic_id, x as timestamp, x'00010000000000000000f03f' as data from c;",
    )


def column_without_end(folder: Path) -> Path:
    """A generated column that computes for ever."""
    return db3(
        folder / "column.db3",
        "create table m(x); insert into m values(1); create view messages as select 1 as topic_id, 1 as timestamp, "
        "zeroblob(900000000) as data from m;",
    )


def mat_struct(folder: Path) -> Path:
    scipy.io.savemat(folder / "s.mat", {"log": {"position_m": np.zeros(40_000_000)}}, do_compression=True)
    return folder / "s.mat"


def mat_cell(folder: Path) -> Path:
    inside = np.empty(1, dtype=object)
    inside[0] = np.zeros(40_000_000)
    scipy.io.savemat(folder / "c.mat", {"log": inside}, do_compression=True)
    return folder / "c.mat"


def mat_hdf5(folder: Path) -> Path:
    h5py = pytest.importorskip("h5py", reason="comes with hexsim[matlab]")
    path = folder / "h.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        data = file.create_dataset("x", shape=(1, 10**9), dtype="f8", chunks=(1, 10**6), compression="gzip")
        data.attrs["MATLAB_class"] = np.bytes_("double")
    raw = bytearray(path.read_bytes())
    raw[:128] = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124) + b"\0\2IM"
    path.write_bytes(raw)
    return path


def mcap_chunk(folder: Path) -> Path:
    """A chunk of zeros that unpacks to 2 GB."""
    zstandard = pytest.importorskip("zstandard", reason="comes with hexsim[ros]")
    import struct

    n, packed = 2 << 30, b""
    pack = zstandard.ZstdCompressor(level=1).compressobj(size=n)
    for _ in range(n >> 26):
        packed += pack.compress(bytes(1 << 26))
    packed += pack.flush()

    def record(kind: int, content: bytes) -> bytes:
        return bytes([kind]) + struct.pack("<Q", len(content)) + content

    def text(content: bytes) -> bytes:
        return struct.pack("<I", len(content)) + content

    chunk = struct.pack("<QQQI", 1, 2, n, 0) + text(b"zstd") + struct.pack("<Q", len(packed)) + packed
    magic = b"\x89MCAP0\r\n"
    path = folder / "z.mcap"
    path.write_bytes(magic + record(1, text(b"") + text(b"")) + record(6, chunk) + magic)
    return path


def gzip_line(folder: Path) -> Path:
    """One line of 500 MB."""
    pack = zlib.compressobj(9, wbits=31)
    path = folder / "n.csv.gz"
    with open(path, "wb") as file:
        file.write(pack.compress(b"time_s,position_m\n"))
        for _ in range(500):
            file.write(pack.compress(b"0" * 1_000_000))
        file.write(pack.flush())
    return path


def wide_text(folder: Path) -> Path:
    path = folder / "w.csv.gz"
    path.write_bytes(gzip.compress((",".join(f"c{i}" for i in range(200_000)) + "\n" + "0,\n" * 20).encode()))
    return path


def constant_parquet(folder: Path) -> Path:
    """100 million rows of one value in a few kB."""
    path = folder / "p.parquet"
    pl.LazyFrame({"time_s": [0.0]}).select(pl.col("time_s").repeat_by(30_000_000).explode()).collect().write_parquet(
        path
    )
    return path


HOSTILE = [
    view_without_end,
    column_without_end,
    mat_struct,
    mat_cell,
    mat_hdf5,
    mcap_chunk,
    gzip_line,
    wide_text,
    constant_parquet,
]


@pytest.mark.slow
@pytest.mark.parametrize("make", HOSTILE)
def test_a_bomb_is_refused_within_bounds(tmp_path, make):
    """Each is refused in a sentence, with less than 1 GB of memory."""
    assert answer(make(tmp_path)).startswith("refused: "), make.__name__


def test_a_bag_names_no_code(tmp_path):
    """rosbags makes Python source of a type's name: a name that is none is refused, nothing runs."""
    pytest.importorskip("rosbags", reason="pip install hexsim[ros]")
    touched = tmp_path / "touched"
    name = f'p/msg/X(__import__("pathlib").Path("{touched}").touch() or object)'
    path = db3(
        tmp_path / "evil.db3",
        "create table message_definitions(topic_type, encoded_message_definition); create table messages(topic_id, timestamp, data);"
        f"update topics set type = '{name}'; insert into message_definitions values('{name}', 'float64 x');",
    )
    with pytest.raises(HexsimError, match="message definition is not read"):
        readers.read_log(path)
    assert not touched.exists()


@pytest.mark.parametrize(
    "definition",
    [
        "float64[1000000] x",
        f"p/Y[1000] x\n{'=' * 80}\nMSG: p/Y\nfloat64[1000] z",
        f"p/Y[9] x\n{'=' * 80}\nMSG: p/Y\nfloat64 z\np/Z[999999] u\n{'=' * 80}\nMSG: p/Z\nint8 w",
    ],
)
def test_a_definition_claims_no_more_than_its_bytes(tmp_path, definition):
    """Arrays of a fixed size beyond 100,000 items, also nested: the topic is not read, and why is said."""
    pytest.importorskip("rosbags", reason="pip install hexsim[ros]")
    writing = pytest.importorskip("mcap.writer", reason="pip install hexsim[ros]")
    with open(tmp_path / "claims.mcap", "wb") as file:
        writer = writing.Writer(file)
        writer.start("ros2")
        schema = writer.register_schema("p/msg/X", "ros2msg", definition.encode())
        channel = writer.register_channel("/x", "cdr", schema)
        for k in range(50):
            writer.add_message(channel, log_time=10**7 * k, publish_time=10**7 * k, data=bytes(12))
        writer.finish()
    with pytest.raises(HexsimError, match=r"topic /x is not read: p/msg/. has arrays of more than 100,000 items"):
        readers.read_log(tmp_path / "claims.mcap")


@pytest.mark.parametrize(
    "raised", [RuntimeError("a\nb"), KeyError("x"), TypeError(), RecursionError("deep"), SystemError("s")]
)
def test_what_a_library_raises_is_a_sentence(tmp_path, monkeypatch, raised):
    """In one place, for every format."""
    say_anything(tmp_path, monkeypatch, raised)


def test_a_panic_of_rust_is_a_sentence(tmp_path, monkeypatch):
    """It is no Exception. Ctrl-C stays one."""

    class PanicException(BaseException):
        """As pyo3 raises it."""

    say_anything(tmp_path, monkeypatch, PanicException("index out of bounds"))
    with pytest.raises(KeyboardInterrupt):
        say_anything(tmp_path, monkeypatch, KeyboardInterrupt())


def say_anything(folder: Path, monkeypatch, raised: BaseException) -> None:
    class Broken(reader.Reader):
        name, suffixes = "broken", (".broken",)

        def read(self, path, layout):
            raise raised

    monkeypatch.setitem(files.readers(), ".broken", Broken())
    (folder / "x.broken").write_text("")
    with pytest.raises(HexsimError, match=r"^cannot read .*x\.broken as broken: .+$"):
        readers.read_log(folder / "x.broken")


def whole_files(folder: Path) -> dict[str, Path]:
    """The same log in formats that are written here."""
    found = {
        "csv": folder / "a.csv",
        "parquet": folder / "a.parquet",
        "mat": folder / "a.mat",
        "csv.gz": folder / "b.csv.gz",
    }
    table = pl.DataFrame(COLUMNS)
    table.write_csv(found["csv"])
    table.write_parquet(found["parquet"])
    found["csv.gz"].write_bytes(gzip.compress(table.write_csv().encode()))
    scipy.io.savemat(found["mat"], COLUMNS, do_compression=True)
    try:
        from mcap.writer import Writer
    except ImportError:
        return found
    import json

    found["mcap"], found["db3"] = folder / "a.mcap", folder / "a.db3"
    with open(found["mcap"], "wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(name="a", encoding="jsonschema", data=b"{}")
        channel = writer.register_channel(topic="/m", message_encoding="json", schema_id=schema)
        for k, t in enumerate(T):
            message = json.dumps({name: x[k] for name, x in COLUMNS.items() if name != "time_s"}).encode()
            writer.add_message(channel, log_time=int(1e9 * t), publish_time=int(1e9 * t), data=message)
        writer.finish()
    bag = sqlite3.connect(found["db3"])
    bag.executescript("create table topics(id, name, type); create table messages(topic_id, timestamp, data)")
    for i, name in enumerate(("position", "valve", "pressure")):
        bag.execute("insert into topics values(?, ?, 'std_msgs/msg/Float64')", (i, f"/{name}"))
        rows = (
            (i, int(1e9 * t), b"\0\1\0\0" + np.float64(x).tobytes())
            for t, x in zip(T, list(COLUMNS.values())[i + 1], strict=True)
        )
        bag.executemany("insert into messages values(?, ?, ?)", rows)
    bag.commit()
    bag.close()
    return found


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return {ending: path.read_bytes() for ending, path in whole_files(tmp_path_factory.mktemp("whole")).items()}


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged")


@pytest.mark.parametrize("ending", ["csv", "csv.gz", "parquet", "mat", "mcap", "db3"])
@settings(max_examples=40, derandomize=True, database=None, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    changes=st.lists(st.tuples(st.floats(0.0, 1.0, exclude_max=True), st.integers(0, 255)), max_size=8),
    kept=st.none() | st.floats(0.0, 1.0),
)
def test_truncated_and_mutated_files(whole, work, ending, changes, kept):
    """A log of finite values, or one sentence. changes: bytes at shares of the file; kept: share of it that is left."""
    if ending not in whole:
        pytest.skip("needs hexsim[ros]")
    content = bytearray(whole[ending])
    for share, value in changes:
        content[int(share * len(content))] = value
    if kept is not None:
        del content[int(kept * len(content)) :]
    path = work / f"x.{ending}"
    path.write_bytes(content)
    try:
        log = readers.read_log(path)
    except HexsimError as error:
        assert "\n" not in str(error) and len(str(error)) < 3000
        return
    assert all(np.isfinite(x).all() for x in log.columns.values())


MAT_PLACES = {  # byte -> value: what scipy reads beyond its tables or behind an array
    "a kind of element that there is not": (184, 0xE8),
    "complex without an imaginary part": (145, 0x08),
    "a struct without its fields": (144, 0x02),
    "cells that are none": (144, 0x01),
}


@pytest.mark.parametrize("what", MAT_PLACES)
def test_a_damaged_mat_file_is_a_sentence_and_no_crash(tmp_path, what):
    """One byte of a MAT-file of version 5: refused before scipy reads it, which ends the process with a segmentation fault."""
    path = tmp_path / "run.mat"
    time = np.arange(600) * 1e-3
    scipy.io.savemat(path, {"time_s": time, "position_m": 0.1 + 0.01 * np.sin(9.0 * time)})
    assert len(readers.read_log(path).time) == 600
    damaged = bytearray(path.read_bytes())
    place, value = MAT_PLACES[what]
    damaged[place] = value
    path.write_bytes(damaged)
    with pytest.raises(HexsimError, match=r"cannot read .*run\.mat as MAT-file: it is damaged"):
        readers.read_log(path)


def test_stamps_that_fall_together_are_one(tmp_path):
    """A time of which one digit is damaged stands on another's place of the grid: a finding, no traceback."""
    path = tmp_path / "run.csv"
    time = np.arange(600) * 1e-3
    time[300] = time[301] - 1e-9
    table = np.stack([time, 0.1 + 0.01 * np.sin(9.0 * time)], axis=1)
    np.savetxt(path, table, delimiter=",", header="time_s,position_m", comments="", fmt="%.9f")
    log = readers.read_log(path)
    seen = np.isfinite(log.columns["position_m"])
    assert seen.sum() > 590
    assert np.abs(log.columns["position_m"] - 0.1 - 0.01 * np.sin(9.0 * log.time))[seen].max() < 1e-4


def test_signals_of_another_length_than_their_time_are_said(tmp_path):
    """A file that was cut in its second channel: one sentence with both lengths."""
    path = tmp_path / "run.npz"
    np.savez(path, time_s=T, position_m=COLUMNS["position_m"][:354])
    with pytest.raises(
        HexsimError, match="no signal that is as long as its time: column position_m has 354 values, its time 600"
    ):
        readers.read_log(path)
