"""A signal: what a column of a log means. Its columns carry leg or axis before the unit: position_3_m, acceleration_x_m_s2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Scope = Literal["machine", "leg", "translation", "rotation", "pose"]
TRANSLATIONS = ("x", "y", "z")
ROTATIONS = ("roll", "pitch", "yaw")
HEXAPOD_AXES = TRANSLATIONS + ROTATIONS


@dataclass(frozen=True, kw_only=True)
class Signal:
    """One quantity of a machine.

    stem, unit: as in column names, unit "" for a ratio. label: in the words of figures and sentences.
    scope: one column for the machine; one for each leg; along x, y, z (a bench has the direction of its leg alone);
    about x, y, z (hexapods); or the six coordinates of the platform (hexapods).
    measured: part of the format of measured logs. held: it may rightly stand still, a setpoint that is held for example.
    """

    stem: str
    unit: str
    label: str
    scope: Scope = "leg"
    measured: bool = False
    held: bool = False

    @property
    def kind(self) -> str:
        """Stem and unit: the column of a bench, and the key of its noise."""
        return self.column()

    def column(self, mark: str | int = "", unit: str | None = None) -> str:
        """Name of a column; mark: leg 1.. or axis."""
        return "_".join(part for part in (self.stem, str(mark), self.unit if unit is None else unit) if part)

    def columns(self, n_legs: int) -> tuple[str, ...]:
        """Names of its columns on a bench (n_legs 1) or a hexapod, in the order of legs or axes."""
        if self.scope == "machine" or (n_legs == 1 and self.scope in ("leg", "translation")):
            return (self.column(),)
        if n_legs == 1:
            return ()
        if self.scope == "leg":
            return tuple(self.column(leg) for leg in range(1, n_legs + 1))
        if self.scope == "pose":
            units = ["m"] * 3 + ["rad"] * 3
            return tuple(self.column(axis, unit) for axis, unit in zip(HEXAPOD_AXES, units, strict=True))
        return tuple(self.column(axis) for axis in TRANSLATIONS)
