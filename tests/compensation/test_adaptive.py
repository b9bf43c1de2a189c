"""The algorithms beyond the report: what they learn, how well they do, and that they let well alone."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from designs import crossing_lead, crossing_path, damping_filter, lead, step_response, tick_response, usual
from leg_plant import AREA_BOTTOM, Leg, run, sine
from leg_plant import Record as Run

import compensation
from compensation import Context
from compensation.adaptive import Adaptive, AdaptiveState
from compensation.adaptive.delay import SPOOL_LAGS_S
from compensation.adaptive.edge_rounding import (
    add_to_rounding,
    disturb_rounding,
    explains_reversals,
    lower_bound_V,
    opening,
    rounding_correction_V,
    start_rounding,
    upper_bound_V,
)
from compensation.adaptive.engagement import PHASES, begin_judging
from compensation.adaptive.feedback import damping
from compensation.adaptive.friction import add_to_friction, start_friction, stribeck_share
from compensation.adaptive.layout import (
    FIT,
    FRICTION,
    LATES,
    LEAD_TICKS,
    LEAK,
    MONITOR,
    PATH_BEFORE,
    PATH_FINE,
    REFERENCE,
    ROUNDING,
    STRIBECK,
    TRIM,
    VALVE,
)
from compensation.adaptive.leak import start_leak
from compensation.adaptive.monitor import add_to_monitor, start_monitor, worse_than_baseline
from compensation.adaptive.null import recentre
from compensation.adaptive.recursive_least_squares import inflate, start_fit, update_fit
from compensation.adaptive.reference import advance_reference
from compensation.adaptive.spool import blocked_flow
from compensation.adaptive.stribeck import add_to_stribeck, update_stribeck
from compensation.adaptive.valve import add_to_valve, lags_agree, start_valve
from compensation.adaptive.valve_edge import MAX_DEAD_BAND_V, start_edge, update_edge
from compensation.records import Record, empty
from compensation.spool_model import set_spool_model

ALL_SPOOL = [1e3] * (LATES * (len(SPOOL_LAGS_S) - 1)) + [0.0] * LATES  # sums that tell of no delay
DEAD_BAND_V = 5e-6 / 1.1e-4  # 5 um of 1.1 mm at 10 V


@pytest.fixture(scope="module")
def plain() -> Run:
    """The 40 kg leg, uncompensated."""
    return run(compensation.create("none"), duration_s=10.0)


@pytest.fixture(scope="module")
def adapted() -> Run:
    """The same leg, the adaptive algorithm starting from nothing."""
    return run(compensation.create("adaptive"), duration_s=24.0)


def valve_gain_m_s_V(leg: Leg) -> float:
    """Velocity gain of one edge at half the supply pressure, Eq. 3.4 over A1."""
    speed = math.pi / (math.pi + 2) * math.sqrt(2 * 3.5e6 / leg.density_kg_m3)
    return math.pi * 0.01 * 1.1e-4 * speed / AREA_BOTTOM


def fit_of(*start: Any, **options: Any) -> Record:
    """A fit that has seen nothing."""
    fit = empty(FIT)
    start_fit(fit, *start, **options)
    return fit


def reference_of(loop_1_s: float, dead_band_m: float = 0.0, feed_forward: float = 0.0) -> Record:
    """A reference at 500 Hz, alike in both directions."""
    reference = empty(REFERENCE)
    reference.tick_s, reference.feed_forward = 0.002, feed_forward
    reference.loop_1_s[:], reference.dead_band_m[:] = loop_1_s, dead_band_m
    return reference


def valve_unknown() -> Record:
    """A valve of which nothing is known."""
    flow = usual(VALVE)
    start_valve(flow, 0.002, 16, 3e-3, 10, 200.0)
    return flow


def test_least_squares_is_the_batch_solution() -> None:
    """Without forgetting the recursion gives the regularised batch solution, to 1e-9."""
    rng = np.random.default_rng(0)
    phi = rng.normal(0, 1, (200, 3))
    y = phi @ [0.5, -2.0, 3.0] + rng.normal(0, 0.1, 200)
    fit = fit_of((0.0, 0.0, 0.0), (10.0, 10.0, 10.0), math.inf)
    for row, value in zip(phi, y, strict=True):
        update_fit(fit, row, float(value))
    batch = np.linalg.solve(phi.T @ phi + np.eye(3) / 100, phi.T @ y)
    assert fit.theta[:3] == pytest.approx(batch, abs=1e-9)
    assert fit.residual == pytest.approx(0.01, rel=0.5)  # the noise's variance, from 50 samples


def test_least_squares_keeps_within_its_first_belief() -> None:
    """10^5 samples that excite one direction only leave the other's spread where it was: no wind-up."""
    fit = fit_of((0.0, 0.0), (10.0, 10.0), 50.0)
    for _ in range(100_000):
        update_fit(fit, np.array([1.0, 0.0]), 1.0)
    assert fit.covariance[1][1] <= 100.0 * (1 + 1e-9)
    assert fit.theta[1] == 0.0


def test_directional_forgetting_keeps_what_no_new_data_tell_of() -> None:
    """10^4 samples of another direction leave a coefficient and its spread where rich data had brought them, within
    1 %; exponential forgetting would let the spread grow back to its start."""
    rng = np.random.default_rng(0)
    spreads = {}
    for directional in (True, False):
        fit = fit_of((0.0, 0.0), (10.0, 10.0), 50.0, directional=directional)
        for _ in range(500):
            phi = rng.normal(0, 1, 2)
            update_fit(fit, phi, float(phi @ [1.0, 2.0]))
        known = fit.covariance[1][1]
        for _ in range(10_000):
            update_fit(fit, np.array([1.0, 0.0]), 1.0)
        assert fit.theta[1] == pytest.approx(2.0, abs=1e-2)
        spreads[directional] = fit.covariance[1][1] / known
    assert spreads[True] == pytest.approx(1.0, rel=0.01)
    assert spreads[False] > 100.0


