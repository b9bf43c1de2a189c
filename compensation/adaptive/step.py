"""One control tick: from a sample to the volts that are added.

demanded motion    what the position loop makes of the setpoint through the identified valve, with its dead band at first, without it
                   once the volts are in; what plain control lags by beyond that is measured
volts              those that make the identified leg follow it (inverse.py), less the controller's own on it
engagement         where b^2/(b^2 + e^2 + f^2 + d^2 + PERCEIVED^2) > LEAST_SHARE, sums over a platform's legs, and the misfit is no more
                   than KNOWN_LEG: b the bump of a leg of the model under plain control, f that of one with the volts, both with the
                   noise and counts of the real one, which start stick-slip; e the one that the doubt about the numbers makes:
                   S P S' of the acceleration, P the numbers' covariance; of the last half strokes, by what is known now; d what the model
                   lacks, its valve too. It leaves where e^2 + f^2 + d^2 are that share of more half strokes, calm ones aside, and a leg
                   with start parameters stays by that rule from its first motion on. Readings that show more than twice plain control's
                   bump are f, and it leaves at once
probe              what plain control hides of the valve shows in a small motion above the felt band, while the doubt alone keeps the
                   volts out
"""

from __future__ import annotations

from math import exp, pi, sin, sqrt

from ..arithmetic import copy, push
from ..compiled import compiled, inlined
from ..loop_feedback import fed_back_V
from ..prediction import start_prediction
from .damping import (
    damping_rate_1_s,
    damping_V,
    design_damping,
    let_out_V,
    let_out_V_Pa,
    oil_stiffness,
    start_damping,
    watch_damping,
)  # fmt: skip
from .estimator import FAST_SHARE, FAST_m_s, collect, hear_windows, is_known_leg, slowest_m_s, watch, watch_legs, work
from .fit import NARROW, follow, forward
from .inverse import AHEAD, FELT_HZ, improve, keep_first, low_pass
from .layout import HALVES, HISTORY, LONG, MOST_DELAY, QUEUE
from .leg import (
    AMP,
    AMP_LAG,
    COULOMB_DN,
    COULOMB_UP,
    DEAD_DN,
    DEAD_UP,
    DELAY,
    GIVE,
    HOLD,
    LN_ROUND,
    LN_SPOOL,
    M1,
    M2,
    MASS,
    N_NUMBERS,
    P1,
    P2,
    PLAY,
    POSITION_LAG,
    S_A1,
    S_A2,
    S_FOUR_WAY,
    S_OWN,
    S_STROKE,
    SPREAD,
    SPRING,
    VISCOUS_DN,
    VISCOUS_UP,
    ZETA,
    V,
    X,
    Y,
    Z,
    tangent,
    tick,
    valve_lag_s,
)  # fmt: skip
from .prior import fill_sheet
from .reference import USUAL_m_s, gains, loop_speed, next_lag, plan_motion, plan_setpoints, watch_lateness

FOLLOW_S = 0.3  # in which the numbers that act follow those that are found
# in which the volts at the soonest, and the probe, come in; the demanded motion is then plain control's own but for its reversals
RAMP_S = 0.15
LINEAR_S = 4.0  # in which the demanded motion then becomes the setpoint: of a sine of 0.5 m/s2 a deviation of 0.06 m/s2
# in which it becomes plain control's again, and the volts go at the latest: they are wrong, and a piston that lags at once would stop
LEAVE_S = 1.5
# of bump^2 in bump^2 + doubt^2 + left^2 + lacking^2, from which it engages, and of the others, from which it leaves: above 1/2 a smaller
# bump is expected, and a change of sides is felt. On 20 drawn legs 0.5, 0.65 and 0.8 made the same one reversal of 674 worse, and legs
# with much doubt engaged below 0.8 alone
LEAST_SHARE = 0.65
# ISO 2631-1, C.2: half of alert people just perceive this peak; a bump that nobody feels is no gain
PERCEIVED_m_s2 = 0.015
# threshold of perception of a peak in heave. A leg that goes on from an earlier run leaves for no smaller doubt before it has seen such a
# bump, and before its first half stroke has ended no smaller corner of the setpoint counts
CLEARLY_m_s2 = 10.0 * PERCEIVED_m_s2
MOST_DOUBT = 2.0  # of bump^2 in one half stroke: beyond it the numbers' errors leave the linear range, and say no more
SAY_TICKS = 8  # from one time to the next that a leg of a platform says whether it wants to engage
PROBE_HZ = (70.0, 120.0)  # above the band in which a bump is judged: spools of 25 Hz and of 250 Hz differ there
# of the bump, as acceleration of each tone: ISO 2631-1 (Wk) weighs them by 0.16 and 0.06, so that a tenth of the bump is felt. With
# half of it, of 26 drawn legs in irregular motion four were not known before the middle of the run, with it none; 52 fresh ones show
# no such difference
PROBE = (0.6, 1.6)
LEAST_PASSED = 1.0 / 3.0  # of a tone: if the valve is a fast one after all, a third of the bump is felt
# from the demanded motion, from which the inverse begins anew: more than a stroke's lag changes at once; while no volts are in, more
# than a dead band that is found anew shifts the motion
OFF_m, OFF_OUTSIDE_m = 5e-3, 5e-4
COARSEST = 1.0 / 256.0  # of the range to one side: half a count of a converter of 8 bits
# corner of the low pass over the acceleration that the position's readings show: noise of 3 um gives 0.03 m/s2, 18 um 0.17
SEEN_HZ = 30.0
QUIET_TICKS = 20  # for which no leg may object
# faster than this nothing is commanded that is to be followed, but corners and steps: of a sine of 3 Hz four high passes let 1 % through
JOLT_HZ = 10.0
# of what a valve without lag would pass: an identified one is sure to that, for its response changes with its stroke. On 16 draws legs
# that are found reach one to nine times their bump, those that shook 18 to 128 times
VALVE_ERROR = 0.03


