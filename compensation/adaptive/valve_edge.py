"""One direction of the valve: gain, dead band, lag and backlash, fitted without backlash and with it (see `valve`)."""

from __future__ import annotations

import math

from ..arithmetic import clip
from ..compiled import compiled
from .recursive_least_squares import inflate, reset_covariance, shift_fit, start_fit, update_fit

START_GAIN = 0.1  # [m/s/V], a start value only
MIN_GAIN, MAX_GAIN = 0.005, 5.0  # [m/s/V]
MAX_DEAD_BAND_V = 1.5
MAX_LAG_S = 0.014
MAX_BACKLASH_V = 0.3
MIN_BACKLASH_V = 2e-3  # a narrower one is not told from noise of the volts by where they reverse
# standard errors below which an edge is ready; of the lag without and with backlash
GAIN_ERROR, DEAD_BAND_ERROR_V, LAG_ERROR_S, LAG_ERROR_BACKLASH_S = 0.10, 1e-3, 6.5e-4, 8e-4
REJECT_MISFIT, ACCEPT_MISFIT = 3.0, 1.7  # residual over noise from which a fit is rejected, up to which it is accepted
BACKLASH_MISFIT = 4.0  # times the squared misfit allowed with backlash: where the volts reverse is roughly known
MIN_MEMORY_WINDOWS = 30.0  # of the fit with backlash; until it is ready its memory is the number of windows so far
DIVERGED = 2.0  # times the squared residual of the fit without backlash, from which the fit with it starts again
BACKLASH_TOLERANCE_V = 1e-4  # change of the backlash from which earlier windows count for less
ACCEPT_ERRORS, REJECT_ERRORS = 4.0, 2.0  # backlash over its standard error, both edges: taken into account, dropped
MIN_WINDOWS, PATIENCE = 15, 3.0  # windows before an edge is first ready; each rejection takes so many times longer
# prior standard deviations of k [m/s/V], k delta [m/s], k tau [m/V], k h [m/s]
GAIN_PRIOR, DEAD_BAND_PRIOR, LAG_PRIOR, BACKLASH_PRIOR = 0.3, 0.05, 2e-3, 5e-3


@compiled
def start_edge(edge, memory):
    """An edge of which nothing is known; its noise is."""
    noise = edge.noise_m
    prior = (GAIN_PRIOR / noise, DEAD_BAND_PRIOR / noise, LAG_PRIOR / noise)
    start_fit(edge.plain_fit, (START_GAIN, 0.0, 0.0), prior, memory, True)
    start_fit(edge.backlash_fit, (START_GAIN, 0.0, 0.0, 0.0), (*prior, BACKLASH_PRIOR / noise), memory, False)
    edge.gain_m_s_V, edge.root, edge.windows_needed = START_GAIN, 1.0, MIN_WINDOWS
    edge.misfit_allowed = 1.0


@compiled
def update_edge(edge, phi, phi_backlash, moved_m, with_backlash):
    """One window in; reads the fit out within its bounds. What it left over [m]."""
    memory = edge.backlash_fit.memory
    if not edge.ready:  # windows gathered with another width are biased
        memory = clip(edge.windows, MIN_MEMORY_WINDOWS, memory)
    edge.backlash_fit.forgetting = 1.0 - 1.0 / memory
    error = update_fit(edge.plain_fit, phi, moved_m)
    error_backlash = update_fit(edge.backlash_fit, phi_backlash, moved_m)
    edge.windows += 1.0
    _read_backlash(edge)
    if with_backlash:
        _read_fit(edge, edge.backlash_fit, edge.fitted_backlash_V, BACKLASH_MISFIT)
        return error_backlash
    _read_fit(edge, edge.plain_fit, 0.0, edge.misfit_allowed)
    return error


@compiled
def _read_fit(edge, fit, backlash_V, misfit_allowed):
    """Decides whether the edge is ready, and takes the numbers of the fit in use. What was ready is held until the edge is
    again: compensation that goes out needs a valve, and a fit that begins anew may be anywhere."""
    k, k_tau = clip(fit.theta[0], MIN_GAIN, MAX_GAIN), fit.theta[2]
    _decide_ready(edge, fit, k, k_tau, backlash_V, misfit_allowed)
    if edge.ready or edge.rejections == 0:
        edge.gain_m_s_V = k
        edge.dead_band_V = clip(fit.theta[1] / k, edge.least_V, MAX_DEAD_BAND_V)
        edge.lag_s = clip(k_tau / k, 0.0, MAX_LAG_S)
        edge.backlash_V = backlash_V


