"""Readers: the same run comes back from every format, and damage is either stated or refused, never swallowed."""

import gc
import gzip
import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from hexsim import HexsimError, readers
from hexsim.machine import load_machine
from hexsim.own import folder as own_folder
from hexsim.tracing.checks import checks

DATA = Path(__file__).resolve().parents[1] / "data"
CLEAN = DATA / "bench_none" / "fit.csv.gz"


@pytest.fixture(scope="module")
def table() -> pl.DataFrame:
    """Two seconds of a bench log."""
    return pl.read_csv(CLEAN).slice(4000, 2000)


def written(table: pl.DataFrame, folder: Path, name: str = "log.csv") -> Path:
    path = folder / name
    table.write_csv(path)
    return path


def test_measured_bench_is_read_as_it_stands():
    """A clean log gives its numbers to the bit, 1000 Hz, and no loss."""
    log = readers.read_log(CLEAN)
    raw = pl.read_csv(CLEAN)
    assert (log.kind, log.n_legs, log.rate, log.losses) == ("bench", 1, 1000.0, ())
    for name, values in log.columns.items():
        np.testing.assert_array_equal(values, raw[name].to_numpy())
    np.testing.assert_allclose(log.time, raw["time_s"].to_numpy(), atol=1e-9)


@pytest.mark.parametrize("ending", ["csv", "csv.gz", "parquet", "mat", "mf4"])
def test_every_format_gives_the_same_run(table, tmp_path, ending):
    """The same table through each format comes back equal (MDF and MAT store float64 too)."""
    path = tmp_path / f"run.{ending}"
    if ending == "parquet":
        table.write_parquet(path)
    elif ending == "csv.gz":
        path.write_bytes(gzip.compress(table.write_csv().encode()))
    elif ending == "csv":
        table.write_csv(path)
    elif ending == "mat":
        scipy_io = pytest.importorskip("scipy.io")
        scipy_io.savemat(path, {name: table[name].to_numpy() for name in table.columns})
    else:
        write_mdf(table, path)
    log = readers.read_log(path)
    assert log.name == "run"
    assert log.losses == ()
    assert set(log.columns) == set(table.columns) - {"time_s"}
    for name, values in log.columns.items():
        np.testing.assert_array_equal(values, table[name].to_numpy(), err_msg=name)


def write_mdf(table: pl.DataFrame, path: Path, units: bool = False) -> None:
    asammdf = pytest.importorskip("asammdf", reason="MDF needs the extra hexsim[mdf]")
    stamps = table["time_s"].to_numpy()
    signals = [
        asammdf.Signal(
            samples=table[name].to_numpy(),
            timestamps=stamps,
            name=name,
            unit="bar" if units and "pressure" in name else "",
        )
        for name in table.columns
        if name != "time_s"
    ]
    with asammdf.MDF(version="4.10") as file:
        file.append(signals)
        file.save(path, overwrite=True)


def test_mdf_states_its_own_units(table, tmp_path):
    """Pressures stored in bar with their unit come back in Pa."""
    bars = table.with_columns(pl.col("pressure_bottom_Pa", "pressure_supply_Pa") / 1e5)
    bars = bars.rename({"pressure_bottom_Pa": "pressure_bottom", "pressure_supply_Pa": "pressure_supply"})
    write_mdf(bars, tmp_path / "bars.mf4", units=True)
    log = readers.read_log(tmp_path / "bars.mf4")
    np.testing.assert_allclose(log.columns["pressure_bottom_Pa"], table["pressure_bottom_Pa"].to_numpy(), rtol=1e-12)


