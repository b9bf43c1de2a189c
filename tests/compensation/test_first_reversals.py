"""What keeps the first compensated reversals no worse than plain control's, and quick to learn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bristles import length_found_m
from designs import usual
from leg_plant import sine
from pair_plant import PairLeg, run_pair

from compensation import Context
from compensation.adaptive import Adaptive
from compensation.adaptive.checks import plain_valve_told
from compensation.adaptive.friction import TYPICAL_STRIBECK, add_to_friction, start_friction, stribeck_share
from compensation.adaptive.inverse import advance_inverse
from compensation.adaptive.layout import FRICTION, LEARNED, MONITOR, PRESLIDING, STRIBECK, VALVE
from compensation.adaptive.monitor import start_monitor, worse_than_baseline, worth_compensating, worth_crossing
from compensation.adaptive.presliding import restore_presliding
from compensation.adaptive.stribeck import MOST_WEIGHT, add_to_stribeck, hold_step, update_stribeck
from compensation.adaptive.stroke import far_from_reversal
from compensation.adaptive.valve import crossing_in_time
from compensation.records import empty


def test_a_wide_overlap_is_crossed_by_the_dead_band_volts_alone() -> None:
    """0.4 V of overlap, edges rounded by 0.04 V, flow that reverses within a tick: no tick asks for volts against the side
    that its flow goes to. The tick of the crossing had up to 0.2 V of them."""
    numbers = Adaptive().start(Context(four_way=True, area_top_m2=1.2566e-3)).numbers
    valve, inverse = numbers.valve, numbers.inverse
    for edge in valve.edges:
        edge.dead_band_V, edge.gain_m_s_V = 0.4, 0.07
    numbers.trim.rounding_V = 0.04
    for k in range(60):
        advance_inverse(
            inverse, 0.25 * ((k - 30.3) * 0.002) ** 2, (1.0, 1.0), valve, numbers.trim, numbers.crossing_path, 0.0
        )
        flow_m_s = inverse.flows_m_s[0]
        assert inverse.flow_V[2] - inverse.crossing_V[0] == pytest.approx(0.0) or inverse.flow_V[2] * flow_m_s > 0.0


def test_slow_reversals_tell_stribeck_friction_better() -> None:
    """20 kPa missing after ten reversals: the next one at 0.1 m/s2 tells half of it, at 0.5 m/s2 a tenth. With a tenth at
    any speed the 600 kg machine still had 0.07 m/s2 after eight reversals at 0.1 m/s2."""
    for acceleration, part in ((0.1, 0.5), (0.5, 0.1)):
        stribeck, t = empty(STRIBECK), (np.arange(61) - 30) * 0.002
        stribeck.tick_s, stribeck.reversals, stribeck.most_weight, stribeck.ticks = 0.002, 10, MOST_WEIGHT, 100
        for v in acceleration * t:
            share = math.copysign(stribeck_share(float(v), 5e-3), v)
            if add_to_stribeck(stribeck, float(v), 2e4 * share, 0.0, share):
                update_stribeck(stribeck, 8e4, 1e6)
        assert stribeck.pressure_Pa == pytest.approx(part * 2e4, rel=0.05)


def test_what_reversals_told_is_held_while_windows_find_the_half_step() -> None:
    """At a reversal half step and Stribeck friction act together. Windows that take 5 kPa off the half step add what makes the
    same, within its bounds, and nothing before the first reversal."""
    stribeck = empty(STRIBECK)
    stribeck.pressure_Pa = 1e4
    hold_step(stribeck, -5e3, 1e5)
    assert stribeck.pressure_Pa == 1e4
    stribeck.at_rest = 2.0
    hold_step(stribeck, -5e3, 1e5)
    assert stribeck.pressure_Pa == pytest.approx(2e4)
    hold_step(stribeck, 2e4, 1e5)
    assert stribeck.pressure_Pa == 0.0


def test_slow_windows_begin_with_typical_stribeck_friction_at_most() -> None:
    """A position that reads late shows as 100 kPa of Stribeck friction beside a half step of 50 kPa: the first reversal begins
    with half of the step. With all of it its bump was beyond plain control's."""
    rng, friction, t = np.random.default_rng(0), usual(FRICTION), np.arange(9000) * 0.002
    start_friction(friction, 0.002, 0.2, 16, 3e-3, 200.0)
    w = 2 * math.pi * 0.5
    y, v = 0.1 + 0.02 * np.sin(w * t), 0.02 * w * np.cos(w * t)
    load = np.sign(v) * (5e4 + 1e5 * np.exp(-np.abs(v) / 5e-3)) + rng.normal(0, 4e3, len(t))
    for row in zip(y, load, -w * w * (y - 0.1), strict=True):
        add_to_friction(friction, *map(float, row))
    assert friction.stribeck.pressure_Pa <= 1.1 * TYPICAL_STRIBECK * friction.half_step_Pa


