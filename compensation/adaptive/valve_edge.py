"""One direction of the valve: gain, dead band, lag and backlash, fitted without backlash and with it (see `valve`)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..compensator import clip
from .recursive_least_squares import RecursiveLeastSquares

START_GAIN = 0.1  # [m/s/V], a start value only
MIN_GAIN, MAX_GAIN = 0.005, 5.0  # [m/s/V]
MAX_DEAD_BAND_V = 1.5
MAX_LAG_S = 0.014
MAX_BACKLASH_V = 0.3
MIN_BACKLASH_V = 2e-3  # a narrower one is not told from noise of the volts by where they reverse
WINDOW_NOISE_M = 5e-6  # displacement noise of a window: two positions with 3 um noise and 3 um resolution
GAIN_ERROR, DEAD_BAND_ERROR_V, LAG_ERROR_S = 0.10, 1e-3, 8e-4  # standard errors below which an edge is ready
REJECT_MISFIT, ACCEPT_MISFIT = 3.0, 1.7  # residual over noise from which a fit is rejected, up to which it is accepted
BACKLASH_MISFIT = 4.0  # times the squared misfit allowed with backlash: where the volts reverse is roughly known
MIN_MEMORY_WINDOWS = 30.0  # of the fit with backlash; until it is ready its memory is the number of windows so far
DIVERGED = 2.0  # times the squared residual of the fit without backlash, from which the fit with it starts again
BACKLASH_TOLERANCE_V = 1e-4  # change of the backlash from which earlier windows count for less
ACCEPT_ERRORS, REJECT_ERRORS = 4.0, 2.0  # backlash over its standard error, both edges: taken into account, dropped
MIN_WINDOWS, PATIENCE = 15, 3.0  # windows before an edge is first ready; each rejection takes so many times longer
# prior standard deviations of k, k delta, k tau, k h over the window's noise: 0.3 m/s/V, 0.05 m/s, 2 mm/V, 5 mm/s
PRIOR = (0.3 / WINDOW_NOISE_M, 0.05 / WINDOW_NOISE_M, 2e-3 / WINDOW_NOISE_M, 5e-3 / WINDOW_NOISE_M)


@dataclass(slots=True)
class ValveEdge:
    """One direction of the valve: what is identified of it."""

    plain_fit: RecursiveLeastSquares  # k, k delta, k tau
    backlash_fit: RecursiveLeastSquares  # the same and k h
    windows: float = 0.0
    gain_m_s_V: float = START_GAIN
    dead_band_V: float = 0.0
    lag_s: float = 0.0
    root: float = 1.0  # R^ of the last window
    backlash_V: float = 0.0  # half width, 0 until it is taken into account
    fitted_backlash_V: float = 0.0
    significant: bool = False  # backlash: from then on b is found from where the volts reverse
    ready: bool = False
    rejections: int = 0  # how often it was ready and then did not fit
    windows_needed: float = float(MIN_WINDOWS)

    def update(self, phi: list[float], phi_backlash: list[float], moved_m: float, with_backlash: bool) -> float:
        """One window in; reads the fit out within its bounds. What it left over [m]."""
        memory = self.backlash_fit.memory
        if not self.ready:  # windows gathered with another width are biased
            memory = clip(self.windows, MIN_MEMORY_WINDOWS, memory)
        self.backlash_fit.forgetting = 1.0 - 1.0 / memory
        errors = self.plain_fit.update(phi, moved_m), self.backlash_fit.update(phi_backlash, moved_m)
        self.windows += 1.0
        self._read_backlash()
        fit = self.backlash_fit if with_backlash else self.plain_fit
        k, k_delta, k_tau = fit.theta[:3]
        k = self.gain_m_s_V = clip(k, MIN_GAIN, MAX_GAIN)
        self.dead_band_V = clip(k_delta / k, 0.0, MAX_DEAD_BAND_V)
        self.lag_s = clip(k_tau / k, 0.0, MAX_LAG_S)
        self.backlash_V = self.fitted_backlash_V if with_backlash else 0.0
        misfit = fit.residual / WINDOW_NOISE_M**2 / (BACKLASH_MISFIT if with_backlash else 1.0)
        if self.ready:
            if misfit > REJECT_MISFIT**2:
                self._reject()
            return errors[with_backlash]
        c, unit = fit.covariance, (WINDOW_NOISE_M / k) ** 2
        self.ready = (
            self.windows >= self.windows_needed
            and misfit < ACCEPT_MISFIT**2
            and k_tau / k < MAX_LAG_S  # at its bound it is something else
            and c[0][0] * unit < GAIN_ERROR**2
            and c[1][1] * unit < DEAD_BAND_ERROR_V**2
            and c[2][2] * unit < LAG_ERROR_S**2
        )
        return errors[with_backlash]

    @property
    def edge_V(self) -> float:
        """Where the edge opens, from the volts' origin [V]; below 0 while the null is not known."""
        return self.plain_fit.theta[1] / max(self.plain_fit.theta[0], MIN_GAIN)

    def shift(self, volts_V: float, oil_m_s: float) -> None:
        """The same fit, with volts counted from further out, and less oil that leaks out in this direction."""
        for fit in (self.plain_fit, self.backlash_fit):
            fit.shift(1, 0, -volts_V, oil_m_s / self.root)
        self.dead_band_V = clip(
            self.dead_band_V - volts_V + oil_m_s / self.root / self.gain_m_s_V, 0.0, MAX_DEAD_BAND_V
        )

    def restart(self) -> None:
        """What was gathered before weighs no more than the prior."""
        self.ready = False
        self.windows_needed = max(self.windows_needed, self.windows + MIN_WINDOWS)
        self.plain_fit.reset_covariance()
        self.backlash_fit.reset_covariance()

    def _reject(self) -> None:
        """The valve no longer behaves as identified."""
        self.ready = False
        self.rejections += 1
        self.windows_needed = self.windows + MIN_WINDOWS * PATIENCE**self.rejections
        self.plain_fit.reset_covariance()
        self.backlash_fit.reset_covariance()

    def _read_backlash(self) -> None:
        """Reads the backlash out.

        Earlier windows were gathered with another width: the more it moved, the less they count.
        """
        fit, plain = self.backlash_fit, self.plain_fit
        if fit.count > 4 and fit.residual > DIVERGED * max(plain.residual, WINDOW_NOISE_M**2):
            fit.theta[:] = [*plain.theta, 0.0]
            fit.reset_covariance()
        gain, before = max(fit.theta[0], MIN_GAIN), self.fitted_backlash_V
        self.fitted_backlash_V = clip(fit.theta[3] / gain, 0.0, MAX_BACKLASH_V)
        moved = self.fitted_backlash_V - before
        if abs(moved) > BACKLASH_TOLERANCE_V:
            fit.inflate(3, (gain * moved / WINDOW_NOISE_M) ** 2)
        self.significant = self.fitted_backlash_V > MIN_BACKLASH_V and self.backlash_errors() > ACCEPT_ERRORS

    def lag_difference_s(self) -> float:
        """Lag of the fit without backlash less that of the fit with it; 0 once backlash is taken into account."""
        plain, fit = self.plain_fit.theta, self.backlash_fit.theta
        return plain[2] / max(plain[0], MIN_GAIN) - fit[2] / max(fit[0], MIN_GAIN) if self.backlash_V == 0.0 else 0.0

    def backlash_errors(self) -> float:
        """The fitted backlash over its standard error."""
        return self.backlash_fit.theta[3] / (WINDOW_NOISE_M * math.sqrt(self.backlash_fit.covariance[3][3]))

    def restart_backlash_fit(self) -> None:
        """What was gathered with another width is biased: fit the backlash anew from the value found."""
        if self.ready:
            return
        self.backlash_fit.reset_covariance()
        self.windows_needed = max(self.windows_needed, self.windows + 2 * MIN_WINDOWS)


def new_edge(memory: float) -> ValveEdge:
    """An edge of which nothing is known."""
    start = [START_GAIN, 0.0, 0.0]
    return ValveEdge(
        RecursiveLeastSquares(list(start), list(PRIOR[:3]), memory, directional=True),
        RecursiveLeastSquares([*start, 0.0], list(PRIOR), memory),
    )
