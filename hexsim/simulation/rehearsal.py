"""Everything a drive calls, called once before a host is listened to: what is not compiled yet is compiled then.

A second motion computer with the same compensators goes through its states for a few ticks each, on readings of a
machine that follows it perfectly. Nothing of it is kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from compensation import Compensator
from hexsim.declaration import Machine
from hexsim.motion_computer.computer import MotionComputer
from hexsim.motion_computer.host_packet import HostCommand
from hexsim.motion_computer.host_setpoints import HostSetpoints
from hexsim.motion_computer.states import State


def rehearse(
    machine: Machine,
    compensators: Sequence[Compensator],
    *,
    four_way: bool,
    n_ticks: int = 40,  # in each state
) -> None:
    """four_way: readings hold the rod sides' pressures too."""
    computer = MotionComputer(machine, compensators, None, state=State.NORMAL)
    host, n, tick_s = HostSetpoints(machine, computer.preview), machine.n_legs, 1.0 / machine.controller.rate_Hz
    half, supply = np.full(n, 0.5 * machine.supply.pressure_Pa), machine.supply.pressure_Pa
    positions, now, sequence = computer.neutral.copy(), 0.0, 0
    for mode, event in ((0, ""), (1, ""), (0, "return_neutral"), (0, "settle")):
        if event:
            computer.command(event, now)
        host.start(mode)
        for _ in range(n_ticks):
            pose = tuple(1e-4 * np.sin(10.0 * now + np.arange(6.0)))
            host.buffer.add(HostCommand(sequence=sequence, time_s=now, setpoints=pose, mode=mode), now)
            computer.last_packet_s = now
            rows = host.rows(now) if computer.state == State.NORMAL else None
            computer.tick(now, rows, positions, half, supply, *((half,) if four_way else ()))
            positions = computer.setpoint.copy()
            now, sequence = now + tick_s, sequence + 1
    machine.mechanics.forward(positions, guess=np.zeros(6))
    computer.learned()
