"""Signals of a run as plots and recordings need them: by leg and by axis, missing ones as None.

Works on a simulated log and on a measured one: what only a simulation knows is then missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hexsim.errors import HexsimError
from hexsim.machine import Machine
from hexsim.mechanics.mechanics import Mechanics
from hexsim.recording.deviation import Deviation, axis_deviation, given_deviation
from hexsim.signals.log import Log
from hexsim.signals.signal import HEXAPOD_AXES, ROTATIONS
from hexsim.signals.table import SETPOINT, motion_column, pose_column, table
from hexsim.smoothness import band_limit

if TYPE_CHECKING:
    from hexsim.simulation import Run

Array = NDArray[np.float64]
AXIS_NAMES = {"x": "surge", "y": "sway", "z": "heave", "roll": "roll", "pitch": "pitch", "yaw": "yaw", "leg": "leg"}


def axis_unit(axis: str) -> str:
    """Unit suffix of an axis' acceleration."""
    return "rad_s2" if axis in ROTATIONS else "m_s2"


def axis_unit_text(axis: str) -> str:
    """The same as people write it."""
    return axis_unit(axis).replace("_s2", "/s²")


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """A log with the machine it belongs to, and its command.

    label: what tables and plots call it. driven: axes with a command. frequency_Hz: of the fundamental,
    None where the motion is not one sine. fade_s: the motion is whole from here. figures_from_s: the figures count from
    here. measured: read the measured acceleration although the log holds the true one.
    reference: axis -> (n,), what `deviation` is from, in place of the fundamental or the command.
    """

    log: Log
    machine: Machine
    label: str = "run"
    driven: tuple[str, ...] = ()
    frequency_Hz: float | None = None
    fade_s: float = 0.0
    figures_from_s: float = 0.0
    measured: bool = False
    reference: Mapping[str, Array] | None = None

    @classmethod
    def of_run(cls, run: Run, label: str | None = None) -> Signals:
        """The signals of a run, with the command of its scenario."""
        scenario = run.scenario
        return cls(
            log=Log.of_table(label or scenario.name, run.log, run.machine.machine.kind),
            machine=run.machine,
            label=label or scenario.name,
            driven=tuple(scenario.signals) if scenario.mode == "dof" else (),
            frequency_Hz=scenario.frequency_Hz,
            fade_s=min(scenario.fade_s, 0.5 * float(run.log["time_s"][-1])),  # a run may end while fading in
            figures_from_s=scenario.figures_start_s,
        )

    def column(self, *names: str) -> Array | None:
        """The first of these columns that the log has."""
        return next((self.log.columns[name] for name in names if name in self.log.columns), None)

    def leg(self, leg: int, *stems: str) -> Array | None:
        """The first of these signals that the log has of a leg, 1..n."""
        return self.column(*(table()[stem].columns(self.machine.n_legs)[leg - 1] for stem in stems))

    @property
    def time_s(self) -> Array:
        return self.log.time

    @property
    def supply(self) -> Array | None:
        """Supply pressure [Pa], the true one where the log holds it."""
        return self.log.signal("true_pressure_supply", "pressure_supply")

    @property
    def legs(self) -> range:
        return range(1, self.machine.n_legs + 1)

    @property
    def axes(self) -> tuple[str, ...]:
        """x y z roll pitch yaw; on the bench `leg`."""
        return self.kinematics.axes

    @property
    def driven_axes(self) -> tuple[str, ...]:
        """Axes with a command; as the log shows where none was declared."""
        if self.driven:
            return tuple(axis for axis in self.axes if axis in self.driven) or self.axes[:1]
        if len(self.axes) == 1:
            return self.axes
        travel = {axis: np.ptp(values) for axis in self.axes if (values := self.commanded(axis)) is not None}
        most = max(travel.values(), default=0.0)
        moving = tuple(axis for axis, size in travel.items() if size > 0.01 * most)
        return moving or ("z",)

    def acceleration(self, axis: str) -> Array | None:
        """[m/s2] or [rad/s2]; the true one where the log holds it, unless `measured`."""
        own = motion_column("acceleration", axis)
        return self.column(own) if self.measured else self.column(motion_column("true_acceleration", axis), own)

    def acceleration_in_band(self, axis: str) -> Array | None:
        """The same in the default band of 50 Hz."""
        acceleration = self.acceleration(axis)
        return None if acceleration is None else band_limit(self.time_s, acceleration)

    def commanded_acceleration(self, axis: str) -> Array | None:
        return self.column(motion_column("commanded_acceleration", axis))

    def position(self, axis: str) -> Array | None:
        """Platform pose relative to neutral [m, rad]; on the bench the piston's position [m]."""
        return self.leg(1, "true_position", "position") if axis == "leg" else self._coordinate("platform", axis)

    def commanded(self, axis: str) -> Array | None:
        """The command, in the terms of `position`."""
        return self.column(SETPOINT.column()) if axis == "leg" else self._coordinate("commanded", axis)

    def _coordinate(self, stem: str, axis: str) -> Array | None:
        """From the log, or by forward kinematics of the legs' positions or setpoints."""
        found = self.column(pose_column(stem, axis))
        pose = self._measured_pose if stem == "platform" and found is None else None
        pose = self._setpoint_pose if stem == "commanded" and found is None else pose
        return found if pose is None else pose[:, HEXAPOD_AXES.index(axis)]

    def pose(self) -> Array | None:
        """(n, 6) pose, from the log or by forward kinematics of the piston positions."""
        if not self.kinematics.has_platform:
            return self._measured_pose if self.leg(1, "true_position") is None else self._pose_of("true_position")
        columns = [column for axis in HEXAPOD_AXES if (column := self.position(axis)) is not None]
        return np.column_stack(columns) if len(columns) == len(HEXAPOD_AXES) else None

    @cached_property
    def kinematics(self) -> Mechanics:
        """Legs and poses."""
        return self.machine.mechanics

    @cached_property
    def _measured_pose(self) -> Array | None:
        return self._pose_of("position")

    @cached_property
    def _setpoint_pose(self) -> Array | None:
        return self._pose_of("setpoint")

    def _pose_of(self, stem: str) -> Array | None:
        """Forward kinematics of a leg quantity; None where a leg is missing or no pose fits."""
        rows = self.log.signal(stem)
        if rows is None or not np.isfinite(rows).all():
            return None
        try:
            return self.kinematics.forward(np.ascontiguousarray(rows.T))
        except HexsimError:
            return None

    def deviation(self, axis: str) -> Deviation | None:
        """Deviation of an axis from its reference acceleration; None where the log has no acceleration."""
        acceleration = self.acceleration(axis)
        if acceleration is None:
            return None
        if self.reference is not None and axis in self.reference:
            return given_deviation(self.time_s, acceleration, self.reference[axis])
        return axis_deviation(
            self.time_s,
            acceleration,
            self.commanded_acceleration(axis) if axis in self.driven_axes else None,
            self.commanded(self.driven_axes[0]),
            self.frequency_Hz,
            self.figures_from_s,
            self.fade_s,
        )