def test_mapping_file_names_units_and_delays(table, tmp_path):
    """inch beside a gauge's zero, bar, g and a late channel become the measured-log columns; a German table (; and decimal comma) is
    read."""
    late = 12  # samples
    foreign = pl.DataFrame(
        {
            "t [ms]": table["time_s"] * 1e3,
            "Weg": (table["position_m"] - 0.01) / 0.0254,
            "Ventil": table["valve_V"],
            "Druck": table["pressure_bottom_Pa"] / 1e5,
            "a": np.roll(table["acceleration_m_s2"].to_numpy(), late) / 9.80665,
        }
    )
    text = foreign.write_csv(separator=";").replace(".", ",")
    (tmp_path / "log.txt").write_text(text)
    (tmp_path / "map.toml").write_text(
        'kind = "bench"\n[columns.time_s]\nfrom = "t [ms]"\nunit = "ms"\n'
        '[columns.position_m]\nfrom = "Weg"\nunit = "inch"\noffset = 0.01\n'
        '[columns.valve_V]\nfrom = "Ventil"\n[columns.pressure_bottom_Pa]\nfrom = "Druck"\nunit = "bar"\n'
        '[columns.acceleration_m_s2]\nfrom = "a"\nunit = "g"\ndelay_s = 0.012\n'
    )
    log = readers.read_log(tmp_path / "log.txt", tmp_path / "map.toml")
    n = len(log.time)
    assert n == len(table) - late
    for name in ("position_m", "valve_V", "pressure_bottom_Pa", "acceleration_m_s2"):
        np.testing.assert_allclose(log.columns[name], table[name].to_numpy()[:n], rtol=1e-9, atol=1e-12, err_msg=name)
    assert any("acceleration_m_s2: was late by 12 ms" in loss for loss in log.losses)
    assert any("setpoint_m is missing" in loss for loss in log.losses)


def test_unit_in_a_column_name_is_converted_and_said(table, tmp_path):
    """position_mm and pressure_bottom_bar need no mapping file."""
    path = written(table.with_columns(position_mm=pl.col("position_m") * 1e3).drop("position_m"), tmp_path)
    log = readers.read_log(path)
    np.testing.assert_allclose(log.columns["position_m"], table["position_m"].to_numpy(), rtol=1e-12)
    assert any("position_mm was read as position_m (times 0.001)" in loss for loss in log.losses)


@pytest.mark.parametrize(
    "mapping, sentence",
    [
        ('[columns.position_m]\nunit = "parsec"\n', "unit 'parsec' is not known"),
        ('[columns.position_m]\nunit = "bar"\n', "cannot become 'm'"),
        ('[columns.position_m]\nfrom = "nowhere"\n', "has no column 'nowhere' for position_m"),
        ('[columns.position_m]\nunit = "mm"\nfactor = 2.0\n', "give unit or factor, not both"),
        ("[columns.position_m]\ngain = 2.0\n", "allowed are from, unit"),
        ("[columns\n", "is not valid TOML"),
    ],
)
def test_a_wrong_mapping_is_refused_with_a_sentence(table, tmp_path, mapping, sentence):
    (tmp_path / "map.toml").write_text(mapping)
    with pytest.raises(HexsimError, match=re.escape(sentence)):
        readers.read_log(written(table, tmp_path), tmp_path / "map.toml")


def test_gap_splits_and_the_longest_stretch_is_used(table, tmp_path):
    """0.3 s missing after 0.5 s: the loss names it; read_stretches gives both parts, the longer first."""
    path = written(pl.concat([table[:600], table[900:]]), tmp_path)
    parts = readers.read_stretches(path)
    assert [len(part.time) for part in parts] == [1100, 600]
    assert any("1 gaps in time_s, 300 samples in all, the first after row 601" in loss for loss in parts[0].losses)
    np.testing.assert_array_equal(parts[0].columns["position_m"], table["position_m"].to_numpy()[900:])


def test_short_gap_and_missing_cells_are_filled_and_counted(table, tmp_path):
    """Three lost rows and a run of four empty cells become straight lines, both stated."""
    holes = table.with_columns(
        pl.when(pl.int_range(pl.len()).is_between(100, 103)).then(None).otherwise(pl.col("valve_V")).alias("valve_V")
    )
    log = readers.read_log(written(pl.concat([holes[:700], holes[703:]]), tmp_path))
    assert len(log.time) == len(table)
    assert any("valve_V: 4 missing values, the first in row 102" in loss for loss in log.losses)
    assert any("position_m: 3 samples filled" in loss for loss in log.losses)
    rest = log.columns["position_m"] - table["position_m"].to_numpy()
    assert np.flatnonzero(rest).min() >= 700 and np.flatnonzero(rest).max() <= 702


