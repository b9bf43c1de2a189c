"""What samples miss of an acceleration that bends where the volts jump."""

from __future__ import annotations

import numpy as np

from hexsim.signals.log import Log
from hexsim.tracing import rules

Array = np.ndarray


def kinks(acceleration: Array, ticks: slice | None) -> Array:
    """What the samples miss of an acceleration whose slope jumps when the volts do, (n,) [m/s2].

    Between ticks it bends back: the samples' mean is (omega h)^2/12 too small, 4 % at the oil's 110 Hz and 1 kHz
    (Euler-Maclaurin: the sum lacks h/12 of each jump of the slope). The jump is the second difference at a tick
    less that of its neighbours, so that a spool which smooths it brings nothing.
    """
    missing = np.zeros_like(acceleration)
    if ticks is not None:
        missing[ticks] = slope_jumps(acceleration)[ticks] / 12.0
    return missing


def slope_jumps(acceleration: Array) -> Array:
    """Second difference at every sample less that of its neighbours, (n,)."""
    bend = np.zeros_like(acceleration)
    bend[1:-1] = np.diff(acceleration, 2)
    jump = bend.copy()
    jump[1:-1] -= 0.5 * (bend[:-2] + bend[2:])
    return jump


def bends_at(acceleration: Array, volts: Array, ticks: slice) -> slice:
    """Samples at which the slope jumps as the volts do: the ticks, or as far apart and later by what the valve is late.

    Where it follows the volts at none of them, the ticks.
    """
    steps, jumps = np.zeros_like(volts), slope_jumps(acceleration)
    steps[1:] = np.diff(volts)
    follows = [float(jumps[late:] @ steps[: len(steps) - late]) for late in range(ticks.step)]
    late = int(np.argmax(follows))
    by_chance = float(np.linalg.norm(jumps) * np.linalg.norm(steps)) / np.sqrt(len(jumps))
    clear = follows[late] > rules.CERTAIN * by_chance
    return slice((ticks.start + late) % ticks.step, None, ticks.step) if clear else ticks


def tick_samples(log: Log, leg: int, controller_Hz: float) -> slice | None:
    """Samples at which the volts of a leg change, None where they may at every sample of an acceleration or are not logged."""
    every = round(min(map(log.rate_of, log.names("acceleration")), default=log.rate) / controller_Hz)
    if every < 2 or log.volts is None:
        return None
    steps = np.abs(np.diff(log.volts[leg], prepend=log.volts[leg, :1]))
    return slice(max(range(every), key=lambda first: float(np.sum(steps[first::every]))), None, every)
