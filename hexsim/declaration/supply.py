"""The tables [supply] and [oil]."""

from __future__ import annotations

from pydantic import model_validator

from hexsim.declaration.section import Section, between

ATMOSPHERE_Pa = 1.01325e5  # pressures are gauge pressures; absolute zero is -ATMOSPHERE_Pa


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
    """Shell Tellus T46 at 35 degC (report)."""

    density_kg_m3: float = between(500.0, 2000.0, "density [kg/m3]")
    bulk_modulus_Pa: float = between(1.0e7, 1.0e10, "bulk modulus [Pa]")
    temperature_degC: float = between(
        -20.0, 120.0, "temperature at which density and modulus hold [degC]", default=35.0
    )
