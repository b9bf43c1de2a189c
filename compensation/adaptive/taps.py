"""FIR filters for the spool's lag: leads for the flow and for the dead band. damping_design.py makes the damping's.

The response of the spool to the volts of one tick (held over the tick), averaged over each following tick, is

    g_j = (1/T) int_{jT}^{(j+1)T} [s(t) - s(t - T)] dt,      s(t) the spool's unit step response.

Each filter is a linear least-squares problem (least_squares.py) in the memory of `work`, a record DESIGN.
"""

from __future__ import annotations

import math

from ..arithmetic import dot, fill_zero, push
from ..compiled import compiled
from ..damping_design import damping_filter
from ..least_squares import add_row, solve, start_least_squares
from .layout import LEAD_TAPS, LEAD_TICKS, PATH_AFTER, PATH_BEFORE, PATH_FINE, RESPONSE
from .spool import round_lag, step_response

FREE_TICKS = 0.75  # on either side of the crossing in which the spool's path is nearly free, with FREE_WEIGHT
FREE_WEIGHT = 0.3
CROSSING_SMOOTHING = 1e-5  # of the crossing lead
RESPONSE_FINE, CROSSING_FINE = 40, 20  # samples a tick
SUM_WEIGHT = 1e3  # of the taps' sum and centre


@compiled
def design(state):
    """The taps for the lag and the delay that the step has found. Takes longer than a tick's step; nothing else reads
    what it writes."""
    settings, work = state.settings, state.design
    lag_s, delay_s, shift, tick_s = state.lag_s, state.delay_s, state.shift, settings.tick_s
    damping = settings.spool_damping
    lead(work, state.lead_taps, lag_s, tick_s, settings.lead_smoothing, delay_s, shift, damping)
    crossing_lead(work, state.crossing_taps, lag_s, tick_s, delay_s, shift, damping)
    crossing_path(work, state.crossing_path, state.crossing_taps, lag_s, tick_s, delay_s, shift, damping)
    crossing_path(work, state.lead_path, state.lead_taps, lag_s, tick_s, delay_s, shift, damping)
    late_s = min(round_lag(state.lateness.late_s), delay_s)  # of the position; pressure is not late
    load = state.resonance_Hz, state.viscous_share
    damping_filter(work, state.damping_taps, lag_s - late_s, delay_s - late_s, load, settings)
    state.design_wanted = False


@compiled
def tick_response(response, lag_s, tick_s, delay_s, damping):
    """g_j into `response` (n,): mean spool position in tick j after one tick of unit volts."""
    for j in range(len(response)):
        total = 0.0
        for i in range(RESPONSE_FINE):
            t = (j * RESPONSE_FINE + i + 0.5) * tick_s / RESPONSE_FINE
            total += step_response(t, lag_s, delay_s, damping) - step_response(t - tick_s, lag_s, delay_s, damping)
        response[j] = total / RESPONSE_FINE


@compiled
def lead(work, taps, lag_s, tick_s, smoothing, delay_s, shift, damping):
    """Taps h (LEAD_TAPS,) so that u_k = sum_i h_i x_{k + LEAD_TICKS - i} makes the spool follow x, as means over ticks.

    Least squares of g * h against a pulse at LEAD_TICKS, with `smoothing` times the taps' roughness: more is softer and
    slower. The taps sum to one, so that nothing changes at rest, and their centre undoes the spool's: no time is left.
    """
    g, past = work.response, work.past
    tick_response(g, lag_s, tick_s, delay_s, damping)
    start_least_squares(work, LEAD_TAPS)
    fill_zero(past)
    for k in range(RESPONSE + LEAD_TAPS - 1):
        push(past, g[k] if k < RESPONSE else 0.0)
        _add_weighed(work, 1.0, 1.0 if k == LEAD_TICKS + shift else 0.0)
    total = moment = 0.0
    for j in range(RESPONSE):
        total, moment = total + g[j], moment + j * g[j]
    _solve_taps(work, taps, smoothing, LEAD_TICKS + shift - moment / total)


@compiled
def crossing_lead(work, taps, lag_s, tick_s, delay_s, shift, damping):
    """Taps (LEAD_TAPS,) like `lead`, for the dead-band compensation alone.

    Inside the overlap the spool lets no oil through; any overshoot beyond it does. So the spool's path is prescribed
    here, and not its mean over ticks: where it stood until FREE_TICKS before the crossing, where it is to stand from
    as long after it, and nearly free in between.
    """
    start_least_squares(work, LEAD_TAPS)
    before = LEAD_TICKS + shift
    for i in range(CROSSING_FINE):
        fill_zero(work.past)
        for k in range(before + RESPONSE):
            part = (i + 0.5) / CROSSING_FINE
            push(work.past, step_response((k + part) * tick_s, lag_s, delay_s, damping))
            time = k - before + part
            weight = (FREE_WEIGHT if abs(time) < FREE_TICKS else 1.0) / math.sqrt(CROSSING_FINE)
            _add_weighed(work, weight, 1.0 if time > 0.0 else 0.0)
    _solve_taps(work, taps, CROSSING_SMOOTHING, before - lag_s / tick_s)


@compiled
def crossing_path(work, path, taps, lag_s, tick_s, delay_s, shift, damping):
    """Path of the crossing spool, from -1 to 1, PATH_FINE samples a tick, from PATH_BEFORE ticks before the step on;
    taps: `crossing_lead`."""
    first = LEAD_TICKS + shift - PATH_BEFORE
    for i in range(PATH_FINE):
        fill_zero(work.past)
        for k in range(first + PATH_BEFORE + PATH_AFTER):
            push(work.past, step_response((k + (i + 0.5) / PATH_FINE) * tick_s, lag_s, delay_s, damping))
            if k >= first:
                path[(k - first) * PATH_FINE + i] = 2.0 * dot(taps, work.past, LEAD_TAPS) - 1.0


@compiled
def _add_weighed(work, weight, target):
    """One row: the spool's response to each of the lead's taps, in `work.past`."""
    for i in range(LEAD_TAPS):
        work.row[i] = weight * work.past[i]
    work.row[LEAD_TAPS] = weight * target
    add_row(work, LEAD_TAPS)


@compiled
def _solve_taps(work, taps, smoothing, centre):
    """The taps of the rows so far, regularised by `smoothing`, with unit sum and a given centre."""
    rough, row = math.sqrt(smoothing), work.row
    for i in range(LEAD_TAPS):
        fill_zero(row)
        row[i] = rough
        if i + 1 < LEAD_TAPS:
            row[i + 1] = -rough
        add_row(work, LEAD_TAPS)
    for i in range(LEAD_TAPS):
        row[i] = SUM_WEIGHT
    row[LEAD_TAPS] = SUM_WEIGHT
    add_row(work, LEAD_TAPS)
    for i in range(LEAD_TAPS):
        row[i] = SUM_WEIGHT * i
    row[LEAD_TAPS] = SUM_WEIGHT * centre
    add_row(work, LEAD_TAPS)
    solve(work, LEAD_TAPS, taps)
    total = 0.0
    for i in range(LEAD_TAPS):
        total += taps[i]
    for i in range(LEAD_TAPS):
        taps[i] /= total