@compiled
def start(s):
    """Nothing known. s: a record of zeros with its settings."""
    fill_sheet(s.sheet, s.settings)
    s.past.noise_m = s.settings.position_error_m
    s.past.noise_Pa = max(sqrt(s.settings.pressure_noise_Pa**2 + s.settings.pressure_resolution_Pa**2 / 12.0), 1.0)
    s.past.noise_m = max(s.past.noise_m, 1e-8)
    start_prediction(s.prediction)
    start_damping(s.damping, s.settings.tick_s)
    s.reference.late_sums[1] = USUAL_m_s**2
    s.objected = QUIET_TICKS
    s.platform = 1 if s.settings.legs > 1 else 0


@compiled
def _steady(x, s, y, v, numbers):
    """A state of steady motion at y, v."""
    x[:] = 0.0
    up = v >= 0.0
    friction = (numbers[COULOMB_UP] if up else -numbers[COULOMB_DN]) + v * (
        numbers[VISCOUS_UP] if up else numbers[VISCOUS_DN]
    )
    supply = s.past.supply_mean_Pa
    a1, a2 = s.sheet[S_A1], s.sheet[S_A2]
    x[Y], x[V] = y, v
    if s.sheet[S_FOUR_WAY] != 0.0:
        x[P2] = 0.5 * supply
    else:
        x[P2] = supply
    spring = numbers[SPRING] * (y - 0.5 * s.sheet[S_STROKE])
    x[P1] = (x[P2] * a2 + numbers[HOLD] + spring + friction) / a1
    x[M1], x[M2] = x[P1], x[P2]
    gain_up, gain_dn = gains(s)
    volts = v / gain_up + numbers[DEAD_UP] if up else v / gain_dn - numbers[DEAD_DN]
    x[AMP] = x[X] = volts
    x[Z] = friction * numbers[GIVE]
    return volts


@compiled
def _invert(s):
    """Volts of this tick, before the hysteresis' inverse."""
    inv, ref = s.inverse, s.reference
    whole = int(s.numbers[DELAY] / s.settings.tick_s)
    for j in range(AHEAD + 1):
        inv.y[j], inv.v[j] = ref.position_m[whole + j], ref.velocity_m_s[whole + j]
    for j in range(AHEAD):
        inv.extra[j] = s.numbers[MASS] * ref.extra_m_s2[whole + j]
    limit, supply = s.settings.voltage_max_V, s.past.supply_mean_Pa
    up, down = gains(s)
    early = int((valve_lag_s(s.numbers) - s.numbers[DELAY]) / s.settings.tick_s + 0.5)
    for j in range(AHEAD):
        v = inv.v[min(j + early, AHEAD)]
        inv.steady[j] = v / up + s.numbers[DEAD_UP] if v > 0.0 else v / down - s.numbers[DEAD_DN]
    if inv.running and whole > inv.whole:  # what is sent now arrives a tick later than what was sent before
        split = s.numbers[DELAY] / s.settings.tick_s - whole
        tick(inv.x, inv.S, s.numbers, s.sheet, inv.before, inv.before, split, supply, inv.extra[0], inv.w)
    elif inv.running and whole < inv.whole:
        inv.x[Y] -= s.settings.tick_s * inv.x[V]
        inv.x[V] -= inv.v[1] - inv.v[0]
    if whole != inv.whole:
        s.expected.compensating = 0
    inv.whole = whole
    off_m = OFF_m if s.share > 0.0 else OFF_OUTSIDE_m
    if not inv.running or (abs(inv.x[Y] - inv.y[0]) > off_m and (s.share > 0.0 or _in_motion(s))):
        s.expected.unsteady, s.expected.compensating = QUEUE, 0
        volts = _steady(inv.x, s, inv.y[0], inv.v[0], s.numbers)
        inv.U[:] = volts
        inv.before = inv.older = volts
        inv.filtered[:] = 0.0
        inv.running = 1
    improve(
        inv.x, inv.U, inv.before, inv.older, inv.y, inv.v, inv.filtered, s.numbers, s.sheet, supply, inv.extra, limit, inv
    )  # fmt: skip
    return inv.U[0]


