"""Where oil turned to vapour in a run, as warnings of the run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.plant import Plant
from hexsim.plant.readout import voids

Array = NDArray[np.float64]


def cavitation_warnings(plant: Plant, time: Array, positions: Array, act: Array) -> list[str]:
    """One sentence a volume of oil that cavitated: when, how long, how large the void. time (m,), positions (m, n_legs), act
    (m, n_states): of the ticks; a void that opens and closes between two ticks is not seen."""
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
