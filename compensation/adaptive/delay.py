"""How much of the valve's lag is spool and how much is delay, from compensated reversals.

Plain control's volts are slow, and of a spool they show the lag alone: a second-order spool has nearly the phase of a delay as
long as its lag; with damping 0.7 up to the third order in frequency. Only where the volts jump, at a compensated
reversal, do the two part. So a bank of spools, all with the identified total lag, is run over each of them:

    d = tau - tau_s,     x_s = spool(tau_s) u(t - d),     z_s' = k f(x_s) R(t),     f with the rounding of the edges
    S_sj += |(1 - Q Q') (y + c P(t - l_j) - z_s)|^2 / noise^2,     c = V / (E A1)

A position transducer that is late by l_j, up to three ticks, makes its part of the delay; the pressure is not late. So the bank is
of spools and of lateness: which of the pressures past makes oil with the position. Q holds what other errors leave: a
constant, a slope (leak, null) and a kink at the reversal (gain, dead band). R follows the pressure, which steps at a reversal
by friction: 1.5 % of the flow on one side made every delay 0.1 ms short. S / 2 is a negative log-likelihood, between the spools of
the bank a parabola. A delay of 6 ms that is wrong by 0.2 ms either way leaves 0.1 m/s2 of 0.9 (100 and 160 kg). At the first
reversals a standard deviation is added: too long a delay makes the lead a little slow, too short a one overshoots into the flow.

Where the data sheet gives the spool, ((tau_s/tau_sheet - 1)/0.15)^2 is in S from the start.

Legs of one machine are alike. What a reversal of another leg told is added, over 1 + the own reversals:

    S = S_own + S_heard / (1 + reversals)
"""

from __future__ import annotations

import math

import numpy as np

from ..arithmetic import clip, copy, dot
from ..compiled import compiled
from .chambers import softplus_V
from .layout import AFTER, BEFORE, LATE_TICKS, LATES, PAST_VOLTS, SPOOLS
from .spool import step_response

USUAL_LAG_S = 0.7 / (math.pi * 60.0)  # of a spool of 60 Hz and damping 0.7, for which the bank is made; else stretched
SHEET_ERROR = 0.15  # standard deviation of a spool's lag about its data sheet's, relative
SPOOL_LAGS_S = 1e-3 * np.array(
    [1.2, 1.5, 1.8, 2.1, 2.4, 2.7, 3.0, 3.3, 3.6, 3.9, 4.2, 4.6, 5.0, 5.5, 6.0, 6.7, 7.5]
)  # (SPOOLS,)
LATE = np.concatenate([np.arange(0.0, 0.5, 0.125), np.arange(0.5, 3.25, 0.25)])  # (LATES,) l_j [ticks]
LATE_SLACK = 0.125  # by which a lateness may be longer than the delay that it is part of [ticks]
FINE = 5  # samples a tick
MEMORY = 0.985  # of the sums, a reversal
ERRORS_FIRST = 1.3  # standard deviations added to the delay at the first reversals, over 1 + their number
BETWEEN = 3  # parts of the interval between two spools of the bank, in which S is interpolated
MODEL_SUM = 0.3  # of a reversal, which errors of the rest of the model may make
MAX_SUM = 40.0  # that one reversal may add

SOFTNESS_MEMORY, SOFTNESS_REVERSALS, SOFTNESS_ERRORS = 0.97, 4, 1.0  # a reversal; before it is used; taken off
MAX_SOFTNESS_M_PA = 1e-10


def _nuisance() -> np.ndarray:
    t = np.arange(-BEFORE, AFTER + 1.0)
    return np.linalg.qr(np.stack([np.ones_like(t), t, np.abs(t)], axis=1))[0]


NUISANCE = _nuisance()  # Q (BEFORE + AFTER + 1, 3)


def _between() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spools between those of the bank (M,), the first of the three that S is interpolated from (M,), their weights (M, 3)."""
    bank, parts = SPOOL_LAGS_S, np.arange(BETWEEN) / BETWEEN
    lags = np.append((bank[:-1, None] + np.diff(bank)[:, None] * parts).ravel(), bank[-1])
    first = np.clip([np.abs(bank - lag).argmin() - 1 for lag in lags], 0, SPOOLS - 3)
    weights = np.ones((len(lags), 3))
    for a in range(3):
        for b in {0, 1, 2} - {a}:
            weights[:, a] *= (lags - bank[first + b]) / (bank[first + a] - bank[first + b])
    return lags, first, weights


BETWEEN_LAGS_S, FIRST_OF_THREE, WEIGHTS_OF_THREE = _between()


@compiled
def start_delay(delay, settings):
    """Nothing is known but the spool's data sheet. The bank reaches from a third to twice the declared lag, 2 zeta/omega."""
    delay.tick_s, delay.tested, delay.damping, delay.scale = settings.tick_s, -1, settings.spool_damping, 1.0
    if settings.spool_frequency_Hz > 0.0:
        delay.declared = True
        delay.scale = settings.spool_damping / (math.pi * settings.spool_frequency_Hz) / USUAL_LAG_S


