"""One control tick: from a sample to the volts that are added.

    demanded motion    what the position loop would make of the setpoint through a valve without dead band:
                       y_d' = K (r - y_d), K the loop's gain by the data sheet
    volts              those that make the identified leg follow y_d (inverse.py), less the controller's own on y_d
    share              b^2/(b^2 + e^2), b the bump that plain control makes by the model, e the one that the doubt about the
                       numbers leaves in the compensated motion: S P S' of the acceleration, P the numbers' covariance
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from ..adaptive.layout import MAX_LOOK, PREVIEW_TICKS
from ..adaptive.prediction import predict, start_prediction, watch_setpoint
from ..compiled import compiled
from .estimator import collect, watch, work
from .fit import N_COLUMNS, forward
from .inverse import AHEAD, LOW_PASS_A, LOW_PASS_B, improve, keep_first
from .layout import HISTORY, MOST_DELAY, QUEUE
from .leg import (
    AMP, COULOMB_DN, COULOMB_UP, DEAD_DN, DEAD_UP, DELAY, GAIN_UP, HOLD, LN_BRISTLE, M1, M2, MASS, N_NUMBERS, P1, P2, PLAY,
    POSITION_LAG, S_A1, S_A2, S_FOUR_WAY, V, VISCOUS_DN, VISCOUS_UP, X, Y, Z, tangent, tick,
)  # fmt: skip
from .prior import fill_prior, fill_sheet

FOLLOW_S = 0.3  # in which the numbers that act follow those that are found
RAMP_S = 0.7  # in which a share rises or falls
LEAST_SHARE = 0.5  # from which anything is added: the doubt is as large as the bump
KEEP_HALVES = 0.75  # of the squares of a half stroke before
NOISE_PEAKS = 2.0  # bump over the standard deviation of a Gaussian error in it


@compiled
def start(s):
    """Nothing known. s: a record of zeros with its settings."""
    fill_sheet(s.sheet, s.settings)
    s.past.noise_m = s.settings.position_error_m
    s.past.noise_Pa = max(sqrt(s.settings.pressure_noise_Pa**2 + s.settings.pressure_resolution_Pa**2 / 12.0), 1.0)
    s.past.noise_m = max(s.past.noise_m, 1e-8)
    start_prediction(s.prediction)


@compiled
def _setpoint_ahead(s, table, preview, look):
    n = len(preview)
    middle = (n - 1) // 2
    bend = preview[0] - 2.0 * preview[middle] + preview[2 * middle]
    if watch_setpoint(s.prediction, n if n > PREVIEW_TICKS else 1, bend, preview[0]):
        far = MAX_LOOK
        _, here, after = predict(s.prediction, table, far, preview[0])
        return here + (look - far) * (after - here), True
    if look < n:
        return preview[look], False
    return preview[n - 1] + (look - n + 1) * (preview[n - 1] - preview[n - 2]), False


@compiled
def _load_ahead(loads, look):
    n = len(loads)
    if look < n:
        return loads[look]
    return loads[n - 1] + (look - n + 1) * (loads[n - 1] - loads[n - 2])


@compiled
def _advance(s, setpoint, loads, predicted):
    """The demanded motion's queue by one tick."""
    ref, tick_s = s.reference, s.settings.tick_s
    loop = s.settings.position_gain_V_per_m * s.settings.velocity_gain_m_s_V
    if ref.count == 0:
        ref.position_m[:] = setpoint
        ref.count, ref.setpoint_m = QUEUE, setpoint
    for j in range(QUEUE - 1):
        ref.position_m[j], ref.velocity_m_s[j] = ref.position_m[j + 1], ref.velocity_m_s[j + 1]
        ref.extra_m_s2[j] = ref.extra_m_s2[j + 1]
    last = QUEUE - 1
    y, v = ref.position_m[last - 1], ref.velocity_m_s[last - 1]
    if s.settings.controller_feeds_forward != 0.0:
        new = setpoint
        speed = (setpoint - ref.setpoint_m) / tick_s
    else:
        middle = 0.5 * (setpoint + ref.setpoint_m)
        new = y + (middle - y) * loop * tick_s / (1.0 + 0.5 * loop * tick_s)
        speed = loop * (setpoint - new)
    ref.setpoint_m = setpoint
    acceleration = (speed - v) / tick_s
    ref.position_m[last], ref.velocity_m_s[last] = new, speed
    ref.extra_m_s2[last] = 0.0
    if len(loads) > 2 and not predicted:
        asked = _load_ahead(loads, last)
        if ref.loads:
            if s.settings.controller_feeds_forward == 0.0:
                ref.load_lag_m_s2 += loop * tick_s * (asked - ref.load_lag_m_s2)
            else:
                ref.load_lag_m_s2 = asked
        else:
            ref.load_lag_m_s2, ref.loads = asked, 1
        ref.extra_m_s2[last] = ref.load_lag_m_s2 - acceleration
    else:
        ref.loads = 0


