"""FIR filter of the pressure damping: phase and gain through the lagging valve, and a stability condition on it.

Oil is let out in proportion to the pressure's oscillation, gamma F(jw) of it a second. With the load's resonance

    s^2 + s (gamma Re F + b/m) + w_r^2 = 0,     so it grows where     gamma Re F < -b/m

b the viscous friction. Hold, spool and delay turn the phase, so that no causal F damps at all frequencies. A light
load resonates at 110 Hz, where a filter made for 15 to 65 Hz feeds: with 4 ms of delay it did so at 97 Hz until the
ride was 5.8 m/s2. So least squares for that band, with bounds: rows are added where Re F lies below its least share,
until it does no longer (penalty method, PASSES at most). The least share: LEAST_SHARE about the identified resonance;
where else a mode of the load may lie, GROWTH_SHARE of the viscous damping may be taken away; -MAX_WRONG_SHARE
elsewhere. What cannot be met that way is met by smaller taps, but for the first.
"""

from __future__ import annotations

import math

from .arithmetic import fill_zero
from .compiled import compiled
from .least_squares import add_row, solve, start_least_squares
from .records import record

MAX_DAMPING_TAPS = 16  # 32 ms at 500 Hz
WORK = record(  # least_squares.py
    triangle=("f8", (MAX_DAMPING_TAPS + 1, MAX_DAMPING_TAPS + 1)),
    row=("f8", (MAX_DAMPING_TAPS + 1,)),
)
MAX_WRONG_SHARE = 1.2  # of a pressure oscillation that the damping may feed at any frequency, over what it damps
GROWTH_SHARE = 0.5  # of the viscous damping of a mode that the filter may take away
LOWEST_MODE, HIGHEST_MODE = 0.7, 1.5  # over the identified resonance: the oil's volume changes with the stroke
NEAR, LEAST_SHARE = 0.1, 0.45  # about the resonance, relative to it; what is to be damped there
PASSES, MARGIN = 20, 0.1  # of the penalty method; by which a row asks for more than its bound
ABOVE, AT_REST, SIZE = 0.15, 1e2, 0.03  # weights: above the band, at rest, of the taps' size
RECOVERY_S, DECAY = 5.0, 0.98  # of the gain; the decay a tick, above half of its bound
BAND_STEPS, ABOVE_STEPS, ABOVE_BAND, CHECK_STEPS = 40, 30, 1.6, 120  # frequencies in the band, above 1.6 times its end


@compiled
def damping_filter(work, taps, lag_s, delay_s, load, settings):
    """Taps on the newest pressures: the flow through the lagging valve opposes the pressure's oscillation.

    load: resonance of the load on the oil [Hz], 0 = unknown, and b/m of it over the damping's rate gamma. The taps sum
    to zero.
    """
    n, low_Hz, high_Hz = int(settings.damping_count), settings.damping_low_Hz, settings.damping_high_Hz
    valve = settings.tick_s, lag_s, delay_s, settings.spool_damping
    nyquist = 0.5 / settings.tick_s
    start_least_squares(work, n)
    for k in range(BAND_STEPS):
        _add_frequency(work, n, low_Hz + k * (high_Hz - low_Hz) / (BAND_STEPS - 1), 1.0, 1.0, valve)
    for k in range(ABOVE_STEPS):
        f = ABOVE_BAND * high_Hz + k * (nyquist - ABOVE_BAND * high_Hz) / (ABOVE_STEPS - 1)
        _add_frequency(work, n, f, ABOVE, 0.0, valve)
    _add_size(work, n)
    solve(work, n, taps)
    for _ in range(PASSES):
        if not _add_bounds(work, taps, n, low_Hz, load, valve):
            break
        solve(work, n, taps)
    _balance_and_scale(taps, n, low_Hz, load, valve)


