"""The tables [supply] and [oil]."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from hexsim.declaration.oil_grades import GRADES, TELLUS_T46, OilGrade, declared_of
from hexsim.declaration.section import Section, between

ATMOSPHERE_Pa = 1.01325e5  # pressures are gauge pressures; absolute zero is -ATMOSPHERE_Pa

Viscosity = Annotated[float, Field(ge=1.5, le=5000.0)]


class Supply(Section):
    """Constant supply of the report; a [power_unit] table or an effect makes it vary."""

    pressure_Pa: float = between(2.0e5, 1.0e8, "supply pressure, gauge [Pa]")
    tank_pressure_Pa: float = between(-ATMOSPHERE_Pa, 1.0e8, "return pressure, gauge [Pa]", default=0.0)

    @model_validator(mode="after")
    def _supply_above_tank(self) -> Supply:
        if self.tank_pressure_Pa >= self.pressure_Pa:
            raise ValueError(
                f"tank_pressure_Pa = {self.tank_pressure_Pa:g} must be below pressure_Pa = {self.pressure_Pa:g}"
            )
        return self


class Oil(Section):
    """Density and bulk modulus at a temperature, as the report's Shell Tellus T46 at 35 degC, or by grade.

    A grade says how the oil follows the temperature, and gives the two numbers where they are not declared. Without
    one it is Tellus T46. `viscosity_mm2_s`: an oil of its own, [viscosity at 40 degC, at 100 degC].
    """

    model_config = ConfigDict(json_schema_extra=lambda schema: schema.update(required=[]))

    grade: Literal["VG 22", "VG 32", "VG 46", "VG 68"] | None = Field(None, description="mineral oil, ISO 3448")
    viscosity_mm2_s: tuple[Viscosity, Viscosity] | None = Field(
        None, strict=False, description="at 40 and 100 degC, in place of the grade's [mm2/s]"
    )
    density_kg_m3: float = between(500.0, 2000.0, "density [kg/m3]")
    bulk_modulus_Pa: float = between(1.0e7, 1.0e10, "bulk modulus [Pa]")
    temperature_degC: float = between(
        -20.0, 120.0, "temperature at which density and modulus hold [degC]", default=35.0
    )

    @model_validator(mode="before")
    @classmethod
    def _numbers_of_the_grade(cls, data: Any) -> Any:
        grade = GRADES.get(data.get("grade", "")) if isinstance(data, dict) else None
        temperature = data.get("temperature_degC", 35.0) if grade else None
        if grade is None or not isinstance(temperature, (int, float)) or not -20.0 <= temperature <= 120.0:
            return data
        return declared_of(grade, temperature) | data

    @property
    def properties(self) -> OilGrade:
        """How this oil follows the temperature."""
        grade = TELLUS_T46 if self.grade is None else GRADES[self.grade]
        if self.viscosity_mm2_s is None:
            return grade
        return replace(grade, viscosity_40_mm2_s=self.viscosity_mm2_s[0], viscosity_100_mm2_s=self.viscosity_mm2_s[1])

    @model_validator(mode="after")
    def _thins_when_warm(self) -> Oil:
        if self.viscosity_mm2_s is not None and self.viscosity_mm2_s[0] <= self.viscosity_mm2_s[1]:
            raise ValueError("viscosity_mm2_s = [at 40 degC, at 100 degC] must fall")
        return self
