"""Monitor of the load: weight and centre of mass of what the legs carry, from pressures and positions.

The legs put on the platform what is left of their pressures beside friction and end stops, and that carries the load and moves
it. In the world's frame about the platform's origin,

    r = J' (P1 A1 - P2 A2 - F_friction(y') - ...)  -  k W(x, x', x'')

W: wrench of the declared body in the measured motion (`leg_load.platform_wrench`).  k: weight carried over declared weight.
x', x'': differences of the pose, low-passed as the pressures are, so that no accelerometer is needed.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import allocating
from hexsim.declaration import Machine
from hexsim.hydraulics import leg
from hexsim.hydraulics.parameters import declared_rows
from hexsim.hydraulics.resolve import resolve
from hexsim.machine.geometry import held_body
from hexsim.motion_computer.errors import Error, Finding
from hexsim.motion_computer.leg_load import platform_wrench
from hexsim.motion_computer.monitors import Tolerances

Array = NDArray[np.float64]
WEIGHT_AND_MOMENTS = slice(2, 5)  # F_z, M_x, M_y of a wrench


@allocating
def _thrusts(rows, y, v, bottom, top, supply):
    """Force (n,) [N] of each leg on the platform by the declared machine."""
    force = np.empty(len(y))
    for i in range(len(y)):
        force[i] = leg.leg_force(rows[i], y[i], v[i], 0.0, bottom[i], top[i], supply, 0.0, 0.0)
    return force


class LoadMonitor:
    """A change of weight or centre is an error. Call `tick` at each control tick.

    P2 = Ps, or Ps + Pt - P1 of a slow leg with both chambers on the valve. r is low-passed twice with `load_filter_s`; what
    the first `load_learn_s` show is its reference, and gives k. Centre = (-M_y, M_x)/F_z. Friction that is not as declared
    passes as a change of weight while all legs move one way. Not on a bench, whose friction is as large as its load.
    """

    EVERY = 10  # control ticks

    def __init__(self, machine: Machine, tolerances: Tolerances) -> None:
        self.mechanics, self.tolerances = machine.mechanics, tolerances
        self._tank_Pa = machine.supply.tank_pressure_Pa if machine.cylinder.rod_side == "valve" else None
        self._step_s = self.EVERY / machine.controller.rate_Hz
        self._share = self._step_s / (self._step_s + tolerances.load_filter_s)
        self._learn = max(1, round(tolerances.load_learn_s / self._step_s))
        self._rows = declared_rows(machine)
        declared = resolve(machine.model_copy(update={"effects": {}}))
        self._gravity = declared.gravity_m_s2
        self._body = held_body(declared)
        self._pose = np.zeros(6)
        self.restart()

    def restart(self) -> None:
        """Learn the reference anew."""
        self._count = self._samples = 0
        self._kept: deque[tuple[Array, Array, Array, float]] = deque(maxlen=3)  # pose, P1, positions, Ps
        self._carried, self._expected = np.zeros(3), np.zeros(3)  # sums while it learns
        self._stages = np.zeros((2, 3))

    def tick(self, positions: Array, pressures: Array | None, supply_Pa: float) -> list[Finding]:
        self._count += 1
        if not self.mechanics.has_platform or pressures is None or self._count % self.EVERY:
            return []
        if not (np.isfinite(pressures).all() and np.isfinite(supply_Pa)):
            self._kept.clear()
            return []
        self._pose = self.mechanics.forward(positions, guess=self._pose)
        self._kept.append((self._pose, pressures.copy(), positions.copy(), supply_Pa))
        if len(self._kept) < 3:
            return []
        carried, expected = self._loads()
        self._samples += 1
        if self._samples <= self._learn:
            self._carried += carried
            self._expected += expected
            return []
        k = self._carried[0] / self._expected[0]
        beyond = carried - k * expected - (self._carried - k * self._expected) / self._learn
        first, second = self._stages
        first += self._share * (beyond - first)
        second += self._share * (first - second)
        return self._judge(second, max(abs(self._carried[0]) / self._learn, 1.0))

    def _twist(self, one: Array, next_one: Array) -> Array:
        """(v, omega) between two poses."""
        return self.mechanics.twist(0.5 * (one + next_one), (next_one - one) / self._step_s)

    def _loads(self) -> tuple[Array, Array]:
        """(F_z, M_x, M_y) that the legs give and that the declared body takes, at the middle one of three samples."""
        (before, *_), (pose, bottom, positions, supply), (after, *_) = self._kept
        earlier, later = self._twist(before, pose), self._twist(pose, after)
        twist, change = 0.5 * (earlier + later), (later - earlier) / self._step_s
        top = np.full(len(bottom), supply) if self._tank_Pa is None else supply + self._tank_Pa - bottom
        speeds = self.mechanics.leg_velocities(pose, twist)
        carried = self.mechanics.jacobian(pose).T @ _thrusts(self._rows, positions, speeds, bottom, top, supply)
        expected = platform_wrench(self._body, self._gravity, self.mechanics, pose, twist, change)
        return carried[WEIGHT_AND_MOMENTS], expected[WEIGHT_AND_MOMENTS]

    def _judge(self, beyond: Array, weight: float) -> list[Finding]:
        change, shift = beyond[0] / weight, float(np.hypot(*beyond[1:])) / weight
        if abs(change) > self.tolerances.load_change:
            return [Finding(error=Error.LOAD_SHIFTED, detail=f"the load changed by {100 * change:.0f} %")]
        if shift > self.tolerances.load_shift_m:
            return [Finding(error=Error.LOAD_SHIFTED, detail=f"its centre moved by {1000 * shift:.0f} mm")]
        return []
