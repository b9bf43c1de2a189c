"""The machine as declared, one class a table of `machine.toml`. SI units; the unit stands in the name of each key.

Sources of the defaults: report = DCT 2005.79 appendix A; assumed = stated with its reason in the machine's README.
"""

from __future__ import annotations

import math
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

ATMOSPHERE_Pa = 1.01325e5  # pressures are gauge pressures; absolute zero is -ATMOSPHERE_Pa

Positive = Field(gt=0.0, allow_inf_nan=False)
NotNegative = Field(ge=0.0, allow_inf_nan=False)


def between(low: float, high: float) -> Any:
    """Bounds wide enough for any real machine and narrow enough to catch bar for Pa or mm for m."""
    return Field(ge=low, le=high, allow_inf_nan=False)


class Section(BaseModel):
    """A table of the machine file: frozen; unknown keys and numbers that are not finite are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Identity(Section):
    """Name, kind and place."""

    name: str
    kind: Literal["bench", "hexapod"]
    gravity_m_s2: float = between(0.0, 30.0)


class Supply(Section):
    """Constant supply of the report; a [power_unit] table or an effect makes it vary."""

    pressure_Pa: float = between(2.0e5, 1.0e8)
    tank_pressure_Pa: float = Field(default=0.0, ge=-ATMOSPHERE_Pa, allow_inf_nan=False)

    @model_validator(mode="after")
    def _supply_above_tank(self) -> Supply:
        if self.tank_pressure_Pa >= self.pressure_Pa:
            raise ValueError(
                f"tank_pressure_Pa = {self.tank_pressure_Pa:g} must be below pressure_Pa = {self.pressure_Pa:g}"
            )
        return self


class Oil(Section):
    """Shell Tellus T46 at 35 degC (report)."""

    density_kg_m3: float = between(500.0, 2000.0)
    bulk_modulus_Pa: float = between(1.0e7, 1.0e10)
    temperature_degC: float = Field(default=35.0, ge=-20.0, le=120.0)  # where these two hold


class Cylinder(Section):
    """Differential cylinder. `rod_side` "supply" is the report: the annulus hangs on the supply line."""

    piston_diameter_m: float = between(1e-3, 2.0)
    rod_diameter_m: float = between(0.0, 2.0)
    stroke_m: float = between(5e-3, 10.0)
    pipeline_volume_m3: float = between(0.0, 0.1)
    rod_side: Literal["supply", "chamber"] = "supply"
    rod_side_volume_m3: float = Field(default=5.0e-7, ge=0.0)  # dead volume of the annulus when it is a chamber
    rod_side_conductance_m3_s_sqrtPa: float = Field(default=2.0e-6, gt=0.0)  # port between annulus and supply line
    cushion_length_m: float = Field(default=0.005, gt=0.0)  # soft end stop acts within this of either end
    cushion_stiffness_N_m: float = Field(default=2.0e7, gt=0.0)
    cushion_damping_N_s_m: float = Field(default=2.0e4, ge=0.0)

    @property
    def area_bottom_m2(self) -> float:
        """A1 = pi/4 D^2."""
        return math.pi / 4 * self.piston_diameter_m**2

    @property
    def area_top_m2(self) -> float:
        """A2 = pi/4 (D^2 - d^2)."""
        return math.pi / 4 * (self.piston_diameter_m**2 - self.rod_diameter_m**2)

    @model_validator(mode="after")
    def _rod_fits(self) -> Cylinder:
        if self.rod_diameter_m >= self.piston_diameter_m:
            raise ValueError(
                f"rod_diameter_m = {self.rod_diameter_m:g} must be smaller than "
                f"piston_diameter_m = {self.piston_diameter_m:g}"
            )
        if self.cushion_length_m >= self.stroke_m / 2:
            raise ValueError(
                f"cushion_length_m = {self.cushion_length_m:g} must be shorter than half of "
                f"stroke_m = {self.stroke_m:g}"
            )
        return self


class Valve(Section):
    """Three-way proportional valve, Eq. 3.2-3.4 and 3.11."""

    flow_area: Literal["overlap", "quadratic"] = "overlap"
    voltage_max_V: float = Positive
    spool_travel_max_m: float = between(1e-5, 0.1)
    spool_diameter_m: float = between(1e-4, 0.5)
    overlap_m: float = Field(allow_inf_nan=False)  # negative: underlap
    edge_rounding_m: float = Field(default=0.0, ge=0.0)  # 0 = sharp edges (report)
    discharge_coefficient: float = Field(gt=0.0, le=1.0)
    quadratic_gain: float = Field(default=300.0, gt=0.0)  # [-] of Eq. 3.11, a(x) = 300 x^2
    pressure_width_Pa: float = Field(default=1.0e4, gt=0.0)  # sqrt(dp) is smooth within this of dp = 0
    spool_frequency_Hz: float = Field(default=0.0, ge=0.0)  # 0 = the spool follows at once (report)
    spool_damping: float = Field(default=0.7, gt=0.0)

    @model_validator(mode="after")
    def _overlap_within_travel(self) -> Valve:
        if abs(self.overlap_m) >= self.spool_travel_max_m:
            raise ValueError(
                f"overlap_m = {self.overlap_m:g} must be smaller than spool_travel_max_m = {self.spool_travel_max_m:g}"
            )
        return self


class Friction(Section):
    """Asymmetric Stribeck curve, Eq. 2.4 ("sharp") or Eq. 3.9 as printed ("report")."""

    form: Literal["sharp", "report"] = "sharp"
    viscous_extend_N_s_m: float = NotNegative
    viscous_retract_N_s_m: float = NotNegative
    coulomb_extend_N: float = NotNegative
    coulomb_retract_N: float = NotNegative
    static_extend_N: float = NotNegative
    static_retract_N: float = NotNegative
    stribeck_velocity_m_s: float = Positive
    sharpness_m_s: float = Field(default=2.0e-4, gt=0.0)  # sharp: sign(v) stands as tanh(v / sharpness)
    arctan_slope_s_m: float = Field(default=100.0, gt=0.0)  # report: sign(v) stands as arctan(k v), unscaled


class Controller(Section):
    """Position loop of the motion computer (report 2.2.4)."""

    gain_V_per_m: float = Positive
    rate_Hz: float = Field(default=500.0, gt=0.0, le=10_000.0)


class Sensors(Section):
    """Noise as one standard deviation of white noise a sample at the log rate of 1 kHz; 0 = ideal."""

    log_rate_Hz: float = Field(default=1000.0, gt=0.0, le=10_000.0)
    position_noise_m: float = Field(default=0.0, ge=0.0)
    position_resolution_m: float = Field(default=0.0, ge=0.0)
    position_delay_s: float = Field(default=0.0, ge=0.0)
    position_gain: float = Field(default=1.0, gt=0.0)
    position_offset_m: float = 0.0
    pressure_noise_Pa: float = Field(default=0.0, ge=0.0)
    pressure_resolution_Pa: float = Field(default=0.0, ge=0.0)
    pressure_delay_s: float = Field(default=0.0, ge=0.0)
    pressure_gain: float = Field(default=1.0, gt=0.0)
    pressure_offset_Pa: float = 0.0
    supply_pressure_gain: float = Field(default=1.0, gt=0.0)
    acceleration_noise_m_s2: float = Field(default=0.0, ge=0.0)
    acceleration_resolution_m_s2: float = Field(default=0.0, ge=0.0)
    acceleration_delay_s: float = Field(default=0.0, ge=0.0)
    acceleration_gain: float = Field(default=1.0, gt=0.0)
    acceleration_offset_m_s2: float = 0.0
    angular_acceleration_noise_rad_s2: float = Field(default=0.0, ge=0.0)


class Load(Section):
    """What the legs carry. A bench has `moving_mass_kg`, a hexapod the platform's mass and inertia."""

    moving_mass_kg: float | None = Field(default=None, gt=0.0)
    platform_mass_kg: float | None = Field(default=None, gt=0.0)
    leg_mass_kg: float = Field(default=0.0, ge=0.0)  # cylinder and rod together; 0 = counted with the platform
    rod_mass_fraction: float = Field(default=0.35, gt=0.0, lt=1.0)
    platform_inertia_kg_m2: tuple[float, float, float] | None = None
    centre_of_mass_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @field_validator("platform_inertia_kg_m2")
    @classmethod
    def _inertia_is_physical(cls, value: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
        if value is not None and (min(value) <= 0 or 2 * max(value) > sum(value) * (1 + 1e-9)):
            raise ValueError("must be three positive moments, none larger than the sum of the other two")
        return value


class Geometry(Section):
    """Six joints in pairs on two circles; legs 1..6 in pairs at base angles 0, 120, 240 deg."""

    base_radius_m: float = Positive
    base_half_angle_deg: float = Field(gt=0.0, lt=60.0)
    platform_radius_m: float = Positive
    platform_half_angle_deg: float = Field(gt=0.0, lt=60.0)
    neutral_leg_length_m: float = Positive


class PowerUnit(Section):
    """Hydraulic power unit (report 2.2.2): pump, motor, accumulator, relief valve, reservoir. Absent = constant supply.

    The pump's flow is zero at supply.pressure_Pa. Report: motor power, reservoir, kind of pump, an accumulator. The
    rest is assumed, see docs/power_unit.md.
    """

    motor_power_W: float = Field(default=2500.0, gt=0.0)  # rating at the shaft; the flow is held below it
    motor_time_constant_s: float = Field(default=0.2, gt=0.0)  # run-up and run-down
    pump_flow_max_m3_s: float = Field(default=3.0e-4, gt=0.0)  # 18 l/min (2.5 kW at 70 bar with losses)
    pump_droop_Pa: float = Field(default=4.0e5, gt=0.0)  # pressure drop from zero to full flow of the compensator
    pump_time_constant_s: float = Field(default=0.07, gt=0.0)
    pump_leakage_m3_s_Pa: float = Field(default=2.4e-12, ge=0.0)  # case drain: 1 l/min at 70 bar
    pump_friction_W: float = Field(default=150.0, ge=0.0)
    pump_side_volume_m3: float = Field(default=5.0e-4, gt=0.0)
    accumulator_volume_m3: float = Field(default=4.0e-3, gt=0.0)
    accumulator_precharge_fraction: float = Field(default=0.8, gt=0.0, lt=1.0)
    polytropic_exponent: float = Field(default=1.3, ge=1.0, le=1.67)
    line_length_m: float = Field(default=3.0, gt=0.0)
    line_diameter_m: float = Field(default=0.016, gt=0.0)
    hose_modulus_Pa: float = Field(default=6.0e8, gt=0.0)  # hose and the oil in it
    filter_resistance_Pa_s_m3: float = Field(default=1.7e8, ge=0.0)  # laminar: 0.5 bar at full flow
    line_resistance_Pa_s2_m6: float = Field(default=1.0e12, ge=0.0)  # turbulent, R q |q|: 0.9 bar at full flow
    manifold_volume_m3: float = Field(default=2.0e-4, gt=0.0)
    relief_pressure_Pa: float = Field(default=8.0e6, gt=0.0)
    relief_conductance_m3_s_Pa: float = Field(default=1.0e-9, gt=0.0)
    reservoir_volume_m3: float = Field(default=0.05, gt=0.0)
    cooling_W_K: float = Field(default=40.0, ge=0.0)
    ambient_temperature_degC: float = Field(default=20.0, ge=-40.0, le=80.0)
    oil_temperature_degC: float = Field(default=35.0, ge=-20.0, le=120.0)  # at the start of a run

    @model_validator(mode="after")
    def _motor_drives_the_pump(self) -> PowerUnit:
        if self.pump_friction_W >= self.motor_power_W:
            raise ValueError(
                f"pump_friction_W = {self.pump_friction_W:g} must be below motor_power_W = {self.motor_power_W:g}"
            )
        return self


EffectTable = dict[str, Any]


class Machine(Section):
    """All tables of a machine file. Frozen; `with_changes` gives a changed copy, validated again."""

    machine: Identity
    supply: Supply
    oil: Oil
    cylinder: Cylinder
    valve: Valve
    friction: Friction
    controller: Controller
    sensors: Sensors = Sensors()
    uncertainty: dict[str, float] = {}
    load: Load
    geometry: Geometry | None = None
    power_unit: PowerUnit | None = None
    effects: dict[str, EffectTable | list[EffectTable]] = {}

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

    @field_validator("uncertainty")
    @classmethod
    def _uncertainty_is_relative(cls, value: dict[str, float]) -> dict[str, float]:
        for key, half_width in value.items():
            if not 0 <= half_width < 1:
                raise ValueError(f"{key} = {half_width} must be a relative half width in [0, 1)")
        return value
