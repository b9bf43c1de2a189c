"""The safety manifold at work: which legs it shuts off from their valves and lowers, and how fast.

A leg whose valve does not do what it is told (leg error, chamber pressure lost) is blocked, and lowered through its
settling orifice. So are all legs once the cabinet is dead, and once the platform is down and its pump stopped.
"""

from __future__ import annotations

import numpy as np

from hexsim.hydraulics.parameters import P
from hexsim.motion_computer.computer import MotionComputer
from hexsim.motion_computer.errors import Error
from hexsim.motion_computer.states import State
from hexsim.plant import Plant

OUT_OF_HAND = Error.LEG_ERROR | Error.PRESSURE_LOW  # of one leg
LEAST_OPEN = 1.0e-6  # of a blocking valve that is shut


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
        self._blocked, self._settling = np.zeros(plant.n_legs), np.zeros(plant.n_legs)  # shares of the way

    def tick(self, computer: MotionComputer, dt: float) -> None:
        if self.declared is None:
            return
        legs = self._dropped(computer)
        shutting_s = self.declared.centring_time_s if self.dead else self.declared.blocking_time_s
        for i in np.flatnonzero(legs | (self._blocked > 0.0) | (self._settling > 0.0)).tolist():
            step = dt if legs[i] else -dt
            self._blocked[i] = np.clip(self._blocked[i] + step / shutting_s, 0.0, 1.0)
            self._settling[i] = np.clip(self._settling[i] + step / self.declared.settling_time_s, 0.0, 1.0)
            is_open = max(1.0 - smooth(self._blocked[i]), LEAST_OPEN)
            gain = self.declared.settling_gain_m3_s_sqrtPa(self.plant.rows[i, P.DENSITY])
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