def test_repeated_backward_and_wild_stamps_are_dropped_and_named(table, tmp_path):
    t = table["time_s"].to_numpy().copy()
    t[50] = t[49]  # repeated
    t[400] = t[398] - 2e-4  # backward
    t[900] = 1e6  # wild
    log = readers.read_log(written(table.with_columns(time_s=pl.Series(t)), tmp_path))
    for sentence in (
        "1 rows repeat a time stamp, the first in row 52",
        "1 rows with time stamps that fit neither neighbour, the first in row 902",
    ):
        assert any(sentence in loss for loss in log.losses), log.losses
    assert any("1 rows are out of order, the first in row 402: sorted" in loss for loss in log.losses)
    assert len(log.time) == len(table)


def test_two_runs_in_one_file_are_refused(table, tmp_path):
    with pytest.raises(HexsimError, match=r"goes back from .* in row 2002: two runs in one file"):
        readers.read_log(written(pl.concat([table, table]), tmp_path))


def test_coarse_stamps_are_spread(table, tmp_path):
    """1 kHz data stamped with two decimals: ten rows share a stamp; the rate comes back."""
    log = readers.read_log(written(table.with_columns(time_s=(pl.col("time_s") - 0.0049).round(2)), tmp_path))
    assert log.rate == pytest.approx(1000.0, rel=2e-3)
    assert any("below their resolution of 10 ms): rows counted instead" in loss for loss in log.losses)


def test_saturated_and_frozen_channels(table, tmp_path):
    """A clipped accelerometer is left out, a frozen pressure ends the stretch, a clipped position is refused."""
    clipped = table.with_columns(pl.col("acceleration_m_s2").clip(upper_bound=0.1))
    log = readers.read_log(written(clipped, tmp_path))
    assert "acceleration_m_s2" not in log.columns
    assert any("acceleration_m_s2: left out: it is saturated at 0.1" in loss for loss in log.losses)
    P = table["pressure_bottom_Pa"].to_numpy().copy()
    P[1200:1700] = P[1200]
    log = readers.read_log(written(table.with_columns(pressure_bottom_Pa=pl.Series(P)), tmp_path))
    assert any("pressure_bottom_Pa: 499 rows of a frozen value, the first in row 1203" in loss for loss in log.losses)
    assert len(log.time) == 1201
    top = float(table["position_m"].quantile(0.7))
    with pytest.raises(HexsimError, match=r"position_m cannot be used, it is saturated at"):
        readers.read_log(written(table.with_columns(pl.col("position_m").clip(upper_bound=top)), tmp_path))


def test_a_spike_of_one_sample_is_taken_out_and_said(table, tmp_path):
    P = table["pressure_bottom_Pa"].to_numpy().copy()
    P[777] = 9e6
    log = readers.read_log(written(table.with_columns(pressure_bottom_Pa=pl.Series(P)), tmp_path))
    assert any("pressure_bottom_Pa: 1 spikes of a single sample, the first in row 779" in loss for loss in log.losses)
    assert abs(log.columns["pressure_bottom_Pa"][777] - P[776]) < 1e5


@pytest.mark.parametrize(
    "change, sentence",
    [
        (lambda t: t.drop("time_s"), "has no column time_s"),
        (lambda t: t.drop("position_m"), "has no column position_m"),
        (lambda t: t.head(0), "has a header and no row of data"),
        (lambda t: t.head(200), "no stretch of 0.5 s"),
        (lambda t: t.with_columns(pl.lit(1.0).alias("time_s")), "time_s stands still"),
        (lambda t: t.with_columns(pl.lit(0.1).alias("position_m")), "position_m cannot be used, it never changes"),
        (lambda t: t.with_columns(pl.col("time_s") * 1e3), "is the column in seconds?"),
        (lambda t: t.with_columns(setpoint_1_m=pl.col("setpoint_m")), "of one leg and of six"),
        (lambda t: t.with_columns(pl.lit(None).alias("position_m")), "values are missing; nothing can be traced"),
    ],
)
def test_what_cannot_be_used_is_refused_with_a_sentence(table, tmp_path, change, sentence):
    with pytest.raises(HexsimError, match=re.escape(sentence)):
        readers.read_log(written(change(table), tmp_path))


