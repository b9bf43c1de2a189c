"""Channels that are sampled more slowly than a log has rows: what a simulation is compared with, and that none gets a name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from hexsim.readers.one_grid import as_read
from hexsim.signals.log import Log
from hexsim.tracing.balances import null
from hexsim.tracing.fitting import fit
from hexsim.tracing.steps import declared_refit, logs, violations

DATA = Path(__file__).resolve().parents[1] / "data"
PRESSURES = ("pressure_bottom_Pa", "pressure_supply_Pa")


def held(folder: Path, columns: tuple[str, ...], rate_Hz: float, every: int) -> None:
    """10 s of the bench in which nothing is missing, some of its columns sampled at a rate and repeated, in every so many rows."""
    folder.joinpath("machine.toml").write_bytes((DATA / "bench_none" / "machine.toml").read_bytes())
    for name in ("fit", "validate"):
        table = pl.read_csv(DATA / "bench_none" / f"{name}.csv.gz").head(10_000)
        tick = np.floor(table["time_s"].to_numpy() * rate_Hz + 1e-6)
        first = np.concatenate([[0], np.flatnonzero(np.diff(tick)) + 1])
        rows = first[np.searchsorted(first, np.arange(len(tick)), side="right") - 1]
        table = table.with_columns(table[column][rows.tolist()].alias(column) for column in columns)
        table[::every].write_csv(folder / f"{name}.csv")


@pytest.mark.parametrize(
    "columns, rate_Hz, every",
    [
        (PRESSURES, 200.0, 2),
        pytest.param(PRESSURES, 200.0, 1, marks=pytest.mark.slow),
        pytest.param(("position_m",), 250.0, 1, marks=pytest.mark.slow),
        pytest.param(("acceleration_m_s2",), 1e3 / 3.0, 1, marks=pytest.mark.slow),
    ],
)
def test_nothing_is_missing_where_a_channel_is_held(tmp_path, columns, rate_Hz, every):
    """Pressures at 200 Hz in rows of 500 or 1000, a position at 250, an accelerometer at 333: all balances hold, and the refitted
    machine leaves no more than noise, with no lag of those channels in it."""
    held(tmp_path, columns, rate_Hz, every)
    trace = violations.STEP.run(logs.begin(tmp_path, ["fit"], ["validate"]), lambda doing: None)
    assert not [line.name for line in trace.violations if line.violated]
    trace = declared_refit.STEP.run(trace, lambda doing: None)
    problem = trace.fit_problem
    misfit = fit.evaluate(trace.base, problem).misfit[0]
    for name, row in zip(problem.channels(0), misfit, strict=True):
        weight = np.median(problem.logs[0].weight(name))
        assert np.sqrt(np.mean(row**2) / weight) < 1.1, name
        slope = np.gradient(problem.measured[0][name])[problem.settle(0) :] / problem.noise[name]
        late, error = row @ slope / (slope @ slope), 1.0 / np.sqrt(slope @ slope * weight)
        assert abs(late) < 5.0 * error, (name, late, error)


def test_noise_of_a_slower_channel_is_that_of_its_samples():
    """Between samples noise is a curve through theirs; a signal on a straight line stays one."""
    n, at = 3000, np.arange(0.0, 3000.0, 2.5)
    line = np.linspace(1e6, 2e6, n)
    log = Log(
        name="fit", kind="bench", time=1e-3 * np.arange(n), position=np.zeros(n), pressure=line,
        sampled={"pressure_bottom_Pa": at},
    )  # fmt: skip
    assert as_read(log).columns["pressure_bottom_Pa"] == pytest.approx(line)
    noise = {"position_m": 0.0, "pressure_bottom_Pa": 1e3}
    rng = np.random.default_rng(1)
    noisy = null.with_noise(log, noise, 0.0, rng).columns["pressure_bottom_Pa"] - line
    white = null.with_noise(replace(log, sampled={}), noise, 0.0, rng).columns["pressure_bottom_Pa"] - line
    sums = [np.std(own[:2900].reshape(-1, 100).sum(axis=1)) for own in (noisy, white)]
    assert np.std(noisy[::5]) == pytest.approx(1e3, rel=0.1)
    assert sums[0] / sums[1] == pytest.approx(np.sqrt(2.5), rel=0.4)