@compiled
def add_to_delay(delay, position_m, pressure_Pa, volts_V, flow_m_s, roots, valve, compliance_m_Pa, compensated):
    """One tick: position now less what leaked, pressure now, volts of the tick past, demanded flow now, R of both edges in the
    tick past. True when a reversal was judged.

    compensated: whether the reversal that lies AFTER ticks back, if one does, was. `delay.rounding_V` is that of the edges.
    """
    _append(delay.volts_V, volts_V)
    _append(delay.oil_m, position_m)
    _append(delay.pressures_Pa, pressure_Pa)
    for i in range(2):
        _append(delay.roots[i], roots[i])
    if flow_m_s * delay.direction < 0.0:
        delay.ticks = 0
    if flow_m_s != 0.0:
        delay.direction = flow_m_s
    delay.ticks += 1
    if delay.ticks == AFTER + 1 and compensated and delay.pressures_Pa[0] != 0.0:  # the history is full
        _prepare(delay, valve, compliance_m_Pa)
    return delay.tested >= 0 and _compare(delay)


@compiled
def _append(history, value):
    """The newest last."""
    for i in range(len(history) - 1):
        history[i] = history[i + 1]
    history[-1] = value


@compiled
def found_delay_s(delay, lag_s):
    """The delay taken, of a total lag: the one that was told; else the mean of its likelihood, and at the first reversals its
    standard deviation more."""
    most_s = max(lag_s - delay.scale * SPOOL_LAGS_S[0], 0.0)
    if delay.told_s[0] > 0.0:
        return min(delay.told_s[0], most_s)
    total, mean, square, _ = _moments(delay, lag_s)
    mean /= total
    errors = ERRORS_FIRST / (1.0 + delay.reversals + delay.heard_reversals)
    deviation = math.sqrt(max(square / total - mean * mean, 0.0))
    return min(mean + errors * deviation, most_s)


@compiled
def found_lateness_s(delay, lag_s):
    """How much of the delay is the position transducer's: as told, else mean of its likelihood."""
    if delay.told_s[0] > 0.0:
        return delay.told_s[1]
    total, _, _, late_s = _moments(delay, lag_s)
    return late_s / total


@compiled
def _smallest(sums):
    least = math.inf
    for i in range(len(sums)):
        least = min(least, sums[i])
    return least


@compiled
def _moments(delay, lag_s):
    """Of the likelihood: its sum, and those of delay, its square and lateness. A lateness is part of the delay."""
    total = mean = square = lateness = 0.0
    least = math.inf
    for m in range(len(BETWEEN_LAGS_S)):
        for j in range(LATES):
            if _is_part(delay, lag_s, m, j):
                least = min(least, _interpolated(delay, lag_s, m, j))
    for m in range(len(BETWEEN_LAGS_S)):
        late = max(lag_s - delay.scale * BETWEEN_LAGS_S[m], 0.0)
        for j in range(LATES):
            if _is_part(delay, lag_s, m, j):
                weight = math.exp(0.5 * (least - _interpolated(delay, lag_s, m, j)))
                total, mean, square = total + weight, mean + weight * late, square + weight * late * late
                lateness += weight * LATE[j] * delay.tick_s
    return total, mean, square, lateness


@compiled
def _is_part(delay, lag_s, m, j):
    """Whether a lateness may be part of what the spool m leaves of the lag."""
    late = max(lag_s - delay.scale * BETWEEN_LAGS_S[m], 0.0)
    return j == 0 or (LATE[j] - LATE_SLACK) * delay.tick_s < late


@compiled
def _interpolated(delay, lag_s, m, j):
    """S between the spools of the bank, with what the data sheet says of the spool. One beyond the lag stands for all of it."""
    share, first = 1.0 / (1.0 + delay.reversals), FIRST_OF_THREE[m]
    over = min(BETWEEN_LAGS_S[m], lag_s / delay.scale) / USUAL_LAG_S
    s = delay.declared * ((over - 1.0) / SHEET_ERROR) ** 2
    for a in range(3):
        k = (first + a) * LATES + j
        s += WEIGHTS_OF_THREE[m, a] * (delay.sums[k] + share * delay.heard[k])
    return s


@compiled
def hear_delay(delay, other):
    """What the reversal of another leg told, in the tick in which it was judged."""
    for k in range(SPOOLS * LATES):
        delay.heard[k] = MEMORY * delay.heard[k] + other.found[k]
    delay.heard_reversals, delay.hears = delay.heard_reversals + 1.0, True


@compiled
def keep_delay(delay, lateness, known):
    """What was identified, in numbers."""
    copy(delay.sums, known.sums)
    known.reversals, known.late_s = delay.reversals, lateness.late_s
    known.oil[0], known.oil[1] = delay.pressure_square, delay.pressure_product
    copy(delay.told_s, known.told_s)


@compiled
def restore_delay(delay, lateness, known):
    """Start with what was identified before."""
    copy(known.sums, delay.sums)
    delay.reversals, lateness.late_s = int(known.reversals), known.late_s
    delay.pressure_square, delay.pressure_product = known.oil[0], known.oil[1]
    copy(known.told_s, delay.told_s)


