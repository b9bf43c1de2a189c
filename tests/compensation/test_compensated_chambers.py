"""Two chambers on a four-way valve: the law's equations by hand, and the bump on the simulated machine."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from designs import usual

from compensation import Context, create
from compensation.adaptive import Adaptive
from compensation.adaptive.chamber_pressures import measure_pressures, pair_roots, roots_ahead
from compensation.adaptive.chambers import compliance_m_Pa, equivalent_Pa, pair_flow_m_s, pair_volts
from compensation.adaptive.friction import demanded_pressure
from compensation.adaptive.layout import VALVE
from compensation.adaptive.valve import lags_agree
from compensation.loop_feedback import fed_back_V
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate

SUPPLY, TANK = 1.6e7, 2e5


def state_of(ratio: float):
    """State of a leg with the areas' ratio on a four-way valve."""
    return (
        Adaptive()
        .start(
            Context(
                area_bottom_m2=2e-3, area_top_m2=ratio * 2e-3, four_way=True, stroke_m=0.6, supply_pressure_Pa=SUPPLY,
                tank_pressure_Pa=TANK, bulk_modulus_Pa=1.3e9, pipeline_volume_m3=4e-5, pipeline_volume_top_m3=3e-5,
                velocity_gain_V_s_per_m=0.6, pressure_gain_V_per_Pa=6e-8,
            )
        )
        .numbers
    )  # fmt: skip


@pytest.mark.parametrize("ratio", (1.0, 0.48))
@pytest.mark.parametrize("extends", (True, False))
def test_at_steady_flow_the_three_way_valve_that_is_alike_has_the_drops_and_the_load(ratio, extends):
    """Steady: both edges pass what the areas sweep, R2 = r R1. The equivalent valve's open edge then has the drop of
    edge 1, R of the pair is R1, and the equivalent load times 1 + r^3 moves as the load pressure does."""
    settings, drop = state_of(ratio).settings, 4e6
    near, far = (SUPPLY - drop, TANK + ratio**2 * drop) if extends else (TANK + drop, SUPPLY - ratio**2 * drop)
    bottom, supply = equivalent_Pa(settings, near, far, SUPPLY)
    assert (supply - bottom if extends else bottom - TANK) == pytest.approx(drop)
    root = pair_roots(settings, 0.2, near, far, SUPPLY)[1 if extends else 0]
    assert root == pytest.approx(math.sqrt(drop / settings.reference_drop_Pa))
    more, _ = equivalent_Pa(settings, near + 1e5, far, SUPPLY)
    assert more - bottom == pytest.approx(1e5 / (1.0 + ratio**3))


@pytest.mark.parametrize("ratio", (1.0, 0.48))
def test_both_chambers_are_springs_in_series(ratio):
    """Force for a travel of the oil, A1 pL / z: the sum of the chambers' stiffnesses E A^2 / V."""
    settings, y = state_of(ratio).settings, 0.17
    volumes = 2e-3 * y + 4e-5, ratio * 2e-3 * (0.6 - y) + 3e-5
    stiffness = 1.3e9 * ((2e-3) ** 2 / volumes[0] + (ratio * 2e-3) ** 2 / volumes[1])
    load_per_equivalent = 1.0 + ratio**3
    assert 2e-3 * load_per_equivalent / compliance_m_Pa(settings, y) == pytest.approx(stiffness)


def test_volts_of_both_edge_pairs_are_the_inverse_of_their_flow():
    """Overlap, critical lap and underlap, sharp and rounded, unequal drops, both signs: the flow comes back to 1 um/s."""
    rng, valve = np.random.default_rng(1), usual(VALVE)
    for _ in range(300):
        rounding, roots = rng.uniform(1e-3, 0.08), tuple(rng.uniform(0.8, 2.0, 2))
        for edge in valve.edges:
            edge.gain_m_s_V, edge.dead_band_V = rng.uniform(0.03, 0.1), rng.uniform(-0.02, 3 * rounding)
        flow = rng.uniform(-0.3, 0.3) * rng.uniform() ** 3
        volts = pair_volts(flow, valve.edges, roots, rounding)
        assert pair_flow_m_s(volts, valve.edges, roots, rounding) == pytest.approx(flow, abs=1e-6)


def test_at_critical_lap_and_equal_drops_rounded_edges_are_a_straight_line():
    """What one edge lets in beyond a sharp one, the other lets out; unequal drops leave s log 2 (R1 - R0) at 0 V."""
    valve = usual(VALVE)
    valve.edges[0].gain_m_s_V = valve.edges[1].gain_m_s_V = 0.07
    for volts in (-0.3, -0.02, 0.0, 0.05, 0.4):
        assert pair_flow_m_s(volts, valve.edges, (1.5, 1.5), 0.04) == pytest.approx(0.07 * 1.5 * volts, abs=1e-12)
    assert pair_flow_m_s(0.0, valve.edges, (1.6, 1.3), 0.04) == pytest.approx(-0.07 * 0.3 * 0.04 * math.log(2.0))


def test_feedback_in_the_motion_asked_for_is_that_of_a_known_motion():
    """A ramp of 0.1 m/s and a pressure step of 0.2 MPa: K_d 0.1 m/s once the filter is in, and K_p 0.2 MPa that falls
    with the high-pass's time constant."""
    state = state_of(1.0)
    volts = [fed_back_V(state.loop, state.settings, 0.1 + 0.1 * k / 500, 2e5 * (k >= 250)) for k in range(331)]
    assert volts[249] == pytest.approx(0.06, rel=1e-6)
    assert volts[250] - 0.06 == pytest.approx(0.012, rel=0.01)
    assert volts[330] - 0.06 == pytest.approx(0.012 * math.exp(-2 * math.pi * 0.16), rel=0.02)


