"""The flow curve learned on line, per direction, scheduled on the pressure drop, from displacements instead of
velocities.

Oil volume over piston area is z = y + V P1 / (E A1), and z' is the flow through the valve, whatever the load does
(Eq. 3.7). With the spool x lagging the volts u by tau and trailing them by a play of half width h, the law of one
edge (Eq. 3.3, 3.4) integrated over a window is linear in what is not known:

    z(t2) - z(t1) = k int p R dt - k delta int R dt - k tau R^ [p]_t1^t2,     p = b + h s,     R = sqrt(dp / dp_ref)

R^ the mean of R, k velocity gain [m/s/V], delta half dead band [V], tau lag [s]; p the output of the play: b the volts
where it last moved along with them, s = -1 where they were rising then, 1 where they were falling. b is found with the h
known so far; it depends on it only where the play turns, so that little is wrong while h is wrong, and what was gathered
before h moved counts for less. Two fits run side by side, without play (p = u) and with it; the one with play is taken
where its h is well beyond its standard error.
Position noise enters only at the two ends of a window and not at all on the right, so that least squares is unbiased;
nothing is differentiated. What the fit leaves is the noise of two positions if the valve is of that kind, and much
more if it is not: then it is not believed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .base import Context, Parameters, clip
from .least_squares import RecursiveLeastSquares

GAIN_START = 0.1  # [m/s/V], a start value only
GAIN_LOW, GAIN_HIGH = 0.005, 5.0  # [m/s/V], bounds of what is believed
DEAD_BAND_HIGH_V = 1.5
LAG_HIGH_S = 0.012
PLAY_HIGH_V = 0.3
PLAY_LOW_V = 2e-3  # narrower play is not told from noise of the volts by where they turn
WINDOW_NOISE_M = 5e-6  # displacement noise of a window: two positions with 3 um noise and 3 um resolution
GAIN_NEEDED, DEAD_BAND_NEEDED_V, LAG_NEEDED_S = 0.10, 1e-3, 8e-4  # standard errors below which an edge is believed
APART_M = 20e-6  # oil at a crossing of the overlap by which both edges' lags may differ: one spool has one lag
MISFIT_HIGH, MISFIT_LOW = 3.0, 1.7  # residual over noise above which an edge is doubted, and below which it is believed
PLAY_ALLOWANCE = 4.0  # times the squared misfit that a valve with play may show: its turning points are rougher
EARLY_WINDOWS = 30.0  # least memory of the fit with play; until it is believed it remembers as many as it has seen
STRAYED = 2.0  # times the squared residual of the fit without play from which the one with play has lost its way
PLAY_MOVED_V = 1e-4  # change of the play found from which the windows before count for less
PLAY_TAKE, PLAY_LEAVE = 4.0, 2.0  # play over its standard error, both edges together, to take the valve as one with it
WINDOWS_NEEDED, PATIENCE = 15, 3.0  # windows before it is first believed; each doubt makes that so many times longer
WINDOWS_KNOWN = 8  # windows from which the gain is right within some per cent
# spreads of k, k delta, k tau, k h that are thinkable, in units of the window's noise: 0.3 m/s/V, 0.05 m/s, 2 mm/V,
# 5 mm/s
SPREAD = (0.3 / WINDOW_NOISE_M, 0.05 / WINDOW_NOISE_M, 2e-3 / WINDOW_NOISE_M, 5e-3 / WINDOW_NOISE_M)


@dataclass(slots=True)
class Edge:
    """One direction of the valve: what is known of it."""

    plain: RecursiveLeastSquares  # k, k delta, k tau
    play: RecursiveLeastSquares  # the same and k h
    windows: float = 0.0
    gain_m_s_V: float = GAIN_START
    dead_band_V: float = 0.0
    lag_s: float = 0.0
    play_V: float = 0.0
    play_found_V: float = 0.0
    play_sure: bool = False  # from then on it is found from where the volts turn
    ready: bool = False
    doubts: int = 0  # how often it was ready and then did not fit
    needed: float = float(WINDOWS_NEEDED)

    def learn(self, phi: list[float], phi_play: list[float], moved_m: float, with_play: bool) -> None:
        """One window in; reads the fit out within its bounds."""
        memory = self.play.memory
        if not self.ready:  # what was gathered while another width was looked for is biased
            memory = clip(self.windows, EARLY_WINDOWS, memory)
        self.play.keep = 1.0 - 1.0 / memory
        self.plain.update(phi, moved_m)
        self.play.update(phi_play, moved_m)
        self.windows += 1.0
        self._find_play()
        fit = self.play if with_play else self.plain
        k, k_delta, k_tau = fit.theta[:3]
        k = self.gain_m_s_V = clip(k, GAIN_LOW, GAIN_HIGH)
        self.dead_band_V = clip(k_delta / k, 0.0, DEAD_BAND_HIGH_V)
        self.lag_s = clip(k_tau / k, 0.0, LAG_HIGH_S)
        self.play_V = self.play_found_V if with_play else 0.0
        misfit = fit.residual / WINDOW_NOISE_M**2 / (PLAY_ALLOWANCE if with_play else 1.0)
        if self.ready:
            if misfit > MISFIT_HIGH**2:
                self.ready = False
                self.doubts += 1
                self.needed = self.windows + WINDOWS_NEEDED * PATIENCE**self.doubts
                self.plain.doubt()
                self.play.doubt()
            return
        c, unit = fit.covariance, (WINDOW_NOISE_M / k) ** 2
        self.ready = (
            self.windows >= self.needed
            and misfit < MISFIT_LOW**2
            and k_tau / k < LAG_HIGH_S  # at its bound it is something else
            and c[0][0] * unit < GAIN_NEEDED**2
            and c[1][1] * unit < DEAD_BAND_NEEDED_V**2
            and c[2][2] * unit < LAG_NEEDED_S**2
        )

    def _find_play(self) -> None:
        """Reads the play out. Windows before were gathered with another width: they count for less, the more it moved."""
        if self.play.count > 4 and self.play.residual > STRAYED * max(self.plain.residual, WINDOW_NOISE_M**2):
            self.play.theta[:] = [*self.plain.theta, 0.0]
            self.play.doubt()
        gain, before = max(self.play.theta[0], GAIN_LOW), self.play_found_V
        self.play_found_V = clip(self.play.theta[3] / gain, 0.0, PLAY_HIGH_V)
        moved = self.play_found_V - before
        if abs(moved) > PLAY_MOVED_V:
            self.play.loosen(3, (gain * moved / WINDOW_NOISE_M) ** 2)
        self.play_sure = self.play_found_V > PLAY_LOW_V and self.play_sureness() > PLAY_TAKE

    def apart_s(self) -> float:
        """Lag without play less lag with it."""
        plain, play = self.plain.theta, self.play.theta
        return plain[2] / max(plain[0], GAIN_LOW) - play[2] / max(play[0], GAIN_LOW) if self.play_V == 0.0 else 0.0

    def play_sureness(self) -> float:
        """The play found over its standard error."""
        return self.play.theta[3] / (WINDOW_NOISE_M * math.sqrt(self.play.covariance[3][3]))

    def seek_play(self) -> None:
        """Look for the play found anew: what was gathered while another width was looked for is biased."""
        if self.ready:
            return
        self.play.doubt()
        self.needed = max(self.needed, self.windows + 2 * WINDOWS_NEEDED)


def new_edge(memory: float) -> Edge:
    """An edge of which nothing is known."""
    start = [GAIN_START, 0.0, 0.0]
    return Edge(
        RecursiveLeastSquares(list(start), list(SPREAD[:3]), memory, directional=True),
        RecursiveLeastSquares([*start, 0.0], list(SPREAD), memory),
    )


@dataclass(slots=True)
class FlowLearner:
    """Both directions, and the window being gathered."""

    context: Context
    window: int  # ticks
    slowest_m_s: float  # a window in which the piston moved slower tells nothing
    settle: int  # ticks after the volts change sign in which the spool's path is not simple
    memory: float  # windows
    edges: list[Edge] = field(default_factory=list)  # [retracting, extending]
    direction: int = 0
    wait: int = 0
    count: int = 0
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)  # z [m], |u| and |p| [V] at the window's start
    sums: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 0.0])  # of u R, R, b R, s R
    turn_V: float = 0.0  # b
    side: float = -1.0  # s
    moving: bool = False
    with_play: bool = False
    pending: tuple[list[float], list[float], float] | None = None
    lag_s: float = 0.0

    def __post_init__(self) -> None:
        if not self.edges:
            self.edges = [new_edge(self.memory), new_edge(self.memory)]

    @property
    def ready(self) -> bool:
        """Whether both directions are known well enough to act on."""
        return self.edges[0].ready and self.edges[1].ready

    @property
    def agreed(self) -> bool:
        """Whether both directions, and the fits without and with play, tell of one spool: their lags agree, in oil at a
        crossing of the overlap."""
        down, up = self.edges
        crossing_m_s = max(down.gain_m_s_V, up.gain_m_s_V) * (down.dead_band_V + up.dead_band_V)
        apart_s = 0.5 * abs(down.apart_s() + up.apart_s())
        return crossing_m_s * max(abs(down.lag_s - up.lag_s), apart_s) < APART_M

    @property
    def known(self) -> bool:
        """Whether both directions are known well enough to tell how the piston moves."""
        return self.edges[0].windows >= WINDOWS_KNOWN and self.edges[1].windows >= WINDOWS_KNOWN

    def add(self, z_m: float, valve_V: float, root: float) -> None:
        """One tick: oil displacement now, volts of the tick past, mean sqrt(dp/dp_ref) in it of the edge they opened."""
        direction = 1 if valve_V > 0.0 else -1
        size = valve_V if direction > 0 else -valve_V
        if direction != self.direction:
            self.direction, self.wait = direction, self.settle
            self._restart()
            return
        edge = self.edges[direction > 0]
        half = edge.play_found_V if edge.play_found_V > PLAY_LOW_V else PLAY_LOW_V
        beyond = self.side * (self.turn_V - valve_V)
        if beyond >= 0.0:
            self.turn_V = valve_V
        elif beyond < -2.0 * half:
            self.turn_V, self.side = valve_V, -self.side
        if self.wait > 0:
            self.wait -= 1
            return
        if self.count:
            s = self.sums
            s[0] += size * root
            s[1] += root
            if edge.play_sure:
                s[2] += direction * self.turn_V * root
                s[3] += direction * self.side * root
            else:
                s[2] += size * root
                s[3] += direction * (self.side + (self.turn_V - valve_V) / half) * root
            if self.count == self.window:
                self._finish(z_m, size, direction * (self.turn_V + half * self.side))
                self.count = 0
        if self.count == 0:
            self.start = (z_m, size, direction * (self.turn_V + half * self.side))
            self.sums = [0.0, 0.0, 0.0, 0.0]
        self.count += 1

    def _restart(self) -> None:
        self.count, self.moving, self.pending = 0, False, None

    def _finish(self, z_m: float, size: float, through: float) -> None:
        """Use the window before this one, if the piston moved in it, before it and after it: none reaches into the
        overlap."""
        tick = self.context.tick_s
        moved = self.direction * (z_m - self.start[0])
        if moved < self.slowest_m_s * self.window * tick:
            self._restart()
            return
        if self.pending is not None:
            down, up = self.edges
            (up if self.direction > 0 else down).learn(*self.pending, self.with_play)
            self._judge(down, up)
            self.lag_s = (down.lag_s * down.windows + up.lag_s * up.windows) / (down.windows + up.windows)
        s = self.sums
        mean = s[1] / self.window
        phi = [s[0] * tick, -s[1] * tick, (self.start[1] - size) * mean]
        phi_play = [s[2] * tick, -s[1] * tick, (self.start[2] - through) * mean, s[3] * tick]
        self.pending = (phi, phi_play, moved) if self.moving else None
        self.moving = True

    def _judge(self, down: Edge, up: Edge) -> None:
        """Whether both edges are taken with play: where it is well beyond its standard error."""
        if down.windows >= down.needed and up.windows >= up.needed:
            sure = (down.play_sureness() + up.play_sureness()) / math.sqrt(2.0)
            found = sure > (PLAY_LEAVE if self.with_play else PLAY_TAKE)
            if found and not self.with_play:
                for edge in (down, up):
                    edge.seek_play()
            self.with_play = found

    def parameters(self) -> Parameters:
        """What is known of both edges, in numbers."""
        return {
            name: {"theta": list(e.plain.theta), "theta_play": list(e.play.theta), "windows": e.windows,
                   "ready": e.ready, "gain_m_s_V": e.gain_m_s_V, "dead_band_V": e.dead_band_V,
                   "lag_s": e.lag_s, "play_V": e.play_V}
            for name, e in zip(("retract", "extend"), self.edges, strict=True)
        }  # fmt: skip

    def restore(self, parameters: Parameters) -> None:
        """Start with what was known before."""
        for edge, name in zip(self.edges, ("retract", "extend"), strict=True):
            known = parameters[name]
            for fit, theta in ((edge.plain, known["theta"]), (edge.play, known["theta_play"])):
                fit.theta[:] = [float(x) for x in theta]
                if known["ready"]:
                    fit.covariance = [[1e-4 * x for x in row] for row in fit.covariance]
            edge.windows, edge.ready = float(known["windows"]), bool(known["ready"])
            edge.gain_m_s_V, edge.dead_band_V = float(known["gain_m_s_V"]), float(known["dead_band_V"])
            edge.lag_s, edge.play_V = float(known["lag_s"]), float(known["play_V"])
        self.lag_s = (self.edges[0].lag_s + self.edges[1].lag_s) / 2
        self.with_play = any(edge.play_V > 0.0 for edge in self.edges)
