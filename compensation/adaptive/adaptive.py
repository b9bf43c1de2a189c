"""The adaptive algorithm: feed-forward through the inverse of an identified valve, with identified friction.

At each tick, for the tick boundary PREVIEW_TICKS ahead:

    y_m                                      reference (reference.py): the setpoint r, once the feed-forward is all in
    P_m = p(y_m', y_m'') + step + Stribeck   pressure that motion needs, its step at a reversal spread over some ms
    z_m = y_m + V P_m / (E A1)               oil displacement that gives both, Eq. 3.7
    x_m = g^-1(z_m' ; dp)                    spool position that lets this oil through: inverse of the valve
    u   = lead(x_m) - Kp (r - y_m) - D (P1 - P_m) + backlash inverse

The lead undoes the spool's lag; the dead-band compensation has a lead of its own (inverse.py, spool.py). The position
loop's own volts are taken off while y_m lags the setpoint. D lets oil out while the pressure oscillates above the
demand, which damps the hydraulic resonance. The backlash inverse acts on the side the volts move to. All that is
identified is bounded, acts only once its standard error is small, and comes in slowly.

docs/compensation_derivation.md derives it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import hypot, sqrt
from operator import mul

from ..compensator import Compensator, Context, Parameters, Sample, clip
from .delay import AFTER, DelayEstimator, Lateness
from .edge_rounding import LeakEstimator
from .engagement import update_engagement
from .feedback import backlash_inverse, damping
from .friction import FrictionEstimator, demanded_pressure
from .inverse import ValveInverse
from .monitor import PerformanceMonitor
from .reference import Reference
from .spool import (
    MAX_SHIFT,
    PREVIEW_TICKS,
    crossing_lead,
    crossing_path,
    damping_filter,
    lead,
    look_ahead_shift,
    round_lag,
)
from .state import AdaptiveState, Demand, Engagement, EngagementSettings
from .valve import ValveEstimator

SUPPLY_SHARE = 0.1  # low-pass of the supply pressure, a tick
DEVIATION_SHARE = 0.06  # low-pass of the pressure's deviation from the demand, a tick
PRESSURE_MEAN_S = 0.2  # time constant of the pressures that the gain of plain control is computed with
DELAY_TOLERANCE_S = 1e-4  # change of the delay from which the taps are designed anew
LAG_TOLERANCE_S = 2e-5  # change of the lag from which the taps are designed anew
MIN_DROP_SHARE = 0.02  # of the reference drop: lower bound of a pressure drop


@dataclass(frozen=True, kw_only=True)
class Adaptive(Compensator):
    """Identifies valve, friction and spool lag while the machine moves, and feeds forward through their inverse.

    The algorithm to use when nothing is known of the motion. Needs 20 ms of preview.

    Feed-forward. lead_smoothing: higher values make the lead softer, slower and kinder to the valve. step_min_s,
    step_max_s, jerk_m_s3: the pressure's step at a reversal is spread over the time that gives the load this jerk,
    within these bounds; lower jerk protects a light load, whose resonance is high. presliding_m_s: velocity within
    which friction reverses.

    Damping. damping_1_s: share of a pressure oscillation let out a second, between damping_low_Hz and damping_high_Hz,
    by an FIR filter of damping_count taps. damping_max_V: bound of its volts; the gain falls as they come near.

    Identification. window_s: length of a window; min_speed_m_s: mean speed from which a window counts; memory_windows:
    windows after which old data weigh 1/e. learn: False uses restored parameters as they are.

    Engagement (engagement.py). min_excitation_m_s2: reversal acceleration from which it engages.
    max_stability_limit_m_s2: it never disengages from motions with a higher one. engage_s, feed_forward_s,
    disengage_s: longest ramp, and times of the feed-forward; higher values make the transfer slower and smoother.
    """

    name: str = "adaptive"
    place = 4
    preview_s: float = 0.028
    reference_drop_Pa: float = 3.5e6
    lead_smoothing: float = 1e-4
    step_min_s: float = 3e-3
    step_max_s: float = 8e-3
    jerk_m_s3: float = 1300.0
    presliding_m_s: float = 3e-4
    damping_1_s: float = 80.0
    damping_count: int = 7
    damping_low_Hz: float = 15.0
    damping_high_Hz: float = 65.0
    damping_max_V: float = 0.2
    window_s: float = 0.032
    min_speed_m_s: float = 3e-3
    memory_windows: float = 200.0
    engage_s: float = 1.0
    feed_forward_s: float = 4.0
    disengage_s: float = 1.5
    max_stability_limit_m_s2: float = 0.03
    min_excitation_m_s2: float = 0.04
    learn: bool = True

    def start(self, context: Context) -> AdaptiveState:
        tick, window = context.tick_s, max(4, round(self.window_s * context.rate_Hz))
        valve = ValveEstimator(context, window, self.min_speed_m_s, round(0.02 * context.rate_Hz), self.memory_windows)
        friction = FrictionEstimator(context, window, self.min_speed_m_s, self.memory_windows)
        noise_m = hypot(context.position_noise_m, context.position_resolution_m / sqrt(12.0))
        settings = EngagementSettings(
            engage_s=self.engage_s,
            feed_forward_s=self.feed_forward_s,
            disengage_s=self.disengage_s,
            min_excitation_m_s2=self.min_excitation_m_s2,
            max_stability_limit_m_s2=self.max_stability_limit_m_s2,
            damping_1_s=self.damping_1_s,
            damping_high_Hz=self.damping_high_Hz,
        )
        engagement = Engagement(settings, PerformanceMonitor(tick, noise_m))
        state = AdaptiveState(
            context,
            valve,
            friction,
            Reference(tick),
            ValveInverse(tick),
            engagement,
            DelayEstimator(tick),
            Lateness(tick),
        )
        state.demands = deque([Demand(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)] * PREVIEW_TICKS, PREVIEW_TICKS + MAX_SHIFT + 1)
        state.deviation_Pa = deque([0.0] * self.damping_count, self.damping_count)
        self._design(state, 0.0)
        return state

    def _design(self, state: AdaptiveState, lag_s: float) -> None:
        tick = state.context.tick_s
        state.lag_s = lag_s
        delay_s = state.delay_s = round_lag(state.delay.delay_s(lag_s))
        shift = state.shift
        state.lead_taps = lead(lag_s, tick, self.lead_smoothing, delay_s, shift)
        state.crossing_taps = crossing_lead(lag_s, tick, delay_s, shift)
        state.crossing_path = crossing_path(lag_s, tick, delay_s, shift)
        low, high = self.damping_low_Hz, self.damping_high_Hz
        state.damping_taps = damping_filter(lag_s, tick, low, high, self.damping_count, delay_s)

    def step(self, state: AdaptiveState, sample: Sample) -> tuple[float, AdaptiveState]:
        context, reference = state.context, state.reference
        behind, here, ahead = self._setpoints(state, sample)
        self._track_plain_control(state, sample)
        reference.advance(behind, here, ahead)

        compliance = context.compliance_m_Pa(reference.position_m)
        spread = self.jerk_m_s3, self.step_min_s, self.step_max_s, self.presliding_m_s
        pressure, share = demanded_pressure(reference, state.friction, state.engagement.friction_share, spread)
        oil, a, v = reference.position_m + compliance * pressure, reference.acceleration_m_s2, reference.velocity_m_s
        state.demands.append(Demand(pressure, share, a, reference.position_m, oil, v))
        now = state.demands.popleft()
        lag = sample.setpoint_m - now.position_m
        load = sample.pressure_bottom_Pa - sample.pressure_supply_Pa * context.area_ratio
        deviation = load - state.lateness.due_Pa(now, state.demands)
        state.deviation_Pa.appendleft(deviation)
        state.mean_deviation_Pa += DEVIATION_SHARE * (deviation - state.mean_deviation_Pa)

        bottom = pressure + state.mean_deviation_Pa + state.supply_Pa * context.area_ratio
        roots = self._roots(state, state.supply_Pa, bottom)
        flow, dead_band = state.inverse.advance(
            oil, roots, state.valve.edges, state.trim, state.crossing_path, state.valve.leak_m_s
        )
        state.flow_V.appendleft(flow)
        state.dead_band_V.appendleft(dead_band)

        u = self.extra(state, sample)
        if state.engagement.ramp > 0.0:
            u += sum(map(mul, state.lead_taps, state.flow_V)) + sum(map(mul, state.crossing_taps, state.dead_band_V))
            u += backlash_inverse(state, u) - context.position_gain_V_per_m * lag
            u += state.valve.null_V - damping(state, self.damping_1_s * compliance, roots, self.damping_max_V)
        if self.learn:
            self._identify(state, sample, load, now)
        setpoint_m_s2 = (ahead - 2 * here + behind) / (context.tick_s * context.tick_s)
        update_engagement(state, setpoint_m_s2, sample, lag)
        limit = context.voltage_max_V
        return state.engagement.weight * clip(u, -limit, limit), state

    def _setpoints(self, state: AdaptiveState, sample: Sample) -> tuple[float, float, float]:
        """At the boundary before the one the demand is for, at it, and after it: the preview's, or predicted."""
        look = PREVIEW_TICKS + state.shift
        if state.predictor.watch(sample.preview_m, sample.setpoint_m):
            return state.predictor.predict(look, sample.setpoint_m)
        item = sample.preview_m.item
        return item(look - 1), item(look), item(look + 1)

    def extra(self, state: AdaptiveState, sample: Sample) -> float:
        """Volts that a derived algorithm adds."""
        return 0.0

    def _track_plain_control(self, state: AdaptiveState, sample: Sample) -> None:
        """Loop gain and dead band of plain control, for the reference.

        Pressures are low-passed: the reference is differentiated, and must not answer to noise or to itself.
        """
        context, reference = state.context, state.reference
        bottom, supply = sample.pressure_bottom_Pa, sample.pressure_supply_Pa
        if state.mean_bottom_Pa == 0.0:
            state.mean_bottom_Pa, state.supply_Pa, state.mean_supply_Pa = bottom, supply, supply
        state.supply_Pa += SUPPLY_SHARE * (supply - state.supply_Pa)
        if reference.feed_forward == 1.0:
            return
        share = context.tick_s / PRESSURE_MEAN_S
        state.mean_bottom_Pa += share * (bottom - state.mean_bottom_Pa)
        state.mean_supply_Pa += share * (supply - state.mean_supply_Pa)
        (down, up), roots = state.valve.edges, self._roots(state, state.mean_supply_Pa, state.mean_bottom_Pa)
        kp = context.position_gain_V_per_m
        reference.loop_1_s = (kp * down.gain_m_s_V * roots[0], kp * up.gain_m_s_V * roots[1])
        reference.null_m, reference.leak_m_s = state.valve.null_V / kp, state.valve.leak_m_s
        reference.dead_band_m = (down.dead_band_V / kp, up.dead_band_V / kp)

    def _roots(self, state: AdaptiveState, supply_Pa: float, bottom_Pa: float) -> tuple[float, float]:
        """sqrt(dp / dp_ref) of the edge to tank and of the edge from the supply."""
        down = (bottom_Pa - state.context.tank_pressure_Pa) / self.reference_drop_Pa
        up = (supply_Pa - bottom_Pa) / self.reference_drop_Pa
        least = MIN_DROP_SHARE
        return sqrt(down if down > least else least), sqrt(up if up > least else least)

    def _identify(self, state: AdaptiveState, sample: Sample, load_Pa: float, now: Demand) -> None:
        """One tick of valve, edge rounding and friction; the taps are designed anew when the lag has moved."""
        valve, p, compensated = (
            sample.valve_V - state.valve.null_V,
            sample.pressure_bottom_Pa,
            state.engagement.ramp == 1.0,
        )
        root = self._roots(state, sample.pressure_supply_Pa, 0.5 * (p + state.last_bottom_Pa))[1 if valve > 0 else 0]
        state.last_bottom_Pa = p
        p_late = state.lateness.then_Pa(p)
        z = sample.position_m + state.context.compliance_m_Pa(sample.position_m) * p_late
        state.oil_error_m.append(z - now.oil_m)
        state.leaked_m += state.valve.leak_m_s * state.context.tick_s
        z -= state.leaked_m
        state.valve.add(z, valve, root)
        if state.engagement.ramp == 0.0 and state.valve.recentre():
            state.rounding.leak = LeakEstimator()
        state.lateness.add(
            state.deviation_Pa[0] - state.mean_deviation_Pa,
            compensated and state.engagement.after_reversal,
            state.lag_s,
        )
        flow = now.velocity_m_s - state.valve.leak_m_s
        now_roots = self._roots(state, sample.pressure_supply_Pa, p) if state.delay.ticks == AFTER else (1.0, 1.0)
        judged = state.delay.add(z, valve, flow, now_roots, state.valve, compensated)
        if judged and abs(state.delay.delay_s(state.lag_s) - state.delay_s) > DELAY_TOLERANCE_S:
            self._design(state, state.lag_s)
        if compensated:
            state.trim.add(state.oil_error_m, now.velocity_m_s, 0.5 * state.valve.edges[0].dead_band_V)
        if state.valve.usable:
            if state.engagement.ramp > 0.0:
                state.rounding.ticks = 0
            elif state.rounding.add(z, valve, root, state.valve):
                state.rounding.leak.tell(state.valve)
                state.trim.rounding_V = state.rounding.lower_bound_V
            state.friction.add(sample.position_m, load_Pa, now.acceleration_m_s2)
        if abs(state.valve.lag_s - state.lag_s) > LAG_TOLERANCE_S and state.valve.ready:
            if state.engagement.ramp == 0.0:
                state.look_ahead(look_ahead_shift(state.valve.lag_s, state.context.tick_s))
            self._design(state, round_lag(state.valve.lag_s))
        stribeck, position_error = state.friction.stribeck, sample.position_m - now.position_m
        complete = stribeck.add(now.velocity_m_s, state.deviation_Pa[0], position_error, now.stribeck_share)
        if complete and compensated:
            stribeck.update(1e6 * state.friction.fit.theta[1], 2.0 * state.friction.half_step_Pa)

    def status(self, state: AdaptiveState) -> str:
        """A sentence while plain control acts because of what reversals or the valve have done."""
        if state.engagement.lockout_s > 0.0:
            return "reversals became worse than plain control's: plain control for a while"
        if state.valve.rejected:
            return "the valve no longer follows what was learned: plain control while it is learned anew"
        return ""

    def parameters(self, state: AdaptiveState) -> Parameters:
        return {
            "flow": state.valve.parameters(),
            "rounding_V": state.trim.rounding_V,
            "friction": state.friction.parameters(),
            "delay": {**state.delay.parameters(), "late_s": state.lateness.late_s},
        }

    def restore(self, context: Context, parameters: Parameters) -> AdaptiveState:
        state = self.start(context)
        state.valve.restore(parameters["flow"])
        state.friction.restore(parameters["friction"])
        state.trim.rounding_V = float(parameters["rounding_V"])
        state.rounding.restore(state.trim.rounding_V)
        state.delay.restore(parameters["delay"])
        state.lateness.late_s = float(parameters["delay"]["late_s"])
        if state.valve.ready:
            state.rounding.leak.restore(state.valve.leak_m_s)
            state.look_ahead(look_ahead_shift(state.valve.lag_s, context.tick_s))
            self._design(state, round_lag(state.valve.lag_s))
        return state
