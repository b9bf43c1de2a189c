"""FIR filter of the pressure damping: phase and gain through the lagging valve, and a stability condition on it.

Oil is let out in proportion to the pressure's oscillation, gamma F(jw) of it a second. With the load's resonance

    s^2 + s (gamma Re F + b/m) + w_r^2 = 0,     so it grows where     gamma Re F < -b/m

b the viscous friction. Hold, spool and delay turn the phase, so that no causal F damps at all frequencies. A light
load resonates at 110 Hz, where a filter made for 15 to 65 Hz feeds: with 4 ms of delay it did so at 97 Hz until the
ride was 5.8 m/s2. So two filters are made, one for the whole band and one for the identified resonance, each scaled
until it takes at most GROWTH_SHARE of the viscous damping away where a mode of the load may lie. The one that damps
more is taken.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from .spool import SPOOL_DAMPING

MAX_WRONG_SHARE = 1.2  # of a pressure oscillation that the damping may feed at any frequency, over what it damps
GROWTH_SHARE = 0.5  # of the viscous damping of a mode that the filter may take away
LOWEST_MODE, HIGHEST_MODE = 0.7, 1.5  # over the identified resonance: the oil's volume changes with the stroke
OWN_LOW, OWN_HIGH = 0.7, 1.3  # band of the filter made for the resonance
OWN_BELOW, OWN_ABOVE = 0.3, 0.5  # weights beside that band
PREFERENCE = 1.5  # how many times as much that one must damp to be taken


def valve_response(f_Hz: np.ndarray, lag_s: float, tick_s: float, delay_s: float) -> np.ndarray:
    """Hold, delay and spool (n,), complex."""
    w, lag_s = 2 * math.pi * f_Hz, lag_s - delay_s
    held = np.exp(-1j * w * (0.5 * tick_s + delay_s)) * np.sinc(f_Hz * tick_s)
    return held / (1 + 1j * w * lag_s - (w * lag_s / (2 * SPOOL_DAMPING)) ** 2) if lag_s > 0 else held


def damped_share(taps: np.ndarray, f_Hz: np.ndarray, lag_s: float, tick_s: float, delay_s: float) -> np.ndarray:
    """Re F (n,): share of the oscillation that is damped; negative where it is fed."""
    ticks = np.exp(-2j * math.pi * tick_s * np.outer(f_Hz, np.arange(len(taps))))
    return (valve_response(f_Hz, lag_s, tick_s, delay_s) * (ticks @ taps)).real


@lru_cache(maxsize=128)
def damping_filter(
    lag_s: float, tick_s: float, low_Hz: float, high_Hz: float, count: int, delay_s: float = 0.0,
    resonance_Hz: float = 0.0, viscous_share: float = 0.0,
) -> tuple[float, ...]:  # fmt: skip
    """Taps (count,) on the newest pressures: the flow through the lagging valve opposes the pressure's oscillation.

    resonance_Hz: of the load on the oil, 0 = unknown: then the filter is made for `low_Hz` to `high_Hz`; viscous_share:
    b/m of the load over the damping's rate gamma. The taps sum to zero.
    """
    nyquist, valve = 0.5 / tick_s, (lag_s, tick_s, delay_s)
    f = np.concatenate([np.linspace(low_Hz, high_Hz, 40), np.linspace(1.6 * high_Hz, nyquist, 30)])
    wide = _least_squares(f, np.where(f <= high_Hz, 1.0, 0.15), f <= high_Hz, count, valve)
    wide = _scaled(wide, low_Hz, resonance_Hz, viscous_share, valve)
    if resonance_Hz == 0.0:
        return tuple(wide.tolist())
    f = np.linspace(0.8 * low_Hz, nyquist, 200)
    inside = (f > OWN_LOW * resonance_Hz) & (f < OWN_HIGH * resonance_Hz)
    below, above = f <= OWN_LOW * resonance_Hz, f < 1.8 * resonance_Hz
    weight = np.where(inside, 1.0, np.where(below, OWN_BELOW, np.where(above, OWN_ABOVE, 0.15)))
    own = _least_squares(f, 1.2 * weight, inside | (below & (f >= low_Hz)), count, valve)
    own = _scaled(own, low_Hz, resonance_Hz, viscous_share, valve)
    near = np.linspace(0.85, 1.15, 7) * resonance_Hz
    damped = [float(damped_share(taps, near, *valve).min()) for taps in (wide, own)]
    return tuple((own if damped[1] > PREFERENCE * max(damped[0], 0.0) else wide).tolist())


def _least_squares(
    f_Hz: np.ndarray, weight: np.ndarray, damped: np.ndarray, count: int, valve: tuple[float, float, float]
) -> np.ndarray:
    """Taps whose flow through the valve is 1 at the frequencies that are to be damped, and 0 at the others."""
    ticks = np.exp(-2j * math.pi * valve[1] * np.outer(f_Hz, np.arange(count)))
    matrix = (weight * valve_response(f_Hz, *valve))[:, None] * ticks
    target = weight * np.where(damped, 1.0, 0.0)
    rows = [matrix.real, matrix.imag, 1e2 * np.ones((1, count)), 0.03 * np.eye(count)]
    right = [target, np.zeros_like(target), np.zeros(1), np.zeros(count)]
    taps = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]
    return taps - taps.mean()


def _scaled(
    taps: np.ndarray, low_Hz: float, resonance_Hz: float, viscous_share: float, valve: tuple[float, float, float]
) -> np.ndarray:
    """The taps, made smaller until they feed no mode of the load more than they may.

    A mode at f is lighter than the identified one by (f_r/f)^2, so that viscous friction damps it more.
    """
    f = np.linspace(low_Hz, 0.5 / valve[1], 120)
    fed, allowed = -damped_share(taps, f, *valve), np.full_like(f, MAX_WRONG_SHARE)
    if resonance_Hz > 0.0:
        mode = (f > LOWEST_MODE * resonance_Hz) & (f < HIGHEST_MODE * resonance_Hz)
        allowed[mode] = np.minimum(GROWTH_SHARE * viscous_share * (f[mode] / resonance_Hz) ** 2, MAX_WRONG_SHARE)
    return taps * min(1.0, float(np.min(allowed[fed > 0.0] / fed[fed > 0.0], initial=1.0)))