@inlined
def _given(plays, spread):
    """Volts behind both plays of the valve's hysteresis (`behind_backlash`); plays: what the wide and the narrow one give."""
    return plays[0] + spread * (plays[1] - plays[0])


@inlined
def _move_plays(plays, volts, half):
    """Both plays under volts."""
    plays[0], plays[1] = follow(plays[0], volts, half)[0], follow(plays[1], volts, NARROW * half)[0]


@compiled
def _load_Pa(s, bottom_Pa, top_Pa):
    """Of a rod side on the supply its pressure is no part of the load's oscillation."""
    return bottom_Pa - (s.sheet[S_A2] / s.sheet[S_A1] * top_Pa if s.sheet[S_FOUR_WAY] != 0.0 else 0.0)


@compiled
def _noise(s):
    """A reading's noise [standard deviations]: evenly distributed numbers of Park and Miller (Comm. ACM 31, 1988), the same in every
    run."""
    e, prime = s.expected, 2147483647
    e.random = 16807 * max(e.random, 1) % prime
    return sqrt(12.0) * (e.random / prime - 0.5)


@compiled
def _judged(memory, x, sheet):
    """One tick of the band in which a bump is judged; memory (4, 2)."""
    for k in range(len(memory)):
        x = low_pass(memory[k], x, sheet)
    return x


@compiled
def _follow_volts(s, twin, volts, extra):
    """A tick of a leg of the model, a record TWIN, under volts before its hysteresis. Returns its acceleration [m/s2]."""
    numbers, speed, tick_s = s.numbers, twin.x[V], s.settings.tick_s
    _move_plays(twin.plays, volts, numbers[PLAY])
    given = _given(twin.plays, numbers[SPREAD])
    split = numbers[DELAY] / tick_s - int(numbers[DELAY] / tick_s)
    supply, none, w = s.past.supply_mean_Pa, s.expected.S, s.expected.w
    tick(twin.x, none, numbers, s.sheet, given, twin.before_V, split, supply, extra, w)
    twin.before_V = given
    return (twin.x[V] - speed) / tick_s


@compiled
def _compensate(s):
    """The leg of the model under the volts of the tick that has passed, with position loop, damping, noise and counts as they are.
    Returns by how far it misses the demanded acceleration, in the judged band [m/s2]."""
    e, inv, d, twin = s.expected, s.inverse, s.damping, s.expected.compensated
    x, own = twin.x, inv.x
    if not e.compensating:
        copy(own, x)
        twin.before_V, e.compensating = inv.before, 1
        twin.plays[0], twin.plays[1] = inv.plays[0], inv.plays[1]
        twin.loop.started = 0
    away_m = x[Y] - own[Y]
    off_Pa = _load_Pa(s, x[M1], x[M2]) - _load_Pa(s, own[M1], own[M2])
    push(e.deviation_Pa, off_Pa + s.past.noise_Pa * _noise(s))
    volts = inv.plays[2] + e.rounded_V - s.settings.position_gain_V_per_m * (away_m + e.noise_m)
    volts -= let_out_V(d, e.deviation_Pa) + fed_back_V(twin.loop, s.settings, away_m, off_Pa)
    missed = _follow_volts(s, twin, volts, inv.extra[0]) - (inv.v[1] - inv.v[0]) / s.settings.tick_s
    return _judged(twin.filtered, missed, s.sheet)


@compiled
def _move_on(s, valve_V):
    """The window moves on over the tick that has passed, under what was sent: a converter rounds what was asked for. What is further off
    is a limit or a fault, which more volts would not mend. Returns what acceleration was left, in the low pass [m/s2]."""
    inv, e = s.inverse, s.expected
    if not inv.running:
        return 0.0
    off = valve_V - s.asked_V
    e.rounded_V = off if abs(off) <= COARSEST * s.settings.voltage_max_V else 0.0
    e.noise_m = s.past.noise_m * _noise(s)
    e.missed = max(e.missed, abs(_compensate(s)))
    sent = inv.U[0] + e.rounded_V
    left = keep_first(
        inv.x, inv.U, sent, inv.before, inv.y, inv.v, inv.filtered, s.numbers, s.sheet, s.past.supply_mean_Pa, inv.extra, inv.S, inv.w
    )  # fmt: skip
    inv.older, inv.before = inv.before, sent
    return left