def test_inflating_frees_one_direction_only() -> None:
    """After 100 rich samples: the parameter's variance grows by what is asked for, what hangs on it along with it, and
    what does not hang on it stays as it is; never beyond the first belief."""
    rng = np.random.default_rng(0)
    fit = fit_of((0.0,) * 3, (10.0,) * 3, 1000.0)
    for _ in range(100):
        shared, own = rng.normal(0, 1, 2)
        update_fit(fit, np.array([shared, shared + 0.1 * rng.normal(), own]), 0.0)
    before = fit.covariance[:3, :3].copy()
    inflate(fit, 0, 0.5)
    after = fit.covariance[:3, :3].copy()
    assert after[0, 0] - before[0, 0] == pytest.approx(0.5)
    assert after[1, 1] - before[1, 1] == pytest.approx(0.5, rel=0.1)
    assert after[2, 2] - before[2, 2] < 0.01
    inflate(fit, 0, 1e3)
    assert fit.covariance[:3, :3] == pytest.approx(after)


def test_reference_engages_with_the_motion_of_plain_control(plain) -> None:
    """With the leg's own gain and dead band, g = 0: within 1.2 mm of where plain control takes the leg, which is 20 mm
    behind the setpoint."""
    loop, dead = 50 * valve_gain_m_s_V(Leg()), DEAD_BAND_V / 50
    reference = reference_of(loop, dead)
    wanted = sine()(plain.time_s)
    made = []
    for i in range(1, len(wanted) - 1):
        advance_reference(reference, *map(float, wanted[i - 1 : i + 2]))
        made.append(float(reference.position_m))
    assert np.abs(np.array(made) - plain.position_m[1:-1])[1000:].max() < 1.2e-3


class Phases(Adaptive):
    """Adaptive whose status is the phase of its engagement."""

    def status(self, state: AdaptiveState) -> str:
        return PHASES[state.numbers.engagement.phase]


def test_it_engages_and_disengages_phase_by_phase() -> None:
    """0.5 Hz, and from 12 s on 0.1 Hz, which is too slow: the phases of the table in their order. Nothing is added
    before and after; the first volts and the last are below 5 mV, so that neither transfer is a step."""

    def slower(t: np.ndarray) -> np.ndarray:
        angle = np.where(t < 12.0, math.pi * t, 12.0 * math.pi + 0.2 * math.pi * (t - 12.0))
        return 0.1 + 0.05 * np.sin(angle) * np.minimum(t / 2.0, 1.0)

    record = run(Phases(), setpoint=slower, duration_s=40.0)
    assert [phase for _, phase in record.statuses] == [
        "plain control", "engaging", "compensated", "feed-forward going out", "disengaging", "plain control",
    ]  # fmt: skip
    begin, end = (round(500 * record.statuses[i][0]) for i in (1, 5))
    acting = np.flatnonzero(record.added_V)
    assert begin <= acting[0] <= begin + 1
    assert end - 3 <= acting[-1] <= end
    assert np.abs(record.added_V[acting[[0, -1]]]).max() < 5e-3


def test_it_trips_on_a_worse_reversal(adapted) -> None:
    """A spool taken for 4 ms slower than it is and not learned anew: after the first worse reversal the phase is tripped, and within
    a quarter of a second plain control; it engages again after the lockout of 4 s."""
    made = Phases(learn=False)
    parameters = made.parameters(adapted.state.inner)
    for edge in ("retract", "extend"):
        parameters["flow"][edge]["lag_s"] += 4e-3
    parameters["delay"]["sums"] = ALL_SPOOL
    record = run(made, duration_s=20.0, state=made.restore(Context(), parameters))
    phases = [phase for _, phase in record.statuses]
    trip = phases.index("tripped")
    assert phases[:trip] == ["plain control", "engaging", "compensated"]
    assert phases[trip + 1] == "plain control"
    assert record.statuses[trip + 1][0] - record.statuses[trip][0] <= 0.26
    assert phases[trip + 2] == "engaging"
    assert record.statuses[trip + 2][0] - record.statuses[trip][0] >= 4.0


