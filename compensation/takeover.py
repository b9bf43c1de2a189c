"""When the adaptive algorithm takes over from plain control and lets go of it, and how smoothly.

It takes over in the midst of a stroke, with the motion that plain control makes (reference.py), once the valve and
friction are known, what is known explains plain control's own reversals (rounding.py), and the motion turns with enough
acceleration; then the feed-forward comes in over seconds. It goes
the same way back. When the valve is doubted, or a reversal was worse than plain control's (bump_watch.py), it goes at once.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .base import Sample, clip
from .bump_watch import BumpWatch
from .spool import AHEAD

if TYPE_CHECKING:
    from .adaptive import Adaptive, AdaptiveState

STILL_S, STILL_M_S2 = 10.0, 1e-3  # time in which an acceleration is forgotten; below this nothing moves
SLOW_M_S = 1.2e-3  # acceleration that a reversal needs, over the rate at which the oil's spring swings up [m/s]
LIVELIER = 1.3  # times the acceleration below which it lets go, it takes hold of
SHUT_SHARE = 0.25  # of a half stroke that the overlap may hold it shut: beyond, plain control moves quite otherwise
WAIT_S, WAIT_LONGER = 4.0, 4.0  # plain control after a harmful reversal, and how many times longer after each further
FORGIVEN = 20  # reversals without harm after which one with harm is forgotten
FLOWING_S = 0.08  # for so long the valve is to have been open, under plain control, when it takes over


@dataclass(slots=True)
class Takeover:
    """How far it has taken over, and what it is judged by."""

    watch: BumpWatch
    harms: int = 0  # reversals made worse, not forgotten yet
    harmless: int = 0  # reversals since
    wait_s: float = 0.0  # for which nothing is tried
    gain: float = 0.0  # of all that is added, 0 .. 1
    friction_gain: float = 0.0  # of the wanted pressure
    pace: float = 0.01  # of the blend, a tick
    turn_sign: float = 0.0  # wanted velocity, last seen
    turn_ticks: int = 0  # since it last changed sign
    half_ticks: int = 0  # between the last two changes
    turn_now: bool = False  # a fifth into a half stroke
    start_now: bool = False  # two fifths into it, the valve being open
    flowing_ticks: int = 0  # for which plain control has held the valve open
    shut_ticks: int = 0  # for which the overlap held it shut, at the reversal before
    acceleration_m_s2: float = 0.0  # low-pass of the setpoint's
    liveliness_m_s2: float = 0.0  # its recent largest
    turn_peak_m_s2: float = 0.0  # largest since the last turn was seen
    turn_m_s2: float = 0.0  # and of the last turn
    lively: bool = False
    slowest_m_s2: float = STILL_M_S2  # acceleration of a turn below which it lets go

    @property
    def blend(self) -> float:
        """Share of the volts that is added: smooth in the gain."""
        return self.gain * self.gain * (3.0 - 2.0 * self.gain)


def engage(config: Adaptive, state: AdaptiveState, asked_m_s2: float, sample: Sample, lag_m: float) -> None:
    """Take over when enough is known and the motion is lively, then bring the feed-forward in.

    asked_m_s2: acceleration of the setpoint, LOOK ticks ahead; lag_m: how far the reference is behind the setpoint now.
    """
    context, reference, takeover = state.context, state.reference, state.takeover
    tick = context.tick_s
    takeover.watch.add(sample.position_m)
    if takeover.gain == 0.0:
        _watch_valve(state, sample.control_V)
    _watch_turns(config, state, reference.velocity_m_s)
    takeover.acceleration_m_s2 += 0.1 * (asked_m_s2 - takeover.acceleration_m_s2)
    size = abs(takeover.acceleration_m_s2)
    if size > takeover.turn_peak_m_s2:
        takeover.turn_peak_m_s2 = size
    faded = takeover.liveliness_m_s2 * (1 - tick / STILL_S)
    takeover.liveliness_m_s2 = size if size > faded else faded
    if takeover.turn_now:
        takeover.liveliness_m_s2 = takeover.turn_m_s2 = takeover.turn_peak_m_s2
        takeover.turn_peak_m_s2 = 0.0
        takeover.slowest_m_s2 = _slowest_m_s2(config, state)
    if takeover.liveliness_m_s2 < takeover.slowest_m_s2:
        takeover.lively = False
    elif _is_lively(config, takeover):
        takeover.lively = True
    slow = tick / config.takeover_s
    ready = state.flow.ready
    target = 1.0 if ready and takeover.lively else 0.0
    known = 1.0 if ready and state.friction.ready else 0.0
    if known != takeover.friction_gain:
        takeover.friction_gain += clip(known - takeover.friction_gain, -slow, slow)
    if takeover.wait_s > 0.0:
        takeover.wait_s -= tick
    if not ready or takeover.wait_s > 0.0:
        takeover.gain = max(0.0, takeover.gain - 4.0 * slow)
    elif 0.0 < takeover.gain < 1.0:
        takeover.gain = clip(takeover.gain + (takeover.pace if target else -takeover.pace), 0.0, 1.0)
    elif target > takeover.gain and takeover.friction_gain == 1.0 and takeover.start_now and _proven(config, state):
        takeover.gain = min(takeover.pace, 1.0)
        _join(state, sample.setpoint_m - sample.position_m - lag_m)
    elif target < takeover.gain and reference.share == 0.0 and (takeover.turn_now or size < STILL_M_S2):
        takeover.gain = 1.0 - takeover.pace
    if takeover.gain == 0.0:
        reference.share = 0.0
    elif takeover.gain == 1.0 and target != reference.share:
        come = tick / config.feed_forward_s if target else -tick / config.let_go_s
        reference.share = clip(reference.share + come, 0.0, 1.0)
    # while taking over, too small a jump is safer than too large a one
    cautious = takeover.gain > 0.0 and reference.share < 1.0
    state.knee.least_V = (1.0 - reference.share) * state.rounding.likely_V if cautious else 0.0


def _join(state: AdaptiveState, behind_m: float) -> None:
    """Shift the reference, and what was asked for of the ticks ahead, to where the piston is."""
    state.reference.lag_m += behind_m
    state.inverse.oil_m -= behind_m
    moved = [(load, part, a, lag + behind_m, oil - behind_m, v) for load, part, a, lag, oil, v in state.ahead]
    state.ahead = deque(moved, state.ahead.maxlen)


def _proven(config: Adaptive, state: AdaptiveState) -> bool:
    """Whether this motion is lively enough and what was learned explains the reversals seen under plain control."""
    takeover = state.takeover
    return (
        _is_lively(config, takeover)
        and takeover.shut_ticks < SHUT_SHARE * takeover.half_ticks
        and takeover.watch.ready
        and state.flow.agreed
        and state.rounding.sound
    )


def _is_lively(config: Adaptive, takeover: Takeover) -> bool:
    lively = LIVELIER * takeover.slowest_m_s2
    return takeover.liveliness_m_s2 > (lively if lively > config.lively_m_s2 else config.lively_m_s2)


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


def _judge(takeover: Takeover, extending: bool) -> None:
    """After a reversal: one that compensation made worse ends it, for longer each time."""
    if takeover.watch.harms(extending, takeover.turn_m_s2, takeover.gain):
        takeover.wait_s = WAIT_S * WAIT_LONGER**takeover.harms
        takeover.harms, takeover.harmless = takeover.harms + 1, 0
    elif takeover.gain == 1.0:
        takeover.harmless += 1
        if takeover.harmless == FORGIVEN:
            takeover.harms, takeover.harmless = max(0, takeover.harms - 1), 0


def _watch_valve(state: AdaptiveState, control_V: float) -> None:
    """For how long plain control has held the valve open, and for how long the overlap held it shut before: a wide
    overlap holds a small motion for long, so that its valve opens late."""
    takeover, edge = state.takeover, state.flow.edges[control_V > 0.0]
    if abs(control_V) > edge.dead_band_V + edge.play_V:
        takeover.flowing_ticks += 1
    elif takeover.flowing_ticks:
        takeover.flowing_ticks, takeover.shut_ticks = 0, 1
    else:
        takeover.shut_ticks += 1


def _watch_turns(config: Adaptive, state: AdaptiveState, velocity_m_s: float) -> None:
    """The blend between plain and compensated falls wholly between two reversals: letting go begins a fifth into a half
    stroke, taking over two fifths, when what plain control's reversal set ringing has died away."""
    takeover = state.takeover
    takeover.turn_ticks += 1
    if velocity_m_s * takeover.turn_sign < 0.0:
        takeover.half_ticks, takeover.turn_ticks = takeover.turn_ticks, 0
    if velocity_m_s:
        takeover.turn_sign = velocity_m_s
    half, ticks = takeover.half_ticks, takeover.turn_ticks - AHEAD
    if half > 0 and ticks == 2 * half // 5:
        _judge(takeover, velocity_m_s > 0.0)
    takeover.turn_now = half > 0 and ticks == half // 5
    takeover.start_now = (
        half > 0 and 0.4 * half <= ticks <= 0.55 * half and takeover.flowing_ticks * state.context.tick_s > FLOWING_S
    )
    if takeover.turn_now:
        takeover.pace = 1.0 / clip(0.4 * half, 10.0, config.takeover_s * state.context.rate_Hz)
