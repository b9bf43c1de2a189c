"""FIR filters for the spool's lag: leads for the flow and for the dead band.

The spool is taken as second order with damping 0.7, so that one number describes it, its lag tau = 2 zeta / omega [s].
The response of the spool to the volts of one tick (held over the tick), averaged over each following tick, is

    g_j = (1/T) int_{jT}^{(j+1)T} [s(t) - s(t - T)] dt,      s(t) the spool's unit step response.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from ..compiled import compiled
from .arithmetic import clip
from .layout import LEAD_TAPS, LEAD_TICKS, MAX_SHIFT, PATH_AFTER, PATH_BEFORE, PATH_FINE

SPOOL_DAMPING = 0.7  # common value for proportional valves; the lag is what is identified
LAG_STEP_S = 1e-5  # lags are rounded to this before a design is made
LAG_MAX_S = 1.4e-2
SHIFT_TICKS = 2.2  # of lag that LEAD_TICKS are enough for
FREE_TICKS = 0.75  # on either side of the crossing in which the spool's path is nearly free, with FREE_WEIGHT
FREE_WEIGHT = 0.3
CROSSING_SMOOTHING = 1e-5  # of the crossing lead


def step_response(t_s: np.ndarray, lag_s: float, delay_s: float = 0.0) -> np.ndarray:
    """Unit step response (n,) of the spool at times `t_s` (n,), zero before 0."""
    t_s, lag_s = t_s - delay_s, lag_s - delay_s
    t = np.maximum(t_s, 0.0)
    if lag_s <= 0.0:
        return np.where(t_s >= 0, 1.0, 0.0)
    z = SPOOL_DAMPING
    w = 2 * z / lag_s
    wd = w * math.sqrt(1 - z * z)
    s = 1 - np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t))
    return np.where(t_s >= 0, s, 0.0)


def tick_response(lag_s: float, tick_s: float, count: int, delay_s: float = 0.0) -> np.ndarray:
    """g_j (count,): mean spool position in tick j after one tick of unit volts."""
    fine = 40
    t = (np.arange(count * fine) + 0.5) * tick_s / fine
    pulse = step_response(t, lag_s, delay_s) - step_response(t - tick_s, lag_s, delay_s)
    return pulse.reshape(count, fine).mean(axis=1)


@compiled
def round_lag(lag_s):
    """Lag [s] on the grid that filters are designed for."""
    return clip(np.rint(lag_s / LAG_STEP_S) * LAG_STEP_S, 0.0, LAG_MAX_S)


@compiled
def look_ahead_shift(lag_s, tick_s):
    """Ticks by which the taps lie earlier, for a lag."""
    return min(max(math.ceil(lag_s / tick_s - SHIFT_TICKS), 0), MAX_SHIFT)


@compiled
def set_spool_model(model, lag_s, tick_s):
    """a, b, c, d of one tick of the spool: x += a (u - x) + b w, w = c (u - x) + d w, with w its rate [V/tick]."""
    if lag_s < 0.25 * tick_s:
        model[0], model[1], model[2], model[3] = 1.0, 0.0, 0.0, 0.0
        return
    z = SPOOL_DAMPING
    w = 2 * z / lag_s
    wd, t = w * math.sqrt(1 - z * z), tick_s
    decay = math.exp(-z * w * t)
    cos, sin = math.cos(wd * t), math.sin(wd * t)
    model[0] = 1 - decay * (cos + z * w / wd * sin)
    model[1] = decay * sin / wd / tick_s
    model[2] = decay * w * w / wd * sin * tick_s
    model[3] = decay * (cos - z * w / wd * sin)


def _taps(matrix: np.ndarray, target: np.ndarray, smoothing: float, centre: float) -> tuple[float, ...]:
    """Least squares of LEAD_TAPS taps, regularised by `smoothing`, with unit sum and a given centre."""
    rough = math.sqrt(smoothing) * (np.eye(LEAD_TAPS) - np.eye(LEAD_TAPS, k=1))
    exact = 1e3 * np.vstack([np.ones(LEAD_TAPS), np.arange(LEAD_TAPS)])
    right = np.r_[target, np.zeros(LEAD_TAPS), 1e3, 1e3 * centre]
    taps = np.linalg.lstsq(np.vstack([matrix, rough, exact]), right, rcond=None)[0]
    return tuple(float(x) for x in taps / taps.sum())


def _steps(t_s: np.ndarray, lag_s: float, tick_s: float, delay_s: float, shift: int) -> np.ndarray:
    """Response of the spool to each tap, for a step at 0 (n, LEAD_TAPS): the first tap acts LEAD_TICKS before it."""
    return np.stack(
        [step_response(t_s + (LEAD_TICKS + shift - i) * tick_s, lag_s, delay_s) for i in range(LEAD_TAPS)], axis=1
    )


@lru_cache(maxsize=128)
def lead(lag_s: float, tick_s: float, smoothing: float, delay_s: float = 0.0, shift: int = 0) -> tuple[float, ...]:
    """Taps h (LEAD_TAPS,) so that u_k = sum_i h_i x_{k + LEAD_TICKS - i} makes the spool follow x, as means over ticks.

    Least squares of g * h against a pulse at LEAD_TICKS, with `smoothing` times the taps' roughness: more is softer and
    slower. The taps sum to one, so that nothing changes at rest, and their centre undoes the spool's: no time is left.
    """
    g = tick_response(lag_s, tick_s, 40, delay_s)
    rows = len(g) + LEAD_TAPS - 1
    matrix = np.zeros((rows, LEAD_TAPS))
    for i in range(LEAD_TAPS):
        matrix[i : i + len(g), i] = g
    target = np.zeros(rows)
    target[LEAD_TICKS + shift] = 1.0
    return _taps(matrix, target, smoothing, LEAD_TICKS + shift - float(np.arange(len(g)) @ g / g.sum()))


@lru_cache(maxsize=128)
def crossing_lead(lag_s: float, tick_s: float, delay_s: float = 0.0, shift: int = 0) -> tuple[float, ...]:
    """Taps (LEAD_TAPS,) like `lead`, for the dead-band compensation alone.

    Inside the overlap the spool lets no oil through; any overshoot beyond it does. So the spool's path is prescribed
    here, and not its mean over ticks: where it stood until FREE_TICKS before the crossing, where it is to stand from
    as long after it, and nearly free in between.
    """
    fine = 20
    t = (np.arange(-(LEAD_TICKS + shift) * fine, 40 * fine) + 0.5) * tick_s / fine
    matrix = _steps(t, lag_s, tick_s, delay_s, shift)
    weight = np.where(np.abs(t) < FREE_TICKS * tick_s, FREE_WEIGHT, 1.0) / math.sqrt(fine)
    return _taps(weight[:, None] * matrix, weight * (t > 0.0), CROSSING_SMOOTHING, LEAD_TICKS + shift - lag_s / tick_s)


@lru_cache(maxsize=128)
def crossing_path(lag_s: float, tick_s: float, delay_s: float = 0.0, shift: int = 0) -> tuple[float, ...]:
    """Path of the crossing spool, from -1 to 1, PATH_FINE samples a tick, from PATH_BEFORE ticks before the step on."""
    t = (np.arange(-PATH_BEFORE * PATH_FINE, PATH_AFTER * PATH_FINE) + 0.5) * tick_s / PATH_FINE
    return tuple(
        float(x)
        for x in 2.0 * _steps(t, lag_s, tick_s, delay_s, shift) @ crossing_lead(lag_s, tick_s, delay_s, shift) - 1.0
    )


@compiled
def blocked_flow(path, share, slope_V, half_V):
    """Flow that the overlap blocks while the spool crosses it, before and after the reversal, as volts of one tick.

    path: of the crossing; share: of its tick that lies before the reversal (0 .. 1): so much of the step comes a tick
    later; slope_V: volts by which the demanded flow grows in a tick; half_V: half dead band. Signed like the slope.
    """
    before = after = 0.0
    for i in range(PATH_FINE, len(path)):
        time = (i + 0.5) / PATH_FINE - PATH_BEFORE - share
        demanded = slope_V * time
        spool = demanded + half_V * (path[i] + share * (path[i - PATH_FINE] - path[i]))
        through = spool - half_V if spool > half_V else (spool + half_V if spool < -half_V else 0.0)
        if time < 0.0:
            before += demanded - through
        else:
            after += demanded - through
    return before / PATH_FINE, after / PATH_FINE
