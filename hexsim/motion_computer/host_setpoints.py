"""From a host's packets to piston setpoints, as far ahead as the compensators look.

    buffer (`host_buffer`) -> limits (`limits`) -> legs -> queue of `preview` ticks

What the limiter gives is for the last tick of the preview: it is predicted there, and then played as it was predicted,
so that a compensator is shown no future that does not come. What packets later tell otherwise, the follower of the
limits brings in smoothly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.motion_computer.host_buffer import HostBuffer
from hexsim.motion_computer.limits import CommandLimiter, Limits, leg_limits, pose_limits, soft_legs

Array = NDArray[np.float64]


class HostSetpoints:
    """mode: 0 degrees of freedom, 1 single actuators. limits: of the degrees of freedom, default `pose_limits`.

    buffer_s: latency that the user gives for certainty, default the machine's `[controller] host_buffer_s`.
    buffer: takes the packets. reference: pose (6,) of the setpoint last given. limited: whether it had to be held back.
    """

    def __init__(
        self, machine: Machine, preview: int, limits: Limits | None = None, buffer_s: float | None = None
    ) -> None:
        self.kinematics, self.tick_s = machine.mechanics, 1.0 / machine.controller.rate_Hz
        self.buffer = HostBuffer(machine.controller.host_buffer_s if buffer_s is None else buffer_s)
        self._dofs = self.kinematics.dof_places
        self._limiters = CommandLimiter(limits or pose_limits(machine)), CommandLimiter(leg_limits(machine))
        self._cushions = machine.of_legs("cylinder", "cushion_length_m")
        self.mode, self.limited = 0, False
        self.look(preview)

    def look(self, preview: int) -> None:
        """So many ticks ahead from now on, from rest at neutral."""
        self.buffer.ahead_s = (preview - 1) * self.tick_s
        self._legs, self._poses = np.zeros((preview, self.kinematics.n_legs)), np.zeros((preview, 6))
        self.start(self.mode)

    def start(self, mode: int) -> None:
        """Begin at rest at neutral."""
        self.mode, self.limited = mode, False
        limiter = self._limiters[mode]
        limiter.position[:], limiter.velocity[:] = 0.0, 0.0
        self._legs[:], self._poses[:] = self.kinematics.neutral_positions, 0.0

    @property
    def reference(self) -> Array:
        return self._poses[0]

    def rows(self, now_s: float) -> Array:
        """Piston setpoints (preview, n_legs) of this tick and the next ones."""
        limiter = self._limiters[self.mode]
        chosen = self._dofs if self.mode == 0 else slice(len(limiter.position))
        position, velocity, acceleration = (value[chosen] for value in self.buffer.target(now_s - self.tick_s))
        command = limiter.step(position, velocity, acceleration, self.tick_s)
        self._legs[:-1], self._poses[:-1] = self._legs[1:], self._poses[1:]
        if self.mode == 0:
            self._poses[-1, self._dofs] = command
            positions = self.kinematics.piston_positions(self._poses[-1])
        else:
            positions = self.kinematics.neutral_positions + command
        self._legs[-1], held = soft_legs(positions, self.kinematics.stroke_m, self._cushions)
        self.limited = limiter.limited or held
        return self._legs.copy()
