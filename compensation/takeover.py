"""When the adaptive algorithm takes over from plain control and lets go of it, and how smoothly.

It takes over in the midst of a stroke, with the motion that plain control makes (reference.py), once the valve and
friction are known, what is known explains plain control's own reversals (rounding.py), and the motion turns with enough
acceleration; then the feed-forward comes in over seconds. It goes
the same way back. When the valve is doubted it goes at once.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from .base import clip
from .spool import AHEAD

if TYPE_CHECKING:
    from .adaptive import Adaptive, AdaptiveState

STILL_S, STILL_M_S2 = 10.0, 1e-3  # time in which an acceleration is forgotten; below this nothing moves
SLOW_M_S = 1.2e-3  # acceleration that a reversal needs, over the rate at which the oil's spring swings up [m/s]
LIVELIER = 1.3  # times the acceleration below which it lets go, it takes hold of
SHUT_SHARE = 0.25  # of a half stroke that the overlap may hold it shut: beyond, plain control moves quite otherwise
FLOWING_S = 0.08  # for so long the valve is to have been open, under plain control, when it takes over


def engage(config: Adaptive, state: AdaptiveState, asked_m_s2: float, behind_m: float, control_V: float) -> None:
    """Take over when enough is known and the motion is lively, then bring the feed-forward in.

    asked_m_s2: acceleration of the setpoint, LOOK ticks ahead; behind_m: how much further the piston is behind the
    setpoint than the reference, now; control_V: what plain control asks.
    """
    context, reference = state.context, state.reference
    tick = context.tick_s
    state.acceleration_m_s2 += 0.1 * (asked_m_s2 - state.acceleration_m_s2)
    size = abs(state.acceleration_m_s2)
    if size > state.turn_peak_m_s2:
        state.turn_peak_m_s2 = size
    faded = state.liveliness_m_s2 * (1 - tick / STILL_S)
    state.liveliness_m_s2 = size if size > faded else faded
    _pace(config, state, reference.velocity_m_s, control_V)
    if state.turn_now:
        state.liveliness_m_s2, state.turn_peak_m_s2 = state.turn_peak_m_s2, 0.0
        state.slowest_m_s2 = _slowest_m_s2(config, state)
    if state.liveliness_m_s2 < state.slowest_m_s2:
        state.lively = False
    elif _is_lively(config, state):
        state.lively = True
    slow = tick / config.takeover_s
    ready = state.flow.ready
    target = 1.0 if ready and state.lively else 0.0
    known = 1.0 if ready and state.friction.ready else 0.0
    if known != state.friction_gain:
        state.friction_gain += clip(known - state.friction_gain, -slow, slow)
    if not ready:
        state.gain = max(0.0, state.gain - 4.0 * slow)
    elif 0.0 < state.gain < 1.0:
        state.gain = clip(state.gain + (state.pace if target else -state.pace), 0.0, 1.0)
    elif target > state.gain and state.friction_gain == 1.0 and state.start_now and _proven(config, state):
        state.gain = min(state.pace, 1.0)
        _join(state, behind_m)
    elif target < state.gain and reference.share == 0.0 and (state.turn_now or size < STILL_M_S2):
        state.gain = 1.0 - state.pace
    if state.gain == 0.0:
        reference.share = 0.0
    elif state.gain == 1.0 and target != reference.share:
        come = tick / config.feed_forward_s if target else -tick / config.let_go_s
        reference.share = clip(reference.share + come, 0.0, 1.0)
    # too small a jump is safer than too large a one
    state.knee.least_V = (1.0 - reference.share) * state.rounding.likely_V if reference.share < 1.0 else 0.0


def _join(state: AdaptiveState, behind_m: float) -> None:
    """Shift the reference, and what was asked for of the ticks ahead, to where the piston is."""
    state.reference.lag_m += behind_m
    state.inverse.oil_m -= behind_m
    moved = [(load, part, a, lag + behind_m, oil - behind_m, v) for load, part, a, lag, oil, v in state.ahead]
    state.ahead = deque(moved, state.ahead.maxlen)


def _proven(config: Adaptive, state: AdaptiveState) -> bool:
    """Whether this motion is lively enough and what was learned explains the reversals seen under plain control."""
    return (
        _is_lively(config, state)
        and state.shut_ticks < SHUT_SHARE * state.half_ticks
        and state.flow.agreed
        and state.rounding.sound
    )


def _is_lively(config: Adaptive, state: AdaptiveState) -> bool:
    lively = LIVELIER * state.slowest_m_s2
    return state.liveliness_m_s2 > (lively if lively > config.lively_m_s2 else config.lively_m_s2)


def _slowest_m_s2(config: Adaptive, state: AdaptiveState) -> float:
    """Acceleration of a reversal below which it is left alone.

    Where friction falls with speed faster than viscosity makes it rise, the oil's spring swings up at a rate that
    a light load makes high; the damping takes its own rate off, as far as the spring's frequency is in its band.
    """
    context, friction = state.context, state.friction
    inertia = friction.inertia_Pa()
    compliance = context.compliance_m_Pa(0.5 * context.stroke_m)
    high = 2 * math.pi * config.damping_high_Hz * math.sqrt(compliance * inertia)
    growth = friction.growth_1_s() - 0.5 * config.damping_1_s * min(1.0, high**4)
    return clip(SLOW_M_S * growth, STILL_M_S2, config.quiet_m_s2)


def _pace(config: Adaptive, state: AdaptiveState, velocity_m_s: float, control_V: float) -> None:
    """The blend between plain and compensated falls wholly between two reversals: letting go begins a fifth into a half
    stroke, taking over two fifths, when what plain control's reversal set ringing has died away. A wide overlap holds
    a small motion for long, so that its valve opens late."""
    edge = state.flow.edges[control_V > 0.0]
    is_open = abs(control_V) > edge.dead_band_V + edge.play_V
    if is_open:
        state.flowing_ticks += 1
    elif state.flowing_ticks:
        state.flowing_ticks, state.shut_ticks = 0, 1
    else:
        state.shut_ticks += 1
    state.turn_ticks += 1
    if velocity_m_s * state.turn_sign < 0.0:
        state.half_ticks, state.turn_ticks = state.turn_ticks, 0
    if velocity_m_s:
        state.turn_sign = velocity_m_s
    state.turn_now = state.half_ticks > 0 and state.turn_ticks == state.half_ticks // 5 + AHEAD
    state.start_now = (
        state.half_ticks > 0
        and 0.4 * state.half_ticks <= state.turn_ticks - AHEAD <= 0.55 * state.half_ticks
        and state.flowing_ticks * state.context.tick_s > FLOWING_S
    )
    if state.turn_now:
        state.pace = 1.0 / clip(0.4 * state.half_ticks, 10.0, config.takeover_s * state.context.rate_Hz)