@compiled
def _damp(s, bottom_Pa, top_Pa):
    """Volts against the load pressure's oscillation about the model's, which is of this tick."""
    d, x, sheet, settings = s.damping, s.inverse.x, s.sheet, s.settings
    whole = int(s.numbers[DELAY] / settings.tick_s)
    turn = (s.past.ticks - settings.leg) % max(settings.legs, 1) == 0
    for j in range(MOST_DELAY, 0, -1):
        d.expected_Pa[j] = d.expected_Pa[j - 1]
    d.expected_Pa[0] = _load_Pa(s, x[M1], x[M2])
    watch_damping(d, s.numbers, _load_Pa(s, bottom_Pa, top_Pa) - d.expected_Pa[whole], turn)
    up, down = gains(s)
    own = settings.pressure_gain_V_per_Pa
    if sheet[S_FOUR_WAY] != 0.0:
        own *= 1.0 + (sheet[S_A2] / sheet[S_A1]) ** 3
    bump2 = max(s.expected.sigma2 + s.expected.left2, PERCEIVED_m_s2**2)
    rate = damping_rate_1_s(s.numbers, sheet, s.past.noise_Pa, bump2)
    d.let_out_V_Pa = let_out_V_Pa(
        rate, oil_stiffness(s.numbers, sheet, x, s.inverse.w), sheet[S_A1], 0.5 * (up + down), own
    )
    return damping_V(d) if s.share > 0.0 else 0.0


@compiled
def _in_motion(s):
    """Whether the demanded motion is as fast as where windows begin, and faster than noise: a steady state is near the leg's own."""
    speed = abs(s.reference.velocity_m_s[int(s.numbers[DELAY] / s.settings.tick_s)])
    return speed > min(FAST_m_s, max(FAST_SHARE * s.past.fastest_m_s, slowest_m_s(s.past, s.settings.tick_s)))


@compiled
def _see(s):
    """What the readings show of the bump, low: under plain control what there is, noise included, and with volts in whether it is beyond
    that. Then the volts are wrong whatever the numbers' covariance says, and this half stroke has left so much."""
    e, ref, y, now, tick_s = s.expected, s.reference, s.past.position_m, s.past.ticks - 1, s.settings.tick_s
    y0, y1, y2 = y[now & (HISTORY - 1)], y[(now - 1) & (HISTORY - 1)], y[(now - 2) & (HISTORY - 1)]
    seen = (y0 - 2.0 * y1 + y2) / (tick_s * tick_s) - (ref.velocity_m_s[1] - ref.velocity_m_s[0]) / tick_s
    share = 1.0 - exp(-2.0 * pi * SEEN_HZ * tick_s)
    for k in range(len(e.seen_filtered)):
        e.seen_filtered[k] += share * (seen - e.seen_filtered[k])
        seen = e.seen_filtered[k]
    e.seen = max(e.seen, abs(seen))
    if s.share > 0.0:
        e.was_plain = 0
        # behind the low pass: w^4 f T noise^2 times twice the integral of x^4/(1 + x^2)^3 over x = f/SEEN_HZ
        noise2 = (2.0 * pi * SEEN_HZ) ** 4 * 3.0 * pi / 8.0 * SEEN_HZ * tick_s * s.past.noise_m**2
        plain2 = max(e.bump2, e.bump * e.bump, 9.0 * noise2)  # noise up to three standard deviations
        for k in range(HALVES):
            plain2 = max(plain2, e.seens2[k])
        # more than twice that is no chance: the largest of a half stroke's noise scatters by a quarter
        if e.seen * e.seen > 2.0**2 * plain2:
            e.wrong = 1
            e.missed = max(e.missed, e.seen)
            e.missed2 = max(e.missed2, e.missed * e.missed / HALVES)


@compiled
def _jolt(e, acceleration_m_s2, tick_s, sheet):
    """What of the setpoint's acceleration is faster than any motion that is to be followed, in the judged band: the largest of each half
    stroke. The loop of plain control rounds it off, and with its lag that would be gone."""
    off, share = _judged(e.jolt_bands, acceleration_m_s2, sheet), 1.0 - exp(-2.0 * pi * JOLT_HZ * tick_s)
    for k in range(len(e.jolt_slow)):
        e.jolt_slow[k] += share * (off - e.jolt_slow[k])
        off -= e.jolt_slow[k]
    e.jolt = max(e.jolt, abs(off))


