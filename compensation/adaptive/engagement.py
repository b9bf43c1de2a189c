"""Bumpless transfer between plain control and compensation: when to engage and disengage, and how.

Two quantities move: the ramp (0 plain control, 1 compensated), which weighs all volts added, and the share g of the
feed-forward in the reference (reference.py). Phases and transitions:

| phase | entered when | ramp | feed-forward g |
|---|---|---|---|
| PLAIN | ramp = 0 | 0 | 0 |
| ENGAGING | from PLAIN: excited, in the engage window, checks passed, no leg waited for; or armed | up, within a half stroke | 0 |
| COMPENSATED | ramp = 1 and excited | 1 | up to 1 in `feed_forward_s` |
| FEED_FORWARD_OUT | ramp = 1 and no longer excited | 1 | down to 0 in `disengage_s` |
| DISENGAGING | g = 0, after a reversal or at rest | down, within a half stroke | 0 |
| TRIPPED | valve no longer identified, between two reversals; or lockout | down in `engage_s` / 4 | held, 0 at the end |

On entry to ENGAGING the reference joins the piston, so that the volts begin without a step. ENGAGING and DISENGAGING
change into each other while the ramp moves, as the excitation comes and goes.

Armed: started with what was learned before, of this machine or its twin. It engages as soon as the setpoints ahead
begin to move, with plain control's bumps of then as the baseline. A piston that then does not follow as where it was
learned is another machine's, and is let go before the first reversal. Where the motion has not begun nothing lags yet: the
ramp ends before the piston moves, g = 1. Else g rises in `ARMED_FEED_FORWARD_S`. The first reversal tells
whether the motion is excited.

Excited: the acceleration of the setpoint at reversals exceeds max(`min_excitation_m_s2`, 1.3 x stability limit), until
it falls below the stability limit. The limit is the reversal acceleration below which the hydraulic resonance of a
light load grows too much, as friction falls with speed.

Checks before engaging: checks.py.
"""

from __future__ import annotations

import math

from ..arithmetic import clip
from ..compiled import compiled
from ..prediction import PREVIEW_TICKS
from .chambers import compliance_m_Pa
from .checks import checks_passed, excited_enough, plain_valve_told
from .edge_rounding import upper_bound_V
from .friction import friction_ready, inertia_Pa, resonance_growth_1_s
from .layout import DEMANDS, LEAD_TICKS
from .monitor import add_to_monitor, begin_range, monitor_ready, worse_than_baseline
from .stroke import far_from_reversal, track_opening
from .valve import valve_ready

PHASES = ("plain control", "engaging", "compensated", "feed-forward going out", "disengaging", "tripped")
PLAIN, ENGAGING, COMPENSATED, FEED_FORWARD_OUT, DISENGAGING, TRIPPED = range(6)
AT_REST_M_S2 = 1e-3  # acceleration below which nothing moves

EXCITATION_MEMORY_S = 10.0  # time constant with which the recent peak of the excitation decays
STABILITY_SPEED_M_S = 1.2e-3  # stability limit [m/s2] over growth rate of the hydraulic resonance [1/s]
LOCKOUT_S, LOCKOUT_RATIO = 4.0, 4.0  # after the first trip, and how many times longer after each further one
REVERSALS_TO_FORGIVE = 20  # good ones, after which one trip is forgotten
MAX_WAIT_S = 1.0  # for the middle of a half stroke, to leave a valve that is no longer identified
MAX_WAIT_OTHERS_S = 10.0  # most that a leg of a platform waits for the others
TELL_TICKS, HEARD_S = 50, 0.3  # between two times that a leg says how far it is; for which others remember it
GENTLE_SHARE = 0.45  # of its own strongest reversal of late, below which a leg does not wait for another one
READY_S = 3.0  # for which a leg that was ready counts as ready, whatever its last reversal was like
FRICTION_S = 0.1  # in which friction comes in before the ramp, of a leg that is told its load
MIN_OPEN_S = 0.08  # time the valve has been open under plain control before engaging
ARMED_ENGAGE_S, ARMED_FEED_FORWARD_S = 0.1, 0.4  # ramp and g after a start with what was learned
JOIN_ERRORS = 4.0  # standard deviations of a position within which a piston stands at its setpoint
JOIN_M_S2, JOIN_M_S = 5e-3, 3e-3  # or with which the loop brings it there; of a setpoint whose motion has not begun
OTHER_RATIO, OTHER_V = 2.0, 0.01  # over how far a piston follows where it was learned: another machine
TRIP_SPEED = 4.0  # of the ramp when tripped, over that of engaging


@compiled
def weight(ramp):
    """Share of the volts that is added: smooth in the ramp."""
    return ramp * ramp * (3.0 - 2.0 * ramp)