@compiled
def _steady(x, s, y, v, numbers):
    """A state of steady motion at y, v."""
    x[:] = 0.0
    up = v >= 0.0
    friction = (numbers[COULOMB_UP] if up else -numbers[COULOMB_DN]) + v * (numbers[VISCOUS_UP] if up else numbers[VISCOUS_DN])
    supply = s.past.supply_mean_Pa
    a1, a2 = s.sheet[S_A1], s.sheet[S_A2]
    x[Y], x[V] = y, v
    if s.sheet[S_FOUR_WAY] != 0.0:
        x[P2] = 0.5 * supply
    else:
        x[P2] = supply
    x[P1] = (x[P2] * a2 + numbers[HOLD] + friction) / a1
    x[M1], x[M2] = x[P1], x[P2]
    volts = v / (s.settings.velocity_gain_m_s_V * numbers[GAIN_UP]) + (numbers[DEAD_UP] if up else -numbers[DEAD_DN])
    x[AMP] = x[X] = volts
    x[Z] = friction / 2.718281828459045 ** numbers[LN_BRISTLE]
    return volts


@compiled
def _invert(s):
    """Volts of this tick, before the backlash's inverse; the state and volts of the window move on."""
    inv, ref = s.inverse, s.reference
    whole = int(s.numbers[DELAY] / s.settings.tick_s)
    for j in range(AHEAD + 1):
        inv.y[j], inv.v[j] = ref.position_m[whole + j], ref.velocity_m_s[whole + j]
    for j in range(AHEAD):
        inv.extra[j] = ref.extra_m_s2[whole + j]
    limit, supply = s.settings.voltage_max_V, s.past.supply_mean_Pa
    if not inv.running or abs(inv.x[Y] - inv.y[0]) > 5e-3:
        volts = _steady(inv.x, s, inv.y[0], inv.v[0], s.numbers)
        inv.U[:] = volts
        inv.before = inv.older = volts
        inv.filtered[:] = 0.0
        inv.running = inv.started_now = 1
    improve(inv.x, inv.U, inv.before, inv.older, inv.y, inv.v, inv.filtered, s.numbers, s.sheet, supply, inv.extra, limit, inv)
    volts = inv.U[0]
    left = keep_first(inv.x, inv.U, inv.before, inv.y, inv.v, inv.filtered, s.numbers, s.sheet, supply, inv.extra, inv.w)
    inv.older, inv.before = inv.before, volts
    return volts, left


@compiled
def _expect(s, volts, last, left):
    """Bumps that plain control makes by the model, and that the doubt about the numbers makes; the share by both, at the end of each
    half stroke."""
    e, ref, tick_s, numbers = s.expected, s.reference, s.settings.tick_s, s.numbers
    kp, supply = s.settings.position_gain_V_per_m, s.past.supply_mean_Pa
    whole = int(numbers[DELAY] / tick_s)
    split = numbers[DELAY] / tick_s - whole
    v, a = ref.velocity_m_s[whole], (ref.velocity_m_s[whole + 1] - ref.velocity_m_s[whole]) / tick_s
    extra = ref.extra_m_s2[whole]
    if not e.started:
        _steady(e.plain, s, ref.position_m[whole], v, numbers)
        _steady(e.x, s, ref.position_m[whole], v, numbers)
        e.started, e.halves = 1, -1  # the first reversal begins with a state that is not known
    # plain control, by the model
    control = v / s.settings.velocity_gain_m_s_V + kp * (ref.position_m[whole] - e.plain[Y])
    speed = e.plain[V]
    tick(e.plain, numbers, s.sheet, control, e.plain_V, split, supply, extra, 0.0, e.w)
    e.plain_V = control
    b = _low_pass(e.plain_filtered, (e.plain[V] - speed) / tick_s - a)
    e.bump = max(e.bump, abs(b))
    e.left = max(e.left, abs(left))
    # the numbers' doubt in the compensated motion
    e.x[:] = s.inverse.x_before
    e.speed[:] = e.S[V]
    tangent(e.x, e.S, N_COLUMNS, True, numbers, s.sheet, volts, last, split, e.d_now, e.d_before, kp, supply, extra, 0.0, e.w)
    if s.known.valid:
        for j in range(N_NUMBERS):
            f = (e.S[V, j] - e.speed[j]) / tick_s
            o = LOW_PASS_B[0] * f + e.filtered[0, j]
            e.filtered[0, j] = LOW_PASS_B[1] * f - LOW_PASS_A[0] * o + e.filtered[1, j]
            e.filtered[1, j] = LOW_PASS_B[2] * f - LOW_PASS_A[1] * o
            e.row[j] = o * s.fit.sd[j]
        forward(s.known.factor, N_NUMBERS, e.row)
        total = 0.0
        for j in range(N_NUMBERS):
            total += e.row[j] * e.row[j]
        e.sigma = max(e.sigma, total * max(1.0, s.known.chi2[0], s.known.chi2[1]))
    sign = 1.0 if v >= 0.0 else -1.0
    peak = a * e.acceleration < 0.0
    e.acceleration = a
    if peak:  # the middle of a stroke: a reversal lies behind
        if e.halves < 0:
            e.halves = 0
        elif e.bump > 0.0:
            k = KEEP_HALVES if e.halves > 0 else 0.0
            e.bump2 = k * e.bump2 + (1.0 - k) * e.bump * e.bump
            e.left2 = k * e.left2 + (1.0 - k) * e.left * e.left
            e.sigma2 = k * e.sigma2 + (1.0 - k) * e.sigma
            e.halves += 1
        e.bump = e.sigma = e.left = 0.0
    e.sign = sign