@compiled
def _saw(e):
    """A half stroke has ended."""
    if e.was_plain:
        e.seens2[e.plain_halves % HALVES] = e.seen * e.seen
        e.plain_halves += 1
    e.seen, e.was_plain, e.wrong = 0.0, 1, 0


@compiled
def _expect(s, volts, left, setpoint_m, forward_V):
    """Bumps that plain control makes by the model, that the volts leave (`_compensate`), and that the doubt about the numbers makes: the
    largest of each half stroke."""
    e, ref, tick_s, numbers = s.expected, s.reference, s.settings.tick_s, s.numbers
    kp, supply = s.settings.position_gain_V_per_m, s.past.supply_mean_Pa
    whole = int(numbers[DELAY] / tick_s)
    split = numbers[DELAY] / tick_s - whole
    v, a = ref.velocity_m_s[whole], (ref.velocity_m_s[whole + 1] - ref.velocity_m_s[whole]) / tick_s
    extra = numbers[MASS] * ref.extra_m_s2[whole]
    up, down = gains(s)
    feeds = 1.0 if s.settings.controller_feeds_forward != 0.0 else 0.0
    here, after = ref.setpoint_m[0], ref.setpoint_m[1]
    plain = e.plain
    if not e.started:
        plain.before_V = _steady(plain.x, s, ref.position_m[0], ref.velocity_m_s[0], numbers)
        plain.plays[:] = plain.before_V
        e.started, e.unsteady = 1, QUEUE
        e.lag_m = here - ref.position_m[0]
    asked = loop_speed(s, e.lag_m, 1.0, up, down)  # plain control's own motion but for its bumps
    e.lag_m = next_lag(s, e.lag_m, after - here, feeds, 1.0, up, down)
    bend = after - 2.0 * here + ref.behind_m
    _jolt(e, bend / (tick_s * tick_s), tick_s, s.sheet)
    smooth = (loop_speed(s, e.lag_m, 1.0, up, down) - asked + feeds * bend / tick_s) / tick_s
    # plain control, by the model
    control = kp * (setpoint_m - plain.x[Y] - e.noise_m) + forward_V + e.rounded_V
    control -= fed_back_V(plain.loop, s.settings, plain.x[Y], _load_Pa(s, plain.x[P1], plain.x[P2]))
    b = _judged(plain.filtered, _follow_volts(s, plain, control, numbers[MASS] * ref.extra_m_s2[0]) - smooth, s.sheet)
    e.bump = max(e.bump, abs(b))
    e.left = max(e.left, abs(left))
    # the numbers' doubt in the compensated motion
    copy(s.inverse.x, e.x)
    copy(e.S[V], e.speed)
    tangent(
        e.x,
        e.S,
        N_NUMBERS,
        N_NUMBERS,
        True,
        numbers,
        s.sheet,
        volts,
        s.inverse.before,
        split,
        e.d_now,
        e.d_before,
        kp,
        supply,
        extra,
        -1,
        0.0,
        0.0,
        e.w,
    )
    for j in range(N_NUMBERS):
        f = (e.S[V, j] - e.speed[j]) / tick_s
        e.row[j] = low_pass(e.filtered[j], f, s.sheet)
    doubt2 = _variance(s, e.row)
    if doubt2 > e.sigma:
        e.sigma = doubt2
        copy(e.row, e.worst)
    peak = a * e.acceleration < 0.0
    if v * e.velocity < 0.0:
        e.turned = 1
    if e.unsteady > 0:  # the start state's own swing is no bump, and a half stroke that turned in it was not seen
        e.unsteady -= 1
        e.bump = e.sigma = e.left = e.missed = e.reach = e.jolt = 0.0
        if e.turned:
            e.begun = 0
    e.acceleration, e.velocity = a, v
    if peak and (e.turned or not e.begun):  # the middle of a stroke: a reversal lies behind
        largest2 = max(e.bump * e.bump, e.missed * e.missed, min(e.sigma, MOST_DOUBT * e.bump * e.bump))
        if s.share > 0.0 and largest2 < e.bump2 / LONG:  # as many weigh less than one of those by which it is judged
            kept = 1.0 - 1.0 / LONG**2
            e.bumps2 *= kept
            e.bump2 *= kept
        elif e.begun and e.bump > 0.0:  # and all of the half stroke
            k = e.halves % LONG
            e.bumps2[k], e.lefts2[k], e.misses2[k] = e.bump * e.bump, e.left * e.left, e.missed * e.missed
            e.reaches2[k], e.jolts2[k] = e.reach * e.reach, e.jolt * e.jolt
            copy(e.worst, e.rows[k])
            e.halves += 1
            if s.share == 0.0:
                e.outside = e.halves
            e.bump2 = e.left2 = e.missed2 = e.reach2 = e.jolt2 = 0.0
            _doubt(s, k)
            count = _counted(e)
            for j in range(count):
                k = (e.halves - 1 - j) % LONG
                e.bump2 += e.bumps2[k] / count
                e.left2 += e.lefts2[k] / count
                e.missed2 += e.misses2[k] / count
                e.reach2 += e.reaches2[k] / count
                e.jolt2 += e.jolts2[k] / count
        _saw(e)
        e.bump = e.sigma = e.left = e.missed = e.reach = e.jolt = 0.0
        e.turned, e.begun = 0, 1