@pytest.mark.parametrize(("reversal_m_s2", "worth"), [(0.0, True), (0.5, True), (0.04, False)])
def test_gentle_motion_is_worth_less(reversal_m_s2: float, worth: bool) -> None:
    """Bumps of 0.15 m/s2 are worth compensating, where they are told by reversals of 0.5 m/s2 and not of 0.04: windows that
    slow took a load of 160 kg for 480 kg, and its first reversals were 1.8 times plain control's."""
    monitor = empty(MONITOR)
    start_monitor(monitor, 0.002, 0.0)
    monitor.baseline_m_s2[:], monitor.reversal_m_s2[:] = 0.15, reversal_m_s2
    assert worth_compensating(monitor, 0.33, False, 0.0) == worth


def test_one_small_bump_does_not_keep_a_leg_of_a_platform_waiting() -> None:
    """Bumps of 0.9 and then 0.1 m/s2: a platform's leg, which is told its load, is still worth compensating by their mean of 0.5;
    a leg alone is not."""
    monitor = empty(MONITOR)
    start_monitor(monitor, 0.002, 0.0)
    for reversal_m_s2, bump_m_s2 in ((0.5, 0.9), (0.1, 0.1)):
        for shaken in (monitor.piston, monitor.off):
            shaken.low_m_s2, shaken.high_m_s2 = 0.0, bump_m_s2
        worse_than_baseline(monitor, False, reversal_m_s2, 0.0)
    assert [worth_compensating(monitor, 4.0, told, 0.0) for told in (True, False)] == [True, False]


@pytest.mark.parametrize(("change", "plain"), [({}, True), ({"null_V": 0.01}, False), ({"leak_m_s": 1e-3}, False)])
def test_a_leak_that_no_reversal_told_is_no_reason_to_wait(change: dict[str, float], plain: bool) -> None:
    """Edges at 45 mV to either side of zero: a leak would have to undo a null offset just so, and a platform's leg engages without
    having seen one. Off zero, or with a leak that was found, it waits; and so does a leg alone, and one whose edges are rounded."""
    numbers = Adaptive().start(Context()).numbers
    numbers.reference.load_given = 2
    for edge in numbers.valve.edges:
        edge.plain_fit.theta[:3] = 0.15, 0.15 * 0.045, 0.0
    for name, value in change.items():
        numbers.valve[name] = value
    assert plain_valve_told(numbers) == plain
    numbers.rounding.square_V2 = 9e-4
    assert not plain_valve_told(numbers)
    numbers.rounding.square_V2, numbers.reference.load_given = 0.0, 1
    assert not plain_valve_told(numbers)


@pytest.mark.parametrize(
    ("velocity_m_s", "acceleration_m_s2", "far"), [(0.06, -0.1, 1), (0.04, -0.1, 0), (0.04, 0.1, 1), (1e-3, 0, 0)]
)
def test_a_leg_engages_late_in_a_stroke_if_its_speed_outlasts_the_ramp(velocity_m_s, acceleration_m_s2, far) -> None:
    """A ramp of 0.5 s, in which 0.1 m/s2 take 0.05 m/s off: 0.06 m/s is enough and 0.04 is not, but for a leg that speeds up; the
    same the other way round. One that hardly moves is near its reversal."""
    numbers = Adaptive().start(Context()).numbers
    engagement = numbers.engagement
    engagement.half_ticks, engagement.ramp_step = 700, 1.0 / 250
    for sign in (1.0, -1.0):
        engagement.acceleration_m_s2 = sign * acceleration_m_s2
        assert far_from_reversal(numbers, sign * velocity_m_s) == far


