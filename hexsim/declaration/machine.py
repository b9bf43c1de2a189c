"""All tables of a machine file together, and what must hold between them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, StringConstraints, field_validator, model_validator

from hexsim.declaration.actuator import Cylinder, Friction
from hexsim.declaration.controller import Controller
from hexsim.declaration.geometry import AnyGeometry
from hexsim.declaration.host_limits import HostLimits
from hexsim.declaration.leg import TABLES, Leg, LegTable, leg_of
from hexsim.declaration.load import Load, Payload
from hexsim.declaration.manifold import Manifold
from hexsim.declaration.mechanics import declared_mechanics
from hexsim.declaration.power_unit import PowerUnit
from hexsim.declaration.section import Name, Section, between
from hexsim.declaration.sensors import Place, Sensors
from hexsim.declaration.supply import Oil, Supply
from hexsim.declaration.valve import Valve
from hexsim.mechanics.mechanics import Mechanics

EffectTable = dict[str, Any]
PointName = Annotated[str, StringConstraints(pattern="^[a-z][a-z0-9_]{0,39}$")]
LENGTHS = ("base_joints_m", "platform_joints_m", "leg_zero_offsets_m")  # of [geometry]: uncertain by so many metres


class Identity(Section):
    """Name, kind and place."""

    name: Name = Field(description="as it stands in tables and reports")
    kind: Literal["bench", "hexapod"] = Field(description="one vertical leg, or six under a platform")
    gravity_m_s2: float = between(0.0, 30.0, "gravity [m/s2]")


class Machine(Section):
    """All tables of a machine file. Frozen; `hexsim.machine.files.changed` gives a changed copy, validated again."""

    machine: Identity
    supply: Supply
    oil: Oil
    cylinder: Cylinder
    valve: Valve
    friction: Friction
    controller: Controller
    sensors: Sensors = Sensors()
    host_limits: HostLimits = HostLimits()
    uncertainty: dict[str, float] = Field(
        default={},
        description="how far a declared value may be off: relative half width, below 1; joints and leg zero offsets in m",
    )
    load: Load
    geometry: AnyGeometry | None = None
    payload: tuple[Payload, ...] = Field(default=(), strict=False, description="bodies bolted to the platform")
    leg: tuple[LegTable, ...] = Field(default=(), strict=False, description="what single legs have otherwise")
    points: dict[PointName, Annotated[Place, Field(strict=False)]] = Field(
        default={},
        strict=False,
        description="places [x, y, z] in the platform's frame whose acceleration is of interest [m]",
    )
    power_unit: PowerUnit | None = None
    manifold: Manifold | None = None
    extra_sensors: dict[str, dict[str, float]] = Field(
        default={}, description="sensors beside the standard ones, a table each: hexsim/signals/sensor.py"
    )
    effects: dict[str, EffectTable | list[EffectTable]] = Field(default={}, description="see `hexsim list effects`")

    @property
    def name(self) -> str:
        return self.machine.name

    @property
    def is_hexapod(self) -> bool:
        return self.machine.kind == "hexapod"

    @property
    def n_legs(self) -> int:
        return 6 if self.is_hexapod else 1

    @property
    def legs(self) -> tuple[Leg, ...]:
        """All tables of every leg: the machine's, with the keys of its [[leg]]."""
        shared = Leg(**{name: getattr(self, name) for name in TABLES})
        return tuple(leg_of(number, shared, self.leg) for number in range(1, self.n_legs + 1))

    @property
    def mechanics(self) -> Mechanics:
        """Legs, poses and limits. Raises HexsimError where the legs do not reach."""
        geometry = self.geometry if self.is_hexapod else None
        return declared_mechanics(geometry, tuple(self.of_legs("cylinder", "stroke_m").tolist()))  # pyright: ignore[reportArgumentType]

    def of_legs(self, table: str, key: str) -> NDArray[np.float64]:
        """A number of every leg, (n_legs,)."""
        return np.array([getattr(getattr(leg, table), key) for leg in self.legs])

    @model_validator(mode="after")
    def _legs_are_there(self) -> Machine:
        numbers = [table.number for table in self.leg]
        for number in numbers:
            if number > self.n_legs:
                raise ValueError(f"[[leg]] number = {number}: the machine has {self.n_legs} leg{'s' * self.is_hexapod}")
            if numbers.count(number) > 1:
                raise ValueError(f"[[leg]] number = {number} stands twice: put its keys into one table")
        _ = self.legs  # raises ValueError where the tables of a leg do not go together
        return self

    @model_validator(mode="after")
    def _kind_has_its_tables(self) -> Machine:
        if self.is_hexapod:
            if self.geometry is None:
                raise ValueError("a hexapod needs a [geometry] table")
            if self.load.platform_mass_kg is None or self.load.platform_inertia_kg_m2 is None:
                raise ValueError("a hexapod needs load.platform_mass_kg and load.platform_inertia_kg_m2")
            stroke = max(self.of_legs("cylinder", "stroke_m"))
            if self.geometry.neutral_leg_length_m <= stroke / 2:
                raise ValueError(
                    f"geometry.neutral_leg_length_m = {self.geometry.neutral_leg_length_m:g} must be longer than half "
                    f"of cylinder.stroke_m = {stroke:g}"
                )
        elif self.load.moving_mass_kg is None:
            raise ValueError("a bench needs load.moving_mass_kg")
        elif self.points or any(self.sensors.imu_position_m) or any(self.sensors.imu_orientation_deg):
            raise ValueError(
                "[points] and the place of an IMU are on a hexapod's platform: a bench moves along its leg alone"
            )
        elif self.payload:
            raise ValueError("[[payload]] is bolted to a hexapod's platform: count it with load.moving_mass_kg")
        return self

    @model_validator(mode="after")
    def _ports_meet_chambers(self) -> Machine:
        if (self.valve.kind == "four_way") != (self.cylinder.rod_side == "valve"):
            raise ValueError(
                f'valve.kind = "{self.valve.kind}" does not go with cylinder.rod_side = "{self.cylinder.rod_side}": a '
                'four-way valve needs rod_side = "valve", and the other way round'
            )
        if max(self.of_legs("cylinder", "rod_leakage_m3_s_Pa")) > 0 and self.cylinder.rod_side != "valve":
            raise ValueError('cylinder.rod_leakage_m3_s_Pa needs rod_side = "valve": set it to 0')
        return self

    @model_validator(mode="after")
    def _pressure_moves_the_piston(self) -> Machine:
        """Friction beyond the largest force of the oil, or a case drain beyond the pump's flow: nothing would move."""
        for number, leg in enumerate(self.legs, start=1):
            place = f"leg {number}: " if self.leg else ""
            force = self.supply.pressure_Pa * leg.cylinder.area_bottom_m2
            for key in ("coulomb_extend_N", "coulomb_retract_N"):
                friction: float = getattr(leg.friction, key)
                if friction >= force:
                    raise ValueError(
                        f"{place}friction.{key} = {friction:g} must be below the largest force of the oil, supply pressure "
                        f"times piston area = {force:.3g} N"
                    )
        if self.power_unit is not None:
            drained = self.power_unit.pump_leakage_m3_s_Pa * self.supply.pressure_Pa
            if drained >= self.power_unit.pump_flow_max_m3_s:
                raise ValueError(
                    f"power_unit.pump_leakage_m3_s_Pa = {self.power_unit.pump_leakage_m3_s_Pa:g} drains {drained:.3g} "
                    f"m3/s at supply pressure; it must be less than "
                    f"pump_flow_max_m3_s = {self.power_unit.pump_flow_max_m3_s:g}"
                )
        return self

    @field_validator("uncertainty")
    @classmethod
    def _uncertainty_is_relative(cls, value: dict[str, float]) -> dict[str, float]:
        for key, half_width in value.items():
            if key in LENGTHS and not 0 <= half_width <= 0.1:
                raise ValueError(f"{key} = {half_width} must be a half width in metres, 0 to 0.1")
            if not 0 <= half_width < 1:
                raise ValueError(f"{key} = {half_width} must be a relative half width in [0, 1)")
        return value