@compiled
def _counted(e):
    """Of the half strokes that have ended those by which it is judged."""
    return min(e.halves, HALVES + e.halves - e.outside, LONG)


@compiled
def _variance(s, row):
    """Of a quantity with derivatives row (N_NUMBERS,) by the numbers, by what is known of them now."""
    known, scaled = s.known, s.expected.scaled
    for j in range(N_NUMBERS):
        scaled[j] = row[j] * known.sd[j]
    forward(known.factor, N_NUMBERS, scaled)
    total = 0.0
    for j in range(N_NUMBERS):
        total += scaled[j] * scaled[j]
    return total * max(1.0, known.chi2[0], known.chi2[1])


@compiled
def _doubt(s, k):
    """The doubt in one of the last half strokes by what is known now: what was not known then does not matter."""
    e = s.expected
    e.doubts2[k] = min(_variance(s, e.rows[k]), MOST_DOUBT * e.bumps2[k])
    e.sigma2, count = 0.0, _counted(e)
    for j in range(count):
        e.sigma2 += e.doubts2[(e.halves - 1 - j) % LONG] / count


@compiled
def _reach(s, volts):
    """What the volts of this tick would make of the demanded acceleration if the valve had no lag, in the judged band: the largest of
    each half stroke."""
    e, ref, tick_s = s.expected, s.reference, s.settings.tick_s
    up, down = gains(s)
    speed = up * max(volts - s.numbers[DEAD_UP], 0.0) + down * min(volts + s.numbers[DEAD_DN], 0.0)
    asked_m_s2 = (ref.velocity_m_s[1] - ref.velocity_m_s[0]) / tick_s
    e.reach = max(e.reach, abs(_judged(e.reach_filtered, (speed - e.reach_m_s) / tick_s - asked_m_s2, s.sheet)))
    e.reach_m_s = speed


@compiled
def _lacking2(s, reach2):
    """What the model lacks, as acceleration squared: the pressure's residual beyond its noise, as white as that, in the judged band;
    and what a valve that is not quite the model's passes of volts which it should hold back. reach2: square of what one without lag
    passes."""
    beyond = max(s.known.chi2[1] - 1.0, 0.0)
    per_Pa = s.sheet[S_A1] / (s.numbers[MASS] * s.sheet[S_OWN])
    band = 2.0 * 0.668 * FELT_HZ * s.settings.tick_s  # integral of 1/(1 + x^4)^4 over x = f/FELT_HZ, four low passes
    return min(band, 1.0) * beyond * (s.fit.noise[1] * per_Pa) ** 2 + VALVE_ERROR**2 * reach2


@compiled
def _goes_on(s):
    """Whether a leg goes on from an earlier run: in its first half stroke it stays as one that is engaged would."""
    return s.fit.restored == 1 and s.expected.halves == 0


@compiled
def _stakes(s):
    """Squares of the bump that plain control makes and of what would stand in its place [m2/s4]: of the last half strokes, or of what the
    first one has shown so far where a leg goes on from an earlier run."""
    e = s.expected
    if _goes_on(s):
        return e.bump * e.bump, e.sigma + e.missed * e.missed + _lacking2(s, e.reach * e.reach)
    return e.bump2, e.sigma2 + e.missed2 + _lacking2(s, e.reach2)


@compiled
def _through_hysteresis(plays, volts, half, spread):
    """What to send so that the valve's hysteresis gives `volts`. plays (3,): what both plays give; what was sent."""
    given, wide, reach = _given(plays, spread), plays[0], NARROW * half
    sign = 1.0 if volts > given else (-1.0 if volts < given else 0.0)
    if sign != 0.0:  # the narrow play moves first, and the other one with it from where it takes hold
        sent = volts + sign * (half + spread * (reach - half))
        if spread > 0.0:
            alone = (volts - wide) / spread + wide + sign * reach
            sent = min(sent, alone) if sign > 0.0 else max(sent, alone)
        plays[2] = sent
    _move_plays(plays, plays[2], half)
    return plays[2]