def test_a_truncated_gzip_gives_its_whole_rows_and_says_so(table, tmp_path):
    whole = gzip.compress(table.write_csv().encode())
    (tmp_path / "cut.csv.gz").write_bytes(whole[: int(len(whole) * 0.7)])
    log = readers.read_log(tmp_path / "cut.csv.gz")
    assert 1000 < len(log.time) < 1900
    assert any("truncated gzip file" in loss for loss in log.losses)
    np.testing.assert_array_equal(log.columns["position_m"], table["position_m"].to_numpy()[: len(log.time)])


def test_fifty_hertz_and_three_seconds_are_read(tmp_path):
    """Slow and short logs are logs; what they cannot tell is the business of the checks."""
    raw = pl.read_csv(CLEAN)
    slow = readers.read_log(written(raw.gather_every(20), tmp_path, "slow.csv"))
    assert slow.rate == 50.0
    short = readers.read_log(written(raw[:3000], tmp_path, "short.csv"))
    assert short.duration_s == pytest.approx(2.999)


def test_own_machine_with_whitespace_and_comment_header(tmp_path):
    """A foreign machine's text file: columns named in the mapping file, kind own, no position needed."""
    rows = "\n".join(f"  {i * 0.02:.2f}   {np.sin(i / 9):.6f} {i % 7}" for i in range(200))
    (tmp_path / "x.exp").write_text("# time rpm junk\n" + rows + "\n")
    (tmp_path / "map.toml").write_text(
        'kind = "own"\n[file]\nseparator = "whitespace"\ncomment = "#"\ncolumns = ["t", "n", "junk"]\n'
        '[columns.time_s]\nfrom = "t"\n[columns.motor_speed_rad_s]\nfrom = "n"\nunit = "rpm"\n'
    )
    log = readers.read_log(tmp_path / "x.exp", tmp_path / "map.toml")
    assert (log.kind, log.rate, list(log.columns)) == ("own", 50.0, ["motor_speed_rad_s"])
    np.testing.assert_allclose(log.columns["motor_speed_rad_s"], np.sin(np.arange(200) / 9) * np.pi / 30, atol=1e-7)
    assert any("not used" in loss and "junk" in loss for loss in log.losses)


def test_letters_behind_numbers_and_means_of_a_slow_test(tmp_path):
    """25.1m is 0.0251 and 3k is 3000, as an instrument writes them; with average_s a sample is a mean, and faster noise is gone."""
    rng, t = np.random.default_rng(0), np.arange(4000) * 0.01
    current, flow = np.sin(0.3 * t) + 0.2 * rng.standard_normal(len(t)), 2000.0 * np.sin(0.3 * t)
    rows = [f"{1e3 * a:.3f}m\t{b / 1e3:.6f}k" for a, b in zip(current, flow, strict=True)]
    (tmp_path / "one.txt").write_text("\n".join(["i\tq", *rows]) + "\n")
    (tmp_path / "mapping.toml").write_text(
        'kind = "own"\n[file]\nseparator = "tab"\nsi_letters = true\nrate_Hz = 100.0\n[columns.i]\n[columns.q]\n'
    )
    (tmp_path / "model.toml").write_text(
        '[parameters]\ngain = { start = 1.0 }\n[outputs.q]\nformula = "gain * i"\n[simulation]\naverage_s = 0.5\n'
    )
    own = own_folder.load_simulated(tmp_path)
    assert own.fit[0].n == 80 and own.fit[0].rate == pytest.approx(2.0)
    np.testing.assert_allclose(own.fit[0].columns["q"], flow.reshape(80, 50).mean(axis=1), rtol=1e-5, atol=1e-2)
    noise = own.fit[0].columns["i"] - own.fit[0].columns["q"] / 2000.0
    assert np.std(noise) == pytest.approx(0.2 / np.sqrt(50), rel=0.3)