@compiled
def _low_pass(memory, x):
    o = LOW_PASS_B[0] * x + memory[0]
    memory[0] = LOW_PASS_B[1] * x - LOW_PASS_A[0] * o + memory[1]
    memory[1] = LOW_PASS_B[2] * x - LOW_PASS_A[1] * o
    return o


@compiled
def _through_backlash(inv, volts, half):
    """Volts whose play of half width `half` gives `volts`: on the side to which they move."""
    if volts > inv.played:
        inv.side = 1.0
    elif volts < inv.played:
        inv.side = -1.0
    inv.played = volts
    return volts + inv.side * half


@compiled
def fed_back_V(s, position_m, pressure_Pa):
    """Volts that velocity and pressure feedback of the controller take off in the demanded motion."""
    ref, settings = s.reference, s.settings
    if ref.loop_started == 0:
        ref.loop_started, ref.loop_y_m, ref.loop_p_Pa = 1, position_m, pressure_Pa
    moved, change = position_m - ref.loop_y_m, pressure_Pa - ref.loop_p_Pa
    ref.loop_y_m, ref.loop_p_Pa = position_m, pressure_Pa
    ref.loop_v_m_s = settings.velocity_pole * ref.loop_v_m_s + settings.velocity_share * moved
    ref.passed_Pa = settings.pressure_pole * ref.passed_Pa + settings.pressure_share * change
    return settings.velocity_gain_V_s_per_m * ref.loop_v_m_s + settings.pressure_gain_V_per_Pa * ref.passed_Pa


@compiled
def tick_of(s, table, preview, loads, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, forward_V):
    """Volts to add. preview (n,), loads (n,) or none; everything else of the sample."""
    settings, ref, inv = s.settings, s.reference, s.inverse
    if s.sheet[S_FOUR_WAY] == 0.0:
        top_Pa = supply_Pa
    ahead, predicted = _setpoint_ahead(s, table, preview, QUEUE - 1)
    _advance(s, ahead, loads, predicted)
    watch(s.past, position_m, bottom_Pa, top_Pa, supply_Pa, ref.extra_m_s2[0], valve_V)
    if settings.learn != 0.0:
        collect(s)
        work(s)
    if not s.known.valid:
        return 0.0
    for k in range(N_NUMBERS):
        if s.numbers[MASS] == 0.0:
            s.numbers[:] = s.known.numbers
        s.numbers[k] += settings.tick_s / FOLLOW_S * (s.known.numbers[k] - s.numbers[k])
    inv.x_before[:] = inv.x
    last = inv.before
    volts, left = _invert(s)
    if inv.started_now:
        inv.x_before[:] = inv.x
        last, inv.started_now = volts, 0
    _expect(s, volts, last, left)
    e = s.expected
    wanted = 0.0
    if e.halves > 0:
        share = e.bump2 / (e.bump2 + e.sigma2 + e.left2)
        wanted = 1.0 if share > LEAST_SHARE else 0.0
    step = settings.tick_s / RAMP_S
    s.share += min(max(wanted - s.share, -step), step)
    total = _through_backlash(inv, volts, s.numbers[PLAY])
    lag = s.numbers[POSITION_LAG] * ref.velocity_m_s[0]
    pressure = inv.x[P1] if s.sheet[S_FOUR_WAY] == 0.0 else inv.x[P1] - settings.area_top_m2 / settings.area_bottom_m2 * inv.x[P2]
    own = settings.position_gain_V_per_m * (setpoint_m - ref.position_m[0] + lag) + forward_V
    own -= fed_back_V(s, ref.position_m[0], pressure)
    s.added_V = s.share * (total - own)
    return s.added_V
