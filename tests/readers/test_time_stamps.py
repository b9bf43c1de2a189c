"""Time stamps that are off, of samples that are even or not; what was filled is known to be filled."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from hexsim import readers

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tracing"))
from dirt import CASES, missing_rows, sampling_jitter, stamp_jitter  # noqa: E402

CLEAN = HERE.parent / "data" / "bench_none" / "fit.csv.gz"


@pytest.fixture(scope="module")
def clean() -> pl.DataFrame:
    return pl.read_csv(CLEAN)[:6000]


def read_back(table: pl.DataFrame, folder: Path):
    table.write_csv(folder / "fit.csv")
    return readers.read_log(folder / "fit.csv")


@pytest.mark.parametrize("case", [case for case in CASES if case.startswith("stamps") and "10 ms" not in case])
@pytest.mark.parametrize("seed", [1, 2])
def test_even_samples_come_back_to_the_bit_whatever_their_stamps(clean, tmp_path, case, seed):
    """Jitter of 0.05 and 0.4 ms, stamps of 2 ms, with and without lost rows: every sample stands where it was taken."""
    log = read_back(CASES[case](clean, np.random.default_rng(seed)), tmp_path)
    lost = log.repaired.get("position_m", np.zeros(log.n, dtype=bool))
    assert (log.n, log.rate, lost.sum()) == (len(clean), 1000.0, 7 if "rows" in case else 0)
    for name, values in log.columns.items():
        assert np.array_equal(values[~lost], clean[name].to_numpy()[~lost])
    assert any("rows counted instead" in loss for loss in log.losses)


@pytest.mark.parametrize("rows", [1, 2, 7])
def test_lost_rows_are_found_under_jitter(clean, tmp_path, rows):
    """Stamps 0.3 ms off at 1 kHz: the hole is as long as it was, within three rows of where it was."""
    rng = np.random.default_rng(3)
    holed = missing_rows(clean, rng, rows)
    at = int(np.flatnonzero(np.diff(holed["time_s"].to_numpy()) > 1.5e-3)[0]) + 1
    log = read_back(stamp_jitter(holed, rng, 3e-4), tmp_path)
    made_up = np.flatnonzero(log.repaired["position_m"])
    assert len(made_up) == rows and log.n == len(clean)
    assert abs(made_up[0] - at) <= 3


def test_samples_that_really_wander_keep_their_stamps(clean, tmp_path):
    """Samples 0.2 ms off their grid whose stamps say so: positions come back within their noise, setpoints to the bit."""
    log = read_back(sampling_jitter(clean, np.random.default_rng(4)), tmp_path)
    assert not any("rows counted" in loss for loss in log.losses)
    assert any("wander" in loss for loss in log.losses)
    rest = log.columns["position_m"] - clean["position_m"].to_numpy()[: log.n]
    assert np.std(rest) < 3.2e-6
    assert np.array_equal(log.columns["setpoint_m"][10:-10], clean["setpoint_m"].to_numpy()[10 : log.n - 10])


def test_parts_of_a_run_know_when_they_begin(clean, tmp_path):
    """What drifts with time goes on behind a gap; the controller's ticks are where volts change."""
    pl.concat([clean[:2001], clean[2500:]]).write_csv(tmp_path / "fit.csv")
    later, first = readers.read_stretches(tmp_path / "fit.csv")
    assert (first.offset_s, first.tick_phase(2)) == (0.0, 0)
    assert later.offset_s == pytest.approx(2.5) and later.tick_phase(2) == 0
    assert later.part(slice(3, None)).tick_phase(2) == 1
    assert later.run_time[0] == pytest.approx(2.5)


def test_windows_that_see_a_filled_stretch_are_known(clean, tmp_path):
    """Seven filled rows cost 60 ms on either side; one filled sample costs nothing but itself."""
    log = read_back(pl.concat([clean[:3000], clean[3007:5000], clean[5001:]]), tmp_path)
    assert np.flatnonzero(~log.whole(0.06, 2)).tolist() == list(range(2940, 3067))
    assert log.repaired["position_m"].sum() == 8


def test_a_slow_log_is_made_finer(clean, tmp_path):
    """Every fourth row, made four times finer: the ticks' setpoints between them within 0.1 um where they are smooth."""
    slow = read_back(clean[::4], tmp_path).finer(4)
    true = clean["setpoint_m"].to_numpy()[: slow.n]
    assert slow.rate == 1000.0
    assert np.max(np.abs(slow.setpoint[0, ::4] - true[::4])) < 1e-12
    assert np.max(np.abs(slow.setpoint[0, 102:1900:4] - true[102:1900:4])) < 1e-7


def test_a_dwell_at_an_end_stop_is_no_saturation(tmp_path):
    """A signal that comes to rest at its end is whole; the same cut off at speed is saturated."""
    t = np.arange(6000) / 1000.0
    stroke = np.where(t < 3.0, 0.05 * (1.0 - np.cos(np.pi * np.minimum(t, 3.0) / 3.0)), 0.1)
    dwelling = 3e-6 * np.round(stroke / 3e-6)

    def said(wave):
        log = pl.DataFrame({"time_s": t, "setpoint_m": stroke, "position_m": stroke, "pressure_bottom_Pa": 1e7 * wave})
        return [loss for loss in read_back(log, tmp_path).losses if "saturated" in loss]

    assert said(dwelling) == []
    assert len(said(np.minimum(0.02 * t, 0.05))) == 1  # and never comes back
    [cut_off] = said(np.minimum(0.07 * np.sin(2 * np.pi * 0.5 * t), 0.05))
    assert int(re.search(r"saturated at 500000 in (\d+) rows", cut_off)[1]) > 500
