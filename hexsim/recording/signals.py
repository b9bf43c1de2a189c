"""The signals of a log by what they are: one reader for logs of a simulation and logs of a machine.

A simulation's log holds the measured columns and, beside them, the truth (`true_...`); a machine's log holds the
measured ones only, and may lack some. Every method returns an array (n,) or None where the log has no such column.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hexsim.errors import HexsimError
from hexsim.machine import Machine
from hexsim.machine.geometry import machine_kinematics
from hexsim.mechanics.kinematics import HexapodKinematics
from hexsim.recording.deviation import Deviation, axis_deviation, given_deviation
from hexsim.simulation import Run
from hexsim.smoothness import band_limit

Array = NDArray[np.float64]

TRANSLATIONS = ("x", "y", "z")
ROTATIONS = ("roll", "pitch", "yaw")
HEXAPOD_AXES = TRANSLATIONS + ROTATIONS
AXIS_NAMES = {
    "x": "surge",
    "y": "sway",
    "z": "heave",
    "roll": "roll",
    "pitch": "pitch",
    "yaw": "yaw",
    "leg": "leg",
}


def axis_unit(axis: str) -> str:
    """Unit suffix of an axis' acceleration."""
    return "rad_s2" if axis in ROTATIONS else "m_s2"


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """A log with the machine it belongs to, and what was asked of it.

    label: what tables and plots call it. driven: axes that were asked to move. frequency_Hz: of the basic harmonic,
    None where the motion is not one sine. fade_s: the motion is whole from here. figures_from_s: the figures count from
    here. measured: read the measured acceleration although the log holds the true one.
    wanted: axis -> (n,), what `deviation` is from, in place of the basic harmonic or the command.
    """

    log: pl.DataFrame
    machine: Machine
    label: str = "run"
    driven: tuple[str, ...] = ()
    frequency_Hz: float | None = None
    fade_s: float = 0.0
    figures_from_s: float = 0.0
    measured: bool = False
    wanted: Mapping[str, Array] | None = None

    def __post_init__(self) -> None:
        if "time_s" not in self.log.columns:
            raise HexsimError(
                f"the log of {self.label!r} has no column time_s; columns are {', '.join(self.log.columns)}"
            )
        if self.log.height < 2:
            raise HexsimError(f"the log of {self.label!r} has {self.log.height} rows; two at least are needed")

    @classmethod
    def of_run(cls, run: Run, label: str | None = None) -> Signals:
        """The signals of a run, with what its scenario asked."""
        scenario = run.scenario
        return cls(
            log=run.log,
            machine=run.machine,
            label=label or scenario.name,
            driven=tuple(scenario.signals) if scenario.mode == "dof" else (),
            frequency_Hz=scenario.frequency_Hz,
            fade_s=min(scenario.fade_s, 0.5 * float(run.log["time_s"][-1])),  # a run may end while fading in
            figures_from_s=scenario.figures_start_s,
        )

    # ---- columns -------------------------------------------------------------------------------------------------

    def column(self, *names: str) -> Array | None:
        """The first of these columns that the log has."""
        for name in names:
            if name in self.log.columns:
                return self.log[name].to_numpy().astype(np.float64)
        return None

    def leg(self, quantity: str, unit: str, leg: int, *others: str) -> Array | None:
        """A column of one leg, 1..n: `setpoint`, `m`, 2 -> setpoint_2_m (bench: setpoint_m); else of `others`."""
        middle = f"_{leg}_" if self.machine.is_hexapod else "_"
        return self.column(*(f"{name}{middle}{unit}" for name in (quantity, *others)))

    @cached_property
    def time_s(self) -> Array:
        return self.log["time_s"].to_numpy().astype(np.float64)

    @property
    def legs(self) -> range:
        return range(1, self.machine.n_legs + 1)

    # ---- axes ----------------------------------------------------------------------------------------------------

    @property
    def axes(self) -> tuple[str, ...]:
        """x y z roll pitch yaw; on the bench `leg`."""
        return HEXAPOD_AXES if self.machine.is_hexapod else ("leg",)

    @property
    def driven_axes(self) -> tuple[str, ...]:
        """Axes that were asked to move; what the log itself says where nobody said it."""
        if self.driven:
            return tuple(axis for axis in self.axes if axis in self.driven) or self.axes[:1]
        if not self.machine.is_hexapod:
            return ("leg",)
        travel = {axis: np.ptp(values) for axis in self.axes if (values := self.commanded(axis)) is not None}
        most = max(travel.values(), default=0.0)
        moving = tuple(axis for axis, size in travel.items() if size > 0.01 * most)
        return moving or ("z",)

    def acceleration(self, axis: str) -> Array | None:
        """[m/s2] or [rad/s2]; the true one where the log holds it, unless `measured`."""
        name = _acceleration_column(axis)
        return self.column(name) if self.measured else self.column(f"true_{name}", name)

    def acceleration_in_band(self, axis: str) -> Array | None:
        """The same in the default band of 50 Hz."""
        acceleration = self.acceleration(axis)
        return None if acceleration is None else band_limit(self.time_s, acceleration)

    def commanded_acceleration(self, axis: str) -> Array | None:
        return self.column(f"commanded_{_acceleration_column(axis)}")

    def position(self, axis: str) -> Array | None:
        """Platform pose relative to neutral [m, rad]; on the bench the piston's position [m]."""
        if axis == "leg":
            return self.column("true_position_m", "position_m")
        unit = "rad" if axis in ROTATIONS else "m"
        found = self.column(f"platform_{axis}_{unit}")
        if found is not None or self._measured_pose is None:
            return found
        return self._measured_pose[:, HEXAPOD_AXES.index(axis)]

    def commanded(self, axis: str) -> Array | None:
        """What was asked for, in the terms of `position`."""
        if axis == "leg":
            return self.column("setpoint_m")
        unit = "rad" if axis in ROTATIONS else "m"
        found = self.column(f"commanded_{axis}_{unit}")
        if found is not None or self._setpoint_pose is None:
            return found
        return self._setpoint_pose[:, HEXAPOD_AXES.index(axis)]

    def pose(self) -> Array | None:
        """(n, 6) platform pose of a hexapod, from the log or by forward kinematics of its piston positions."""
        columns = [self.position(axis) for axis in HEXAPOD_AXES]
        return (
            None
            if any(column is None for column in columns)
            else np.column_stack([c for c in columns if c is not None])
        )

    @cached_property
    def kinematics(self) -> HexapodKinematics:
        """Kinematics of a hexapod."""
        return machine_kinematics(self.machine)

    @cached_property
    def _measured_pose(self) -> Array | None:
        return self._pose_of("position")

    @cached_property
    def _setpoint_pose(self) -> Array | None:
        return self._pose_of("setpoint")

    def _pose_of(self, quantity: str) -> Array | None:
        """Forward kinematics of a leg quantity; None where a leg is missing or no pose fits."""
        columns = [self.leg(quantity, "m", leg) for leg in self.legs]
        present = [column for column in columns if column is not None]
        if len(present) < len(columns) or not np.isfinite(np.column_stack(present)).all():
            return None
        try:
            return self.kinematics.forward(np.column_stack(present))
        except HexsimError:
            return None

    # ---- smoothness ----------------------------------------------------------------------------------------------

    def deviation(self, axis: str) -> Deviation | None:
        """What is left of an axis' acceleration beside what was wanted; None where the log has no acceleration."""
        acceleration = self.acceleration(axis)
        if acceleration is None:
            return None
        if self.wanted is not None and axis in self.wanted:
            return given_deviation(self.time_s, acceleration, self.wanted[axis])
        return axis_deviation(
            self.time_s,
            acceleration,
            self.commanded_acceleration(axis) if axis in self.driven_axes else None,
            self.commanded(self.driven_axes[0]),
            self.frequency_Hz,
            self.figures_from_s,
            self.fade_s,
        )


def _acceleration_column(axis: str) -> str:
    if axis == "leg":
        return "acceleration_m_s2"
    if axis in ROTATIONS:
        return f"angular_acceleration_{TRANSLATIONS[ROTATIONS.index(axis)]}_rad_s2"
    return f"acceleration_{axis}_m_s2"
