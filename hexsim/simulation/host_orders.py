"""What a host orders, given to the motion computer: commands, setpoints, compensators."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.motion_computer.compensator_packet import AskedCompensator
from hexsim.motion_computer.computer import MotionComputer
from hexsim.motion_computer.errors import Error, Finding
from hexsim.motion_computer.host_packet import HostCommand
from hexsim.motion_computer.host_setpoints import HostSetpoints
from hexsim.motion_computer.states import State
from hexsim.packets import Refusals
from hexsim.simulation.asked_compensators import AskedCompensators
from hexsim.simulation.manual import SignalGenerator

Array = NDArray[np.float64]


class HostOrders:
    """refused: whether the last order was; refusals: how often, by reason. messages: (time [s], leg or 0, text), added to.
    compensator: name of what acts."""

    def __init__(
        self,
        machine: Machine,
        computer: MotionComputer,
        generator: SignalGenerator,
        host: HostSetpoints,
        messages: deque[tuple[float, int, str]],
    ) -> None:
        self.computer, self.generator, self.host, self.messages = computer, generator, host, messages
        self.asked = AskedCompensators(machine)
        self.refused, self.refusals, self.compensator = False, Refusals(), "none"

    def execute(self, command: HostCommand, now: float) -> None:
        """Give the host's command to the motion computer."""
        if command.command == "none":
            return
        try:
            self.computer.command(command.command, now)
        except HexsimError as error:
            return self._refuse(error, now)
        self.refused = False
        if command.command == "run_normal":
            self.host.start(command.mode)
        elif command.command == "run_manual":
            self.generator.restart()

    def compensate(self, asked: AskedCompensator, now: float) -> None:
        """Take the host's compensator, while nothing moves."""
        try:
            found = self.asked.take(asked, self._check_at_rest)
            if found is None:
                return
        except HexsimError as error:
            return self._refuse(error, now)
        self.refused = False
        self.computer.loop.compensate(found)
        self.asked.accept()
        self.compensator, self.generator.preview = found[0].name if found else "none", self.computer.preview
        self.host.look(self.computer.preview)

    def _check_at_rest(self) -> None:
        if self.computer.state not in (State.OFF, State.NEUTRAL) or not self.computer.arrived:
            raise HexsimError("a compensator is taken in off, or standing in neutral")

    def _refuse(self, error: HexsimError, now: float) -> None:
        self.refused = True
        self.refusals.note(str(error))
        self.messages.append((now, 0, f"refused: {error}"))

    def setpoints(self, now: float) -> Array | None:
        """Piston setpoints (preview, n_legs) of manual or normal mode."""
        if self.computer.state == State.MANUAL:
            return self.generator.rows()
        if self.computer.state != State.NORMAL:
            return None
        rows = self.host.rows(now)
        finding = Finding(error=Error.WORKSPACE, detail="the host's setpoint is beyond the limits")
        self.computer.warn(now, finding, self.host.limited)
        return rows
