"""Logs as people have them: made here as their tools write them, read to the right values, or refused with the cause."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import scipy.io

from hexsim import HexsimError, readers
from hexsim.machine import load_machine
from hexsim.readers import files

DATA = Path(__file__).resolve().parents[1] / "data"
T = np.arange(1500) / 500.0
TRUE = {
    "Ref": 40.0 * np.sin(4.4 * T),
    "Pos": 100.0 + 38.0 * np.sin(4.4 * T - 0.2),
    "U": 0.9 * np.cos(4.4 * T),
    "p1": 34.0 + 3.0 * np.sin(4.4 * T + 0.5),
}
COLUMNS = {
    "Ref": ("setpoint_m", "mm"),
    "Pos": ("position_m", "mm"),
    "U": ("valve_V", "V"),
    "p1": ("pressure_bottom_Pa", "bar"),
}
SI = {"mm": 1e-3, "V": 1.0, "bar": 1e5}


def mapping(time: str | None = "Time", units: bool = True, names=lambda name: name, more: str = "") -> str:
    """A mapping file for the four signals."""
    text = 'kind = "bench"\n' + ("" if time is None else f'[columns.time_s]\nfrom = "{time}"\n{more}')
    for name, (column, unit) in COLUMNS.items():
        text += f'[columns.{column}]\nfrom = "{names(name)}"\n' + (f'unit = "{unit}"\n' if units else "")
    return text


def rows(stamps=None, separator: str = ",", decimal: str = ".", note=None) -> list[str]:
    """Rows of data as text."""
    stamps = [f"{t:.6f}" for t in T] if stamps is None else stamps
    found = []
    for k in range(len(T)):
        cells = [str(stamps[k]), *(f"{x[k]:.6f}" for x in TRUE.values())]
        cells = [cell.replace(".", decimal) if i else cell for i, cell in enumerate(cells)]
        if note is not None:
            cells.append(note[k])
        out = io.StringIO()
        csv.writer(out, delimiter=separator, lineterminator="").writerow(cells)
        found.append(out.getvalue())
    return found


def hold(log, n: int = len(T)) -> None:
    """All signals, at 500 Hz."""
    assert (log.n, log.rate) == (n, 500.0)
    for name, (column, unit) in COLUMNS.items():
        assert log.columns[column] == pytest.approx(SI[unit] * TRUE[name], rel=1e-5, abs=1e-6), name


WALL = [str(x) for x in (np.datetime64("2024-03-01T23:59:58.5", "ms") + np.round(1e3 * T).astype("timedelta64[ms]"))]
QUOTED = ['start, "slow"' if k % 7 == 0 else "two\nlines" if k % 7 == 1 else "" for k in range(len(T))]
HEAD = "Time,Ref,Pos,U,p1"
TEXTS = {
    "preamble and a row of units": (
        "Operator\tA. Nobody\nRig\tcylinder 3\n\n"
        + HEAD.replace(",", "\t")
        + "\ns\tmm\tmm\tV\tbar\n"
        + "\n".join(rows(separator="\t")),
        mapping(units=False),
    ),
    "sep=; and decimal commas": (
        "sep=;\n"
        + HEAD.replace(",", ";")
        + "\n"
        + "\n".join(rows([f"{t:.3f}".replace(".", ",") for t in T], ";", ",")),
        mapping(),
    ),
    "quotes with commas, quotes and line ends": (HEAD + ",Note\n" + "\n".join(rows(note=QUOTED)), mapping()),
    "units in brackets of the header": (
        "Time [s],Ref [mm],Pos (mm),U [V],p1 [bar]\n" + "\n".join(rows()),
        mapping(
            "Time [s]", units=False, names={"Ref": "Ref [mm]", "Pos": "Pos (mm)", "U": "U [V]", "p1": "p1 [bar]"}.get
        ),
    ),
    "dates over midnight": (HEAD + "\n" + "\n".join(rows([x.replace("T", " ") for x in WALL])), mapping()),
    "ISO 8601 with a zone": (HEAD + "\n" + "\n".join(rows([x + "Z" for x in WALL])), mapping()),
    "German dates": (
        HEAD.replace(",", ";")
        + "\n"
        + "\n".join(rows([f"{x[8:10]}.{x[5:7]}.{x[:4]} {x[11:]}".replace(".", ".") for x in WALL], ";", ",")),
        mapping(),
    ),
    "local time in the night of the change to summer time": (
        HEAD
        + "\n"
        + "\n".join(
            rows([f"2026-03-29T{'01:59' if t < 1 else '03:00'}:{(59 + t) % 60:09.6f}+0{1 + (t >= 1)}:00" for t in T])
        ),
        mapping(),
    ),
    "months by name": (
        HEAD + "\n" + "\n".join(rows([f"29-Mar-2026 10:00:{t:09.6f}" for t in T])),
        mapping(),
    ),
    "ISO 8601 without marks": (HEAD + "\n" + "\n".join(rows([f"20260329T1000{t:09.6f}" for t in T])), mapping()),
    "time of day over midnight": (HEAD + "\n" + "\n".join(rows([x[11:] for x in WALL])), mapping()),
    "counter of 32 bits in us": (
        HEAD + "\n" + "\n".join(rows([int(x) for x in (np.round(1e6 * T) + 4294000000) % 2**32])),
        mapping(more='unit = "us"\n'),
    ),
    "signed counter of 32 bits in us": (
        HEAD + "\n" + "\n".join(rows([int(x) for x in (np.round(1e6 * T) + 4294000000 - 2**31) % 2**32 - 2**31])),
        mapping(more='unit = "us"\n'),
    ),
    "counter of 16 bits in ms": (
        HEAD + "\n" + "\n".join(rows([int(x) for x in (np.round(1e3 * T) + 65000) % 2**16])),
        mapping(more='unit = "ms"\n'),
    ),
    "newest row first": (HEAD + "\n" + "\n".join(rows()[::-1]), mapping()),
    "a row twice and two rows swapped": (
        HEAD + "\n" + "\n".join([*rows()[:300], rows()[299], rows()[301], rows()[300], *rows()[302:]]),
        mapping(),
    ),
}


@pytest.mark.parametrize("kind", TEXTS)
def test_texts(tmp_path, kind):
    """Each is the same log."""
    text, names = TEXTS[kind]
    (tmp_path / "log.csv").write_text(text)
    (tmp_path / "mapping.toml").write_text(names)
    hold(readers.read_log(tmp_path / "log.csv"))


@pytest.mark.parametrize(
    ("separator", "cell"),
    [
        (";", lambda x: f"{x:,.3f}".translate(str.maketrans(",.", ".,"))),
        (",", lambda x: f'"{x:,.3f}"'),
        (";", lambda x: f"{x:,.3f}"),
        ("\t", lambda x: f"{x:,.3f}".replace(",", "'")),
        (" ", lambda x: f"{x:.9E}".replace("E", "D")),
    ],
    ids=["German", "English in quotes", "English", "Swiss", "Fortran"],
)
def test_numbers_as_offices_write_them(tmp_path, separator, cell):
    """Thousands in groups and Fortran's exponents: what is taken for a number is read as one."""
    columns = {"time_us": 1e6 * T, "position_m": np.round(TRUE["Pos"], 3), "pressure_bottom_Pa": 1e5 * TRUE["p1"]}
    lines = [separator.join(columns), *(separator.join(map(cell, row)) for row in zip(*columns.values(), strict=True))]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = readers.read_log(tmp_path / "log.csv")
    assert (log.n, log.rate) == (len(T), 500.0)
    for name in ("position_m", "pressure_bottom_Pa"):
        assert log.columns[name] == pytest.approx(columns[name], rel=1e-8)