@compiled
def update_engagement(state, setpoint_m_s, setpoint_m_s2, position_m, control_V, behind_m):
    """One tick of the transfer.

    setpoint_m_s, setpoint_m_s2: of the setpoint, PREVIEW_TICKS ahead; behind_m: reference now less the piston.
    """
    engagement, reference, settings = state.engagement, state.reference, state.settings
    add_to_monitor(state.monitor, position_m, behind_m)
    if engagement.ramp == 0.0:
        track_opening(engagement, state.valve, control_V - state.valve.null_V)
    _track_reversals(state, reference.velocity_m_s)
    _track_excitation(state, setpoint_m_s2)

    identified, step = valve_ready(state.valve), settings.tick_s / settings.engage_s
    friction_target = 1.0 if identified and friction_ready(state.friction) else 0.0
    if friction_target != engagement.friction_share:
        hurries = engagement.ramp == 0.0 and plain_valve_told(state)  # nothing acts yet: only histories must fill
        most = settings.tick_s / (FRICTION_S if hurries else settings.engage_s)
        engagement.friction_share += clip(friction_target - engagement.friction_share, -most, most)
    if engagement.lockout_s > 0.0:
        engagement.lockout_s -= settings.tick_s

    phase = engagement.phase = _next_phase(state, identified, _may_engage(state, identified))
    _watch_following(state, settings.position_gain_V_per_m * abs(behind_m))
    if phase == TRIPPED:
        engagement.ramp = max(0.0, engagement.ramp - TRIP_SPEED * step)
    elif phase == ENGAGING:
        if engagement.ramp == 0.0 and engagement.armed and stands_at_setpoint(state, setpoint_m_s, behind_m):
            reference.feed_forward = reference.linear = 1.0
            engagement.ramp_step = 1.0 / PREVIEW_TICKS
        elif engagement.ramp == 0.0:
            _join(state, behind_m)
        engagement.ramp = min(1.0, engagement.ramp + engagement.ramp_step)
    elif phase == DISENGAGING:
        engagement.ramp = max(0.0, engagement.ramp - engagement.ramp_step)
    _move_feed_forward(state, identified)


@compiled
def _watch_following(state, volts_V):
    """How far the piston is off the reference, in volts of the loop. Armed it may be twice as far as where it was learned, or
    the machine is another one, and nothing of what was learned is used on it. Of a controller that feeds forward itself
    this tells nothing: its own motion does not begin as the reference does."""
    engagement, settings = state.engagement, state.settings
    if engagement.ramp < 1.0:
        return
    if not engagement.armed and state.reference.feed_forward == 1.0:
        faded = engagement.follows_V * (1.0 - settings.tick_s / EXCITATION_MEMORY_S)
        engagement.follows_V = max(faded, volts_V)
    known = engagement.follows_V > 0.0 and settings.controller_feeds_forward == 0.0
    if engagement.armed and known and volts_V > OTHER_RATIO * engagement.follows_V + OTHER_V:
        engagement.armed, engagement.other, engagement.lockout_s = False, True, LOCKOUT_S


@compiled
def _move_feed_forward(state, identified):
    """The share g, and the caution about the edges' rounding that goes with it."""
    engagement, reference, settings = state.engagement, state.reference, state.settings
    if engagement.ramp == 0.0:
        reference.feed_forward = reference.linear = 0.0
    elif engagement.ramp == 1.0:
        coming = identified and (engagement.excited or engagement.armed)
        rise_s = ARMED_FEED_FORWARD_S if engagement.armed else settings.feed_forward_s
        change = settings.tick_s / rise_s if coming else -settings.tick_s / settings.disengage_s
        reference.linear = clip(reference.linear + change, 0.0, 1.0)
        waits = state.trust.turning_s > 0.0 and not state.trust.trusted
        if coming and waits and not engagement.armed and reference.load_given != 2:
            change = -change
        reference.feed_forward = clip(reference.feed_forward + change, 0.0, 1.0)
    if settings.controller_feeds_forward != 0.0:  # plain control has no lag either
        reference.feed_forward = reference.linear = 1.0
    # until the dead band is compensated, too small a compensation is safer than too large a one
    transfer = engagement.ramp > 0.0 and reference.linear < 1.0
    state.trim.minimum_V = (1.0 - reference.linear) * upper_bound_V(state.rounding) if transfer else 0.0


