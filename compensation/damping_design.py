"""FIR filter of the pressure damping: phase and gain through the lagging valve, and a stability condition on it.

Oil is let out in proportion to the pressure's oscillation, gamma F(jw) of it a second. With the load's resonance

    s^2 + s (gamma Re F + b/m) + w_r^2 = 0,     so it grows where     gamma Re F < -b/m

b the viscous friction. Hold, spool and delay turn the phase, so that no causal F damps at all frequencies. A light
load resonates at 110 Hz, where a filter made for 15 to 65 Hz feeds: with 4 ms of delay it did so at 97 Hz until the
ride was 5.8 m/s2. So least squares for that band, with bounds: rows are added where Re F lies below its least share,
until it does no longer (penalty method, passes at most). The least share: least_near about the identified resonance;
where else a mode of the load may lie, most_growth of the viscous damping may be taken away; -most_wrong
elsewhere. What cannot be met that way is met by smaller taps, but for the first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .arithmetic import fill_zero
from .compiled import compiled
from .least_squares import add_row, solve, start_least_squares
from .records import record

MAX_DAMPING_TAPS = 16  # 32 ms at 500 Hz
WORK = record(  # least_squares.py
    triangle=("f8", (MAX_DAMPING_TAPS + 1, MAX_DAMPING_TAPS + 1)),
    row=("f8", (MAX_DAMPING_TAPS + 1,)),
)


class Design(NamedTuple):
    """The damping's filter: what it may do to a mode of the load, and how it is found."""

    most_wrong: float = 1.2  # of a pressure oscillation that the damping may feed at any frequency, over what it damps
    most_growth: float = 0.5  # of the viscous damping of a mode that the filter may take away
    lowest_mode: float = 0.7  # over the identified resonance: the oil's volume changes with the stroke
    highest_mode: float = 1.5  # likewise
    near: float = 0.1  # about the resonance, relative to it
    least_near: float = 0.45  # what is to be damped there
    passes: int = 20  # of the penalty method, at most
    margin: float = 0.1  # by which a row asks for more than its bound
    weight_above: float = 0.15  # above the band
    weight_at_rest: float = 1e2  # at rest: of the taps' sum
    weight_of_size: float = 0.03  # of the taps' size
    recovery_s: float = 5.0  # of the gain
    decay: float = 0.98  # of the gain, a tick, above half of its bound
    band_steps: int = 40  # frequencies in the band
    above_steps: int = 30  # and above it
    above_band: float = 1.6  # which begins at so many times its end
    check_steps: int = 120  # at which the bounds are checked


DESIGN = Design()


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
    for k in range(DESIGN.band_steps):
        _add_frequency(work, n, low_Hz + k * (high_Hz - low_Hz) / (DESIGN.band_steps - 1), 1.0, 1.0, valve)
    for k in range(DESIGN.above_steps):
        f = DESIGN.above_band * high_Hz + k * (nyquist - DESIGN.above_band * high_Hz) / (DESIGN.above_steps - 1)
        _add_frequency(work, n, f, DESIGN.weight_above, 0.0, valve)
    _add_size(work, n)
    solve(work, n, taps)
    for _ in range(DESIGN.passes):
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
        work.row[i] = DESIGN.weight_at_rest
    work.row[n] = 0.0
    add_row(work, n)
    for i in range(n):
        fill_zero(work.row)
        work.row[i] = DESIGN.weight_of_size
        add_row(work, n)


@compiled
def _least_share(f_Hz, load):
    """What a mode of the load there allows Re F to be; load: as above.

    A mode at f is lighter than the identified one by (f_r/f)^2, so that viscous friction damps it more.
    """
    resonance_Hz, viscous_share = load
    if DESIGN.lowest_mode * resonance_Hz < f_Hz < DESIGN.highest_mode * resonance_Hz:
        return -min(DESIGN.most_growth * viscous_share * (f_Hz / resonance_Hz) ** 2, DESIGN.most_wrong)
    return -DESIGN.most_wrong


@compiled
def _add_bounds(work, taps, n, low_Hz, load, valve):
    """A row for each frequency at which the taps damp too little; whether there was one."""
    added = False
    for k in range(DESIGN.check_steps):
        f = low_Hz + k * (0.5 / valve[0] - low_Hz) / (DESIGN.check_steps - 1)
        near = abs(f - load[0]) < DESIGN.near * load[0]
        least = DESIGN.least_near if near else _least_share(f, load)
        if damped_share(taps, n, f, valve) < least:
            for i in range(n):
                work.row[i] = _valve_response(f, valve, i)[0]
            work.row[n] = least + DESIGN.margin
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
    for k in range(DESIGN.check_steps):
        f = low_Hz + k * (0.5 / valve[0] - low_Hz) / (DESIGN.check_steps - 1)
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
        return gain + (1.0 - gain) * tick_s / DESIGN.recovery_s
    return gain * DESIGN.decay
