"""At the level of the rest: small realities keep to their size, a large effect is found with its number beside them."""

from pathlib import Path

import numpy as np
import pytest
from other_plant import write_machine

from hexsim.machine import load_machine
from hexsim.tracing import rules
from hexsim.tracing.balances.balance import resolved_machine, sensed_leg
from hexsim.tracing.fitting.parameters import candidates
from hexsim.tracing.fitting.rest_level import ordinary_effects
from hexsim.tracing.steps import shapes, violations
from hexsim.tracing.steps.dominant import sure_effects
from hexsim.tracing.steps.logs import begin

DATA = Path(__file__).parents[1] / "data"
ROUGH = {
    "small_spool_lag": 150.0,
    "small_position_delay": 0.4,
    "small_null_offset": 0.006,
    "friction_warm_up": 0.06,
    "scale_ripple": 3e-6,
}


def violated(folder, names=("fit", "sweep"), held_out=("validate",)):
    trace = begin(folder, names, held_out)
    for step in (violations.STEP, shapes.STEP):
        trace = step.run(trace, lambda doing: None)
    return trace


def test_accelerometer_of_a_clean_bench_has_no_slope_against_the_second_derivative_of_position():
    """Samples miss 4 % of an acceleration that bends between ticks; with what they miss the slope is below 0.5 %."""
    trace = begin(DATA / "bench_none", ["fit"], ["validate"])
    point = sensed_leg(trace.fit_problem.logs[0], resolved_machine(trace.machine), 0)
    kept = slice(500, -500)
    rest, a = point.disagreement[kept], point.window.mean(point.acceleration)[kept]
    missed = point.between_ticks[kept]
    assert abs(rest @ a) / (a @ a) < 0.005
    assert abs((rest + missed) @ a) / (a @ a) > 0.025


def test_small_realities_are_held_to_their_ordinary_size():
    """Every one of the table is an effect of the library with one number, which cannot leave its ordinary size."""
    possible = candidates(load_machine(DATA / "bench_none"))
    small = {candidate.effect.name: candidate for candidate in ordinary_effects(possible)}
    assert set(small) == set(rules.ORDINARY)
    for name, candidate in small.items():
        [number] = candidate.effect.parameters
        reach = number.bounds[0] if np.isinf(number.neutral) else number.bounds[1]
        assert reach == pytest.approx(rules.ORDINARY[name])


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect, value, name, unit_value",
    [
        ("leakage_supply_to_chamber", 2e-12, "leakage_supply_to_chamber", 2e-12),
        ("mass", 0.2, "mass_change", None),
        (None, None, None, None),
    ],
)
def test_a_large_effect_is_named_over_five_small_ones_and_none_where_there_is_none(
    tmp_path, effect, value, name, unit_value
):
    """Right name, number within 10 %; without a large effect nothing is sure."""
    write_machine(tmp_path, 41, ROUGH | ({} if effect is None else {effect: value}))
    found = sure_effects(violated(tmp_path), lambda doing: None)
    assert [own.candidate.effect.name for own in found.named] == ([] if name is None else [name])
    if unit_value is not None:
        fit = found.best.fit
        [number] = fit.values[fit.candidates.index(found.named[0].candidate)].values()
        assert number == pytest.approx(unit_value, rel=0.1)