def test_a_pause_longer_than_the_data_splits_the_run(tmp_path):
    """A logger that stood still for 30 s of 33: two stretches, and the gap is said."""
    lines = rows([f"{t + 30.0 * (t >= 1):.6f}" for t in T])
    (tmp_path / "log.csv").write_text("\n".join([HEAD, *lines]))
    (tmp_path / "mapping.toml").write_text(mapping())
    parts = readers.read_stretches(tmp_path / "log.csv")
    assert [part.n for part in parts] == [1000, 500] and "1 gaps" in "; ".join(parts[0].losses)


def test_a_column_of_time_for_each_channel(tmp_path):
    """The pressure is sampled 0.7 ms later, by its own column: it comes back on the clock of the others."""
    late = 34.0 + 3.0 * np.sin(4.4 * (T + 0.0007) + 0.5)
    table = pl.DataFrame({"Time": T, **{k: v for k, v in TRUE.items() if k != "p1"}, "t2": T + 0.0007, "p1": late})
    table.write_csv(tmp_path / "log.csv")
    (tmp_path / "mapping.toml").write_text(mapping() + 'time = "t2"\n')
    log = readers.read_log(tmp_path / "log.csv")
    assert log.columns["pressure_bottom_Pa"] == pytest.approx(1e5 * TRUE["p1"][1 : log.n + 1], abs=0.5)


