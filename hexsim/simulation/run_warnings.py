"""Warnings of a run: where oil turned to vapour, and a constant time step that the machine is too stiff for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.hydraulics.leg import chamber_capacity
from hexsim.hydraulics.steps import STIFF
from hexsim.plant import Plant
from hexsim.plant.readout import voids

Array = NDArray[np.float64]
TENDON_ERROR = "reversal peaks within 0.2 % and waveform within 0.5 % of full legs"
STABLE_REAL, STABLE_RING = 2.78, 2.83  # h lambda and h omega up to which RK4 is stable


def start_warnings(plant: Plant, fast: bool) -> list[str]:
    """What is known before the run: the error of the tendon model where `fast` chose it, and a time step too long."""
    tendon = [f"tendon model: {TENDON_ERROR}"] if fast and plant.is_tendon else []
    return tendon + time_step_warnings(plant)


def time_step_warnings(plant: Plant) -> list[str]:
    """A sentence where a constant step is beyond RK4's bound of stability in some state: friction at standstill, or the oil's
    springs at rest. Beyond it the run may diverge, or chatter within bounds."""
    if plant.timestep is None:
        return []
    rule, y = plant.step_rule(), plant.piston_positions()
    stiffest = max(1.0 / chamber_capacity(p, y[i], plant.bottom_pressures()[i]) for i, p in enumerate(plant.rows))
    longest = {
        "friction where a leg stands still": STABLE_REAL / (STIFF * rule.standstill),
        "the oil's spring": STABLE_RING / np.sqrt(rule.springs * stiffest),
    }
    what = min(longest, key=lambda name: longest[name])
    if plant.timestep <= longest[what]:
        return []
    return [
        f"time step {1e3 * plant.timestep:g} ms: {what} is stable up to {1e3 * longest[what]:.2g} ms; figures of this run may be "
        "those of the step: make it shorter, or leave the choice to hexsim"
    ]


def cavitation_warnings(plant: Plant, tick_s: float, positions: Array, act: Array) -> list[str]:
    """One sentence a volume of oil that cavitated: when, how long, how large the void. positions (m, n_legs), act
    (m, n_states): of every tick; a void that opens and closes between two ticks is not seen."""
    time = np.arange(len(act), dtype=float) * tick_s
    return [_sentence(place, time, void, area) for place, (void, area) in voids(plant, time, positions, act).items()]


def _sentence(place: str, time: Array, void: Array, area: float) -> str:
    """void (m,) [m3], not zero throughout; area [m2] of the piston that pulls it, 0 of a volume without one."""
    there = void > 0.0
    begins = np.flatnonzero(there & ~np.concatenate([[False], there[:-1]]))
    largest, tick = int(np.argmax(void)), time[1] - time[0] if len(time) > 1 else 0.0
    often = "once" if len(begins) == 1 else f"{len(begins)} times, first"
    travel = f", {1e3 * void[largest] / area:.2g} mm of the piston" if area > 0.0 else ""
    return (
        f"{place} cavitated {often} at {time[begins[0]]:.3f} s, {1e3 * tick * there.sum():.3g} ms in all: largest void "
        f"{1e6 * void[largest]:.2g} cm3{travel} at {time[largest]:.3f} s"
    )
