"""Simulations that answer a log: same setpoints, same start."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import Log
from hexsim.tracing.simulation import closed_loop as loop
from hexsim.tracing.simulation.rig import rig_of
from hexsim.tracing.simulation.start import outputs, shot, start_state

Array = np.ndarray


def simulate_log(machine: Machine, log: Log, feedback: int, noise: Mapping[str, float]) -> dict[str, Array]:
    """Outputs as the sensors show them, without noise; NaN after a divergence.

    position, valve, pressure_bottom, pressure_top, pressure_difference (n_legs, n); pressure_supply (n,);
    acceleration (1, n) of a bench, (3, n) of a platform, angular_acceleration (3, n) of a platform.
    noise: of the channels by kind, which weighs what the start of the log shows.
    """
    rig, resolved = rig_of(machine, feedback)
    nothing = np.zeros((log.n_legs, log.n))
    inputs = loop.Inputs(
        setpoint=nothing if log.setpoint is None else log.setpoint,
        volts=nothing if log.volts is None else log.volts,
        position=log.position,
        near_rest=log.near_rest,
        rate_Hz=float(log.rate),
    )
    start = shot(rig, inputs, start_state(rig, resolved, log), log, noise)
    return outputs(loop.answer(rig, inputs, start), log.n_legs)