@compiled
def _sd(s, k):
    """Standard deviation of number k, by what is known now."""
    row = s.expected.row
    row[:] = 0.0
    row[k] = 1.0
    return sqrt(_variance(s, row))


@compiled
def _fastest_rad_s(s):
    """The spool's corner, as fast as it may be: two standard deviations."""
    return 2.0 * pi * exp(s.known.numbers[LN_SPOOL] + 2.0 * _sd(s, LN_SPOOL))


@compiled
def _passed(n, w, corner_rad_s):
    """Share of a sine of w [rad/s] that an amplifier and a spool of numbers n (N_NUMBERS,) with this corner pass."""
    q, late = w / corner_rad_s, w * n[AMP_LAG]
    return 1.0 / sqrt(((1.0 - q * q) ** 2 + (2.0 * n[ZETA] * q) ** 2) * (1.0 + late * late))


@compiled
def _probe(s):
    """Volts [V] of a small motion that shows the valve, for a leg whose doubt alone keeps the compensation out."""
    e, tick_s = s.expected, s.settings.tick_s
    up, down = gains(s)
    v, gain = s.reference.velocity_m_s[0], 0.5 * (up + down)
    closed_V = max(
        0.5 * (s.numbers[DEAD_UP] + s.numbers[DEAD_DN]), exp(s.numbers[LN_ROUND])
    )  # an underlapped valve is never closed
    slow = gain * closed_V
    if abs(v) < slow:
        return 0.0
    corner_rad_s, total, peak = _fastest_rad_s(s), 0.0, 0.0
    for k in range(len(PROBE_HZ)):
        w = 2.0 * pi * PROBE_HZ[k]
        share = PROBE[k] / (w * max(_passed(s.known.numbers, w, corner_rad_s), LEAST_PASSED))
        peak += share
        total += share * sin(w * s.past.ticks * tick_s)
    opened = min(abs(v) / slow - 1.0, 1.0)  # tones fade: what begins at once the spool answers in the felt band
    most = 2.0 * COARSEST * s.settings.voltage_max_V / peak  # tones that are cut off beat at 50 Hz
    amplitude = min(sqrt(e.bump2) / gain, most)
    return amplitude * opened * opened * (3.0 - 2.0 * opened) * total


@compiled
def _probe_through_hysteresis(s, control_V, volts):
    """What to add to plain control so that the valve moves by `volts` more: hysteresis swallows what is smaller than itself. Of its half
    width only what is certain is made up for, two standard deviations less: too much would be felt."""
    plain, half, spread = s.probe.plain, max(s.numbers[PLAY] - 2.0 * _sd(s, PLAY), 0.0), s.numbers[SPREAD]
    _move_plays(plain, control_V, half)
    sent = _through_hysteresis(s.probe.plays, _given(plain, spread) + volts, half, spread)
    return sent - control_V if volts != 0.0 else 0.0


@compiled
def _follow_known(s):
    """A tick of the numbers that act towards those that are found. A bristle that gives more carries its force over a longer way."""
    numbers, known = s.numbers, s.known.numbers
    if numbers[MASS] == 0.0:  # the demanded motion begins where the piston is
        copy(known, numbers)
        s.reference.stale = QUEUE
        s.reference.lag_m = s.reference.followed_m[1] - s.past.position_m[(s.past.ticks - 1) & (HISTORY - 1)]
    give = numbers[GIVE]
    for k in range(N_NUMBERS):
        numbers[k] += s.settings.tick_s / FOLLOW_S * (known[k] - numbers[k])
    for x in (s.inverse.x, s.expected.plain.x, s.expected.compensated.x):
        x[Z] *= numbers[GIVE] / give


