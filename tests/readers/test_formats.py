"""Formats of logs: each is one file, and what a file cannot give is said."""

import builtins
import gzip
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pandas as pd
import polars as pl
import pytest

from hexsim import HexsimError, readers
from hexsim.readers import files, formats
from hexsim.readers.formats import text
from hexsim.setpoints import signals

CLEAN = Path(__file__).resolve().parents[1] / "data" / "bench_none" / "fit.csv.gz"
ARROW = '''"""Arrow's own files."""

import numpy as np
import polars as pl

from hexsim.readers.reader import RawLog, Reader


class ArrowReader(Reader):
    """One table."""

    name = "Arrow"
    suffixes = (".arrow",)

    def read(self, path, layout):
        table = pl.read_ipc(path)
        return RawLog.of_table({name: table[name].to_numpy() for name in table.columns})


READER = ArrowReader()
'''


@pytest.fixture(scope="module")
def table() -> pl.DataFrame:
    """Two seconds of a bench log."""
    return pl.read_csv(CLEAN).slice(4000, 2000)


def test_a_format_of_ones_own_is_one_file(table, tmp_path, monkeypatch):
    """A file with READER in a folder of the formats: logs and setpoint files of that format are read."""
    (tmp_path / "arrow.py").write_text(ARROW)
    table.write_ipc(tmp_path / "run.arrow")
    with pytest.raises(HexsimError, match=r"a log ends in one of .*\.parquet"):
        readers.read_log(tmp_path / "run.arrow")
    monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(tmp_path)])
    files.readers.cache_clear()
    try:
        log = readers.read_log(tmp_path / "run.arrow")
        setpoints = signals.read_setpoint_file(tmp_path / "run.arrow")
        assert files.log_files(tmp_path, "run") == tmp_path / "run.arrow"
    finally:
        files.readers.cache_clear()
    assert (log.name, log.losses) == ("run", ())
    assert np.array_equal(log.columns["position_m"], table["position_m"].to_numpy())
    assert np.array_equal(setpoints["setpoint_m"], table["setpoint_m"].to_numpy())


def mdf(path: Path, groups: list[tuple[np.ndarray, dict[str, np.ndarray]]]) -> Path:
    asammdf = pytest.importorskip("asammdf", reason="MDF needs the extra hexsim[mdf]")
    with asammdf.MDF(version="4.10") as file:
        for stamps, channels in groups:
            file.append([asammdf.Signal(samples=x, timestamps=stamps, name=name) for name, x in channels.items()])
        file.save(path, overwrite=True)
    return path


def columns_of(table: pl.DataFrame) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    return table["time_s"].to_numpy(), {name: table[name].to_numpy() for name in table.columns if name != "time_s"}


def test_two_mdf_channels_of_one_name_are_told_apart_by_their_group(table, tmp_path):
    """Two groups have a position: the sentence names both; the mapping says which."""
    stamps, channels = columns_of(table)
    other = {"position_m": channels["position_m"] + 0.01}
    path = mdf(tmp_path / "two.mf4", [(stamps, channels), (stamps, other)])
    with pytest.raises(HexsimError, match=r"several signals for position_m: group 1\.position_m, group 2\.position_m"):
        readers.read_log(path)
    for group, values in (("group 1", channels), ("group 2", other)):
        (tmp_path / "mapping.toml").write_text(f'[columns.position_m]\nfrom = "{group}.position_m"\n')
        assert np.array_equal(readers.read_log(path).columns["position_m"], values["position_m"])


def test_an_mdf_channel_that_ends_early_is_missing_there(table, tmp_path):
    """Slow supply pressure that ends after 1.2 s: the rest is missing, not held and then called frozen."""
    stamps, channels = columns_of(table)
    supply = channels.pop("pressure_supply_Pa")
    part = slice(0, 1201, 2)
    log = readers.read_log(
        mdf(tmp_path / "ends.mf4", [(stamps, channels), (stamps[part], {"pressure_supply_Pa": supply[part]})])
    )
    assert not any("frozen" in loss for loss in log.losses)
    assert any(
        f"lasts from {stamps[0]:.3f} to {stamps[1200]:.3f} s: missing before and after" in loss for loss in log.losses
    )
    assert log.time[-1] == pytest.approx(stamps[1200], abs=4e-3)


@pytest.mark.filterwarnings("ignore:duration_to_mat")  # the writer's choice of a time unit, used by this test alone
@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_timetables_of_matlab_are_read(table, tmp_path, version):
    """Row times at 2.5 kHz become seconds from the first row, columns and their units come back."""
    matio = pytest.importorskip("matio", reason="timetables need the extra hexsim[matlab]")
    frame = pd.DataFrame({name: table[name].to_numpy() for name in table.columns if name != "time_s"})
    frame.index = pd.to_timedelta(np.arange(len(frame)) * 400, unit="us")
    frame.index.name = "Time"
    matio.save_to_mat(str(tmp_path / "run.mat"), {"run": frame}, version=version)
    log = readers.read_log(tmp_path / "run.mat")
    assert (log.rate, log.n) == (2500.0, len(frame))
    for name, values in log.columns.items():
        assert np.array_equal(values, frame[name].to_numpy()), name


def test_without_mat_io_a_timetable_is_refused_with_what_to_do(tmp_path, monkeypatch):
    """The sentence names the extra and another way to save."""
    (tmp_path / "run.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n")
    real = builtins.__import__

    def without(name, *more, **others):
        if name == "matio":
            raise ImportError(name)
        return real(name, *more, **others)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(
        HexsimError, match=r"of version 7\.3: pip install 'hexsim\[matlab\]' to read it, or save it again"
    ):
        readers.read_log(tmp_path / "run.mat")


