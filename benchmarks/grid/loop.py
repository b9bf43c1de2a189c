"""The 500 Hz position loop on a drawn leg, its samples as the motion computer makes them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from benchmarks.grid import plant
from benchmarks.grid.host import played_setpoints
from benchmarks.grid.legs import Leg
from benchmarks.grid.motions import Motion
from compensation import Compensator, Sample, preview_count

RATE_HZ = 500.0
COLUMNS = (
    "position_m",
    "pressure_bottom_Pa",
    "pressure_top_Pa",
    "pressure_supply_Pa",
    "valve_V",
    "added_V",
    "true_position_m",
    "true_velocity_m_s",
    "true_pressure_bottom_Pa",
    "true_pressure_top_Pa",
    "true_pressure_supply_Pa",
    "true_spool_V",
)


@dataclass
class Run:
    """log: (ticks,) arrays of COLUMNS, time_s, setpoint_m and control_V: as read and as sent at the tick; the true ones at the grid
    point at or just before it. acceleration_m_s2: true, every 1e-4 s; statuses: (time [s], text) at each change."""

    leg: Leg
    motion: Motion
    log: dict[str, np.ndarray]
    acceleration_m_s2: np.ndarray
    state: Any
    statuses: list[tuple[float, str]] = field(default_factory=list)
    reason: str = ""  # what keeps it out at the end

    @property
    def acts_s(self) -> float:
        """First tick with volts added, those of a probe and those that leave again too."""
        there = np.flatnonzero(self.log["added_V"])
        return float(self.log["time_s"][there[0]]) if len(there) else math.inf

    @property
    def engaged_s(self) -> float | None:
        """First tick with volts added that stay until the end: no half second without them after it."""
        there = np.flatnonzero(self.log["added_V"])
        if not len(there) or len(self.log["added_V"]) - there[-1] > RATE_HZ / 2:
            return None
        gaps = np.flatnonzero(np.diff(there) > RATE_HZ / 2)
        return float(self.log["time_s"][there[gaps[-1] + 1 if len(gaps) else 0]])


class Bench:
    """The plant with its transducers and converters. noise: the seed of both."""

    def __init__(self, leg: Leg, motion: Motion, ticks: int, noise: int) -> None:
        c, random = leg.c, np.random.default_rng([leg.seed, noise, 17])
        white = random.normal(0.0, 1.0, (ticks, 4))
        instants = np.arange(ticks) / RATE_HZ + random.uniform(-1.0, 1.0, ticks) * c.jitter_s
        instants[0] = 0.0
        if c.position_colour > 0.0:
            white[:, 0] = lfilter([math.sqrt(1.0 - c.position_colour**2)], [1.0, -c.position_colour], white[:, 0])
        noises = white * [c.position_noise_m, *(3 * [c.pressure_noise_Pa])]
        self.leg, self.state = leg, plant.balanced(c, float(motion.path(np.zeros(1))[0]))
        self.acceleration, steps = np.zeros(ticks * 20), ticks * leg.pieces
        reads = np.empty((4, steps + 1))
        reads[:, 0] = self.state[[plant.Y, plant.P1, plant.P2, plant.PS]]
        self.parts = (
            leg.numbers,
            self.state,
            np.zeros(2),
            np.zeros(steps),
            reads,
            self.acceleration,
            instants,
            noises,
            leg.pieces,
        )
        self.out = np.empty(4)
        plant.read(leg.numbers, reads, noises[0], 0.0, leg.pieces, self.out)

    def exchange(self, k: int, volts: float) -> float:
        """Send volts at tick k and read, into `out`, at the next."""
        return plant.exchange(*self.parts, k, volts, self.out)


def run_leg(
    compensator: Compensator, leg: Leg, motion: Motion, *, noise: int = 0, state: Any = None, host: str = ""
) -> Run:
    """One run from nothing learned. noise: seed of the transducers' noise and of the tick's jitter; state: in place of a fresh one;
    host: of what packets the setpoints come (`host.played_setpoints`), "": their future is known."""
    context = replace(leg.context, period_s=motion.period_s)
    state = compensator.start(context) if state is None else state
    ticks, look = round(motion.duration_s * RATE_HZ), preview_count(compensator, context, state)
    wanted = setpoints(leg, motion, host, ticks, look)
    bench, gain, four_way = Bench(leg, motion, ticks, noise), float(leg.c.gain_V_m), bool(leg.c.four_way > 0.5)
    log = np.zeros((len(COLUMNS), ticks))
    statuses, sent, text, s = [], 0.0, "", bench.state
    for k in range(ticks):
        y, p1, p2, supply = bench.out.tolist()
        log[6:12, k] = s[:6]
        here = float(wanted[k])
        control = gain * (here - y)
        sample = Sample(
            k / RATE_HZ,
            here,
            wanted[k : k + look],
            y,
            control,
            sent,
            p1,
            supply,
            pressure_top_Pa=p2 if four_way else 0.0,
        )
        added, state = compensator.step(state, sample)
        if (now := compensator.status(state)) != text:
            statuses.append((k / RATE_HZ, now))
            text = now
        sent = bench.exchange(k, control + added)
        log[:6, k] = y, p1, p2, supply, sent, added
    return run_of(bench, motion, log, wanted[:ticks], state, statuses, compensator.not_engaged(state))


def run_plain(leg: Leg, motion: Motion, *, noise: int = 0, host: str = "", look: int = 1) -> Run:
    """`run_leg` with proportional control alone, compiled as a whole. look: how far ahead a host's packets are predicted [ticks]."""
    ticks = round(motion.duration_s * RATE_HZ)
    wanted = setpoints(leg, motion, host, ticks, look)[:ticks]
    bench, log = Bench(leg, motion, ticks, noise), np.zeros((len(COLUMNS), ticks))
    plant.driven(*bench.parts, wanted, np.zeros(ticks), log)
    return run_of(bench, motion, log, wanted, None, [], "plain control")


def setpoints(leg: Leg, motion: Motion, host: str, ticks: int, look: int) -> np.ndarray:
    """(ticks + look,) setpoints [m] of a motion, as a host's packets give them where there is one."""
    return played_setpoints(host, motion, leg.seed, ticks, look) if host else motion.sampled(ticks + look)


def run_of(
    made: Bench, motion: Motion, log: np.ndarray, wanted: np.ndarray, state: Any, told: list, reason: str
) -> Run:
    columns: dict[str, np.ndarray] = {name: log[i] for i, name in enumerate(COLUMNS)}
    columns["time_s"], columns["setpoint_m"] = np.arange(len(wanted)) / RATE_HZ, wanted
    columns["control_V"] = made.leg.c.gain_V_m * (wanted - columns["position_m"])
    return Run(made.leg, motion, columns, made.acceleration, state, told, reason)