@compiled
def _next_phase(state, identified, may_engage):
    """The table's second column."""
    engagement = state.engagement
    engagement.lost_ticks = 0 if identified else engagement.lost_ticks + 1
    waited = engagement.between or engagement.lost_ticks * state.settings.tick_s > MAX_WAIT_S
    if engagement.lockout_s > 0.0 or not (identified or (engagement.ramp == 1.0 and not waited)):
        return TRIPPED if engagement.ramp > 0.0 else PLAIN
    if engagement.ramp == 0.0:
        moves = engagement.excited or abs(engagement.acceleration_m_s2) > AT_REST_M_S2
        if engagement.armed and moves and engagement.reversal_ticks > DEMANDS:
            engagement.ramp_step = state.settings.tick_s / ARMED_ENGAGE_S
            return ENGAGING
        return ENGAGING if may_engage else PLAIN
    if engagement.ramp < 1.0:
        return ENGAGING if engagement.excited or engagement.armed else DISENGAGING
    if engagement.excited or engagement.armed:
        return COMPENSATED
    at_rest = abs(engagement.acceleration_m_s2) < AT_REST_M_S2
    lags = state.reference.linear == 0.0 or state.settings.controller_feeds_forward != 0.0
    may_leave = lags and (engagement.after_reversal or at_rest)
    return DISENGAGING if may_leave else FEED_FORWARD_OUT


@compiled
def _may_engage(state, identified):
    """Whether a leg under plain control is ready to engage, it may do so now, and no other leg of its platform is waited for.

    Where some legs are compensated and others are not, bumps that cancelled in an axis no longer do: with three legs that know
    their machine one reversal in fourteen is worse than plain control's. So those that are ready wait for those that are not.
    """
    engagement, tick_s, told = state.engagement, state.settings.tick_s, state.reference.load_given == 2
    plain = engagement.ramp == 0.0 and engagement.lockout_s <= 0.0
    known = plain and identified and engagement.excited and engagement.friction_share == 1.0
    ready = known and (engagement.engage_window or told) and checks_passed(state)
    engagement.ready_s = READY_S if ready else max(0.0, engagement.ready_s - tick_s)
    engagement.asks = plain and told and engagement.excited and engagement.ready_s == 0.0
    engagement.ticks = engagement.ticks + 1 if told else 0
    engagement.asked_s = max(0.0, engagement.asked_s - tick_s)
    engagement.joined_s = max(0.0, engagement.joined_s - tick_s)
    others = engagement.asked_s > 0.0 and engagement.joined_s == 0.0
    waits = ready and others and engagement.waited_s < MAX_WAIT_OTHERS_S
    engagement.waited_s = engagement.waited_s + tick_s if waits else (engagement.waited_s if plain else 0.0)
    return ready and engagement.engage_window and not waits


@compiled
def tells_now(engagement):
    """Whether this tick tells the other legs of a platform how far this one is."""
    return engagement.ticks % TELL_TICKS == 1


@compiled
def hear_engagement(engagement, other):
    """Another leg tells how far it is. One that turns much more gently is not waited for."""
    if other.asks and other.strongest_m_s2 > GENTLE_SHARE * engagement.strongest_m_s2:
        engagement.asked_s = HEARD_S
    if other.ramp > 0.0:
        engagement.joined_s = HEARD_S


@compiled
def arm(state, known):
    """Start with what `keep_plain_control` kept: where it says what plain control's reversals were like."""
    engagement, monitor = state.engagement, state.monitor
    monitor.baseline_m_s2[:], monitor.reversal_m_s2[:] = known.baseline_m_s2, known.reversal_m_s2
    if not (valve_ready(state.valve) and friction_ready(state.friction) and monitor_ready(monitor)):
        return
    engagement.armed, engagement.friction_share, state.trust.trusted, state.trust.error_m_s2 = True, 1.0, True, 0.0
    engagement.stability_limit_m_s2, engagement.follows_V = _stability_limit_m_s2(state), known.follows_V


@compiled
def keep_plain_control(state, known):
    """Bumps of plain control's reversals, what was asked for at them, and how far a compensated piston follows."""
    known.baseline_m_s2[:], known.reversal_m_s2[:] = state.monitor.baseline_m_s2, state.monitor.reversal_m_s2
    known.follows_V = state.engagement.follows_V


@compiled
def stands_at_setpoint(state, setpoint_m_s, behind_m):
    """Whether the motion has not begun, and plain control brings the piston to its setpoint unfelt, or it is within noise."""
    loop_1_s, size = max(state.reference.loop_1_s[0], state.reference.loop_1_s[1]), abs(behind_m)
    near = size < JOIN_ERRORS * state.monitor.noise_m or size * loop_1_s * loop_1_s < JOIN_M_S2
    return near and abs(setpoint_m_s) < JOIN_M_S


@compiled
def _join(state, behind_m):
    """Shift the reference, and the demands already made for the ticks ahead, to where the piston is."""
    state.reference.lag_m += behind_m
    state.inverse.oil_m -= behind_m
    for i in range(state.demands.count):
        state.demands.position_m[i] -= behind_m
        state.demands.oil_m[i] -= behind_m


