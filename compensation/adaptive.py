"""Feed-forward through a learned valve, with learned friction, lead for the spool and damping from pressure.

At each tick, for the tick boundary LOOK ticks ahead:

    y_m                                   motion asked for (reference.py): the setpoint r, once all is taken over
    P_m = p(y_m', y_m'') + step + rise    pressure that motion needs, its step at a reversal spread over some ms
    z_m = y_m + V P_m / (E A1)            oil displacement that gives both, Eq. 3.7
    x_m = g^-1(z_m' ; dp)                 spool position that lets this oil through: the learned valve
    u   = lead(x_m) - Kp (r - y_m) - D (P1 - P_m) + play

lead undoes the spool's lag, the jump across the overlap apart from the flow (inverse.py, spool.py); the position loop's
own volts are taken off while y_m lags the setpoint; D lets oil out while the pressure swings above what is wanted and so
damps the oil's spring; play is added on the side the volts move to. Everything learned is bounded, acts only once its
standard error is small, and comes in slowly.
docs/compensation.md derives it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import hypot, sqrt
from operator import mul

from .base import Compensator, Context, Parameters, Sample, clip
from .bump_watch import BumpWatch
from .flow_learning import FlowLearner
from .friction_learning import FrictionLearner, stribeck_part
from .inverse import ValveInverse
from .knee import REACH_TICKS, Knee
from .reference import Reference
from .rounding import Rounding
from .spool import AHEAD, LEAD_TAPS, LOOK, crossing, damping_taps, lead, round_lag
from .takeover import Takeover, engage

PLAY_SOFT_V = 1e-3  # half of the way back after which the volts stand wholly on the other side of the play
SUPPLY_SHARE = 0.1  # low-pass of the supply pressure, a tick
PRESSURE_S = 0.2  # mean of the bottom pressure over this time tells the gain of plain control
LAG_MOVED_S = 2e-5  # change of the lag from which taps are made anew
LOW_DROP = 0.02  # share of the reference drop below which no pressure drop is believed


# what is wanted at a tick boundary: load pressure [Pa], signed part of Stribeck's rise, acceleration [m/s2],
# r - y_m [m], oil displacement [m], velocity [m/s]
Wanted = tuple[float, float, float, float, float, float]


@dataclass(slots=True)
class AdaptiveState:
    """What is learned, what is wanted of the ticks to come, and what is remembered of those past."""

    context: Context
    flow: FlowLearner
    friction: FrictionLearner
    reference: Reference
    inverse: ValveInverse
    takeover: Takeover
    lag_s: float = 0.0  # the lag that the taps were made for
    lead_taps: tuple[float, ...] = ()
    crossing_taps: tuple[float, ...] = ()
    damping_taps: tuple[float, ...] = ()
    ahead: deque[Wanted] = field(default_factory=deque)  # of the boundaries to come, the nearest first
    flow_V: deque[float] = field(
        default_factory=lambda: deque([0.0] * LEAD_TAPS, LEAD_TAPS)
    )  # wanted spool beyond the overlap, newest (AHEAD ticks on) first
    jump_V: deque[float] = field(default_factory=lambda: deque([0.0] * LEAD_TAPS, LEAD_TAPS))  # and across it
    surplus_Pa: deque[float] = field(default_factory=deque)  # measured less wanted pressure, newest first
    slow_Pa: float = 0.0  # slow mean of it
    before_Pa: float = 0.0  # bottom pressure at the tick before
    bottom_Pa: float = 0.0  # slow mean of the bottom pressure
    supply_Pa: float = 0.0  # mean of the supply pressure
    loop_supply_Pa: float = 0.0  # slow mean of it
    rounding: Rounding = field(default_factory=Rounding)
    knee: Knee = field(default_factory=Knee)
    excess_m: deque[float] = field(
        default_factory=lambda: deque([0.0] * (REACH_TICKS + 1), REACH_TICKS + 1)
    )  # oil less wanted oil, newest last
    total_V: float = 0.0  # fed forward, play aside, following within PLAY_SOFT_V
    damping_gain: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Adaptive(Compensator):
    """The algorithm to use when nothing is known of the motion. Needs 20 ms of preview.

    ease: softness of the lead; more is slower and kinder to the valve. width_low_s, width_high_s, jerk_m_s3: the
    pressure's step at a reversal is spread over a time that gives the load no more than this jerk, within these
    bounds: a light load gets a slower step, so that its high resonance is not rung. presliding_m_s: velocity within
    which friction turns over. damping_1_s: how much of a swing of pressure is let out a second, between
    damping_low_Hz and damping_high_Hz; its volts are bounded by damping_max_V and give way when they come near
    that. window_s, slowest_m_s, memory_windows: learning, see flow_learning.py. takeover_s, feed_forward_s,
    let_go_s: how slowly it comes in and goes. lively_m_s2: it takes hold of motions that turn with more acceleration
    than this, and lets go of those that turn too slowly for the oil's spring to stay quiet (takeover.py), but of
    none that turn with more than quiet_m_s2. learn: off to use restored parameters as they are.
    """

    name: str = "adaptive"
    preview_s: float = 0.020
    reference_drop_Pa: float = 3.5e6
    ease: float = 1e-4
    width_low_s: float = 3e-3
    width_high_s: float = 8e-3
    jerk_m_s3: float = 1300.0
    presliding_m_s: float = 3e-4
    damping_1_s: float = 80.0
    damping_count: int = 7
    damping_low_Hz: float = 15.0
    damping_high_Hz: float = 65.0
    damping_max_V: float = 0.2
    window_s: float = 0.032
    slowest_m_s: float = 3e-3
    memory_windows: float = 200.0
    takeover_s: float = 1.0
    feed_forward_s: float = 4.0
    let_go_s: float = 1.5
    quiet_m_s2: float = 0.03
    lively_m_s2: float = 0.04
    learn: bool = True

    def start(self, context: Context) -> AdaptiveState:
        tick, window = context.tick_s, max(4, round(self.window_s * context.rate_Hz))
        flow = FlowLearner(context, window, self.slowest_m_s, round(0.02 * context.rate_Hz), self.memory_windows)
        friction = FrictionLearner(context, window, self.slowest_m_s, self.memory_windows)
        noise_m = hypot(context.position_noise_m, context.position_resolution_m / sqrt(12.0))
        takeover = Takeover(BumpWatch(tick, noise_m))
        state = AdaptiveState(context, flow, friction, Reference(tick), ValveInverse(tick), takeover)
        state.ahead = deque([(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)] * LOOK, LOOK + 1)
        state.surplus_Pa = deque([0.0] * self.damping_count, self.damping_count)
        self._design(state, 0.0)
        return state

    def _design(self, state: AdaptiveState, lag_s: float) -> None:
        tick = state.context.tick_s
        state.lag_s = lag_s
        state.lead_taps = lead(lag_s, tick, self.ease)
        state.crossing_taps = crossing(lag_s, tick)
        state.damping_taps = damping_taps(lag_s, tick, self.damping_low_Hz, self.damping_high_Hz, self.damping_count)

    def step(self, state: AdaptiveState, sample: Sample) -> tuple[float, AdaptiveState]:
        context, reference = state.context, state.reference
        item = sample.preview_m.item
        behind, here, further = item(LOOK - 1), item(LOOK), item(LOOK + 1)
        self._follow_loop(state, sample)
        reference.advance(behind, here, further)
        carried = state.supply_Pa * context.area_ratio
        load = sample.pressure_bottom_Pa - sample.pressure_supply_Pa * context.area_ratio
        compliance = context.compliance_m_Pa(reference.position_m)

        wanted, part = self._wanted_pressure(state)
        oil = reference.position_m + compliance * wanted
        state.ahead.append((wanted, part, reference.acceleration_m_s2, reference.lag_m, oil, reference.velocity_m_s))
        wanted_now, part_now, a_now, lag_now, oil_now, v_now = state.ahead.popleft()
        surplus = load - wanted_now
        state.slow_Pa += 0.06 * (surplus - state.slow_Pa)

        roots = self._roots(state, state.supply_Pa, wanted + state.slow_Pa + carried)
        flow, jump = state.inverse.advance(oil, roots, state.flow.edges, state.knee, state.lag_s)
        state.flow_V.appendleft(flow)
        state.jump_V.appendleft(jump)
        state.surplus_Pa.appendleft(surplus)
        u = self.extra(state, sample)
        if state.takeover.gain > 0.0:
            u += sum(map(mul, state.lead_taps, state.flow_V)) + sum(map(mul, state.crossing_taps, state.jump_V))
            u += self._play(state, u) - context.position_gain_V_per_m * lag_now
            u -= self._damping(state, compliance, roots)
        if self.learn:
            self._learn(state, sample, load, a_now, oil_now, v_now)
            rise = state.friction.rise
            if (
                rise.watch(v_now, surplus, sample.position_m - sample.setpoint_m + lag_now, part_now)
                and state.takeover.gain == 1.0
            ):
                rise.learn(1e6 * state.friction.fit.theta[1], 2.0 * state.friction.half_step_Pa)
        asked = (further - 2 * here + behind) / (context.tick_s * context.tick_s)
        engage(self, state, asked, sample, lag_now)
        limit = context.voltage_max_V
        return state.takeover.blend * clip(u, -limit, limit), state

    def _follow_loop(self, state: AdaptiveState, sample: Sample) -> None:
        """Tell the reference what plain control does; pressures are taken slowly, lest noise be differentiated."""
        context, reference = state.context, state.reference
        bottom, supply = sample.pressure_bottom_Pa, sample.pressure_supply_Pa
        if state.bottom_Pa == 0.0:
            state.bottom_Pa, state.supply_Pa, state.loop_supply_Pa = bottom, supply, supply
        state.supply_Pa += SUPPLY_SHARE * (supply - state.supply_Pa)
        if reference.share == 1.0:
            return
        slow = context.tick_s / PRESSURE_S
        state.bottom_Pa += slow * (bottom - state.bottom_Pa)
        state.loop_supply_Pa += slow * (supply - state.loop_supply_Pa)
        (down, up), roots = state.flow.edges, self._roots(state, state.loop_supply_Pa, state.bottom_Pa)
        kp = context.position_gain_V_per_m
        reference.loop_1_s = (kp * down.gain_m_s_V * roots[0], kp * up.gain_m_s_V * roots[1])
        reference.dead_m = (down.dead_band_V / kp, up.dead_band_V / kp)

    def extra(self, state: AdaptiveState, sample: Sample) -> float:
        """Volts that a derived algorithm adds."""
        return 0.0

    def _wanted_pressure(self, state: AdaptiveState) -> tuple[float, float]:
        """P1 - Ps A2/A1 [Pa] that the reference needs, and the signed part of it that is Stribeck's rise."""
        reference, friction = state.reference, state.friction
        if state.takeover.friction_gain == 0.0:
            return 0.0, 0.0
        v, a = reference.velocity_m_s, reference.acceleration_m_s2
        sign = 1.0 if v > 0.0 else -1.0
        if abs(v) < abs(a) * self.width_high_s + self.presliding_m_s:
            width = clip(friction.jolt_m_s2() / self.jerk_m_s3, self.width_low_s, self.width_high_s)
            x = v / (abs(a) * width + self.presliding_m_s)
            if -1.0 < x < 1.0:
                sign = x * (2.0 - abs(x))
        part = sign * stribeck_part(v)
        step = sign * friction.half_step_Pa + part * friction.rise.rise_Pa
        return state.takeover.friction_gain * (friction.smooth_Pa(reference.position_m, v, a) + step), part

    def _roots(self, state: AdaptiveState, supply_Pa: float, pressure_Pa: float) -> tuple[float, float]:
        """sqrt(dp / dp_ref) of the edge to tank and of the edge from the supply."""
        return self._root(pressure_Pa - state.context.tank_pressure_Pa), self._root(supply_Pa - pressure_Pa)

    def _root(self, drop_Pa: float) -> float:
        """sqrt(dp / dp_ref) of an edge."""
        share = drop_Pa / self.reference_drop_Pa
        return sqrt(share if share > LOW_DROP else LOW_DROP)

    def _damping(self, state: AdaptiveState, compliance: float, roots: tuple[float, float]) -> float:
        """Volts that let oil out while the pressure swings above what is wanted."""
        up = state.flow_V[AHEAD] > 0
        gain = state.flow.edges[up].gain_m_s_V * roots[up]
        swing = sum(map(mul, state.damping_taps, state.surplus_Pa))
        u = state.damping_gain * self.damping_1_s * compliance * swing / gain
        limit = self.damping_max_V
        if -0.5 * limit < u < 0.5 * limit:
            state.damping_gain += (1.0 - state.damping_gain) * state.context.tick_s / 5.0
        else:
            state.damping_gain *= 0.98
        return clip(u, -limit, limit)

    def _play(self, state: AdaptiveState, total_V: float) -> float:
        """Volts that take up the valve's play, on the side to which its volts have moved by some millivolts."""
        state.total_V = clip(state.total_V, total_V - PLAY_SOFT_V, total_V + PLAY_SOFT_V)
        down, up = state.flow.edges
        play = up.play_V if total_V > 0 else down.play_V
        return play * (total_V - state.total_V) / PLAY_SOFT_V

    def _learn(
        self,
        state: AdaptiveState,
        sample: Sample,
        load_Pa: float,
        acceleration_m_s2: float,
        oil_m: float,
        flow_m_s: float,
    ) -> None:
        valve, p = sample.valve_V, sample.pressure_bottom_Pa
        mean = 0.5 * (p + state.before_Pa)
        root = self._root(sample.pressure_supply_Pa - mean if valve > 0 else mean - state.context.tank_pressure_Pa)
        state.before_Pa = p
        z = sample.position_m + state.context.compliance_m_Pa(sample.position_m) * p
        state.flow.add(z, valve, root)
        state.excess_m.append(z - oil_m)
        if state.takeover.gain == 1.0:
            state.knee.watch(state.excess_m, flow_m_s, 0.5 * state.flow.edges[0].dead_band_V)
        if state.flow.known:
            if state.takeover.gain > 0.0:
                state.rounding.ticks = 0
            elif state.rounding.watch(z, valve, root, state.flow):
                state.knee.rounding_V = state.rounding.surely_V
            state.friction.add(sample.position_m, load_Pa, acceleration_m_s2)
        if abs(state.flow.lag_s - state.lag_s) > LAG_MOVED_S and state.flow.ready:
            self._design(state, round_lag(state.flow.lag_s))

    def status(self, state: AdaptiveState) -> str:
        """A sentence while the valve does not behave as learned."""
        if state.takeover.wait_s > 0.0:
            return "reversals became worse than plain control's: plain control for a while"
        doubted = any(edge.doubts and not edge.ready for edge in state.flow.edges)
        return "the valve no longer follows what was learned: plain control while it is learned anew" if doubted else ""

    def parameters(self, state: AdaptiveState) -> Parameters:
        return {
            "flow": state.flow.parameters(),
            "rounding_V": state.knee.rounding_V,
            "friction": state.friction.parameters(),
        }

    def restore(self, context: Context, parameters: Parameters) -> AdaptiveState:
        state = self.start(context)
        state.flow.restore(parameters["flow"])
        state.friction.restore(parameters["friction"])
        state.knee.rounding_V = float(parameters["rounding_V"])
        state.rounding.restore(state.knee.rounding_V)
        if state.flow.ready:
            self._design(state, round_lag(state.flow.lag_s))
        return state