def test_columns_with_units_in_brackets_are_read(table, tmp_path):
    """Headers of other tools: Position [mm], Pressure bottom (bar)."""
    renamed = table.with_columns(pl.col("position_m") * 1e3, pl.col("pressure_bottom_Pa") / 1e5)
    renamed = renamed.rename({"position_m": "Position [mm]", "pressure_bottom_Pa": "Pressure bottom (Bar)"})
    renamed.write_csv(tmp_path / "log.csv")
    log = readers.read_log(tmp_path / "log.csv")
    assert np.allclose(log.columns["position_m"], table["position_m"].to_numpy(), rtol=1e-12)
    assert np.allclose(log.columns["pressure_bottom_Pa"], table["pressure_bottom_Pa"].to_numpy(), rtol=1e-12)


def bomb(path: Path, line: bytes, megabytes: int) -> Path:
    """A gzip file of so much text; two members, so that the second is bounded too."""
    with open(path, "wb") as file:
        file.write(gzip.compress(b"time_s,position_m\n"))
        pack, block = zlib.compressobj(9, wbits=31), line * (1_000_000 // len(line))
        for _ in range(megabytes):
            file.write(pack.compress(block))
        file.write(pack.flush())
    return path


@pytest.mark.slow
@pytest.mark.parametrize("line", [b"0", b"0,0\n", b"x,y\n", b","])
def test_a_gzip_bomb_is_bounded(tmp_path, line):
    """2 GB of text in 2 MB: a sentence or a stated loss, under 2 GB of memory."""
    path = bomb(tmp_path / "bomb.csv.gz", line, 2000)
    program = (
        "import resource, sys\n"
        "from hexsim.errors import HexsimError\nfrom hexsim.readers import read_log\n"
        "try:\n    read_log(sys.argv[1])\nexcept HexsimError as error:\n    print(error)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=True)
    assert int(done.stdout.split()[-1]) < 2_000_000  # kB


def test_inflated_pieces_are_bounded(tmp_path):
    """No piece is larger than the chunk, however well it is packed, and together they are the whole."""

    path = bomb(tmp_path / "bomb.csv.gz", b"0,0\n", 30)
    with open(path, "rb") as file:
        sizes = [len(piece) for piece in text.inflated(file)]
    assert max(sizes) <= text.LARGEST.piece and sum(sizes) == len(b"time_s,position_m\n") + 30_000_000


def test_more_text_than_is_read_is_said(table, tmp_path, monkeypatch):
    """Beyond the largest text only the whole rows before it are used."""
    monkeypatch.setitem(text.file_bytes.__kwdefaults__, "most_bytes", 50_000)
    monkeypatch.setattr(text, "LARGEST", text.LARGEST._replace(piece=10_000))
    table.write_csv(tmp_path / "log.csv")
    log = readers.read_log(tmp_path / "log.csv")
    assert any("only so much of it is used" in loss for loss in log.losses)
    assert 500 < log.n < len(table)
    assert np.array_equal(log.columns["position_m"], table["position_m"].to_numpy()[: log.n])


def test_a_delay_longer_than_the_log_is_refused(table, tmp_path):
    """The mapping's key, its value and the length of the log are named."""
    table.write_csv(tmp_path / "log.csv")
    (tmp_path / "mapping.toml").write_text("[columns.acceleration_m_s2]\ndelay_s = 10.0\n")
    with pytest.raises(
        HexsimError, match=r"\[columns\.acceleration_m_s2\] delay_s = 10 .* is longer than the log \(2 s\)"
    ):
        readers.read_log(tmp_path / "log.csv")


def test_missing_setpoints_of_a_held_signal_are_those_of_their_tick(tmp_path):
    """1 % of the cells of a setpoint that is held for two samples: all but whole ticks come back to the bit."""
    whole = pl.read_csv(CLEAN)
    missing = np.random.default_rng(1).random(len(whole)) < 0.01
    holes = whole.with_columns(
        pl.when(pl.Series(missing)).then(None).otherwise(pl.col("setpoint_m")).alias("setpoint_m")
    )
    holes.write_csv(tmp_path / "log.csv")
    log = readers.read_log(tmp_path / "log.csv")
    true, same_tick = whole["setpoint_m"].to_numpy(), missing.reshape(-1, 2).all(axis=1).repeat(2)
    assert np.array_equal(log.columns["setpoint_m"][~same_tick], true[~same_tick])
    assert np.allclose(log.columns["setpoint_m"], true, rtol=0, atol=2e-5)  # a straight line over 4 ms
    assert np.array_equal(log.repaired["setpoint_m"], missing)


def test_filled_samples_are_marked(table, tmp_path):
    """Empty cells of one column and lost rows of all: the log says which samples were made up, no others."""
    holes = table.with_columns(
        pl.when(pl.int_range(pl.len()).is_between(100, 103)).then(None).otherwise(pl.col("valve_V")).alias("valve_V")
    )
    pl.concat([holes[:700], holes[703:]]).write_csv(tmp_path / "log.csv")
    log = readers.read_log(tmp_path / "log.csv")
    assert set(log.repaired) == set(log.columns)
    assert np.flatnonzero(log.repaired["valve_V"]).tolist() == [100, 101, 102, 103, 700, 701, 702]
    assert np.flatnonzero(log.repaired["position_m"]).tolist() == [700, 701, 702]
    assert readers.read_log(CLEAN).repaired == {}
    assert "valve_V" in log.head(0.2).repaired and "position_m" not in log.head(0.2).repaired
