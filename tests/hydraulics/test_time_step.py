"""The rule for the time step: stiffer is shorter, and it follows the state."""

import numpy as np
import pytest

from hexsim.hydraulics import steps
from hexsim.hydraulics import supply as supplies
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import load_machine

MASS = np.array([[1 / 40.0]])
CALM = 1.0  # [s] long after the last reversal


@pytest.fixture
def bench():
    resolved = resolve(load_machine("bench"))
    return resolved.rows, resolved.supply


def here(rule, row, y=0.1, v=-0.1, x=0.0, P1=3.5e6, Ps=7e6, calm_s=CALM):
    """Steps of the next millisecond."""
    return steps.count_steps_by_rule(rule, steps.leg_steps(rule, row, y, v, x, P1, Ps, Ps, 0.0), calm_s, 1e-3)


@pytest.mark.parametrize("place", [P.COULOMB_EXTEND, P.STATIC_RETRACT, P.VISCOUS_EXTEND])
def test_stiffer_friction_takes_shorter_steps_near_standstill(bench, place):
    """A hundred times the friction: more steps near standstill, and no fewer elsewhere."""
    rows, supply = bench
    soft = steps.step_rule(rows, supply, MASS)
    rows[:, place] *= 100.0
    stiff = steps.step_rule(rows, supply, MASS)
    assert here(stiff, rows[0], calm_s=0.0) > here(soft, rows[0], calm_s=0.0)
    assert here(stiff, rows[0]) >= here(soft, rows[0])


def test_standstill_keeps_the_friction_stable(bench):
    """h lambda stays below 2.78, where RK4 is stable, with lambda = (F_c + F_s)/(v_s m) + sigma/m of the bench: 11,930 1/s."""
    rows, supply = bench
    for mass in (2.0, 10.0, 40.0, 400.0):
        rule = steps.step_rule(rows, supply, np.array([[1 / mass]]))
        rate = (95.0 / 2e-4 + 2200.0) / mass
        assert rate * 1e-3 / here(rule, rows[0], calm_s=0.0) < 2.78


def test_less_mass_and_less_oil_take_shorter_steps(bench):
    """The oil's spring sqrt(A1^2/(C m)) sets the step: a quarter of the mass, or a nearly retracted piston, shortens it."""
    rows, supply = bench
    rules = [steps.step_rule(rows, supply, MASS * share) for share in (0.25, 1.0, 4.0, 16.0)]
    counts = [here(rule, rows[0]) for rule in rules]
    assert counts == sorted(counts) and counts[0] < counts[-1]
    assert here(rules[1], rows[0], y=0.006) > here(rules[1], rows[0], y=0.19)


def test_a_ring_is_followed_after_a_reversal(bench):
    """Heavy load: one step a millisecond in calm motion, two for 0.1 s after a reversal, more at it."""
    rows, supply = bench
    rule = steps.step_rule(rows, supply, MASS / 10)
    assert [here(rule, rows[0], calm_s=calm) for calm in (0.11, 0.09)] == [1, 2]
    rows[:, P.SHARPNESS] /= 10.0
    assert here(steps.step_rule(rows, supply, MASS / 10), rows[0], calm_s=0.0) > 2


def test_an_open_valve_at_little_pressure_drop_takes_shorter_steps(bench):
    """dq/dP1 grows as the pressure drop falls: the step shrinks, down to FASTEST_LAW_S and no further."""
    rows, supply = bench
    rule = steps.step_rule(rows, supply, MASS / 100)
    counts = [here(rule, rows[0], x=1e-3, P1=7e6 - drop) for drop in (5e6, 1e6, 1e5, 0.0)]
    assert counts == sorted(counts) and counts[0] < counts[-1] == round(1e-3 / steps.STEP.fastest_law_s)


def test_a_fast_supply_line_takes_shorter_steps(bench):
    """R C of 0.2 ms, and no shorter than FASTEST_LAW_S for one of 1 us."""
    rows, supply = bench
    supply[supplies.S.MODEL], supply[supplies.S.RESISTANCE] = supplies.LINE, 2e9
    counts = []
    for capacity in (5e-12, 1e-13, 5e-16):
        supply[supplies.S.CAPACITY] = capacity
        counts.append(here(steps.step_rule(rows, supply, MASS / 100), rows[0]))
    assert counts == sorted(counts) and counts[0] < counts[1] < counts[2] == round(1e-3 / steps.STEP.fastest_law_s)


def test_an_end_stop_takes_shorter_steps(bench):
    """Within the cushion its spring and damper count."""
    rows, supply = bench
    rule = steps.step_rule(rows, supply, MASS)
    assert here(rule, rows[0], y=0.199) > here(rule, rows[0], y=0.15)


def test_a_leg_that_may_reverse_is_near_standstill(bench):
    """Slow, or slowing down so fast that it may reverse within the next step of the rule."""
    row = bench[0][0]
    assert steps.near_standstill(row, 0.5e-3, 0.5e-3)
    assert not steps.near_standstill(row, 5e-3, 5.1e-3)
    assert steps.near_standstill(row, 5e-3, 12e-3)


def test_no_step_is_shorter_than_the_shortest(bench):
    """Whatever a state asks for: SHORTEST_S."""
    rows, supply = bench
    rule = steps.step_rule(rows, supply, MASS)
    assert steps.count_steps(rule, np.inf, CALM, 1e-3) == round(1e-3 / steps.STEP.shortest_s)


@pytest.mark.parametrize(("v", "x"), [(0.1, 0.0), (0.5, 1e-4)])
def test_a_chamber_on_its_way_to_vapour_takes_shorter_steps(bench, v, x):
    """A piston that leaves its oil behind: 0.1 ms, and less for a light load. The valve's flow counts."""
    rows, supply = bench
    heavy, light = (steps.step_rule(rows, supply, share * MASS) for share in (0.1, 10.0))
    assert here(heavy, rows[0], v=v, x=x) == 10
    assert here(light, rows[0], v=v, x=x) > 20
    assert here(heavy, rows[0], v=0.1, x=1.1e-4) == 1
