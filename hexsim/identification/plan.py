"""The motions of an identification that are known before anything is driven, as the packets that will leave the host."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.files.atomic import written_whole
from hexsim.identification import bump
from hexsim.identification.picture import motion_figure
from hexsim.motion_computer.host_limiter import HostLimiter, setpoints_of
from hexsim.recording.figure_style import png
from hexsim.tracing import rules
from hexsim.tracing.design.motions import MotionFamily

Array = NDArray[np.float64]
SMALL_s = 5.0  # of the first, careful motion
# kind, axis, size, two frequencies, slope, seed: see `MotionFamily.bounds`
FIRST = np.array([0, 0, 0.9, 0.2, 0.75, 0.5, 1])
HELD_OUT = {  # by the name of the log
    "held_out": np.array([2, 2, 0.8, 0.35, 0.6, 0.3, 2]),
    "held_out_2": np.array([0, 0, 0.7, 0.3, 0.7, 0.6, 11]),
}


def planned(
    machine: Machine,
    largest: float = 1.0,
    compensate: bool = False,
    *,
    small_share: float = 0.2,  # of the first motion
) -> dict[str, Array]:
    """Name of the log -> setpoints (m, 6), in the order in which they are driven.

    Raises HexsimError where no motion fits inside the limits.
    """
    family, careful = (
        MotionFamily(machine, rules.MOTION_S, largest=largest),
        MotionFamily(machine, SMALL_s, largest=largest),
    )
    scenarios = {"small": careful.scenario(FIRST)}
    scenarios |= {name: family.scenario(point) for name, point in HELD_OUT.items()} | {
        "round_1": family.scenario(FIRST)
    }
    if compensate:
        scenarios["heave_plain"] = scenarios["heave_compensated"] = bump.measured_heave(machine)
    found, limiter = {}, HostLimiter(machine, largest)
    for name, tables in scenarios.items():
        if tables is None:
            raise HexsimError(f"machine {machine.name}: no motion fits inside its limits; check stroke and cushions")
        rows = setpoints_of(machine, tables)
        found[name] = limiter.limit(small_share * rows if name == "small" else rows)
    return found


def draw(machine: Machine, rows: Array, name: str, folder: Path, largest: float = 1.0) -> Path:
    """The picture of a motion in the folder's `motions`: what would be driven, beside its limits."""
    limiter, place = HostLimiter(machine, largest), folder / "motions" / f"{name}.png"
    place.parent.mkdir(parents=True, exist_ok=True)
    picture = png(motion_figure(limiter, limiter.limit(rows), name.replace("_", " ")))
    with written_whole(place) as file:
        file.write_bytes(picture)
    return place