@pytest.mark.slow
def test_ten_million_rows_are_cut_with_a_stated_loss(tmp_path):
    """1e7 rows of a bench log: the first two million are read, and the loss says so."""
    block = pl.read_csv(CLEAN)
    path = tmp_path / "long.csv"
    with open(path, "wb") as file:
        for k in range(500):
            block.with_columns((pl.col("time_s") + 20.0 * k).round(4)).write_csv(file, include_header=k == 0)
    log = readers.read_log(path)
    assert len(log.time) == 2_000_000
    assert any("more than 2,000,000 rows" in loss for loss in log.losses)


# ---- fuzz ------------------------------------------------------------


def mutate(text: bytes, rng: np.random.Generator) -> bytes:
    """One of the ways in which a file goes wrong."""
    lines = text.split(b"\n")
    row = int(rng.integers(1, len(lines) - 1))
    cells = lines[row].split(b",")
    column = int(rng.integers(len(cells)))
    way = int(rng.integers(16))
    if way == 0:  # flipped byte
        place = int(rng.integers(len(text)))
        return text[:place] + bytes([int(rng.integers(256))]) + text[place + 1 :]
    if way == 1:  # cut
        return text[: int(rng.integers(len(text)))]
    if way == 2:  # lost bytes
        place = int(rng.integers(len(text)))
        return text[:place] + text[place + int(rng.integers(1, 400)) :]
    if way == 3:  # repeated block of rows
        size = int(rng.integers(1, 60))
        return b"\n".join([*lines[: row + size], *lines[row:]])
    if way == 4:  # lost rows
        return b"\n".join([*lines[:row], *lines[row + int(rng.integers(1, 80)) :]])
    if way in (5, 6):  # cells of one column replaced
        junk = [b"", b"nan", b"inf", b"-inf", b"1e400", b"abc", b"0x10", b"--", b"1,5", b"1e30", b"\xff\xfe", b'"'][
            int(rng.integers(12))
        ]
        for k in range(row, min(row + int(rng.integers(1, 200)), len(lines) - 1)):
            part = lines[k].split(b",")
            if column < len(part):
                part[column] = junk
            lines[k] = b",".join(part)
        return b"\n".join(lines)
    if way == 7:  # two rows swapped
        other = int(rng.integers(1, len(lines) - 1))
        lines[row], lines[other] = lines[other], lines[row]
        return b"\n".join(lines)
    if way == 8:  # header damaged
        head = lines[0].split(b",")
        head[column] = [b"", b"x", head[0], b"position_m", b"12"][int(rng.integers(5))]
        return b"\n".join([b",".join(head), *lines[1:]])
    if way == 9:  # header lost
        return b"\n".join(lines[1:])
    if way == 10:  # another separator
        return text.replace(b",", [b";", b"\t", b" ", b"|"][int(rng.integers(4))])
    if way == 11:  # noise appended
        return text + rng.integers(0, 256, int(rng.integers(1, 300)), dtype=np.uint8).tobytes()
    if way == 12:  # gzip, perhaps cut
        packed = gzip.compress(text, 1)
        return packed[: int(rng.integers(1, len(packed) + 1))]
    if way == 13:  # decimal commas
        return text.replace(b",", b";").replace(b".", b",")
    if way == 14:  # a column scaled or frozen from some row on
        for k in range(row, len(lines) - 1):
            part = lines[k].split(b",")
            part[column] = cells[column]
            lines[k] = b",".join(part)
        return b"\n".join(lines)
    return [b"", b"\0" * 50, b"\xef\xbb\xbf" + text, text.decode().encode("utf-16"), b"\x1f\x8b junk"][
        int(rng.integers(5))
    ]


