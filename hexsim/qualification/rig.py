"""The device under test: plays a scenario and returns the motion of its coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from compensation import Compensator
from hexsim.declaration import Machine
from hexsim.scenarios import Scenario
from hexsim.scenarios.scenario import DOF_NAMES
from hexsim.signals.table import motion_column, pose_column, table
from hexsim.simulation import simulate

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A played scenario: time_s (m,); for each axis command and response, position and acceleration (m,);
    setpoints and positions of the legs (m, n_legs)."""

    time_s: Array
    commanded: dict[str, Array]
    response: dict[str, Array]
    commanded_acceleration: dict[str, Array]
    acceleration: dict[str, Array]
    leg_setpoints: Array
    leg_positions: Array


class Rig(Protocol):
    """axes: names of the coordinates, "x" .. "yaw" or "z" alone."""

    name: str
    axes: tuple[str, ...]

    def play(self, scenario: Scenario, seed: int = 0) -> Motion: ...


Record = Callable[[Scenario, Motion], None]


class MachineRig:
    """A machine, simulated with the tendon model (equal to full legs).

    What is measured is the true motion, without sensor noise; the position loop sees noise drawn from `seed`. record: is
    given each motion with its scenario.
    """

    def __init__(
        self,
        machine: Machine,
        compensator: str | Compensator = "none",
        record: Record = lambda scenario, motion: None,
    ) -> None:
        self.machine, self.compensator, self.record = machine, compensator, record
        self.name = machine.name
        self.mechanics = machine.mechanics
        self.model = "tendon" if self.mechanics.has_platform else "full"
        self.axes: tuple[str, ...] = self.mechanics.dofs

    def play(self, scenario: Scenario, seed: int = 0) -> Motion:
        machine = self.machine
        run = simulate(machine, scenario, compensator=self.compensator, seed=seed, fast=True)
        log, n = run.whole(f"the machine does not complete the motion test {scenario.name}").log, machine.n_legs
        time = log["time_s"].to_numpy()
        setpoints, positions = (
            log.select(table()[stem].columns(n)).to_numpy(order="c") for stem in ("setpoint", "true_position")
        )
        commanded, _, accelerations = scenario.evaluate(time)
        command = {axis: commanded[:, DOF_NAMES.index(axis)] for axis in self.axes}
        references = {axis: accelerations[:, DOF_NAMES.index(axis)] for axis in self.axes}
        named = zip(self.axes, self.mechanics.axes, strict=True)
        acceleration = {dof: log[motion_column("true_acceleration", axis)].to_numpy() for dof, axis in named}
        if self.mechanics.has_platform:
            response = {axis: log[pose_column("platform", axis)].to_numpy() for axis in self.axes}
        else:
            response = {"z": self.mechanics.forward(positions)[:, 2]}
        motion = Motion(
            time_s=time,
            commanded=command,
            response=response,
            commanded_acceleration=references,
            acceleration=acceleration,
            leg_setpoints=setpoints,
            leg_positions=positions,
        )
        self.record(scenario, motion)
        return motion
