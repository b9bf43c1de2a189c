"""Identification of the valve, per direction: gain, dead band, lag and backlash, from displacements, not velocities.

Oil volume over piston area is z = y + V P1 / (E A1), and z' is the flow through the valve, whatever the load does
(Eq. 3.7). The spool x lags the volts u by tau and follows them through a backlash of half width h. The law of one edge
(Eq. 3.3, 3.4), integrated over a window, is linear in what is unknown:

    z(t2) - z(t1) = k int p R dt - k delta int R dt - k tau R^ [p]_t1^t2,     p = b + h s,     R = sqrt(dp / dp_ref)

R^ is the mean of R, k the velocity gain [m/s/V], delta the half dead band [V], tau the lag [s]. p is the output of the
backlash: b the volts where it last moved along with them, s = -1 where they were rising then, 1 where they were
falling. b is found with the h known so far. It depends on h only where the backlash reverses, so that little is wrong
while h is wrong, and windows gathered before h moved count for less.

Two fits run side by side, without backlash (p = u) and with it. The one with backlash is taken where its h is well
beyond its standard error.

Position noise enters only at the two ends of a window and not at all on the right, so that least squares is unbiased.
Nothing is differentiated. The residual is the noise of two positions if the valve is of this kind, and much more if it
is not: then the fit is rejected.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ..compensator import Context, Parameters, clip
from .recursive_least_squares import RecursiveLeastSquares

START_GAIN = 0.1  # [m/s/V], a start value only
MIN_GAIN, MAX_GAIN = 0.005, 5.0  # [m/s/V]
MAX_DEAD_BAND_V = 1.5
MAX_LAG_S = 0.012
MAX_BACKLASH_V = 0.3
MIN_BACKLASH_V = 2e-3  # a narrower one cannot be distinguished from noise of the volts by where they reverse
WINDOW_NOISE_M = 5e-6  # displacement noise of a window: two positions with 3 um noise and 3 um resolution
GAIN_ERROR, DEAD_BAND_ERROR_V, LAG_ERROR_S = 0.10, 1e-3, 8e-4  # standard errors below which an edge is ready
MAX_LAG_OIL_M = 20e-6  # oil at a crossing of the overlap by which the lags of both edges may differ: one spool, one lag
REJECT_MISFIT, ACCEPT_MISFIT = 3.0, 1.7  # residual over noise from which a fit is rejected, up to which it is accepted
BACKLASH_MISFIT = 4.0  # times the squared misfit allowed with backlash: where the volts reverse is roughly known
MIN_MEMORY_WINDOWS = 30.0  # of the fit with backlash; until it is ready its memory is the number of windows so far
DIVERGED = 2.0  # times the squared residual of the fit without backlash, from which the fit with it starts again
BACKLASH_TOLERANCE_V = 1e-4  # change of the backlash from which earlier windows count for less
ACCEPT_ERRORS, REJECT_ERRORS = 4.0, 2.0  # backlash over its standard error, both edges: taken into account, dropped
MIN_WINDOWS, PATIENCE = 15, 3.0  # windows before an edge is first ready; each rejection takes so many times longer
USABLE_WINDOWS = 8  # from which the gain is right within some per cent
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
    backlash_V: float = 0.0  # half width, 0 until it is taken into account
    fitted_backlash_V: float = 0.0
    significant: bool = False  # backlash: from then on b is found from where the volts reverse
    ready: bool = False
    rejections: int = 0  # how often it was ready and then did not fit
    windows_needed: float = float(MIN_WINDOWS)

    def update(self, phi: list[float], phi_backlash: list[float], moved_m: float, with_backlash: bool) -> None:
        """One window in; reads the fit out within its bounds."""
        memory = self.backlash_fit.memory
        if not self.ready:  # windows gathered with another width are biased
            memory = clip(self.windows, MIN_MEMORY_WINDOWS, memory)
        self.backlash_fit.forgetting = 1.0 - 1.0 / memory
        self.plain_fit.update(phi, moved_m)
        self.backlash_fit.update(phi_backlash, moved_m)
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
            return
        c, unit = fit.covariance, (WINDOW_NOISE_M / k) ** 2
        self.ready = (
            self.windows >= self.windows_needed
            and misfit < ACCEPT_MISFIT**2
            and k_tau / k < MAX_LAG_S  # at its bound it is something else
            and c[0][0] * unit < GAIN_ERROR**2
            and c[1][1] * unit < DEAD_BAND_ERROR_V**2
            and c[2][2] * unit < LAG_ERROR_S**2
        )

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


@dataclass(slots=True)
class ValveEstimator:
    """Both directions, and the window being gathered."""

    context: Context
    window: int  # ticks
    min_speed_m_s: float  # mean speed of the piston from which a window counts
    settle: int  # ticks after the volts change sign in which the spool crosses
    memory: float  # windows
    edges: list[ValveEdge] = field(default_factory=list)  # [retracting, extending]
    direction: int = 0
    wait: int = 0
    count: int = 0
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)  # z [m], |u| and |p| [V] at the window's start
    sums: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 0.0])  # of u R, R, b R, s R
    reversal_V: float = 0.0  # b
    side: float = -1.0  # s
    moving: bool = False
    with_backlash: bool = False
    pending: tuple[list[float], list[float], float] | None = None
    lag_s: float = 0.0

    def __post_init__(self) -> None:
        if not self.edges:
            self.edges = [new_edge(self.memory), new_edge(self.memory)]

    def edge(self, volts: float) -> ValveEdge:
        """The edge that these volts open."""
        return self.edges[1 if volts > 0.0 else 0]

    @property
    def ready(self) -> bool:
        """Whether both directions are known well enough to act on."""
        return self.edges[0].ready and self.edges[1].ready

    @property
    def rejected(self) -> bool:
        """Whether a direction had been ready and no longer behaves as identified."""
        down, up = self.edges
        return (down.rejections > 0 and not down.ready) or (up.rejections > 0 and not up.ready)

    @property
    def usable(self) -> bool:
        """Whether both directions are known well enough to tell how the piston moves."""
        return self.edges[0].windows >= USABLE_WINDOWS and self.edges[1].windows >= USABLE_WINDOWS

    @property
    def lags_agree(self) -> bool:
        """Whether both directions, and the fits without and with backlash, find the lag of one spool.

        Measured as oil at a crossing of the overlap.
        """
        down, up = self.edges
        crossing_m_s = max(down.gain_m_s_V, up.gain_m_s_V) * (down.dead_band_V + up.dead_band_V)
        difference_s = 0.5 * abs(down.lag_difference_s() + up.lag_difference_s())
        return crossing_m_s * max(abs(down.lag_s - up.lag_s), difference_s) < MAX_LAG_OIL_M

    def add(self, z_m: float, valve_V: float, root: float) -> None:
        """One tick: oil displacement now, volts of the tick past, mean sqrt(dp/dp_ref) in it of their edge."""
        direction = 1 if valve_V > 0.0 else -1
        size = valve_V if direction > 0 else -valve_V
        if direction != self.direction:
            self.direction, self.wait = direction, self.settle
            self._restart()
            return
        edge = self.edges[direction > 0]
        half = edge.fitted_backlash_V if edge.fitted_backlash_V > MIN_BACKLASH_V else MIN_BACKLASH_V
        beyond = self.side * (self.reversal_V - valve_V)
        if beyond >= 0.0:
            self.reversal_V = valve_V
        elif beyond < -2.0 * half:
            self.reversal_V, self.side = valve_V, -self.side
        if self.wait > 0:
            self.wait -= 1
            return
        if self.count:
            s = self.sums
            s[0] += size * root
            s[1] += root
            if edge.significant:
                s[2] += direction * self.reversal_V * root
                s[3] += direction * self.side * root
            else:
                s[2] += size * root
                s[3] += direction * (self.side + (self.reversal_V - valve_V) / half) * root
            if self.count == self.window:
                self._finish(z_m, size, direction * (self.reversal_V + half * self.side))
                self.count = 0
        if self.count == 0:
            self.start = (z_m, size, direction * (self.reversal_V + half * self.side))
            self.sums = [0.0, 0.0, 0.0, 0.0]
        self.count += 1

    def _restart(self) -> None:
        self.count, self.moving, self.pending = 0, False, None

    def _finish(self, z_m: float, size: float, through: float) -> None:
        """Use the window before this one, if the piston moved in it, before it and after it.

        So none reaches into the overlap.
        """
        tick = self.context.tick_s
        moved = self.direction * (z_m - self.start[0])
        if moved < self.min_speed_m_s * self.window * tick:
            self._restart()
            return
        if self.pending is not None:
            down, up = self.edges
            (up if self.direction > 0 else down).update(*self.pending, self.with_backlash)
            self._decide_backlash(down, up)
            self.lag_s = (down.lag_s * down.windows + up.lag_s * up.windows) / (down.windows + up.windows)
        s = self.sums
        mean = s[1] / self.window
        phi = [s[0] * tick, -s[1] * tick, (self.start[1] - size) * mean]
        phi_backlash = [s[2] * tick, -s[1] * tick, (self.start[2] - through) * mean, s[3] * tick]
        self.pending = (phi, phi_backlash, moved) if self.moving else None
        self.moving = True

    def _decide_backlash(self, down: ValveEdge, up: ValveEdge) -> None:
        """Whether both edges are taken with backlash: where it is well beyond its standard error."""
        if down.windows >= down.windows_needed and up.windows >= up.windows_needed:
            errors = (down.backlash_errors() + up.backlash_errors()) / math.sqrt(2.0)
            found = errors > (REJECT_ERRORS if self.with_backlash else ACCEPT_ERRORS)
            if found and not self.with_backlash:
                for edge in (down, up):
                    edge.restart_backlash_fit()
            self.with_backlash = found

    def parameters(self) -> Parameters:
        """What was identified of both edges, in numbers."""
        return {
            name: {"theta": list(e.plain_fit.theta), "theta_backlash": list(e.backlash_fit.theta),
                   "windows": e.windows, "ready": e.ready, "gain_m_s_V": e.gain_m_s_V,
                   "dead_band_V": e.dead_band_V, "lag_s": e.lag_s, "backlash_V": e.backlash_V}
            for name, e in zip(("retract", "extend"), self.edges, strict=True)
        }  # fmt: skip

    def restore(self, parameters: Parameters) -> None:
        """Start with what was identified before."""
        for edge, name in zip(self.edges, ("retract", "extend"), strict=True):
            known = parameters[name]
            for fit, theta in ((edge.plain_fit, known["theta"]), (edge.backlash_fit, known["theta_backlash"])):
                fit.theta[:] = [float(x) for x in theta]
                if known["ready"]:
                    fit.covariance = [[1e-4 * x for x in row] for row in fit.covariance]
            edge.windows, edge.ready = float(known["windows"]), bool(known["ready"])
            edge.gain_m_s_V, edge.dead_band_V = float(known["gain_m_s_V"]), float(known["dead_band_V"])
            edge.lag_s, edge.backlash_V = float(known["lag_s"]), float(known["backlash_V"])
        self.lag_s = (self.edges[0].lag_s + self.edges[1].lag_s) / 2
        self.with_backlash = any(edge.backlash_V > 0.0 for edge in self.edges)