def values_seen(log) -> np.ndarray:
    return np.concatenate([log.time, *(log.columns[name] for name in sorted(log.columns))])


@pytest.mark.parametrize("count", [50, pytest.param(1000, marks=pytest.mark.slow)])
def test_mutated_files_never_fail_silently(tmp_path, count):
    """Each mutated file is refused in one sentence, or read with a stated loss or finding, or equals the original.

    What no reader can see: a digit changed within the signal's own range, a value repeated for under 5 ms, a file that
    just ends early. Such a difference is allowed in at most 5 neighbouring rows, by at most half of the channel's span.
    """
    table = pl.read_csv(CLEAN).slice(4000, 800)
    text = table.write_csv().encode()
    machine = load_machine(DATA / "bench_none")
    original = read_text_log(text, tmp_path / "original.csv")
    outcome = {"refused": 0, "stated": 0, "equal": 0, "few rows": 0}
    for seed in range(count):
        damaged = mutate(text, np.random.default_rng([7, seed]))
        path = tmp_path / ("x.csv.gz" if damaged[:2] == b"\x1f\x8b" else "x.csv")
        try:
            log = read_text_log(damaged, path)
        except HexsimError as error:
            assert len(str(error)) > 20 and "\n" not in str(error)
            outcome["refused"] += 1
            continue
        assert np.all(np.isfinite(values_seen(log))), seed
        if log.losses or [finding for finding in checks.check_log(log, machine) if finding.channel != "time_s"]:
            outcome["stated"] += 1
        elif len(values_seen(log)) == len(values_seen(original)) and np.array_equal(
            values_seen(log), values_seen(original)
        ):
            outcome["equal"] += 1
        else:
            outcome["few rows"] += 1
            assert_few_rows_differ(log, original, seed)
    assert min(outcome["refused"], outcome["stated"], outcome["equal"]) > 0.02 * count, outcome


def assert_few_rows_differ(log, original, seed) -> None:
    """The rows at hand equal the original but for at most five in a row; a shorter log has lost its end."""
    n = len(log.time)
    assert n <= len(original.time), seed
    for name, values in log.columns.items():
        same = original.columns[name][:n]
        differing = np.flatnonzero(values != same)
        if len(differing):
            assert np.ptp(differing) < 5, (seed, name, differing)
            assert np.abs(values - same).max() <= 0.51 * np.ptp(same), (seed, name)


def read_text_log(text: bytes, path: Path):
    path.write_bytes(text)
    return readers.read_log(path)


@pytest.mark.parametrize(("ending", "count"), [("parquet", 30), ("mat", 30), ("mf4", 6)])
def test_damaged_binary_files_are_refused_or_read_without_a_traceback(table, tmp_path, ending, count, capfd):
    """Damaged files of each format: HexsimError or a log of finite values, and nothing on the error stream."""
    whole = tmp_path / f"whole.{ending}"
    if ending == "parquet":
        table.write_parquet(whole)
    elif ending == "mat":
        pytest.importorskip("scipy.io").savemat(whole, {name: table[name].to_numpy() for name in table.columns})
    else:
        write_mdf(table, whole)
    content = whole.read_bytes()
    refused = 0
    for seed in range(count):
        rng = np.random.default_rng([11, seed])
        damaged = bytearray(content)
        for place in rng.integers(0, len(content) if seed % 2 else 400, 5):
            damaged[place] = rng.integers(256)
        if seed % 3 == 0:
            del damaged[int(rng.integers(len(damaged))) :]
        path = tmp_path / f"x{seed}.{ending}"
        path.write_bytes(damaged)
        try:
            assert np.all(np.isfinite(values_seen(readers.read_log(path))))
        except HexsimError as error:
            assert "\n" not in str(error)
            refused += 1
    gc.collect()  # what is left of refused files raises nothing later
    assert refused > count / 3
    assert "Traceback" not in capfd.readouterr().err