@compiled
def tick_of(
    s,
    table,
    preview,
    loads,
    pose_m_s2,
    mobility,
    forces_N,
    speeds_m_s,
    setpoint_m,
    position_m,
    control_V,
    valve_V,
    bottom_Pa,
    top_Pa,
    supply_Pa,
    forward_V,
):
    """Volts to add. preview (n,), loads (n,) or none; everything else of the sample."""
    settings, ref, inv = s.settings, s.reference, s.inverse
    if s.sheet[S_FOUR_WAY] == 0.0:
        top_Pa = supply_Pa
    plan_motion(s, loads, plan_setpoints(s, table, preview))
    watch(s.past, position_m, bottom_Pa, top_Pa, supply_Pa, valve_V, settings.tick_s)
    if s.platform:
        watch_legs(s.past, pose_m_s2, mobility, forces_N, speeds_m_s)
    if settings.learn != 0.0:
        collect(s)
        work(s)
    if not s.known.valid:
        return 0.0
    _follow_known(s)
    if ref.stale > 0:  # a demanded motion by numbers that are not the leg's
        ref.stale -= 1
        return 0.0
    e = s.expected
    watch_lateness(s, position_m)
    if not e.started and not _in_motion(s):
        return 0.0
    left = _move_on(s, valve_V)
    volts = _invert(s)
    _see(s)
    _expect(s, volts, left, setpoint_m, forward_V)
    _doubt(s, s.past.ticks % LONG)
    stays = s.share > 0.0 or _goes_on(s)
    knows = s.known.changed == 0 if s.share > 0.0 else is_known_leg(s.known.chi2)
    wants = False
    # half strokes: one each way, where neither an earlier run nor other legs tell
    seen = 1 if s.fit.restored or s.platform or s.share > 0.0 else 2
    if knows and (e.halves >= seen or (_goes_on(s) and e.unsteady == 0)):
        bump2, doubt2 = _stakes(s)
        # calm motion tells nothing of the bumps that are to come
        calm = stays and s.fit.restored == 1 and e.bump2 < CLEARLY_m_s2**2
        felt2 = (CLEARLY_m_s2 if calm else PERCEIVED_m_s2) ** 2 * max(settings.legs, 1)
        for k in range(settings.legs):  # legs of a platform engage together: what they all gain and may lose counts
            bump2 += s.said_bump2[k]
            doubt2 += s.said_doubt2[k]
        # a change of sides is felt: the other one's bump must be the smaller one by that share, what is not felt aside
        larger2 = doubt2 if stays else bump2
        wants = (larger2 > LEAST_SHARE * (bump2 + doubt2 + felt2)) != stays
    step = settings.tick_s / RAMP_S
    doubted = s.share == 0.0 and e.halves > 0 and knows and not wants
    s.probe.level = min(max(s.probe.level + (step if doubted else -step), 0.0), 1.0)
    probe = _probe_through_hysteresis(s, control_V, s.probe.level * _probe(s)) if s.probe.level > 0.0 else 0.0
    _reach(s, volts)
    total = _through_hysteresis(inv.plays, volts, s.numbers[PLAY], s.numbers[SPREAD]) - _damp(s, bottom_Pa, top_Pa)
    lag = s.numbers[POSITION_LAG] * ref.velocity_m_s[0]
    pressure = s.damping.expected_Pa[inv.whole]
    own = settings.position_gain_V_per_m * (setpoint_m - ref.position_m[0] + lag) + forward_V
    own -= fed_back_V(s.loop, settings, ref.position_m[0], pressure)
    wanted = 1.0 if wants else 0.0
    if s.platform:
        s.wants = 1 if wants else 0
        s.objected = max(s.objected - 1, 0) if wants else QUIET_TICKS
        wanted = 1.0 if s.objected == 0 else 0.0
    # volts that come or go are not felt, but for wrong ones: in a dead band they wait for the stroke
    up, down = gains(s)
    unfelt = PERCEIVED_m_s2 * settings.tick_s / max(0.5 * (up + down) * abs(total - own), PERCEIVED_m_s2 * RAMP_S)
    stands = s.linear > 0.0 and wanted == 0.0 and e.wrong == 0
    leaves = step if e.wrong else min(step, max(unfelt, settings.tick_s / LEAVE_S))
    s.share += min(max((1.0 if stands else wanted) - s.share, -leaves), unfelt)
    # corners of the setpoint, rounded off by plain control's lag, would be felt more than its bumps without it
    jolt2, least_m_s2 = (e.jolt2, PERCEIVED_m_s2) if e.halves > 0 else (e.jolt * e.jolt, CLEARLY_m_s2)
    s.jolts = 1 if jolt2 > max(e.bump2, least_m_s2**2) else 0
    s.jolted = QUIET_TICKS if s.jolts else max(s.jolted - 1, 0)
    follows = wanted if s.share == 1.0 and s.jolted == 0 else 0.0
    step = settings.tick_s / (LINEAR_S if follows > 0.0 else LEAVE_S)
    s.linear_step = min(max(follows - s.linear, -step), step)
    s.linear += s.linear_step
    if s.damping.wanted:
        design_damping(s)
    added = s.share * (total - own) + probe
    s.asked_V = control_V + added
    return added


@compiled
def hear_leg(s, other):
    """Legs of a platform engage together: one that is not known, or where all do not gain, keeps the others out."""
    hear_windows(s, other)
    s.said_bump2[other.settings.leg], s.said_doubt2[other.settings.leg] = _stakes(other)
    if other.jolts:
        s.jolted = QUIET_TICKS
    if other.wants == 0:
        s.objected = QUIET_TICKS