def test_a_sparse_table_holds_two_clocks(tmp_path):
    """Two topics in one table with empty cells, the second 0.3 ms after the first: each on its own stamps."""
    late = 34.0 + 3.0 * np.sin(4.4 * (T + 0.0003) + 0.5)
    first = pl.DataFrame({"Time": T, **{k: v for k, v in TRUE.items() if k != "p1"}})
    second = pl.DataFrame({"Time": T + 0.0003, "p1": late})
    pl.concat([first, second], how="diagonal").sort("Time").write_csv(tmp_path / "log.csv")
    (tmp_path / "mapping.toml").write_text(mapping())
    log = readers.read_log(tmp_path / "log.csv")
    assert log.rate == 500.0 and log.columns["pressure_bottom_Pa"] == pytest.approx(
        1e5 * TRUE["p1"][1 : log.n + 1], abs=0.5
    )


@pytest.mark.parametrize("rows", [5.0, 2.5, 1.6, 3.7])
@pytest.mark.parametrize("name", ["pressure_bottom_Pa", "position_m"])
def test_a_value_that_a_logger_repeats_is_no_sample(tmp_path, name, rows):
    """A channel that is sampled every 1.6 to 5 rows and repeated in all others: between its samples a curve, no stairs."""
    true = {
        "position_m": lambda t: 0.1 + 0.038 * np.sin(4.4 * t),
        "pressure_bottom_Pa": lambda t: 3e6 + 3e5 * np.sin(4.4 * t),
    }
    table = {"time_s": T, **{column: own(T) for column, own in true.items()}}
    taken = rows * np.floor(np.arange(len(T)) / rows + 1e-9) / 500.0
    pl.DataFrame(table | {name: true[name](taken)}).write_csv(tmp_path / "log.csv")
    log = readers.read_log(tmp_path / "log.csv")
    size = np.ptp(true[name](T))
    assert log.columns[name][10:-10] == pytest.approx(true[name](log.time)[10:-10], abs=1e-4 * size)
    assert log.rate_of(name) == pytest.approx(500.0 / rows, rel=0.01)
    assert rows not in (5.0, 2.5) or np.all(
        log.sampled[name] % 1.0 == 0.0
    )  # of 2.5 rows the grid has a point in the middle
    assert any(name in loss and f"every {rows:g}. row" in loss for loss in log.losses)


def test_a_repeated_value_is_a_sample_where_a_transducer_is_coarse(tmp_path):
    """A position in steps of 1 mm stands still in most rows, at no even rate: each row is a sample."""
    coarse = 1e-3 * np.round(100.0 + 38.0 * np.sin(4.4 * T) + 0.4 * np.random.default_rng(1).standard_normal(len(T)))
    pl.DataFrame({"time_s": T, "position_m": coarse}).write_csv(tmp_path / "log.csv")
    log = readers.read_log(tmp_path / "log.csv")
    assert not log.sampled and log.columns["position_m"] == pytest.approx(coarse[: log.n])


def test_two_rates_in_one_file(tmp_path):
    """500 Hz, then 250 Hz: no sample is lost, the slower half weighs less."""
    keep = (np.arange(len(T)) < 750) | (np.arange(len(T)) % 2 == 0)
    pl.DataFrame({"Time": T, **TRUE}).filter(pl.Series(keep)).write_csv(tmp_path / "log.csv")
    (tmp_path / "mapping.toml").write_text(mapping())
    log = readers.read_log(tmp_path / "log.csv")
    assert log.rate == 500.0 and log.duration_s > 2.99
    assert np.median(log.weight("position_m")[:700]) == 1.0 and np.median(log.weight("position_m")[-600:]) == 0.5
    assert log.columns["position_m"] == pytest.approx(1e-3 * TRUE["Pos"][: log.n], abs=1e-6)


@pytest.mark.parametrize("length", [1, 3, 8])
@pytest.mark.parametrize("column, marker", [("Pos", -9999.0), ("Pos", 1e6), ("p1", -999.9), ("U", 999.0)])
def test_a_marker_is_missing_however_long(tmp_path, length, column, marker):
    """What the machine cannot have weighs nothing, and the lines say where it stood."""
    values = {name: x.copy() for name, x in TRUE.items()}
    values[column][700 : 700 + length] = marker
    pl.DataFrame({"Time": T, **values}).write_csv(tmp_path / "log.csv")
    (tmp_path / "mapping.toml").write_text(mapping())
    name = COLUMNS[column][0]
    log = readers.read_log(tmp_path / "log.csv", machine=load_machine("bench"))
    assert np.flatnonzero(log.weight(name) == 0).tolist() == list(range(700, 700 + length))
    assert any(loss.startswith(f"column {name}: {length} ") and "row 702" in loss for loss in log.losses), log.losses


