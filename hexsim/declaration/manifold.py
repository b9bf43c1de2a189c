"""The table [manifold]."""

from __future__ import annotations

import math

from hexsim.declaration.section import Section, between


class Manifold(Section):
    """Safety manifold between valves and cylinders, as motion bases have it. Absent: a leg hangs on its valve alone.

    Each leg: an orifice and a blocking valve in each port's line, check valves to supply and tank, and a normally open
    settling valve with an orifice to the tank. The defaults suit the 600 kg machine; docs/manifold.md derives the sizes.
    """

    port_flow_m3_s: float = between(
        1e-9, 1.0, "through orifice and open blocking valve of a port at their rated drop [m3/s]", default=3.5e-4
    )
    port_pressure_drop_Pa: float = between(1e3, 1e8, "across both at that flow [Pa]", default=3.0e6)
    blocking_time_s: float = between(1e-3, 10.0, "in which a blocking valve shuts [s]", default=0.12)
    check_flow_m3_s: float = between(1e-9, 1.0, "through a check valve at its rated drop [m3/s]", default=5.0e-4)
    check_pressure_drop_Pa: float = between(1e3, 1e8, "across it at that flow [Pa]", default=5.0e5)
    settling_diameter_m: float = between(1e-4, 0.1, "of the settling orifice, sharp-edged [m]", default=1.3e-3)
    settling_time_s: float = between(1e-3, 10.0, "in which the settling valve opens [s]", default=0.3)
    settling_taper_m: float = between(1e-4, 1.0, "stroke above the stop over which it narrows [m]", default=0.02)
    centring_time_s: float = between(
        1e-3, 10.0, "in which spools without current centre: orifices in the pilot lines [s]", default=0.3
    )
    accumulator_volume_m3: float = between(1e-6, 100.0, "oil for the way down: gas at precharge [m3]", default=4.0e-3)
    accumulator_precharge_fraction: float = between(0.05, 0.99, "precharge over supply pressure [-]", default=0.8)

    @property
    def port_resistance_Pa_s2_m6(self) -> float:
        """dp/Q^2 of a port's line."""
        return self.port_pressure_drop_Pa / self.port_flow_m3_s**2

    @property
    def check_gain_m3_s_sqrtPa(self) -> float:
        """Q/sqrt(dp) of a check valve."""
        return self.check_flow_m3_s / math.sqrt(self.check_pressure_drop_Pa)

    def settling_gain_m3_s_sqrtPa(self, density_kg_m3: float, discharge: float = 0.611) -> float:
        """Q/sqrt(dp) of the settling orifice, C_d pi d^2/4 sqrt(2/rho); C_d of an orifice in a plate."""
        return discharge * math.pi / 4 * self.settling_diameter_m**2 * math.sqrt(2.0 / density_kg_m3)