@compiled
def _add_frequency(work, n, f_Hz, weight, share, valve):
    """Two rows: real and imaginary part of the taps through the valve are to be `share` and 0."""
    for part in range(2):
        for i in range(n):
            work.row[i] = weight * _valve_response(f_Hz, valve, i)[part]
        work.row[n] = weight * share if part == 0 else 0.0
        add_row(work, n)


@compiled
def _add_size(work, n):
    """Rows that keep the taps small and their sum zero."""
    for i in range(n):
        work.row[i] = AT_REST
    work.row[n] = 0.0
    add_row(work, n)
    for i in range(n):
        fill_zero(work.row)
        work.row[i] = SIZE
        add_row(work, n)


@compiled
def _least_share(f_Hz, load):
    """What a mode of the load there allows Re F to be; load: as above.

    A mode at f is lighter than the identified one by (f_r/f)^2, so that viscous friction damps it more.
    """
    resonance_Hz, viscous_share = load
    if LOWEST_MODE * resonance_Hz < f_Hz < HIGHEST_MODE * resonance_Hz:
        return -min(GROWTH_SHARE * viscous_share * (f_Hz / resonance_Hz) ** 2, MAX_WRONG_SHARE)
    return -MAX_WRONG_SHARE


@compiled
def _add_bounds(work, taps, n, low_Hz, load, valve):
    """A row for each frequency at which the taps damp too little; whether there was one."""
    added = False
    for k in range(CHECK_STEPS):
        f = low_Hz + k * (0.5 / valve[0] - low_Hz) / (CHECK_STEPS - 1)
        near = abs(f - load[0]) < NEAR * load[0]
        least = LEAST_SHARE if near else _least_share(f, load)
        if damped_share(taps, n, f, valve) < least:
            for i in range(n):
                work.row[i] = _valve_response(f, valve, i)[0]
            work.row[n] = least + MARGIN
            add_row(work, n)
            added = True
    return added


@compiled
def _balance_and_scale(taps, n, low_Hz, load, valve):
    """Makes the taps' sum zero, and the taps smaller until they feed no mode of the load more than they may."""
    mean, share = 0.0, 1.0
    for i in range(n):
        mean += taps[i] / n
    for i in range(n):
        taps[i] -= mean
    for k in range(CHECK_STEPS):
        f = low_Hz + k * (0.5 / valve[0] - low_Hz) / (CHECK_STEPS - 1)
        found, least = damped_share(taps, n, f, valve), _least_share(f, load)
        if found * share < least:
            share = least / found
    for i in range(n):
        taps[i] *= share


@compiled
def damped_share(taps, n, f_Hz, valve):
    """Re F: share of the oscillation that is damped, negative where it is fed. valve: tick, lag and delay [s], damping of the spool."""
    through = 0.0
    for i in range(n):
        through += taps[i] * _valve_response(f_Hz, valve, i)[0]
    return through


@compiled
def _valve_response(f_Hz, valve, ticks):
    """Real and imaginary part of spool, hold, delay and `ticks` more at a frequency."""
    tick_s, lag_s, delay_s, damping = valve
    w = 2 * math.pi * f_Hz
    lag_s = max(lag_s - delay_s, 0.0)
    real, imaginary = 1.0 - (w * lag_s / (2 * damping)) ** 2, w * lag_s
    half = 0.5 * w * tick_s
    size = math.sin(half) / half / (real * real + imaginary * imaginary)
    phase = w * ((0.5 + ticks) * tick_s + delay_s)
    cosine, sine = math.cos(phase), math.sin(phase)
    return size * (real * cosine - imaginary * sine), -size * (real * sine + imaginary * cosine)


@compiled
def next_damping_gain(gain, volts, limit_V, tick_s):
    """The damping's gain after a tick with its volts: it recovers, and falls as they come near their bound."""
    if -0.5 * limit_V < volts < 0.5 * limit_V:
        return gain + (1.0 - gain) * tick_s / RECOVERY_S
    return gain * DECAY
