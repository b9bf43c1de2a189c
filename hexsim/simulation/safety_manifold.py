"""The safety manifold at work: which legs it shuts off from their valves and lowers, and how fast.

A leg whose valve does not do what it is told (leg error, chamber pressure lost) is blocked, and lowered through its
settling orifice. So are all legs once the cabinet is dead, and once the platform is down and its pump stopped.
The manifold sits on the cylinder: a hose that bursts is shut off with the valve.
"""

from __future__ import annotations

import numpy as np

from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P
from hexsim.motion_computer.computer import MotionComputer
from hexsim.motion_computer.errors import Error
from hexsim.motion_computer.states import State
from hexsim.plant import Plant

OUT_OF_HAND = Error.LEG_ERROR | Error.PRESSURE_LOW  # of one leg


def smooth(share: float) -> float:
    """From 0 to 1 with no jump in speed or acceleration."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


class SafetyManifold:
    """Drives the manifold of a plant: `tick` once a tick. Without [manifold] it does nothing.

    dead: the cabinet has no power, so every solenoid has dropped.
    """

    def __init__(self, plant: Plant) -> None:
        self.plant, self.declared = plant, plant.machine.manifold
        self.dead = False
        self.open_share = np.ones(plant.n_legs)  # of the blocking valves
        self._blocked, self._settling = np.zeros(plant.n_legs), np.zeros(plant.n_legs)  # shares of the way

    def settling_velocity_m_s(self) -> float:
        """v_s = K_s sqrt(P - Pt)/A1, mean of the legs at rest: P A1 = F, and + Ps A2 where the rod side stays on the supply.

        0 without a manifold. Asked before the run moves.
        """
        if self.declared is None:
            return 0.0
        rows, tank = self.plant.rows, self.plant.rows[:, P.TANK_PRESSURE]
        above = self.plant.bottom_pressures() - tank
        on_valve = rows[:, P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE
        held = (rows[:, P.SUPPLY_PRESSURE] - tank - above) * rows[:, P.AREA_TOP] / rows[:, P.AREA_BOTTOM]
        above = np.maximum(above - on_valve * held, 0.0)  # P2 falls from Ps + Pt - P1 to the tank's
        gains = np.array([self.declared.settling_gain_m3_s_sqrtPa(density) for density in rows[:, P.DENSITY]])
        return float(np.mean(gains * np.sqrt(above) / rows[:, P.AREA_BOTTOM]))

    def tick(
        self,
        computer: MotionComputer,
        dt: float,
        *,
        least_open: float = 1.0e-6,  # of a blocking valve that is shut
    ) -> None:
        if self.declared is None:
            return
        legs = self._dropped(computer)
        shutting_s = self.declared.centring_time_s if self.dead else self.declared.blocking_time_s
        for i in np.flatnonzero(legs | (self._blocked > 0.0) | (self._settling > 0.0)).tolist():
            step = dt if legs[i] else -dt
            self._blocked[i] = np.clip(self._blocked[i] + step / shutting_s, 0.0, 1.0)
            self._settling[i] = np.clip(self._settling[i] + step / self.declared.settling_time_s, 0.0, 1.0)
            is_open = max(1.0 - smooth(self._blocked[i]), least_open)
            gain = self.declared.settling_gain_m3_s_sqrtPa(self.plant.rows[i, P.DENSITY])
            self.open_share[i] = is_open
            self.plant.change_row(i, P.PORT_RESISTANCE, self.declared.port_resistance_Pa_s2_m6 / is_open**2)
            self.plant.change_row(i, P.SETTLING_GAIN, smooth(self._settling[i]) * gain)

    def _dropped(self, computer: MotionComputer) -> np.ndarray:
        """Whether each leg's solenoids (n_legs,) have dropped."""
        if self.dead:
            return np.ones(self.plant.n_legs, bool)
        legs = np.zeros(self.plant.n_legs, bool)
        if computer.state == State.FAULT:
            legs[:] = computer.arrived and not computer.pump_on
            for _, finding in computer.findings:
                if finding.leg and finding.error & OUT_OF_HAND:
                    legs[finding.leg - 1] = True
        return legs