@compiled
def _decide_ready(edge, fit, k, k_tau, backlash_V, misfit_allowed):
    """By misfit and standard errors."""
    misfit = fit.residual / edge.noise_m**2 / misfit_allowed
    if edge.ready:
        if misfit > REJECT_MISFIT**2:
            _reject(edge)
        return
    c, unit = fit.covariance, (edge.noise_m / k) ** 2
    edge.ready = (
        edge.windows >= edge.windows_needed
        and misfit < ACCEPT_MISFIT**2
        and k_tau / k < MAX_LAG_S  # at its bound it is something else
        and c[0, 0] * unit < GAIN_ERROR**2
        and c[1, 1] * unit < DEAD_BAND_ERROR_V**2
        and c[2, 2] * unit < (LAG_ERROR_S if backlash_V == 0.0 else LAG_ERROR_BACKLASH_S) ** 2
    )


@compiled
def edge_variance_m2_s2(edge, with_backlash):
    """Variance of k delta of the fit in use, by its covariance and what it leaves over."""
    if with_backlash:
        return edge.backlash_fit.covariance[1, 1] * max(edge.backlash_fit.residual, edge.noise_m**2)
    return edge.plain_fit.covariance[1, 1] * max(edge.plain_fit.residual, edge.noise_m**2)


@compiled
def edge_V(edge):
    """Where the edge opens, from the volts' origin [V]; below 0 while the null is not known."""
    return edge.plain_fit.theta[1] / max(edge.plain_fit.theta[0], MIN_GAIN)


@compiled
def shift_edge(edge, volts_V, oil_m_s):
    """The same fit, with volts counted from further out, and less oil that leaks out in this direction."""
    shift_fit(edge.plain_fit, 1, 0, -volts_V, oil_m_s / edge.root)
    shift_fit(edge.backlash_fit, 1, 0, -volts_V, oil_m_s / edge.root)
    edge.dead_band_V = clip(
        edge.dead_band_V - volts_V + oil_m_s / edge.root / edge.gain_m_s_V, edge.least_V, MAX_DEAD_BAND_V
    )


@compiled
def restart_edge(edge):
    """What was gathered before weighs no more than the prior."""
    edge.ready = False
    edge.windows_needed = max(edge.windows_needed, edge.windows + MIN_WINDOWS)
    reset_covariance(edge.plain_fit)
    reset_covariance(edge.backlash_fit)


@compiled
def begin_edge(edge):
    """The same, and what it left over is forgotten."""
    restart_edge(edge)
    edge.plain_fit.count = edge.backlash_fit.count = 0


@compiled
def _reject(edge):
    """The valve no longer behaves as identified."""
    edge.ready = False
    edge.rejections += 1
    edge.windows_needed = edge.windows + MIN_WINDOWS * PATIENCE**edge.rejections
    reset_covariance(edge.plain_fit)
    reset_covariance(edge.backlash_fit)


@compiled
def _read_backlash(edge):
    """Reads the backlash out.

    Earlier windows were gathered with another width: the more it moved, the less they count.
    """
    fit, plain = edge.backlash_fit, edge.plain_fit
    if fit.count > 4 and fit.residual > DIVERGED * max(plain.residual, edge.noise_m**2):
        for i in range(3):
            fit.theta[i] = plain.theta[i]
        fit.theta[3] = 0.0
        reset_covariance(fit)
    gain, before = max(fit.theta[0], MIN_GAIN), edge.fitted_backlash_V
    edge.fitted_backlash_V = clip(fit.theta[3] / gain, 0.0, MAX_BACKLASH_V)
    moved = edge.fitted_backlash_V - before
    if abs(moved) > BACKLASH_TOLERANCE_V:
        inflate(fit, 3, (gain * moved / edge.noise_m) ** 2)
    edge.significant = edge.fitted_backlash_V > MIN_BACKLASH_V and backlash_errors(edge) > ACCEPT_ERRORS


@compiled
def lag_difference_s(edge):
    """Lag of the fit without backlash less that of the fit with it; 0 once backlash is taken into account."""
    plain, fit = edge.plain_fit.theta, edge.backlash_fit.theta
    if edge.backlash_V != 0.0:
        return 0.0
    return plain[2] / max(plain[0], MIN_GAIN) - fit[2] / max(fit[0], MIN_GAIN)


@compiled
def backlash_errors(edge):
    """The fitted backlash over its standard error."""
    fit = edge.backlash_fit
    return fit.theta[3] / (edge.noise_m * math.sqrt(fit.covariance[3, 3]))


@compiled
def restart_backlash_fit(edge):
    """What was gathered with another width is biased: fit the backlash anew from the value found."""
    if edge.ready:
        return
    reset_covariance(edge.backlash_fit)
    edge.windows_needed = max(edge.windows_needed, edge.windows + 2 * MIN_WINDOWS)
