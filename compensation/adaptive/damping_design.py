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

from ..compiled import compiled
from .arithmetic import fill_zero
from .least_squares import add_row, solve, start_least_squares
from .spool import SPOOL_DAMPING

MAX_WRONG_SHARE = 1.2  # of a pressure oscillation that the damping may feed at any frequency, over what it damps
GROWTH_SHARE = 0.5  # of the viscous damping of a mode that the filter may take away
LOWEST_MODE, HIGHEST_MODE = 0.7, 1.5  # over the identified resonance: the oil's volume changes with the stroke
OWN_LOW, OWN_HIGH = 0.7, 1.3  # band of the filter made for the resonance, over it
OWN_BELOW, OWN_ABOVE, OWN_FAR = 0.3, 0.5, 1.8  # weights beside that band; above it up to OWN_FAR
OWN_WEIGHT, OWN_STEPS = 1.2, 150
PREFERENCE = 1.5  # how many times as much that one must damp to be taken
NEAR, NEAR_STEPS = 0.15, 7  # about the resonance, where they are compared
ABOVE, AT_REST, SIZE = 0.15, 1e2, 0.03  # weights: above the band, at rest, of the taps' size
BAND_STEPS, ABOVE_STEPS, ABOVE_BAND, CHECK_STEPS = 40, 30, 1.6, 120  # frequencies in the band, above 1.6 times its end


@compiled
def damping_filter(work, taps, lag_s, delay_s, load, settings):
    """Taps on the newest pressures: the flow through the lagging valve opposes the pressure's oscillation.

    load: resonance of the load on the oil [Hz], 0 = unknown, and b/m of it over the damping's rate gamma. The taps sum
    to zero.
    """
    n, low_Hz, high_Hz = int(settings.damping_count), settings.damping_low_Hz, settings.damping_high_Hz
    valve = settings.tick_s, lag_s, delay_s
    nyquist, resonance_Hz = 0.5 / settings.tick_s, load[0]
    start_least_squares(work, n)
    for k in range(BAND_STEPS):
        _add_frequency(work, n, low_Hz + k * (high_Hz - low_Hz) / (BAND_STEPS - 1), 1.0, 1.0, valve)
    for k in range(ABOVE_STEPS):
        f = ABOVE_BAND * high_Hz + k * (nyquist - ABOVE_BAND * high_Hz) / (ABOVE_STEPS - 1)
        _add_frequency(work, n, f, ABOVE, 0.0, valve)
    _solve(work, taps, n)
    _scale(taps, n, low_Hz, load, valve)
    if resonance_Hz == 0.0:
        return
    start_least_squares(work, n)
    first = 0.8 * low_Hz
    for k in range(OWN_STEPS):
        f = first + k * (nyquist - first) / (OWN_STEPS - 1)
        below, beyond = f <= OWN_LOW * resonance_Hz, f >= OWN_HIGH * resonance_Hz
        above = OWN_ABOVE if f < OWN_FAR * resonance_Hz else ABOVE
        weight = OWN_BELOW if below else (above if beyond else 1.0)
        _add_frequency(work, n, f, OWN_WEIGHT * weight, 0.0 if beyond or f < low_Hz else 1.0, valve)
    own = work.own_taps
    _solve(work, own, n)
    _scale(own, n, low_Hz, load, valve)
    if _least_share(own, n, resonance_Hz, valve) > PREFERENCE * max(_least_share(taps, n, resonance_Hz, valve), 0.0):
        for i in range(n):
            taps[i] = own[i]


@compiled
def _add_frequency(work, n, f_Hz, weight, share, valve):
    """Two rows: real and imaginary part of the taps through the valve are to be `share` and 0."""
    for part in range(2):
        for i in range(n):
            work.row[i] = weight * _valve_response(f_Hz, valve, i)[part]
        work.row[n] = weight * share if part == 0 else 0.0
        add_row(work, n)


@compiled
def _solve(work, taps, n):
    """The taps of the rows so far, small and with sum zero."""
    for i in range(n):
        work.row[i] = AT_REST
    work.row[n] = 0.0
    add_row(work, n)
    for i in range(n):
        fill_zero(work.row)
        work.row[i] = SIZE
        add_row(work, n)
    solve(work, n, taps)
    mean = 0.0
    for i in range(n):
        mean += taps[i] / n
    for i in range(n):
        taps[i] -= mean


@compiled
def _scale(taps, n, low_Hz, load, valve):
    """Makes the taps smaller until they feed no mode of the load more than they may.

    A mode at f is lighter than the identified one by (f_r/f)^2, so that viscous friction damps it more.
    """
    resonance_Hz, viscous_share, share = load[0], load[1], 1.0
    for k in range(CHECK_STEPS):
        f, allowed = low_Hz + k * (0.5 / valve[0] - low_Hz) / (CHECK_STEPS - 1), MAX_WRONG_SHARE
        if LOWEST_MODE * resonance_Hz < f < HIGHEST_MODE * resonance_Hz:
            allowed = min(GROWTH_SHARE * viscous_share * (f / resonance_Hz) ** 2, MAX_WRONG_SHARE)
        fed = -damped_share(taps, n, f, valve)
        if fed * share > allowed:
            share = allowed / fed
    for i in range(n):
        taps[i] *= share


@compiled
def _least_share(taps, n, resonance_Hz, valve):
    """Re F near the resonance."""
    least = math.inf
    for k in range(NEAR_STEPS):
        f = resonance_Hz * (1.0 - NEAR + 2.0 * NEAR * k / (NEAR_STEPS - 1))
        least = min(least, damped_share(taps, n, f, valve))
    return least


@compiled
def damped_share(taps, n, f_Hz, valve):
    """Re F: share of the oscillation that is damped, negative where it is fed. valve: tick, lag and delay [s]."""
    through = 0.0
    for i in range(n):
        through += taps[i] * _valve_response(f_Hz, valve, i)[0]
    return through


@compiled
def _valve_response(f_Hz, valve, ticks):
    """Real and imaginary part of spool, hold, delay and `ticks` more at a frequency."""
    tick_s, lag_s, delay_s = valve
    w = 2 * math.pi * f_Hz
    lag_s = max(lag_s - delay_s, 0.0)
    real, imaginary = 1.0 - (w * lag_s / (2 * SPOOL_DAMPING)) ** 2, w * lag_s
    half = 0.5 * w * tick_s
    size = math.sin(half) / half / (real * real + imaginary * imaginary)
    phase = w * ((0.5 + ticks) * tick_s + delay_s)
    cosine, sine = math.cos(phase), math.sin(phase)
    return size * (real * cosine - imaginary * sine), -size * (real * sine + imaginary * cosine)