@compiled
def _prepare(delay, valve, compliance_m_Pa):
    """The reversal in the history is the one to compare."""
    volts, down, up = delay.task_volts_V, valve.edges[0], valve.edges[1]
    for i in range(len(volts)):
        volts[i] = delay.volts_V[i]
    for i in range(len(delay.oil_m)):
        delay.task_oil_m[i] = delay.oil_m[i]
        for j in range(LATES):
            whole = int(LATE[j])
            part, near = LATE[j] - whole, i + LATE_TICKS - whole
            here, before = delay.pressures_Pa[near], delay.pressures_Pa[near - 1]
            delay.task_pressures_Pa[j, i] = here + part * (before - here)
    for j in range(LATES):
        _without_nuisance(delay.task_pressures_Pa[j])
    delay.compliance_m_Pa = compliance_m_Pa
    if valve.with_backlash:
        half, follower = valve.edges[1 if volts[-1] > 0.0 else 0].backlash_V, volts[0]
        if valve.four_way:  # near critical lap the spool is open where the history begins
            follower += math.copysign(half, volts[0] - volts[-1])
        for i in range(len(volts)):
            follower = volts[i] = clip(follower, volts[i] - half, volts[i] + half)
    for k in range(BEFORE + AFTER):
        delay.task_gains_m_s_V[0, k] = down.gain_m_s_V * delay.roots[0, k]
        delay.task_gains_m_s_V[1, k] = up.gain_m_s_V * delay.roots[1, k]
    delay.dead_bands_V[0], delay.dead_bands_V[1] = down.dead_band_V, up.dead_band_V
    delay.lag_s, delay.tested = valve.lag_s, 0


@compiled
def _modelled_oil(delay, spool_s):
    """Measured oil less what this spool would have let through, into `error_m`."""
    volts, error, pulse, tick_s = delay.task_volts_V, delay.error_m, delay.pulse, delay.tick_s
    delay_s, damping = delay.lag_s - spool_s, delay.damping
    for i in range(len(pulse)):
        t = (i + 0.5) * tick_s / FINE
        pulse[i] = step_response(t, delay.lag_s, delay_s, damping)
        pulse[i] -= step_response(t - tick_s, delay.lag_s, delay_s, damping)
    moved, error[0] = 0.0, delay.task_oil_m[0]
    for k in range(len(error) - 1):
        into = out = 0.0
        for i in range(FINE):
            path = volts[0]
            for j in range(PAST_VOLTS + 2):
                if k + PAST_VOLTS - j >= 0:  # before that the volts are taken as constant
                    path += (volts[k + PAST_VOLTS - j] - volts[0]) * pulse[j * FINE + i]
            into += softplus_V(path - delay.dead_bands_V[1], delay.rounding_V)
            out += softplus_V(-path - delay.dead_bands_V[0], delay.rounding_V)
        moved += (delay.task_gains_m_s_V[1, k] * into - delay.task_gains_m_s_V[0, k] * out) / FINE
        error[k + 1] = delay.task_oil_m[k + 1] - moved * tick_s


@compiled
def softness_m_Pa(delay):
    """Compliance of the oil beyond the data sheet's: oil that is missing at reversals over the pressure that steps
    there, less two standard errors."""
    if delay.reversals < SOFTNESS_REVERSALS or delay.pressure_square <= 0.0:
        return 0.0
    error = SOFTNESS_ERRORS * delay.noise_m / math.sqrt(delay.pressure_square)
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
    error, c = delay.error_m, delay.compliance_m_Pa
    count = len(error)
    _modelled_oil(delay, min(delay.scale * SPOOL_LAGS_S[delay.tested], delay.lag_s))
    _without_nuisance(error)
    square = dot(error, error, count)
    for j in range(LATES):
        pressures = delay.task_pressures_Pa[j]
        product, pressure_square = dot(error, pressures, count), dot(pressures, pressures, count)
        left = square + c * (2.0 * product + c * pressure_square)
        delay.found[delay.tested * LATES + j] = left / delay.noise_m**2
        if (delay.tested == 0 and j == 0) or left < delay.least_m2:
            delay.least_m2, delay.best_product = left, product + c * pressure_square
            delay.best_square = pressure_square
    delay.tested += 1
    if delay.tested < SPOOLS:
        return False
    least = _smallest(delay.found)
    scale = max(1.0, least / (count - 3))
    for i in range(SPOOLS):
        for j in range(LATES):
            k = i * LATES + j
            delay.found[k] = clip((delay.found[k] - least) / scale - MODEL_SUM, 0.0, MAX_SUM)
            delay.sums[k] = MEMORY * delay.sums[k] + delay.found[k]
    delay.reversals, delay.tested = delay.reversals + 1, -1
    delay.pressure_square = SOFTNESS_MEMORY * delay.pressure_square + delay.best_square
    delay.pressure_product = SOFTNESS_MEMORY * delay.pressure_product - delay.best_product
    return True