def test_markers_of_the_mapping_are_missing(tmp_path):
    """0 is a marker where the mapping says so."""
    values = {**TRUE, "p1": np.where(np.arange(len(T)) // 4 == 100, 0.0, TRUE["p1"])}
    pl.DataFrame({"Time": T, **values}).write_csv(tmp_path / "log.csv")
    (tmp_path / "mapping.toml").write_text(mapping() + "missing = [0.0]\n")
    assert np.flatnonzero(readers.read_log(tmp_path / "log.csv").weight("pressure_bottom_Pa") == 0).tolist() == [
        400,
        401,
        402,
        403,
    ]


def test_structs_by_path_each_with_its_own_time(tmp_path):
    """{Time, Data} by struct: a signal that starts 40 ms later stands there; a name that is not unique is refused."""
    k = 20
    part = {s: slice(k, None) if s == "p1" else slice(None, -k) for s in TRUE}
    scipy.io.savemat(tmp_path / "log.mat", {s: {"Time": T[part[s]], "Data": x[part[s]]} for s, x in TRUE.items()})
    (tmp_path / "mapping.toml").write_text(mapping(None, names=lambda name: f"{name}.Data"))
    log = readers.read_log(tmp_path / "log.mat")
    assert log.time[0] == pytest.approx(0.04) and log.n == len(T) - 2 * k
    assert log.columns["pressure_bottom_Pa"] == pytest.approx(1e5 * TRUE["p1"][k:-k])
    assert log.columns["position_m"] == pytest.approx(1e-3 * TRUE["Pos"][k:-k])
    (tmp_path / "mapping.toml").write_text(mapping(None, names=lambda _: "Data"))
    with pytest.raises(
        HexsimError, match=r"'Data' for setpoint_m may be Ref.Data, Pos.Data, U.Data, p1.Data: give the whole name"
    ):
        readers.read_log(tmp_path / "log.mat")


def test_names_of_dspace(tmp_path):
    """rec.X is the clock, rec.Y(i).Name the name of a signal."""
    Y = np.zeros((1, 4), dtype=[("Name", object), ("Data", object)])
    for i, (name, values) in enumerate(TRUE.items()):
        Y[0, i] = (name, values[None])
    X = np.zeros((1, 1), dtype=[("Name", object), ("Data", object)])
    X[0, 0] = ("Time", T[None])
    scipy.io.savemat(tmp_path / "log.mat", {"rec": {"X": X, "Y": Y}})
    (tmp_path / "mapping.toml").write_text(mapping(None))
    hold(readers.read_log(tmp_path / "log.mat"))


def test_stamps_of_parquet(tmp_path):
    """Datetime is a time stamp, a column of text is named where it is missed."""
    stamps = pl.Series(np.round(T * 1e6).astype(np.int64) + 1_700_000_000_000_000).cast(pl.Datetime("us"))
    pl.DataFrame({"Time": stamps, **TRUE, "Note": ["x"] * len(T)}).write_parquet(tmp_path / "log.parquet")
    (tmp_path / "mapping.toml").write_text(mapping())
    hold(readers.read_log(tmp_path / "log.parquet"))
    (tmp_path / "mapping.toml").write_text(mapping().replace('"p1"', '"Note"'))
    with pytest.raises(
        HexsimError, match=r"no column 'Note' for pressure_bottom_Pa: .*Not read: column Note holds String"
    ):
        readers.read_log(tmp_path / "log.parquet")


def test_a_column_of_text_is_refused_with_its_first_cell(tmp_path):
    """Row and column of the odd cell."""
    (tmp_path / "log.csv").write_text(HEAD + ",Note\n" + "\n".join(rows(note=["", "late", *["on"] * (len(T) - 2)])))
    (tmp_path / "mapping.toml").write_text(mapping().replace('"p1"', '"Note"'))
    with pytest.raises(HexsimError, match="Not read: column Note holds text, the first is 'late' in row 3"):
        readers.read_log(tmp_path / "log.csv")


def test_a_cylinder_at_its_end_is_not_saturated(tmp_path):
    """It runs into its end at speed and stays there; the same limit within the stroke is a saturated transducer."""
    machine = load_machine("bench")
    stroke, t = machine.cylinder.stroke_m, np.arange(3000) / 1000.0
    noise = np.random.default_rng(1).normal(0, 3e-6, len(t))
    for limit, whole in ((stroke, True), (0.7 * stroke, False)):
        x = np.minimum(0.3 * stroke + 0.6 * stroke * np.sin(3.0 * t) ** 2 + noise, limit)
        x = np.minimum(x + 0.2 * stroke * np.sin(3.0 * t) ** 2, limit)
        pl.DataFrame({"time_s": t, "position_m": x, "valve_V": np.cos(3 * t)}).write_csv(tmp_path / "log.csv")
        if whole:
            assert readers.read_log(tmp_path / "log.csv", machine=machine).n == len(t)
        else:
            with pytest.raises(HexsimError, match="position_m cannot be used, it is saturated"):
                readers.read_log(tmp_path / "log.csv", machine=machine)


GOALS = {
    "sin_sin": lambda t: np.pi / 2 * np.sin(t) + np.sin(5 * t) / 2 * np.sin(2 * t),
    "sin_time_square": lambda t: np.sin(t**2),
}


@pytest.mark.parametrize("run", sorted(path.name for path in (DATA / "bam_xl330").glob("*.csv.gz")))
def test_stamps_of_a_software_logger_are_kept(run):
    """Measured: the goal is a known function of the clock but for 3.6 ms; times are right to 0.3 ms rms (they were 3 to 8 ms
    off when rows were counted). A run that changes its rate from 187 to 290 Hz keeps its length and the stamps of its samples."""
    log, raw = readers.read_log(DATA / "bam_xl330" / run), pl.read_csv(DATA / "bam_xl330" / run)
    stamps = raw["timestamp"].to_numpy()
    assert log.duration_s == pytest.approx(np.ptp(stamps), abs=0.02)
    goal = next((value for name, value in GOALS.items() if run.startswith(name)), None)
    if goal is None:
        back = np.interp(stamps, log.time, log.columns["position_rad"])
        moving = np.abs(np.gradient(raw["position"].to_numpy(), stamps)) > 0.5
        error = (back - raw["position"].to_numpy())[moving] / np.gradient(raw["position"].to_numpy(), stamps)[moving]
        assert np.sqrt(np.mean(error[2:-2] ** 2)) < 1e-3  # an encoder's step of 1.5 mrad is 0.3 ms and more
        return
    t = log.time - 0.0036
    slope = (goal(t + 1e-4) - goal(t - 1e-4)) / 2e-4
    moving = np.abs(slope) > 0.5
    error = (log.columns["goal_rad"] - goal(t))[moving] / slope[moving]
    assert np.sqrt(np.mean(error**2)) < 3e-4


def test_topics_that_are_not_read_are_named(tmp_path):
    """A schema in IDL: the refusal names topic and schema."""
    mcap = pytest.importorskip("mcap.writer", reason="pip install hexsim[ros]")
    with open(tmp_path / "log.mcap", "wb") as file:
        writer = mcap.Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema(name="a/msg/B", encoding="ros2idl", data=b"module a {};")
        channel = writer.register_channel(topic="/p", message_encoding="cdr", schema_id=schema)
        writer.add_message(channel, log_time=1, publish_time=1, data=b"\0\1\0\0" + bytes(8))
        writer.finish()
    with pytest.raises(
        HexsimError, match=r"no signal of numbers\. Not read: topic /p is CDR with a ros2idl schema of a/msg/B"
    ):
        files.raw_log(tmp_path / "log.mcap")


def test_notes_beside_logs_are_no_logs(tmp_path):
    """A text of sentences, a list of parts, an empty file, requirements; two logs, one of them packed."""
    notes = {
        "notes.txt": "Run 3 at 35 bar.\nThe hose was changed, twice.\n",
        "parts.txt": "valve\ncylinder\n",
        "empty.txt": "",
        "log.log": "2024-03-01 12:00:00 started\n2024-03-01 12:00:01 host is gone\n",
    }
    for name, text in notes.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "a.txt").write_text(HEAD + "\n" + "\n".join(rows()))
    pl.DataFrame({"Time": T, **TRUE}).write_parquet(tmp_path / "b.parquet")
    assert [path.name for path in files.logs_of_folder(tmp_path)] == ["a.txt", "b.parquet"]
