# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""A foreign FMU as the payload of a run: it takes the machine's motion and gives back force and moment.

Explicit co-simulation: at each tick of a run it is given the motion, steps to the next tick, and its force acts there
until then. So it is late by one tick, and a payload whose own mass or stiffness rivals the machine's makes the pair ring.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hexsim.errors import HexsimError, shortened
from hexsim.foreign_fmu import ForeignFmu
from hexsim.plant import Plant
from hexsim.plant.plant import InterventionError
from hexsim.plant.readout import platform_signals

Array = NDArray[np.float64]
AXES = "xyz"
# Names of motion (what a payload may take) and of load (what it may give), with or without a platform.
PLATFORM_MOTION = (
    *(f"platform_{axis}_m" for axis in AXES),
    *(f"platform_{axis}_rad" for axis in ("roll", "pitch", "yaw")),
    *(f"platform_velocity_{axis}_m_s" for axis in AXES),
    *(f"platform_angular_velocity_{axis}_rad_s" for axis in AXES),
    *(f"acceleration_{axis}_m_s2" for axis in AXES),
    *(f"angular_acceleration_{axis}_rad_s2" for axis in AXES),
)
PLATFORM_LOAD = (*(f"force_{axis}_N" for axis in AXES), *(f"moment_{axis}_N_m" for axis in AXES))
BENCH_MOTION, BENCH_LOAD = ("position_m", "velocity_m_s", "acceleration_m_s2"), ("force_N",)


class PayloadFmu:
    """An intervention of `simulate`: an FMU of version 2.0 or 3.0 for co-simulation on the platform or a bench's load.

    connections: our name -> (name in the FMU, factor), for variables that are not called as ours. Force and moment are in
    the world frame, the moment about the platform's origin; on a bench the force is along the leg, extension positive.
    It runs in a process of its own, and only with allow_native: its code may do whatever the user may.
    Raises HexsimError where FMPy is missing, the file is no such FMU, or nothing of it is connected.
    """

    def __init__(
        self,
        path: Path,
        connections: Mapping[str, tuple[str, float]],
        *,
        has_platform: bool,
        allow_native: bool = False,
    ) -> None:
        motion, load = (PLATFORM_MOTION, PLATFORM_LOAD) if has_platform else (BENCH_MOTION, BENCH_LOAD)
        self.path = path
        self._fmu = ForeignFmu(path, allow_native=allow_native, what="payload")
        variables = self._fmu.variables
        unknown = [name for name in connections if name not in (*motion, *load)]
        missing = [theirs for theirs, _ in connections.values() if theirs not in variables]
        if unknown or missing:
            known = (*motion, *load) if unknown else variables
            raise HexsimError(f"{path.name}: there is no {(unknown or missing)[0]}; there are {', '.join(known)}")
        connected = {name: connections.get(name, (name, 1.0)) for name in (*motion, *load)}
        self._inputs = self._of(connected, motion, "input")
        self._outputs = self._of(connected, load, "output")
        self._load = load
        if not self._outputs[0]:
            outputs = [name for name, (_, causality) in variables.items() if causality == "output"]
            raise HexsimError(
                f"{path.name} gives none of {', '.join(load)}: name an output for it with --connect, as {load[-1]}=theirs; "
                f"it has {', '.join(outputs) or 'no outputs'}"
            )
        self._fmu.start(self._inputs[1], self._outputs[1])

    def _of(
        self, connected: Mapping[str, tuple[str, float]], ours: tuple[str, ...], kind: str
    ) -> tuple[list[int], list[int], Array]:
        """Places among `ours`, references in the FMU and factors of what is connected."""
        places, references, factors = [], [], []
        for place, name in enumerate(ours):
            theirs, factor = connected[name]
            variable = self._fmu.variables.get(theirs)
            if variable is not None and (variable[1] == kind or theirs != name):
                places.append(place)
                references.append(variable[0])
                factors.append(factor)
        return places, references, np.array(factors)

    def before_step(
        self,
        time_s: float,
        plant: Plant,
        volts: Array,
        *,
        largest_load_N: float = 1e8,  # N and N m: ten thousand tons hang on no motion system
    ) -> Array:
        """Give the FMU the motion, step it over the tick and put its load on the plant; volts stay.

        Raises HexsimError where it fails in the first tick, InterventionError later: the run so far is kept.
        """
        places, _, factors = self._inputs
        load = np.zeros(6)
        try:
            values = (motion_of(plant)[places] * factors).tolist()
            given = np.array(self._fmu.step(time_s, plant.context.tick_s, values)) * self._outputs[2]
            load[self._outputs[0]] = given
            if not (np.abs(load) <= largest_load_N).all():
                worst = int(np.argmin(np.abs(load) <= largest_load_N))
                raise HexsimError(
                    f"payload {self.path.name} gives {self._load[worst]} = {load[worst]:g}: "
                    f"{-largest_load_N:g} to {largest_load_N:g} is possible"
                )
        except HexsimError as error:
            if time_s > 0.0:
                raise InterventionError(str(error)) from None
            raise
        put_load(plant, load)
        return volts


def motion_of(plant: Plant) -> Array:
    """PLATFORM_MOTION (18,) or BENCH_MOTION (3,) of the present state; accelerations of the last evaluation."""
    data = plant.data
    if not plant.kinematics.has_platform:
        return np.array([plant.piston_positions()[0], data.qvel[0], data.qacc[0]])
    signals = platform_signals(plant, data.qpos[None], data.qvel[None], data.qacc[None])
    return np.concatenate([signals.pose[0], signals.twist[0], signals.acceleration[0], signals.angular_acceleration[0]])


def put_load(plant: Plant, load: Array) -> None:
    """Force and moment (6,) on the platform, about its origin, or a force along a bench's leg (first of them)."""
    data = plant.data
    if not plant.kinematics.has_platform:
        data.qfrc_applied[0] = load[0]
        return
    body = plant.model.body(plant.kinematics.moving_body).id
    data.xfrc_applied[body, :3] = load[:3]
    data.xfrc_applied[body, 3:] = load[3:] + np.cross(data.xpos[body] - data.xipos[body], load[:3])


def parse_connections(texts: list[str]) -> dict[str, tuple[str, float]]:
    """`force_z_N=theirs` or `force_z_N=theirs*-9.81` as name -> (theirs, factor)."""
    found = {}
    for text in texts:
        name, equals, rest = text.partition("=")
        theirs, star, factor = rest.rpartition("*")
        try:
            found[name.strip()] = (theirs if star else rest).strip(), float(factor) if star else 1.0
        except ValueError:
            equals = ""
        if not equals or not name.strip() or not rest.strip():
            raise HexsimError(f"--connect {shortened(repr(text))} is not OURS=THEIRS or OURS=THEIRS*FACTOR")
    return found
