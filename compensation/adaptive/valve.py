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
from .valve_edge import ACCEPT_ERRORS, MIN_BACKLASH_V, REJECT_ERRORS, ValveEdge, new_edge

MAX_LAG_OIL_M = 20e-6  # oil at a crossing of the overlap by which the lags of both edges may differ: one spool, one lag
NULL_TOLERANCE_V = 5e-3  # by which the null may be off the middle of the edges
NULL_ALPHA, NULL_BETA = 0.08, 0.003  # with which the null and its rate follow, a window
NULL_ERROR_V, NULL_RATE_V_S, NULL_TICKS = (
    5e-3,
    0.03,
    100,
)  # bounds of an error, of the rate, of the time between windows
UNKNOWN_LEAK = 3.0  # times the slowest speed of a window, while a leak may move the piston by itself
USABLE_WINDOWS = 8  # from which the gain is right within some per cent


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
    null_V: float = 0.0  # volts that lie in the middle between both edges
    leak_m_s: float = 0.0  # oil that flows into the chamber while the valve is closed
    leak_known: bool = False
    null_rate_V_s: float = 0.0
    ticks: int = 1  # since the last window that was used

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
        return self.ready or min(edge.windows for edge in self.edges) >= USABLE_WINDOWS

    @property
    def lags_agree(self) -> bool:
        """Whether both directions, and the fits without and with backlash, find the lag of one spool.

        Measured as oil at a crossing of the overlap.
        """
        down, up = self.edges
        crossing_m_s = max(down.gain_m_s_V, up.gain_m_s_V) * (down.dead_band_V + up.dead_band_V)
        difference_s = 0.5 * abs(down.lag_difference_s() + up.lag_difference_s())
        return crossing_m_s * max(abs(down.lag_s - up.lag_s), difference_s) < MAX_LAG_OIL_M

    def recentre(self) -> bool:
        """Moves the null into the middle of the edges, where it is well off it; whether it was."""
        down, up = self.edges
        off = 0.5 * (up.edge_V - down.edge_V)
        if not self.usable or abs(off) < NULL_TOLERANCE_V:
            return False
        self.null_V += off
        up.shift(off, 0.0)
        down.shift(-off, 0.0)
        self._restart()
        return True

    def _follow_null(self, error_m: float, edge: ValveEdge) -> None:
        """What a window left over moves the null, and its rate (alpha-beta filter)."""
        limit = NULL_ERROR_V
        off = -self.direction * clip(
            error_m / (edge.gain_m_s_V * edge.root * self.window * self.context.tick_s), -limit, limit
        )
        since, self.ticks = min(self.ticks, NULL_TICKS) * self.context.tick_s, 0
        self.null_rate_V_s = clip(self.null_rate_V_s + NULL_BETA * off / since, -NULL_RATE_V_S, NULL_RATE_V_S)
        self.null_V += NULL_ALPHA * off + self.null_rate_V_s * since

    def set_leak(self, leak_m_s: float) -> None:
        """Takes a leak off the oil displacement, from now on and from what was gathered."""
        change, self.leak_m_s = leak_m_s - self.leak_m_s, leak_m_s
        down, up = self.edges
        up.shift(0.0, change)
        down.shift(0.0, -change)
        self._restart()
        if abs(change) > 0.25 * self.min_speed_m_s:
            up.restart()
            down.restart()

    def add(self, z_m: float, valve_V: float, root: float) -> None:
        """One tick: oil displacement now less what leaked, volts of the tick past less the null, mean sqrt(dp/dp_ref)
        in it of their edge."""
        self.ticks += 1
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
        slowest = self.min_speed_m_s if self.leak_known else UNKNOWN_LEAK * self.min_speed_m_s
        if moved < slowest * self.window * tick:
            self._restart()
            return
        if self.pending is not None:
            down, up = self.edges
            edge = up if self.direction > 0 else down
            error = edge.update(*self.pending, self.with_backlash)
            if self.usable:
                self._follow_null(error, edge)
            self._decide_backlash(down, up)
            self.lag_s = (down.lag_s * down.windows + up.lag_s * up.windows) / (down.windows + up.windows)
        s = self.sums
        mean = s[1] / self.window
        self.edges[self.direction > 0].root = mean
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
            "null_V": self.null_V, "leak_m_s": self.leak_m_s,
            **{name: {"theta": list(e.plain_fit.theta), "theta_backlash": list(e.backlash_fit.theta),
                   "windows": e.windows, "ready": e.ready, "gain_m_s_V": e.gain_m_s_V,
                   "dead_band_V": e.dead_band_V, "lag_s": e.lag_s, "backlash_V": e.backlash_V}
            for name, e in zip(("retract", "extend"), self.edges, strict=True)}
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
        self.null_V, self.leak_m_s = float(parameters["null_V"]), float(parameters["leak_m_s"])
        self.leak_known = self.ready
        self.lag_s = (self.edges[0].lag_s + self.edges[1].lag_s) / 2
        self.with_backlash = any(edge.backlash_V > 0.0 for edge in self.edges)