@compiled
def _track_excitation(state, setpoint_m_s2):
    """The recent peak of the setpoint's acceleration, renewed at each reversal, with enable/disable hysteresis."""
    engagement = state.engagement
    engagement.acceleration_m_s2 += 0.1 * (setpoint_m_s2 - engagement.acceleration_m_s2)
    size = abs(engagement.acceleration_m_s2)
    if size > engagement.peak_m_s2:
        engagement.peak_m_s2 = size
    faded = engagement.excitation_m_s2 * (1 - state.settings.tick_s / EXCITATION_MEMORY_S)
    engagement.excitation_m_s2 = size if size > faded else faded
    faded = engagement.strongest_m_s2 * (1 - state.settings.tick_s / EXCITATION_MEMORY_S)
    engagement.strongest_m_s2 = max(faded, engagement.reversal_m_s2)
    if engagement.after_reversal:
        engagement.excitation_m_s2 = engagement.reversal_m_s2 = engagement.peak_m_s2
        engagement.peak_m_s2 = 0.0
        engagement.stability_limit_m_s2 = _stability_limit_m_s2(state)
    if engagement.excitation_m_s2 < engagement.stability_limit_m_s2:
        engagement.excited = False
    elif excited_enough(engagement, state.settings):
        engagement.excited = True


@compiled
def _stability_limit_m_s2(state):
    """Acceleration of a reversal below which compensation leaves it alone.

    Near rest friction falls with speed faster than viscous friction rises. The hydraulic resonance then grows, at a
    rate that is high for a light load. The pressure damping takes its own rate off, as far as the resonance lies in
    its band.
    """
    settings = state.settings
    compliance = compliance_m_Pa(settings, 0.5 * settings.stroke_m)
    over_band = 2 * math.pi * settings.damping_high_Hz * math.sqrt(compliance * inertia_Pa(state.friction))
    growth = resonance_growth_1_s(state.friction) - 0.5 * settings.damping_1_s * min(1.0, over_band**4)
    return clip(STABILITY_SPEED_M_S * growth, AT_REST_M_S2, settings.max_stability_limit_m_s2)


@compiled
def _judge_reversal(engagement, monitor, extending):
    """A compensated reversal worse than the baseline trips, with a longer lockout each time."""
    if worse_than_baseline(monitor, extending, engagement.reversal_m_s2, engagement.ramp):
        engagement.lockout_s, engagement.other = LOCKOUT_S * LOCKOUT_RATIO**engagement.trips, False
        engagement.trips, engagement.good_reversals = engagement.trips + 1, 0
    elif engagement.ramp == 1.0:
        engagement.good_reversals += 1
        if engagement.good_reversals == REVERSALS_TO_FORGIVE:
            engagement.trips, engagement.good_reversals = max(0, engagement.trips - 1), 0


@compiled
def begin_judging(engagement, monitor, half_s):
    """The first reversal of an armed start is not judged: its range holds the beginning of the motion. Neither is the
    trembling of a reference that has joined a noisy reading."""
    engagement.armed = half_s < ARMED_ENGAGE_S or engagement.reversal_m_s2 < AT_REST_M_S2
    begin_range(monitor)


@compiled
def _track_reversals(state, velocity_m_s):
    """Reversals of the reference, and the windows between two of them.

    The ramp falls wholly between two reversals. Disengaging begins a fifth into a half stroke. Engaging begins at two
    fifths, when the oscillation that plain control's reversal excited has decayed; of a leg that is told its load as long
    as the stroke goes on, too.
    """
    engagement, settings = state.engagement, state.settings
    engagement.reversal_ticks += 1
    if velocity_m_s * engagement.direction < 0.0:
        engagement.half_ticks, engagement.reversal_ticks = engagement.reversal_ticks, 0
    if velocity_m_s != 0.0:
        engagement.direction = velocity_m_s
    half, ticks = engagement.half_ticks, engagement.reversal_ticks - LEAD_TICKS - state.shift
    engagement.after_reversal = engagement.engage_window = engagement.between = False
    opened = engagement.open_ticks * settings.tick_s > MIN_OPEN_S
    if half == 0 or ticks > 0.55 * half:
        engagement.engage_window = opened and state.reference.load_given == 2 and far_from_reversal(state, velocity_m_s)
        return
    if ticks == 2 * half // 5:
        if engagement.armed:
            begin_judging(engagement, state.monitor, half * settings.tick_s)
        else:
            _judge_reversal(engagement, state.monitor, velocity_m_s > 0.0)
    engagement.engage_window = ticks >= 0.4 * half and opened
    engagement.between = ticks >= half // 5
    if ticks == half // 5:
        engagement.after_reversal = True
        engagement.ramp_step = 1.0 / clip(0.4 * half, 10.0, settings.engage_s / settings.tick_s)