def bump(comp: str, changes: dict[str, float], scenario: str = "heave", name: str = "servo_bench") -> float:
    """Peak in the band from 14 to 24 s of the sine."""
    motion = dataclasses.replace(load_scenario(scenario, duration_s=24.0), figures_from_s=14.0)
    axes = simulate(changed(load_machine(name), changes), motion, compensator=create(comp), fast=True).summary["axes"]
    found = axes["roll" if scenario == "roll" else next(iter(axes)) if "bench" in name else "z"]
    return found.get("peak_band_m_s2", found.get("peak_band_rad_s2"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    (
        {},
        {"controller.integral_time_s": 1.0},
        {"controller.integral_time_s": 1.0, "controller.velocity_gain_V_s_per_m": 0.6},
        {"controller.velocity_feed_forward_V_s_per_m": 9.6, "controller.acceleration_feed_forward_V_s2_per_m": 0.05},
        {"controller.notch_Hz": 27.0},
        {"controller.structure": "cascade", "controller.velocity_gain_V_s_per_m": 1.0},
        {"controller.pressure_feedback_V_per_Pa": 6e-8},
        {"load.moving_mass_kg": 500.0},
        {"valve.edge_rounding_m": 0.0},
    ),
    ids=("P", "PI", "PID", "feed-forward", "notch", "cascade", "pressure feedback", "500 kg", "sharp edges"),
)
def test_a_bench_on_a_four_way_valve_has_an_eighth_of_plain_controls_bump(changes):
    """0.05 m at 0.5 Hz, nothing learned before, on top of each controller."""
    assert bump("adaptive", changes) < bump("none", changes) / 8


@pytest.mark.slow
def test_a_servo_hexapod_in_heave_has_an_eighth_of_plain_controls_bump():
    """As the bench, six legs."""
    assert bump("adaptive", {}, name="servo_hexapod") < bump("none", {}, name="servo_hexapod") / 8


@pytest.mark.slow
def test_a_servo_hexapod_in_roll_has_a_sixth_of_plain_controls_bump():
    """Legs 3 and 6 hardly move themselves. A pressure step spread over 3 ms left 1/5.6."""
    assert bump("adaptive", {}, "roll", "servo_hexapod") < bump("none", {}, "roll", "servo_hexapod") / 6


def test_the_step_of_a_heavy_load_on_a_four_way_valve_is_narrow():
    """0.5 m/s2 of step and 0.5 m/s2 of acceleration: friction's sign goes over within 1 ms and presliding, not 3 ms."""
    state = state_of(1.0)
    friction, reference = state.friction, state.reference
    friction.windows[:], friction.half_step_Pa, friction.fit.theta[1] = 50, 5e4, 0.2
    reference.acceleration_m_s2 = 0.5
    width_m_s = 0.5 * 1e-3 + state.settings.presliding_m_s
    for velocity, whole in ((0.99 * width_m_s, False), (1.01 * width_m_s, True), (-1.01 * width_m_s, True)):
        reference.velocity_m_s = velocity
        sign = demanded_pressure(reference, friction, 1.0, state.settings)[3]
        assert (sign == math.copysign(1.0, velocity)) is whole


def test_the_drops_asked_for_follow_a_low_passed_supply():
    """White noise of the supply's transducer reaches the drops through the low-pass alone."""
    state = state_of(1.0)
    measure_pressures(state.chambers, 8e6, 8e6, SUPPLY + 1e5)
    _, equivalent = equivalent_Pa(state.settings, 8e6, 8e6, SUPPLY)
    state.reference.position_m = 0.3
    roots = roots_ahead(state.chambers, state.settings, state.reference, 0.3, 0.5 * TANK, equivalent, True, 0)
    assert roots[1] == pytest.approx(pair_roots(state.settings, 0.3, 8e6, 8e6, SUPPLY)[1], rel=1e-9)


def test_two_directions_of_one_spool_may_differ_by_half_a_millisecond_on_a_four_way_valve():
    """0.8 V of overlap and 0.07 m/s/V: 28 um of oil at a crossing. On a three-way valve 15 um are the most."""
    valve = state_of(1.0).valve
    for edge, lag_s in zip(valve.edges, (3.0e-3, 3.5e-3), strict=True):
        edge.gain_m_s_V, edge.dead_band_V, edge.lag_s = 0.07, 0.4, lag_s
        for fit in (edge.plain_fit, edge.backlash_fit):
            fit.theta[0], fit.theta[2] = 0.07, 0.07 * lag_s
    assert lags_agree(valve)
    valve.edges[1].lag_s = 4.0e-3
    assert not lags_agree(valve)
    valve.edges[1].lag_s, valve.four_way = 3.5e-3, False
    assert not lags_agree(valve)


@pytest.mark.slow
def test_an_overlap_of_20_um_on_a_four_way_valve_is_compensated():
    """0.4 V on either side: to a third. Two lags that differ by the load kept it from engaging before."""
    assert bump("adaptive", {"valve.overlap_m": 2e-5}) < bump("none", {"valve.overlap_m": 2e-5}) / 3