@pytest.mark.parametrize("frequency_Hz", [0.5, 2.0])
def test_worse_reversals_are_seen_from_positions(frequency_Hz) -> None:
    """A sine with 3.1 um of noise, and the same with an acceleration of +-0.6 m/s2 for 30 ms each way: its range of
    1.2 m/s2 is seen within 0.5, and is worse; without it no half stroke of fifty is."""
    tick, noise, rng = 0.002, 3.1e-6, np.random.default_rng(0)
    half = round(0.5 / frequency_Hz / tick)
    pulse = 0.6 * np.repeat([1.0, -1.0], 15)
    bump = np.r_[np.zeros(half // 2), np.cumsum(np.cumsum(pulse)) * tick**2]
    bump = np.r_[bump, np.full(half, bump[-1])][:half]
    monitor, worse, ranges = empty(MONITOR), [], []
    start_monitor(monitor, tick, noise)
    for stroke in range(60):
        t = (stroke * half + np.arange(half)) * tick
        reference = 0.005 * np.sin(2 * math.pi * frequency_Hz * t)
        y = reference + rng.normal(0, noise, half) + (bump if stroke == 58 else bump[-1] if stroke > 58 else 0.0)
        for value, asked in zip(y, reference, strict=True):
            add_to_monitor(monitor, float(value), float(asked - value))
        ranges.append(monitor.piston.high_m_s2 - monitor.piston.low_m_s2)
        worse.append(worse_than_baseline(monitor, stroke % 2 == 0, 0.1, 0.0 if stroke < 8 else 1.0))
    assert worse[58]
    assert not any(worse[:58])
    assert ranges[58] - np.median(ranges[8:58]) == pytest.approx(1.2, abs=0.5)


@pytest.mark.parametrize(("bump_m_s2", "worse"), [(0.0, False), (0.6, True)])
def test_a_rough_motion_that_the_piston_follows_is_no_bump(bump_m_s2, worse) -> None:
    """A baseline of 0.3 m/s2 in a smooth motion; then rough air, 1 m/s2 at 6 Hz, which the piston follows to its noise of
    3.1 um: not worse. With +-0.6 m/s2 for 30 ms each way beside it, it is."""
    tick, rng, monitor = 0.002, np.random.default_rng(0), empty(MONITOR)
    start_monitor(monitor, tick, 3.1e-6)
    monitor.baseline_m_s2[:], monitor.reversal_m_s2[:] = 0.3, 0.5
    t = tick * np.arange(500)
    asked = 1.0 / (12 * math.pi) ** 2 * np.sin(12 * math.pi * t)
    pulse = np.r_[np.zeros(200), np.repeat([bump_m_s2, -bump_m_s2], 15), np.zeros(270)]
    piston = asked + np.cumsum(np.cumsum(pulse)) * tick**2 + rng.normal(0, 3.1e-6, len(t))
    for y, y_m in zip(piston, asked, strict=True):
        add_to_monitor(monitor, float(y), float(y_m - y))
    assert monitor.piston.high_m_s2 - monitor.piston.low_m_s2 > 1.5
    assert worse_than_baseline(monitor, True, 0.5, 1.0) is worse


def test_stribeck_friction_is_found_without_differentiating() -> None:
    """A load moved through a reversal at 0.5 m/s2 by pressures with 20 kPa of Stribeck friction missing, 30 um of
    oscillation at 40 Hz and transducer noise: after 40 reversals it is found within 3 kPa."""
    rng = np.random.default_rng(0)
    stribeck, p1, t = empty(STRIBECK), 8e4, (np.arange(61) - 30) * 0.002
    stribeck.tick_s = 0.002
    for _ in range(40):
        v = 0.5 * t
        share = np.sign(v) * [stribeck_share(float(x), 5e-3) for x in v]
        swing, phase = 2 * math.pi * 40.0, rng.uniform(0, 2 * math.pi)
        ahead = 3e-5 * np.sin(swing * t + phase)
        surplus = (2e4 - stribeck.pressure_Pa) * share - p1 * swing**2 * ahead + rng.normal(0, 4e3, len(t))
        ahead = ahead + rng.normal(0, 3e-6, len(t))
        for row in zip(v, surplus, ahead, share, strict=True):
            if add_to_stribeck(stribeck, *map(float, row)):
                update_stribeck(stribeck, p1, 1e6)
        stribeck.direction = 0.0
    assert stribeck.pressure_Pa == pytest.approx(2e4, abs=3e3)


def test_a_piston_at_rest_tells_nothing_of_stribeck_friction() -> None:
    """A reference that trembles by micrometres while the piston sticks, 100 kPa off: nothing is learned; one reversal that
    is 300 kPa off moves what ten have told by 3 kPa, a tenth of three of its errors."""
    stribeck, t = empty(STRIBECK), (np.arange(61) - 30) * 0.002
    stribeck.tick_s, stribeck.reversals, stribeck.pressure_Pa = 0.002, 10, 2.4e4
    for acceleration, off, expected in ((1e-3, 1e5, 2.4e4), (0.5, 3e5, 2.7e4)):
        stribeck.ticks = 100  # the last reversal is long ago
        for v in acceleration * t:
            share = math.copysign(stribeck_share(float(v), 5e-3), v)
            if add_to_stribeck(stribeck, float(v), off * share, 0.0, share):
                update_stribeck(stribeck, 8e4, 1e6)
        assert stribeck.pressure_Pa == pytest.approx(expected, abs=1.0)
        stribeck.direction = 0.0


def test_a_first_reversal_tells_all_of_stribeck_friction() -> None:
    """A heavy load whose friction is 100 kPa off at its first reversal: it is learned within 1 kPa at once. Bounded, as what is
    known is, it took ten reversals."""
    stribeck, t = empty(STRIBECK), (np.arange(61) - 30) * 0.002
    stribeck.tick_s = 0.002
    stribeck.ticks = 100  # no reversal before
    for v in 0.5 * t:
        share = math.copysign(stribeck_share(float(v), 5e-3), v)
        if add_to_stribeck(stribeck, float(v), 1e5 * share, 0.0, share):
            update_stribeck(stribeck, 8e4, 1e6)
    assert stribeck.pressure_Pa == pytest.approx(1e5, abs=1e3)


def test_the_controllers_own_pressure_feedback_takes_the_place_of_the_damping() -> None:
    """80 1/s at 7e-11 m/Pa through a gain of 0.15 m/s/V are 37 nV/Pa: 0.5 V of what oscillates at 1e7 Pa, less what 25
    nV/Pa of the controller give; none is left where those are 50."""
    state = Adaptive().start(Context()).numbers
    state.valve.edges[0].gain_m_s_V = state.valve.edges[1].gain_m_s_V = 0.15
    state.settings.damping_max_V, state.deviation_Pa[:] = 10.0, 0.0
    state.damping_taps[0], state.deviation_Pa[0] = 1.0, 1e7
    for own, expected in ((0.0, 5.6e-9 / 0.15), (2.5e-8, 5.6e-9 / 0.15 - 2.5e-8), (5e-8, 0.0)):
        state.settings.pressure_gain_V_per_Pa, state.damping_gain = own, 1.0
        assert damping(state, 80.0 * 7e-11, (1.0, 1.0)) == pytest.approx(1e7 * expected, rel=1e-9)


def test_reference_without_feed_forward_is_the_loop_with_a_straight_valve() -> None:
    """g = 0: the lag at 0.5 Hz is that of s Kp / (p + s Kp), within 0.1 %; g = 1: it vanishes."""
    tick, loop, w = 0.002, 7.6, math.pi
    t = np.arange(6000) * tick
    r = np.sin(w * t)
    for share, wanted in ((0.0, abs(1j * w / (1j * w + loop))), (1.0, 0.0)):
        reference = reference_of(loop, feed_forward=share)
        lags = []
        for i in range(1, 5999):
            advance_reference(reference, *map(float, r[i - 1 : i + 2]))
            lags.append(float(reference.lag_m))
        assert max(lags[3000:]) == pytest.approx(wanted, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize(("lag_s", "most"), [(0.0, 0.12), (2e-3, 0.12), (3.7e-3, 0.12), (8e-3, 0.3)])
def test_lead_undoes_the_spool(lag_s, most) -> None:
    """Lead, then spool: a tick's pulse comes back LEAD_TICKS ticks later with less than 12 % elsewhere (30 % for
    a spool as slow as 28 Hz: ten taps are too few), and nothing at rest."""
    taps = np.array(lead(lag_s, 0.002, 1e-4))
    through = np.convolve(taps, tick_response(lag_s, 0.002, 40))
    through[LEAD_TICKS] -= 1.0
    assert taps.sum() == pytest.approx(1.0, abs=1e-9)
    assert np.abs(through).max() < most


def strayed(path: np.ndarray) -> float:
    """Area [ticks] that a path from -1 to 1 encloses beyond either end."""
    return float(np.maximum(np.abs(path) - 1.0, 0.0).sum()) / PATH_FINE


@pytest.mark.parametrize(("lag_s", "times"), [(2e-3, 6.0), (3.7e-3, 6.0), (7.4e-3, 4.0)])
def test_crossing_hardly_strays_from_the_overlap(lag_s, times) -> None:
    """The crossing's taps leave less than a sixth (a quarter for a spool of 30 Hz) of the oil beyond the overlap that the
    lead's, made for the flow, would; three ticks before and five after it stands where it is to, within 4 %,
    and its middle is within 0.6 ms of the tick asked for."""
    path = np.array(crossing_path(lag_s, 0.002))
    t = (np.arange(len(path)) + 0.5) * 0.002 / PATH_FINE - PATH_BEFORE * 0.002
    taps = lead(lag_s, 0.002, 1e-4)
    by_lead = 2.0 * sum(h * step_response(t + (LEAD_TICKS - i) * 0.002, lag_s) for i, h in enumerate(taps)) - 1.0
    assert strayed(path) < strayed(by_lead) / times
    assert path[0] == pytest.approx(-1.0, abs=0.04)
    assert path[-1] == pytest.approx(1.0, abs=0.04)
    assert abs(t[np.argmax(path > 0.0)]) < 6e-4


def spool_model(lag_s: float, tick_s: float) -> list[float]:
    """The four numbers of one tick of the spool."""
    model = np.zeros(4)
    set_spool_model(model, lag_s, tick_s, 0.7)
    return model.tolist()


def test_crossing_path_is_what_the_spool_does() -> None:
    """The path is that of the spool's own equations driven with the crossing's taps, to 1e-6 of the step."""
    lag = 3.7e-3
    fine = 0.002 / PATH_FINE
    a, b, c, d = spool_model(lag, fine / 2)  # half a sample: the path's samples lie in the middle of theirs
    volts = np.repeat(np.cumsum([*crossing_lead(lag, 0.002), *[0.0] * 20]), 2 * PATH_FINE)
    x = rate = 0.0
    seen = []
    for u in volts:
        x, rate = x + a * (u - x) + b * rate, c * (u - x) + d * rate
        seen.append(x)
    first = (LEAD_TICKS - PATH_BEFORE) * 2 * PATH_FINE
    path = crossing_path(lag, 0.002)
    assert 2.0 * np.array(seen)[first : first + 2 * len(path) : 2] - 1.0 == pytest.approx(path, abs=1e-6)


@pytest.mark.parametrize("slope_V", [2e-3, 8e-3])
def test_flow_that_a_shut_valve_blocks(slope_V) -> None:
    """A spool that rests in the middle for a tick on either side of the reversal blocks slope/2 there, 0 before and
    after; the sign is that of the flow; a crossing in no time blocks nothing."""
    n = len(crossing_path(3.7e-3, 0.002))
    t = (np.arange(n) + 0.5) / PATH_FINE - PATH_BEFORE
    resting, at_once = np.where(np.abs(t) < 1.0, 0.0, np.sign(t)), np.sign(t)
    assert blocked_flow(resting, 0.0, slope_V, 0.05) == pytest.approx((-slope_V / 2, slope_V / 2), rel=1e-9)
    assert blocked_flow(at_once, 0.0, slope_V, 0.05) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_step_response_reaches_one_with_the_lag_as_its_area() -> None:
    """int (1 - s) dt is the lag: what 'lag' means here."""
    t = np.linspace(0, 0.2, 200_001)
    assert np.trapezoid(1 - step_response(t, 3.7e-3), t) == pytest.approx(3.7e-3, rel=1e-3)


@pytest.mark.parametrize("lag_s", [0.0, 2e-3, 3.7e-3])
def test_damping_opposes_the_pressure_between_20_and_60_hz(lag_s) -> None:
    """Taps, hold and spool together have a phase within 50 degrees of the pressure there, and pass nothing at
    rest.
    """
    taps = np.array(damping_filter(lag_s, 0.002, 15.0, 65.0, 7))
    assert taps.sum() == pytest.approx(0.0, abs=1e-12)
    for f in np.linspace(20, 60, 9):
        w = 2 * math.pi * f
        spool = 1 / (1 + 1j * w * lag_s - (w * lag_s / 1.4) ** 2) * np.exp(-1e-3j * w)
        through = spool * np.sum(taps * np.exp(-2e-3j * w * np.arange(7)))
        assert abs(np.angle(through, deg=True)) < 50
        assert abs(through) > 0.5


def test_rounding_trim_is_the_inverse_of_a_rounded_edge() -> None:
    """s log(1 + exp(x/s)) at x = v/k + c(v) is v/k again, to 1e-9, for v from 1e-4 m/s on."""
    s, k = 0.018, 0.15
    trim = empty(TRIM)
    trim.rounding_V = s
    for v in (1e-4, 1e-3, 3e-3, 1e-2):
        x = v / k + rounding_correction_V(trim, v, k, 10.0)
        assert s * math.log1p(math.exp(x / s)) == pytest.approx(v / k, abs=1e-9)


def rounding_unknown() -> Record:
    """Edges of which nothing is known."""
    rounding = usual(ROUNDING)
    start_rounding(rounding, False)
    return rounding


def valve_learned(lag_s: float, backlash_V: float = 0.0) -> Record:
    """A valve of 0.15 m/s/V and 0.09 V of half dead band, known but for what a test gets wrong."""
    flow = valve_unknown()
    for edge in flow.edges:
        edge.gain_m_s_V, edge.dead_band_V, edge.lag_s, edge.backlash_V, edge.ready = 0.15, 0.09, lag_s, backlash_V, True
    flow.lag_s = lag_s
    return flow


def passed(rounding: Record, flow: Record, rounding_V: float, backlash_V: float = 0.0, periods: int = 10) -> None:
    """0.3 V at 0.5 Hz through a valve with such edges and such backlash, its oil measured with 4 um of noise."""
    rng, z, follower, leak = np.random.default_rng(0), 0.0, 0.0, usual(LEAK)
    start_leak(leak)
    for i in range(1000 * periods):
        volts = 0.3 * math.sin(math.pi * i * 0.002)
        follower = min(max(follower, volts - backlash_V), volts + backlash_V)
        z += 0.15 * opening(follower, 0.09, rounding_V) * 0.002
        add_to_rounding(rounding, leak, z + rng.normal(0, 4e-6), volts, (1.0, 1.0), flow, 0.7)


def flow_seen(backlash_V: float, lag_s: float, amplitude_V: float, seconds: float, chatter_V: float = 0.0) -> Record:
    """What is learned of 0.15 m/s/V, 45 mV of half dead band, such a backlash and lag; sine at 0.5 Hz, 3.5 um of noise."""
    rng, flow = np.random.default_rng(1), valve_unknown()
    a, b, c, d = spool_model(lag_s, 0.002)
    z = follower = x = rate = 0.0
    for i in range(round(500 * seconds)):
        volts = amplitude_V * math.sin(math.pi * i * 0.002) + chatter_V * rng.normal()
        follower = min(max(follower, volts - backlash_V), volts + backlash_V)
        before, x, rate = x, x + a * (follower - x) + b * rate, c * (follower - x) + d * rate
        z += 0.15 * opening(0.5 * (before + x), 0.045, 0.0) * 0.002
        add_to_valve(flow, z + rng.normal(0, 3.5e-6), volts, 1.0)
    return flow


def test_backlash_and_lag_are_told_apart_soon() -> None:
    """25 mV of backlash and 3.7 ms of lag, large motion: after four periods the backlash is compensated, within 0.8 mV,
    the lag within 0.35 ms; were the windows gathered with another width to count in full, they would be 1.1 mV and
    0.4 ms off."""
    flow = flow_seen(0.025, 3.7e-3, 1.0, 8.0)
    assert flow.with_backlash
    for edge in flow.edges:
        assert edge.backlash_V == pytest.approx(0.025, abs=8e-4)
        assert edge.lag_s == pytest.approx(3.7e-3, abs=3.5e-4)


@pytest.mark.parametrize("amplitude_V", [0.15, 1.0])
def test_no_backlash_is_seen_where_there_is_none(amplitude_V) -> None:
    """Volts with 1 mV of chatter through a valve without backlash, 20 s: it is taken as one without, lag within 0.2 ms."""
    flow = flow_seen(0.0, 3.7e-3, amplitude_V, 20.0, 1e-3)
    assert not flow.with_backlash
    assert flow.lag_s == pytest.approx(3.7e-3, abs=2e-4)


def test_little_backlash_in_small_motion_is_not_taken_for_lag() -> None:
    """1.5 mV of backlash at 0.15 V passes for 3 ms of lag; until the fits agree it does not engage."""
    agreed = [flow_seen(1.5e-3, 2e-3, 0.15, seconds) for seconds in (4.0, 6.0, 8.0)]
    assert all(not lags_agree(flow) or abs(flow.lag_s - 2e-3) < 1.2e-3 for flow in agreed)
    assert any(abs(flow.lag_s - 2e-3) > 1.2e-3 for flow in agreed)  # so there is something to be told


@pytest.mark.parametrize("rounding_V", [0.0, 8e-3, 12e-3, 18e-3])
def test_rounding_is_found_from_slow_passages(rounding_V) -> None:
    """Ten periods of plain control's volts: the rounding within 1 mV, 0 for sharp edges; the valve is explained."""
    rounding = rounding_unknown()
    passed(rounding, valve_learned(0.0), rounding_V)
    assert lower_bound_V(rounding) == pytest.approx(rounding_V, abs=1e-3)
    assert lower_bound_V(rounding) <= upper_bound_V(rounding) < rounding_V + 5e-3
    assert explains_reversals(rounding)


def test_a_platforms_leg_needs_more_to_take_its_edges_as_rounded() -> None:
    """What is 3.5 standard errors of q off zero: rounded edges of a leg alone, sharp ones of a platform's, whose passages other
    legs disturb (5.5 mV were found on sharp edges); a four-way valve's bound stays."""
    alone, told, pair = rounding_unknown(), rounding_unknown(), usual(ROUNDING)
    start_rounding(pair, True)
    for rounding in (alone, told, pair):
        rounding.square_V2, rounding.variance_V4 = 3.5e-5, 1e-10
    disturb_rounding(alone, False)
    disturb_rounding(told, True)
    before_V = lower_bound_V(pair)
    disturb_rounding(pair, True)
    assert lower_bound_V(alone) > 4e-3 and lower_bound_V(told) == 0.0
    assert lower_bound_V(pair) == before_V > 4e-3


def test_a_wrong_backlash_is_seen_at_reversals() -> None:
    """Play of 20 mV taken as 13 mV and 4 ms of lag: windows beyond the overlap hardly tell them apart, reversals do."""
    right, wrong = rounding_unknown(), rounding_unknown()
    passed(right, valve_learned(0.0, 0.02), 0.0, 0.02)
    passed(wrong, valve_learned(4e-3, 0.013), 0.0, 0.02)
    assert explains_reversals(right)
    assert not explains_reversals(wrong)


def test_edges_of_one_spool_agree_on_its_lag() -> None:
    """0.18 V of overlap: lags 0.5 ms apart are agreed, 1 ms (27 um of oil at a crossing) are not; of a platform's leg, which
    others wait for, 0.8 ms are (22 um)."""
    flow = valve_learned(3e-3)
    flow.edges[1].lag_s = 3.5e-3
    assert lags_agree(flow)
    flow.edges[1].lag_s = 3.8e-3
    assert lags_agree(flow, True) and not lags_agree(flow)
    flow.edges[1].lag_s = 4e-3
    assert not lags_agree(flow, True) and not lags_agree(flow)


def test_friction_step_is_found_whatever_mass_and_viscosity() -> None:
    """Windows from P = p0 + 0.03 a + 1.5 v + 0.05 sign(v) [MPa] with 2 kPa noise give the step within 3 kPa."""
    context = Context()
    learner = usual(FRICTION)
    start_friction(learner, context.tick_s, context.stroke_m, 16, 3e-3, 200.0)
    rng = np.random.default_rng(0)
    t = np.arange(10_000) / 500
    y = 0.1 + 0.05 * np.sin(math.pi * t)
    v, a = 0.05 * math.pi * np.cos(math.pi * t), -0.05 * math.pi**2 * np.sin(math.pi * t)
    load = 1e6 * (0.3 + 0.03 * a + 1.5 * v + 0.05 * np.sign(v)) + rng.normal(0, 4e3, len(t))
    for row in zip(y, load, a, strict=True):
        add_to_friction(learner, *map(float, row))
    assert learner.half_step_Pa == pytest.approx(5e4, abs=3e3)


def sine_loads(seconds: float, coupled_Pa: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, pressure without noise and acceleration of a sine; another leg's load at 3 Hz in its last 5 s."""
    t = np.arange(round(500 * seconds)) / 500
    y, v, a = (0.05 * w * f(math.pi * t) for w, f in ((1, np.sin), (math.pi, np.cos), (-(math.pi**2), np.sin)))
    load = 1e6 * (0.3 + 0.03 * a + 1.5 * v + 0.05 * np.sign(v))
    return 0.1 + y, load + coupled_Pa * np.sin(6 * math.pi * t) * (t > seconds - 5.0), a


def test_windows_in_which_the_piston_turns_tell_nothing_of_friction() -> None:
    """Without noise, step and mass are exact within 0.2 % and 2 %: no window reaches over a reversal."""
    learner = usual(FRICTION)
    start_friction(learner, 0.002, 0.2, 16, 3e-3, 200.0)
    for row in zip(*sine_loads(20.0), strict=True):
        add_to_friction(learner, *map(float, row))
    assert learner.half_step_Pa == pytest.approx(5e4, rel=2e-3)
    assert learner.fit.theta[1] == pytest.approx(0.03, rel=0.02)


def test_load_from_other_legs_moves_the_fit_little() -> None:
    """40 kPa of load that is not the leg's, for 5 s: step within 5 %, mass within 25 %."""
    learner = usual(FRICTION)
    start_friction(learner, 0.002, 0.2, 16, 3e-3, 200.0)
    for row in zip(*sine_loads(20.0, 4e4), strict=True):
        add_to_friction(learner, *map(float, row))
    assert learner.half_step_Pa == pytest.approx(5e4, rel=0.05)
    assert learner.fit.theta[1] == pytest.approx(0.03, rel=0.25)


def test_it_finds_the_valve(adapted) -> None:
    """Dead band within 0.5 mV of 45.45, gain within 1 %, lag within 0.1 ms of 2 zeta/omega = 3.71 ms, both
    directions.
    """
    for edge in adapted.state.inner.numbers.valve.edges:
        assert edge.dead_band_V == pytest.approx(DEAD_BAND_V, abs=5e-4)
        assert edge.gain_m_s_V == pytest.approx(valve_gain_m_s_V(Leg()), rel=0.01)
        assert edge.lag_s == pytest.approx(1.4 / (2 * math.pi * 60), abs=1e-4)


def test_restored_parameters_serve_as_they_are(adapted) -> None:
    """What was learned, restored with learning off: the leg reaches its target of 0.05 m/s2."""
    made = compensation.create("adaptive", learn=False)
    state = made.restore(Context(), made.parameters(adapted.state))
    assert run(made, duration_s=16.0, state=state).peak(10.0, 16.0) <= 0.05


def test_armed_it_compensates_from_the_first_motion(adapted) -> None:
    """Restored, at rest for a second, then 0.05 m at 0.5 Hz at once: it is engaged before the motion begins, and in the
    first half stroke the piston is within 0.4 mm of the setpoint (5 mm before, while plain control began)."""
    made, begin = compensation.create("adaptive"), 1.0
    state = made.restore(Context(), made.parameters(adapted.state))

    def motion(time):
        return 0.1 + 0.05 * np.sin(np.pi * (time - begin)) * np.clip((time - begin) / 0.5, 0.0, 1.0) ** 3 * (
            time > begin
        )

    record = run(made, setpoint=motion, duration_s=2.5, state=state)
    first = (record.time_s > begin) & (record.time_s < 2.4)
    assert np.abs(record.position_m - motion(record.time_s))[first].max() < 4e-4
    assert not record.statuses


@pytest.mark.parametrize(
    ("change", "other"),
    [({}, False), ({"mass_kg": 50.0}, False), ({"overlap_m": 15e-6}, True), ({"leak_supply_m3_s_Pa": 2e-12}, True)],
)
def test_armed_on_another_machine_it_lets_go_before_the_first_reversal(adapted, change, other) -> None:
    """Restored on a leg with three times the overlap, or a leak: within the first half stroke (1 s from the first motion) the
    piston is further off the reference than where it was learned, and plain control acts. A quarter more mass is no other machine."""
    made, begin = compensation.create("adaptive"), 1.0
    state = made.restore(Context(), made.parameters(adapted.state))
    shape = lambda time: np.clip((time - begin) / 0.5, 0.0, 1.0) ** 3 * (time > begin)  # noqa: E731
    record = run(
        made, leg=Leg(**change), setpoint=lambda time: 0.1 + 0.05 * np.sin(np.pi * (time - begin)) * shape(time),
        duration_s=1.6, state=state,
    )  # fmt: skip
    said = [text for _, text in record.statuses if "plain control" in text]
    assert bool(said) is other and all("no longer follows what was learned" in text for text in said)
    assert bool(record.added_V[-1] == 0.0) is other


@pytest.mark.parametrize(
    ("half_s", "reversal_m_s2", "armed"), [(1.0, 0.3, False), (0.02, 0.3, True), (1.0, 5e-4, True)]
)
def test_the_first_reversal_of_an_armed_start_is_not_judged(half_s, reversal_m_s2, armed) -> None:
    """A bump of 10 m/s2, the beginning of the motion in it, trips nothing and is forgotten; after a half stroke that moved
    anything the next one is judged, after a trembling reference it is not."""
    state = Adaptive().start(Context()).numbers
    engagement, monitor = state.engagement, state.monitor
    engagement.armed, engagement.reversal_m_s2, engagement.ramp = True, reversal_m_s2, 1.0
    for shaken in (monitor.piston, monitor.off):
        shaken.low_m_s2, shaken.high_m_s2 = -5.0, 5.0
    monitor.baseline_m_s2[:] = 0.1
    begin_judging(engagement, monitor, half_s)
    assert engagement.armed == armed and engagement.lockout_s == 0.0
    assert not worse_than_baseline(monitor, True, reversal_m_s2, 1.0)


def test_worse_reversals_are_seen_and_ended(plain, adapted) -> None:
    """A spool taken for 4 ms slower than it is and not learned anew: the first compensated period is worse than twice plain control's,
    it is said in the log, and plain control acts again; tried again later, for one reversal at a time."""
    made = compensation.create("adaptive", learn=False)
    parameters = made.parameters(adapted.state)
    for edge in ("retract", "extend"):
        parameters["flow"][edge]["lag_s"] += 4e-3
    parameters["delay"]["sums"] = ALL_SPOOL
    del parameters["plain_control"]  # it engages after plain control's own reversals
    state = made.restore(Context(), parameters)
    record = run(made, duration_s=26.0, state=state)
    peaks, usual = record.peaks(), plain.peak(6.0, 10.0)
    assert peaks.max() > 2.0 * usual
    assert any("worse than plain control" in text for _, text in record.statuses)
    assert (peaks > 1.3 * usual).sum() <= 4
    assert peaks[-2] == pytest.approx(usual, rel=0.05)


def test_it_finds_friction_and_mass(adapted) -> None:
    """Coulomb step (65 + 60 N)/A1 within 5 %, mass within 25 % (position and acceleration are alike in a sine)."""
    friction = adapted.state.inner.numbers.friction
    assert 2 * friction.half_step_Pa == pytest.approx(125 / AREA_BOTTOM, rel=0.05)
    assert friction.fit.theta[1] * 1e6 * AREA_BOTTOM == pytest.approx(40.0, rel=0.25)


def test_bench_40_kg_reaches_its_target(plain, adapted) -> None:
    """0.05 m at 0.5 Hz: <= 0.05 m/s2 in 50 Hz where plain control has about 0.5, and the raw peak no higher than
    plain.
    """
    assert plain.peak(6.0, 10.0) == pytest.approx(0.53, abs=0.03)
    assert adapted.peak(16.0, 24.0) <= 0.05
    assert adapted.peak(16.0, 24.0, band_Hz=None) <= plain.peak(6.0, 10.0, band_Hz=None)


def test_bench_100_kg_reaches_its_target() -> None:
    """0.05 m at 0.5 Hz, 100 kg: <= 0.08 m/s2, where a perfect valve inverse leaves 0.41."""
    assert run(compensation.create("adaptive"), Leg(mass_kg=100.0), duration_s=20.0).peak(14.0, 20.0) <= 0.08


def test_ninety_per_cent_within_ten_seconds(plain, adapted) -> None:
    """From nothing, the peak of 8 .. 10 s has already lost 90 % of what it will lose."""
    before, last = plain.peak(8.0, 10.0), adapted.peak(20.0, 24.0)
    assert adapted.peak(8.0, 10.0) <= before - 0.9 * (before - last)


@pytest.mark.parametrize(("overlap_m", "part"), [(2e-5, 6), (5e-5, 4)])
def test_wide_overlaps(overlap_m, part) -> None:
    """20 and 50 um on 100 kg: a sixth and a quarter at most of plain control (the aim of an eighth is not always
    met).
    """
    leg = Leg(mass_kg=100.0, overlap_m=overlap_m)
    peaks = [
        run(compensation.create(name), dataclasses.replace(leg), duration_s=22.0).peak(18.0, 22.0)
        for name in ("none", "adaptive")
    ]
    assert peaks[1] < peaks[0] / part


def test_rounded_edges_are_learned() -> None:
    """Edges rounded over 2 um (18 mV): the rounding is found within 5 mV and the peak from 26 s on is a quarter at
    most."""
    leg = Leg(rounding_m=2e-6)
    record = run(compensation.create("adaptive"), dataclasses.replace(leg), duration_s=32.0)
    assert record.state.inner.numbers.trim.rounding_V == pytest.approx(2e-6 / 1.1e-4, abs=5e-3)
    assert record.peak(26.0, 32.0) < run(compensation.create("none"), leg, duration_s=10.0).peak(6.0, 10.0) / 4


def test_rounding_is_known_before_it_engages() -> None:
    """Edges rounded over 2 um (18 mV), nothing added yet: found within 3 mV, and no edge is taken as rounded that is
    sharp."""
    for rounding_m in (2e-6, 0.0):
        record = run(Adaptive(min_excitation_m_s2=10.0), Leg(rounding_m=rounding_m), sine(0.02), duration_s=12.0)
        assert np.all(record.added_V == 0.0)
        assert lower_bound_V(record.state.numbers.rounding) == pytest.approx(rounding_m / 1.1e-4, abs=3e-3)


def test_it_does_not_engage_for_slow_reversals() -> None:
    """0.05 m at 0.1 Hz turns with 0.02 m/s2: however fast it was faded in, nothing is added in 30 s."""
    record = run(compensation.create("adaptive"), Leg(mass_kg=100.0), sine(0.05, 0.1), duration_s=30.0, period_s=10.0)
    assert np.all(record.added_V == 0.0)


def test_backlash_is_told_from_lag() -> None:
    """Hysteresis of 0.5 % (backlash of +-25 mV): found within 4 mV, and the peak is below half of plain control's."""
    leg = Leg(backlash_V=0.025)
    record = run(compensation.create("adaptive"), dataclasses.replace(leg), duration_s=24.0)
    for edge in record.state.inner.numbers.valve.edges:
        assert edge.backlash_V == pytest.approx(0.025, abs=4e-3)
    assert record.peak(18.0, 24.0) < 0.5 * run(compensation.create("none"), leg, duration_s=10.0).peak(6.0, 10.0)


def test_a_valve_of_another_kind_is_left_alone() -> None:
    """The quadratic law of Eq. 3.11 does not fit an overlap: nothing is ever added."""
    record = run(compensation.create("adaptive"), Leg(quadratic=True), duration_s=12.0)
    assert np.all(record.added_V == 0.0)


@pytest.mark.parametrize("what", ["overlap", "oil"])
def test_it_adapts_again_within_twenty_seconds(what) -> None:
    """Overlap 5 to 20 um, or oil 15 degC warmer, at 12 s: at 32 s the peak is below a sixth of plain control's."""

    def change(time_s: float, leg: Leg) -> None:
        if time_s >= 12.0 and what == "overlap":
            leg.overlap_m = 2e-5
        elif time_s >= 12.0:
            leg.density_kg_m3, leg.friction = 850.0, 0.67

    assert run(compensation.create("adaptive"), duration_s=34.0, change=change).peak(32.0, 34.0) < 0.53 / 6


def test_a_new_valve_is_said() -> None:
    """When the overlap changes under it the algorithm says that it no longer trusts what it learned, and later
    no more.
    """

    def change(time_s: float, leg: Leg) -> None:
        leg.overlap_m = 5e-6 if time_s < 10.0 else 2e-5

    said = [text for _, text in run(compensation.create("adaptive"), duration_s=24.0, change=change).statuses]
    assert said[0].startswith("the valve no longer follows what was learned")
    assert said[-1] == ""


@pytest.mark.parametrize("amplitude_m", [0.0, 2e-5])
def test_standing_still_it_neither_drifts_nor_learns(amplitude_m, adapted) -> None:
    """A minute at rest, or moving by 20 um, after learning: nothing added once quiet, no parameter moves, no
    drift.
    """
    made = compensation.create("adaptive")
    state = made.restore(Context(), made.parameters(adapted.state))
    known = made.parameters(state)["flow"]
    record = run(made, setpoint=sine(amplitude_m), duration_s=60.0, state=state)
    assert np.all(record.added_V == 0.0)
    assert made.parameters(record.state)["flow"] == known
    assert abs(record.position_m[-1] - record.position_m[0]) < 0.045 / 50 + 2e-5  # within the dead band of the loop


@pytest.mark.slow
def test_an_hour_at_rest(adapted) -> None:
    """One hour simulated: as above."""
    made = compensation.create("adaptive")
    state = made.restore(Context(), made.parameters(adapted.state))
    record = run(made, setpoint=sine(0.0), duration_s=3600.0, state=state)
    assert np.all(record.added_V == 0.0)
    assert np.ptp(record.position_m) < 1e-6


@pytest.mark.parametrize(("amplitude_m", "frequency_Hz"), [(0.002, 2.0), (0.01, 0.5), (0.01, 2.0), (0.05, 0.1)])
def test_no_period_is_worse_than_plain_control(amplitude_m, frequency_Hz) -> None:
    """From 2 s on, learning and engaging included, the peak of each period is at most 10 % above plain control's.

    5 % is meant for single reversals (docs/results/compensation_robustness.md); a period during which the amplitude changes
    is no pure harmonic, which adds to the figure here.
    """
    period = 1 / frequency_Hz
    motion = sine(amplitude_m, frequency_Hz)
    duration = max(10.0, 2 + 2 * period)
    peaks = [
        run(compensation.create(name), setpoint=motion, duration_s=duration, period_s=period).peaks(period)
        for name in ("none", "adaptive")
    ]
    assert np.all(peaks[1] <= 1.10 * peaks[0] + 1e-9)


def test_repetitive_learns_what_is_left() -> None:
    """After 24 s the position error of `estimated` has fallen to a third, and the peak stays below 0.05 m/s2."""
    record, without = (run(compensation.create(name), duration_s=24.0) for name in ("repetitive", "estimated"))
    wanted = sine()(record.time_s)
    late = record.time_s > 20.0

    def error(r: Run) -> float:
        return float(np.std((r.position_m - wanted)[late]))

    assert error(record) < error(without) / 3
    assert record.peak(18.0, 24.0) < 0.05


def test_repetitive_without_a_period_is_estimated() -> None:
    """A host that commands freely gives no period: the same volts, to the bit, as those of `estimated`."""
    free = [run(compensation.create(n), duration_s=9.0, period_s=None).added_V for n in ("estimated", "repetitive")]
    assert np.array_equal(*free) and free[0].any()


def test_configuration_is_kept_apart_from_state() -> None:
    """An instance is frozen: learning goes into the state alone."""
    made = Adaptive()
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.lead_smoothing = 1.0  # type: ignore[misc]


def test_a_valve_that_is_lost_is_held_until_it_is_found_again() -> None:
    """An edge that was ready and then sees windows of no valve: it is rejected, and keeps gain, dead band and lag. A fit with
    a negative gain moves the null by no more than the largest dead band."""
    rng = np.random.default_rng(5)
    valve = valve_learned(4e-3)
    edge = valve.edges[1]
    start_edge(edge, 200.0)
    phi_backlash = np.zeros(4)
    for k in range(60):
        phi = np.array([0.01 * (1.0 + 0.5 * math.sin(k)), -0.032, 0.1 * math.cos(1.7 * k)])
        update_edge(
            edge, phi, phi_backlash, float(phi @ [0.15, 0.15 * 0.045, 0.15 * 4e-3]) + rng.normal(0, 4e-6), False
        )
    assert edge.ready
    known = edge.gain_m_s_V, edge.dead_band_V, edge.lag_s
    assert known == pytest.approx((0.15, 0.045, 4e-3), rel=0.1)
    while edge.ready:
        known = edge.gain_m_s_V, edge.dead_band_V, edge.lag_s
        update_edge(edge, phi, phi_backlash, rng.normal(0, 1e-3), False)
    for _ in range(10):
        update_edge(edge, phi, phi_backlash, rng.normal(0, 1e-3), False)
    assert not edge.ready and (edge.gain_m_s_V, edge.dead_band_V, edge.lag_s) == known
    for e in range(2):
        valve.edges[e].windows, valve.edges[e].plain_fit.theta[:2] = 20.0, (-0.1, 0.05 * e)
    for _ in range(20):
        recentre(valve)
    assert abs(valve.null_V) <= MAX_DEAD_BAND_V
