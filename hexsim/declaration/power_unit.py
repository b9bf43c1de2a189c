"""The table [power_unit]."""

from __future__ import annotations

from pydantic import model_validator

from hexsim.declaration.section import Section, between


class PowerUnit(Section):
    """Hydraulic power unit (report 2.2.2): pump, motor, accumulator, relief valve, reservoir. Absent = constant supply.

    The pump's flow is zero at supply.pressure_Pa. Report: motor power, reservoir, kind of pump, an accumulator. The
    rest is assumed, see docs/power_unit.md.
    """

    motor_power_W: float = between(1.0, 1e7, "rating at the shaft; the flow is held below it [W]", default=2500.0)
    motor_time_constant_s: float = between(1e-3, 1e3, "run-up and run-down [s]", default=0.2)
    pump_flow_max_m3_s: float = between(1e-8, 10.0, "full flow: 18 l/min is 2.5 kW at 70 bar [m3/s]", default=3.0e-4)
    pump_droop_Pa: float = between(1e3, 1e8, "pressure drop from zero to full flow [Pa]", default=4.0e5)
    pump_time_constant_s: float = between(1e-3, 100.0, "lag of the compensator [s]", default=0.07)
    pump_leakage_m3_s_Pa: float = between(0.0, 1e-8, "case drain: 1 l/min at 70 bar [m3/(s Pa)]", default=2.4e-12)
    pump_friction_W: float = between(0.0, 1e7, "shaft power at no flow [W]", default=150.0)
    pump_side_volume_m3: float = between(1e-7, 10.0, "oil between pump and line [m3]", default=5.0e-4)
    accumulator_volume_m3: float = between(1e-6, 100.0, "gas volume at precharge [m3]", default=4.0e-3)
    accumulator_precharge_fraction: float = between(0.05, 0.99, "precharge over supply pressure [-]", default=0.8)
    polytropic_exponent: float = between(1.0, 1.67, "of the gas: 1 isothermal, 1.4 adiabatic [-]", default=1.3)
    line_length_m: float = between(0.01, 1e3, "supply line [m]", default=3.0)
    line_diameter_m: float = between(1e-3, 1.0, "supply line, inside [m]", default=0.016)
    hose_modulus_Pa: float = between(1e6, 1e11, "hose and the oil in it [Pa]", default=6.0e8)
    filter_resistance_Pa_s_m3: float = between(0.0, 1e13, "laminar: 0.5 bar at full flow [Pa s/m3]", default=1.7e8)
    line_resistance_Pa_s2_m6: float = between(
        0.0, 1e20, "turbulent, R q |q|: 0.9 bar at full flow [Pa s2/m6]", default=1.0e12
    )
    manifold_volume_m3: float = between(1e-7, 10.0, "oil between line and valves [m3]", default=2.0e-4)
    relief_pressure_Pa: float = between(2e5, 1e8, "where the relief valve opens, gauge [Pa]", default=8.0e6)
    relief_conductance_m3_s_Pa: float = between(1e-14, 1e-4, "of the open relief valve [m3/(s Pa)]", default=1.0e-9)
    reservoir_volume_m3: float = between(1e-5, 1e3, "oil in the tank [m3]", default=0.05)
    cooling_W_K: float = between(0.0, 1e6, "heat given off above ambient temperature [W/K]", default=40.0)
    ambient_temperature_degC: float = between(-40.0, 80.0, "of the room [degC]", default=20.0)
    oil_temperature_degC: float = between(-20.0, 120.0, "at the start of a run [degC]", default=35.0)

    @model_validator(mode="after")
    def _motor_drives_the_pump(self) -> PowerUnit:
        if self.pump_friction_W >= self.motor_power_W:
            raise ValueError(
                f"pump_friction_W = {self.pump_friction_W:g} must be below motor_power_W = {self.motor_power_W:g}"
            )
        return self
