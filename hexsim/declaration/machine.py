"""All tables of a machine file together, and what must hold between them."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from hexsim.declaration.actuator import Cylinder, Friction
from hexsim.declaration.controller import Controller
from hexsim.declaration.load import Geometry, Load
from hexsim.declaration.power_unit import PowerUnit
from hexsim.declaration.section import Name, Section, between
from hexsim.declaration.sensors import Sensors
from hexsim.declaration.supply import Oil, Supply
from hexsim.declaration.valve import Valve

EffectTable = dict[str, Any]


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
    uncertainty: dict[str, float] = Field(
        default={}, description="how far a declared value may be off: relative half width, below 1"
    )
    load: Load
    geometry: Geometry | None = None
    power_unit: PowerUnit | None = None
    extra_sensors: dict[str, dict[str, float]] = Field(
        default={}, description="sensors beside the standard ones, a table each: hexsim/signals/sensor.py"
    )
    effects: dict[str, EffectTable | list[EffectTable]] = Field(default={}, description="see `hexsim effects`")

    @property
    def name(self) -> str:
        return self.machine.name

    @property
    def is_hexapod(self) -> bool:
        return self.machine.kind == "hexapod"

    @property
    def n_legs(self) -> int:
        return 6 if self.is_hexapod else 1

    @model_validator(mode="after")
    def _kind_has_its_tables(self) -> Machine:
        if self.is_hexapod:
            if self.geometry is None:
                raise ValueError("a hexapod needs a [geometry] table")
            if self.load.platform_mass_kg is None or self.load.platform_inertia_kg_m2 is None:
                raise ValueError("a hexapod needs load.platform_mass_kg and load.platform_inertia_kg_m2")
            if self.geometry.neutral_leg_length_m <= self.cylinder.stroke_m / 2:
                raise ValueError(
                    f"geometry.neutral_leg_length_m = {self.geometry.neutral_leg_length_m:g} must be longer than half "
                    f"of cylinder.stroke_m = {self.cylinder.stroke_m:g}"
                )
        elif self.load.moving_mass_kg is None:
            raise ValueError("a bench needs load.moving_mass_kg")
        return self

    @model_validator(mode="after")
    def _ports_meet_chambers(self) -> Machine:
        if (self.valve.kind == "four_way") != (self.cylinder.rod_side == "valve"):
            raise ValueError(
                f'valve.kind = "{self.valve.kind}" does not go with cylinder.rod_side = "{self.cylinder.rod_side}": a '
                'four-way valve needs rod_side = "valve", and the other way round'
            )
        if self.cylinder.rod_leakage_m3_s_Pa > 0 and self.cylinder.rod_side != "valve":
            raise ValueError('cylinder.rod_leakage_m3_s_Pa needs rod_side = "valve": set it to 0')
        return self

    @model_validator(mode="after")
    def _pressure_moves_the_piston(self) -> Machine:
        """Friction beyond the largest force of the oil, or a case drain beyond the pump's flow: nothing would move."""
        force = self.supply.pressure_Pa * self.cylinder.area_bottom_m2
        for key in ("coulomb_extend_N", "coulomb_retract_N"):
            friction: float = getattr(self.friction, key)
            if friction >= force:
                raise ValueError(
                    f"friction.{key} = {friction:g} must be below the largest force of the oil, supply pressure times "
                    f"piston area = {force:.3g} N"
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
            if not 0 <= half_width < 1:
                raise ValueError(f"{key} = {half_width} must be a relative half width in [0, 1)")
        return value
