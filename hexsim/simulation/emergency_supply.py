"""The supply once its pump stops: the unit's own state, or a substitute accumulator for a constant supply.

Substitute, for machines whose supply is a constant: P = P0 (V_g/(V_g + dV))^n while the accumulator holds oil, with dV
what the legs have taken (retraction takes A2 v, extension (A1 - A2) v), and once it is empty the line pressure
decays in `line_decay_s`; when the pump runs again it comes back as fast. Sizes: those of [manifold], or its defaults,
4 l and precharge 0.8 P0; n as of a power unit's accumulator.
"""

from __future__ import annotations

import math

import numpy as np

from hexsim.declaration import Manifold, PowerUnit
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P
from hexsim.hydraulics.supply import POWER_UNIT, S
from hexsim.plant import Plant


class EmergencySupply:
    """Drives the supply of a plant: `tick(pump_on, dt)` once a tick.

    tripped: the pump has stopped by itself. ceiling_Pa: highest pressure of a burst line. With a power unit it is a leak
    in the manifold's hose that takes the full pump flow at about that pressure.
    """

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.nominal = float(plant.machine.supply.pressure_Pa)
        self.tank = float(plant.machine.supply.tank_pressure_Pa)
        self.tripped = False
        self.ceiling_Pa = math.inf
        self.running = True
        self.power_unit = plant.has_supply_states and int(plant.resolved.supply[S.MODEL]) == POWER_UNIT
        sizes = plant.machine.manifold or Manifold()
        self._precharge = sizes.accumulator_precharge_fraction
        self._exponent = PowerUnit().polytropic_exponent
        self._gas = sizes.accumulator_volume_m3 * self._precharge ** (1.0 / self._exponent)
        self._taken = 0.0
        self._pressure = self.nominal
        self._positions = np.zeros(plant.n_legs)
        self._moved = False

    def tick(self, pump_on: bool, dt: float) -> None:
        running = self.running = pump_on and not self.tripped
        plant = self.plant
        if plant.has_supply_states:
            plant.switch_pump(running)
            if math.isfinite(self.ceiling_Pa) and self.power_unit:
                full_flow = plant.resolved.supply[S.PUMP_FLOW_MAX]
                share = (self.nominal - self.ceiling_Pa) / self.nominal
                leak = share * full_flow / math.sqrt(max(self.ceiling_Pa, 1.0e4))
                plant.change_supply(S.BURST, leak)
            return
        if running and not math.isfinite(self.ceiling_Pa) and not self._moved:
            return
        positions = plant.piston_positions().copy()
        step = positions - self._positions if self._moved else np.zeros_like(positions)
        self._positions, self._moved = positions, True
        pressure = min(self._substitute_pressure(running, step, dt), self.ceiling_Pa)
        self._pressure = max(pressure, self.tank)
        plant.change_row(slice(None), P.SUPPLY_PRESSURE, self._pressure)

    def _substitute_pressure(
        self,
        running: bool,
        step: np.ndarray,
        dt: float,
        *,
        line_decay_s: float = 0.3,  # of the line's pressure, once the pump has stopped
        leakage_m3_s: float = 5.0e-6,  # valves, pump and drain, 0.3 l/min
    ) -> float:
        """Supply pressure after this tick [Pa]."""
        if running:
            self._taken = 0.0
            return self.nominal + (self._pressure - self.nominal) * math.exp(-dt / line_decay_s)
        row = self.plant.rows[0]
        on_valve = row[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE
        rod_side = row[P.AREA_TOP] * (np.maximum(-step, 0.0) if on_valve else -step)
        self._taken += float(np.sum(row[P.AREA_BOTTOM] * np.maximum(step, 0.0) + rod_side))
        self._taken += leakage_m3_s * dt
        gas = self.nominal * (self._gas / (self._gas + max(self._taken, 0.0))) ** self._exponent
        if gas > self._precharge * self.nominal:
            return gas
        return self._pressure * math.exp(-dt / line_decay_s)