@pytest.mark.parametrize(("resonance_Hz", "bumps_m_s2", "worth"), [(38.0, (0.85, 1.7), 0), (26.0, (0.85, 0.6), 1)])
def test_a_light_load_is_not_moved_across_an_overlap(resonance_Hz, bumps_m_s2, worth) -> None:
    """17 um of oil too much and too little are 0.97 m/s2 to a load at 38 Hz (120 kg), more than the smaller of plain control's
    bumps, and 0.45 m/s2 at 26 Hz (250 kg). The light one had five reversals of 22 up to 1.3 times plain control's."""
    monitor = empty(MONITOR)
    monitor.least_m_s2[:] = bumps_m_s2
    assert worth_crossing(monitor, resonance_Hz) == worth


def test_last_bumps_that_are_large_by_chance_do_not_cross_an_overlap() -> None:
    """Bumps of 0.3 and then 1.2 m/s2 in irregular motion, either direction: a load at 38 Hz stays with plain control, of whose
    reversals 12 of 38 became worse in such a run. After eight of 1.2 m/s2, as in a sine, it is worth it."""
    monitor = empty(MONITOR)
    start_monitor(monitor, 0.002, 0.0)
    found = []
    for bump_m_s2 in (0.3, *8 * (1.2,)):
        for extending in (False, True):
            monitor.piston.low_m_s2 = monitor.off.low_m_s2 = 0.0
            monitor.piston.high_m_s2 = monitor.off.high_m_s2 = bump_m_s2
            worse_than_baseline(monitor, extending, 0.5, 0.0)
        found.append(worth_crossing(monitor, 38.0))
    assert found[1] is False
    assert found[-1] is True


def test_a_four_way_valve_engages_after_its_rounding_is_told() -> None:
    """5 um of overlap, 250 kg: the leak was found anew three times, no reversal told the rounding of the edges, and compensation
    with sharp ones left 0.34 of 0.71 m/s2, two reversals worse than without. Now less than a fifth."""
    record = run_pair(Adaptive(), PairLeg(overlap_m=5e-6), sine(0.05, 0.5), 24.0, period_s=2.0, seed=9713)
    assert record.peaks(2.0)[-3:].max() < 0.71 / 5.0


@pytest.mark.parametrize(
    ("overlap_V", "lag_s", "left"), [(0.4, 7.2e-3, True), (0.4, 3.3e-3, False), (0.1, 9e-3, False)]
)
def test_an_overlap_both_wide_and_late_is_left_alone(overlap_V: float, lag_s: float, left: bool) -> None:
    """20 um of a four-way valve are 0.4 V on either side. On a three-way valve nothing is left alone for it."""
    valve = usual(VALVE)
    valve.lag_s, valve.four_way = lag_s, 1
    for edge in valve.edges:
        edge.dead_band_V = overlap_V
    assert crossing_in_time(valve) == (not left)
    valve.four_way = 0
    assert crossing_in_time(valve)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("length_m", [0.0, 8e-6, 20e-6])
def test_short_bristles_of_a_heavy_leg_are_told_by_its_first_reversals(length_m: float, seed: int) -> None:
    """160 kg, for which 3 um of noise is 4 times as much as for 40 kg, 50 kPa of half step fed all at once, 4 kPa of noise:
    five reversals at 0.5 m/s2 tell bristles of 8 and 20 um, to a half of their length (1.2 and 1.3 of the bank's steps), and
    twenty no bristles where there are none."""
    found_m = length_found_m(length_m, 1.27e5, 5 if length_m else 20, seed)
    assert found_m == pytest.approx(length_m, rel=0.5)


@pytest.mark.parametrize(
    ("misfit", "evidence", "found"),
    [
        (1.0, 11.0, False),
        (1.0, 13.0, True),
        (4.0, 40.0, False),
        (4.0, 44.0, True),
        (7.0, 58.0, False),
        (7.0, 62.0, True),
    ],
)
def test_what_bristles_leave_unexplained_asks_for_more_evidence(misfit: float, evidence: float, found: bool) -> None:
    """Bristles of 20 um leave `misfit` times the noise of eight reversals, none `evidence` times that more: 12 are enough
    where they explain all, 42 where they leave four times the noise, 60 are always enough."""
    known, p = empty(LEARNED).presliding, usual(PRESLIDING)
    known.weight, known.shapes[:] = 30.0, 1.0
    known.squares[:] = 30.0 * misfit + misfit * evidence
    known.squares[5] = 30.0 * misfit
    restore_presliding(p, known, 5e4)
    assert (p.length_m > 0.0) == found
