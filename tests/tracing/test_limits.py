"""A limit that a motion hardly takes: a search that begins where nothing takes it does not find it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from other_plant import driven, measured, write_machine

from hexsim.tracing import state
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.fitting import parameters
from hexsim.tracing.steps import balance_search, logs, shapes, ties, violations

LIMIT_m_s, SEED = 4.85e-3, 11


def ended_with_a_lag(folder: Path, effects: dict[str, float]) -> tuple[state.Trace, least_squares.Fit]:
    """The trace of a bench of the second plant whose search has ended with a spool lag, refined. A sine of 0.0495 m at 0.919 Hz:
    its fastest ticks take the limit, if there is one."""
    plant = write_machine(folder, SEED, effects, runs=("validate",), duration_s=8.0, suffix=".csv")
    t = np.floor(np.arange(8_000) * 1e-3 * 500 + 1e-6) / 500
    setpoint = 0.5 * plant.legs["stroke"][0] + 0.0495 * np.sin(2 * np.pi * 0.919 * t)[:, None]
    log = measured(plant, driven(plant, setpoint), np.random.default_rng(SEED))
    pl.DataFrame(log).write_csv(folder / "sine.csv")
    trace = logs.begin(folder, ["sine"], ["validate"])
    for step in (violations.STEP, shapes.STEP, balance_search.STEP):
        trace = step.run(trace, lambda doing: None)
    lag = {"frequency_Hz": 800.0, "damping": 1.0}
    fit = replace(trace.base, candidates=(parameters.named("spool_lag"),), values=(lag,))
    return trace, least_squares.refine(
        least_squares.start_fit_at(fit, trace.fit_problem), trace.fit_problem, stated=True
    )


@pytest.mark.slow
def test_a_limit_of_the_spools_speed_is_not_told_as_another_spool(tmp_path: Path) -> None:
    """Where the search has ended with a spool of another lag, the limit stands in its place, within 5 %; the other way
    round, a machine with a lag keeps it."""
    limited, lag = ended_with_a_lag(tmp_path / "limited", {"spool_rate_limit": LIMIT_m_s})
    better = ties.better_limit(lag, 0, limited)
    assert better is not None
    assert [own.effect.name for own in better.candidates] == ["spool_rate_limit"]
    assert better.values[0]["rate_m_s"] == pytest.approx(LIMIT_m_s, rel=0.05)
    late, lag = ended_with_a_lag(tmp_path / "late", {"spool_lag": 150.0})
    assert ties.better_limit(lag, 0, late) is None
