"""How much of the valve's lag is spool and how much is delay, from compensated reversals.

Plain control's volts are slow, and of a spool they show the lag alone: a second-order spool of damping 0.7 has the
phase of a delay as long as its lag, up to the third order in frequency. Only where the volts jump, at a compensated
reversal, do the two part. So a bank of spools, all with the identified total lag, is run over each of them:

    d = tau - tau_s,     x_s = spool(tau_s) u(t - d),     z_s' = k f(x_s) R,     S_s += |(1 - Q Q') (z - z_s)|^2 / noise^2

Q holds what other errors leave: a constant, a slope (leak, null) and a kink at the reversal (gain, dead band). S / 2 is
a negative log-likelihood. Too long a delay is benign: the lead then trusts the spool too much, and is a little slow.
Too short a one makes the volts overshoot into the flow. So a standard deviation is added.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import compiled
from .arithmetic import clip, copy, dot, push
from .layout import AFTER, BEFORE, LATE_TICKS, PAST_VOLTS, SPOOLS
from .spool import step_response

SPOOL_LAGS_S = 1e-3 * np.array(
    [1.2, 1.5, 1.8, 2.1, 2.4, 2.7, 3.0, 3.3, 3.6, 3.9, 4.2, 4.6, 5.0, 5.5, 6.0, 6.7, 7.5]
)  # (SPOOLS,)
FINE = 5  # samples a tick
NOISE_M = 3.3e-6  # of an oil displacement
MEMORY = 0.985  # of the sums, a reversal
ERRORS, ERRORS_FIRST = 0.2, 1.3  # standard deviations added to the delay at last; and further ones at first
MODEL_SUM = 0.3  # of a reversal, which errors of the rest of the model may make
MAX_SUM = 40.0  # that one reversal may add

SOFTNESS_MEMORY, SOFTNESS_REVERSALS, SOFTNESS_ERRORS = 0.95, 4, 2.0  # a reversal; before it is used; taken off
MAX_SOFTNESS_M_PA = 1e-10
LATE_SHARE = 0.3  # of its correction that lateness takes at a reversal


def _nuisance() -> np.ndarray:
    t = np.arange(-BEFORE, AFTER + 1.0)
    return np.linalg.qr(np.stack([np.ones_like(t), t, np.abs(t)], axis=1))[0]


NUISANCE = _nuisance()  # Q (BEFORE + AFTER + 1, 3)


@compiled
def add_to_delay(delay, z_m, pressure_Pa, volts_V, flow_m_s, roots, valve, compensated):
    """One tick: oil displacement now, volts of the tick past, demanded flow now. True when a reversal was judged.

    compensated: whether the reversal that lies AFTER ticks back, if one does, was.
    """
    _append(delay.volts_V, volts_V)
    _append(delay.oil_m, z_m)
    _append(delay.pressures_Pa, pressure_Pa)
    if flow_m_s * delay.direction < 0.0:
        delay.ticks = 0
    if flow_m_s != 0.0:
        delay.direction = flow_m_s
    delay.ticks += 1
    if delay.ticks == AFTER + 1 and compensated:
        _prepare(delay, roots, valve)
    return delay.tested >= 0 and _compare(delay)


@compiled
def _append(history, value):
    """The newest last."""
    for i in range(len(history) - 1):
        history[i] = history[i + 1]
    history[-1] = value


@compiled
def found_delay_s(delay, lag_s):
    """The delay taken, of a total lag: mean of its likelihood, and a part of its standard deviation more."""
    least, total, mean, square = min(delay.sums), 0.0, 0.0, 0.0
    for i in range(SPOOLS):
        late, weight = max(lag_s - SPOOL_LAGS_S[i], 0.0), math.exp(0.5 * (least - delay.sums[i]))
        total, mean, square = total + weight, mean + weight * late, square + weight * late * late
    mean /= total
    errors = ERRORS + ERRORS_FIRST / (1.0 + delay.reversals)
    deviation = math.sqrt(max(square / total - mean * mean, 0.0))
    return min(mean + errors * deviation, max(lag_s - SPOOL_LAGS_S[0], 0.0))


@compiled
def keep_delay(delay, lateness, known):
    """What was identified, in numbers."""
    copy(delay.sums, known.sums)
    known.reversals, known.late_s = delay.reversals, lateness.late_s


@compiled
def restore_delay(delay, lateness, known):
    """Start with what was identified before."""
    copy(known.sums, delay.sums)
    delay.reversals, lateness.late_s = int(known.reversals), known.late_s


@compiled
def _prepare(delay, roots, valve):
    """The reversal in the history is the one to compare."""
    volts, down, up = delay.task_volts_V, valve.edges[0], valve.edges[1]
    for i in range(len(volts)):
        volts[i] = delay.volts_V[i]
    for i in range(len(delay.oil_m)):
        delay.task_oil_m[i], delay.task_pressures_Pa[i] = delay.oil_m[i], delay.pressures_Pa[i]
    _without_nuisance(delay.task_pressures_Pa)
    if valve.with_backlash:
        half, follower = valve.edges[1 if volts[-1] > 0.0 else 0].backlash_V, volts[0]
        for i in range(len(volts)):
            follower = volts[i] = clip(follower, volts[i] - half, volts[i] + half)
    delay.gains_m_s_V[0], delay.gains_m_s_V[1] = down.gain_m_s_V * roots[0], up.gain_m_s_V * roots[1]
    delay.dead_bands_V[0], delay.dead_bands_V[1] = down.dead_band_V, up.dead_band_V
    delay.lag_s, delay.tested = valve.lag_s, 0


@compiled
def _modelled_oil(delay, spool_s):
    """Measured oil less what this spool would have let through, into `error_m`."""
    volts, error, pulse, tick_s = delay.task_volts_V, delay.error_m, delay.pulse, delay.tick_s
    delay_s = delay.lag_s - spool_s
    for i in range(len(pulse)):
        t = (i + 0.5) * tick_s / FINE
        pulse[i] = step_response(t, delay.lag_s, delay_s) - step_response(t - tick_s, delay.lag_s, delay_s)
    moved, error[0] = 0.0, delay.task_oil_m[0]
    for k in range(len(error) - 1):
        flow = 0.0
        for i in range(FINE):
            path = volts[0]
            for j in range(PAST_VOLTS + 2):
                if k + PAST_VOLTS - j >= 0:  # before that the volts are taken as constant
                    path += (volts[k + PAST_VOLTS - j] - volts[0]) * pulse[j * FINE + i]
            flow += delay.gains_m_s_V[1] * max(path - delay.dead_bands_V[1], 0.0)
            flow -= delay.gains_m_s_V[0] * max(-path - delay.dead_bands_V[0], 0.0)
        moved += flow / FINE
        error[k + 1] = delay.task_oil_m[k + 1] - moved * tick_s


@compiled
def softness_m_Pa(delay):
    """Compliance of the oil beyond the data sheet's: oil that is missing at reversals over the pressure that steps
    there, less two standard errors."""
    if delay.reversals < SOFTNESS_REVERSALS or delay.pressure_square <= 0.0:
        return 0.0
    error = SOFTNESS_ERRORS * NOISE_M / math.sqrt(delay.pressure_square)
    return clip(delay.pressure_product / delay.pressure_square - error, 0.0, MAX_SOFTNESS_M_PA)


@compiled
def _without_nuisance(history):
    """Takes off what a constant, a slope and a kink explain."""
    for column in range(NUISANCE.shape[1]):
        share = 0.0
        for k in range(len(history)):
            share += NUISANCE[k, column] * history[k]
        for k in range(len(history)):
            history[k] -= NUISANCE[k, column] * share


@compiled
def _compare(delay):
    """The next spool of the bank against the reversal; True after the last."""
    error = delay.error_m
    _modelled_oil(delay, min(SPOOL_LAGS_S[delay.tested], delay.lag_s))
    _without_nuisance(error)
    square = dot(error, error, len(error))
    delay.found[delay.tested] = square / NOISE_M**2
    if delay.tested == 0 or square < delay.least_m2:
        delay.least_m2, delay.best_product = square, dot(error, delay.task_pressures_Pa, len(error))
    delay.tested += 1
    if delay.tested < SPOOLS:
        return False
    least = min(delay.found)
    scale = max(1.0, least / (len(error) - 3))
    for i in range(SPOOLS):
        delay.sums[i] = MEMORY * delay.sums[i] + clip((delay.found[i] - least) / scale - MODEL_SUM, 0.0, MAX_SUM)
    delay.reversals, delay.tested = delay.reversals + 1, -1
    pressures = delay.task_pressures_Pa
    delay.pressure_square = SOFTNESS_MEMORY * delay.pressure_square + dot(pressures, pressures, len(pressures))
    delay.pressure_product = SOFTNESS_MEMORY * delay.pressure_product - delay.best_product
    return True


# How late the position transducer is, from when the pressure steps at compensated reversals. All that is asked for
# holds for the position as it is measured. Pressure and oil are then early by as much. Least squares of what the
# pressure deviates by on the rate that is asked for:  late += share sum(dev P') / sum(P'^2).


@compiled
def due_pressure_Pa(lateness, now_Pa, ahead_Pa):
    """The pressure demanded for now; now_Pa, ahead_Pa: for this tick as it was decided, and for the next ones."""
    late = lateness.late_s / lateness.tick_s
    whole = int(late)
    near, far = ahead_Pa[whole - 1] if whole else now_Pa, ahead_Pa[whole]
    lateness.rate_Pa = far - near
    return near + (late - whole) * (far - near)


@compiled
def pressure_then_Pa(lateness, pressure_Pa):
    """One tick: the pressure that belongs to the position measured now."""
    push(lateness.pressures_Pa, pressure_Pa)
    late = lateness.late_s / lateness.tick_s
    whole = int(late)
    near, far = lateness.pressures_Pa[whole], lateness.pressures_Pa[whole + 1]
    return near + (late - whole) * (far - near)


@compiled
def add_to_lateness(lateness, deviation_Pa, judged, lag_s):
    """One tick: measured less demanded pressure; judged: a compensated reversal lies behind."""
    if judged:
        if lateness.square > 0.0:
            late_s = lateness.late_s + LATE_SHARE * lateness.product / lateness.square * lateness.tick_s
            longest_s = min(max(lag_s - SPOOL_LAGS_S[0], 0.0), (LATE_TICKS - 2) * lateness.tick_s)
            lateness.late_s = clip(late_s, 0.0, longest_s)
        lateness.product = lateness.square = 0.0
    else:
        lateness.product += deviation_Pa * lateness.rate_Pa
        lateness.square += lateness.rate_Pa * lateness.rate_Pa
