"""Simulations that answer a log: same setpoints, same start."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import Log
from hexsim.tracing.attempt import attempted
from hexsim.tracing.memory import latest
from hexsim.tracing.simulation import closed_loop as loop
from hexsim.tracing.simulation import motion
from hexsim.tracing.simulation.rig import Rig, rig_of
from hexsim.tracing.simulation.start import outputs, shot, start_state

Array = np.ndarray


def simulate_log(
    machine: Machine,
    log: Log,
    feedback: int,
    noise: Mapping[str, float],
    off_Pa: Array | float = 0.0,
    volts_share: float = 0.0,
) -> dict[str, Array]:
    """Outputs as the sensors show them, without noise; NaN after a divergence, and all of it of a machine that cannot be built.

    position, valve, pressure_bottom, pressure_top, pressure_difference (n_legs, n); pressure_supply (n,);
    acceleration (1, n) of a bench, (3, n) of a platform, angular_acceleration (3, n) of a platform.
    noise: of the channels by kind, which weighs what the start of the log shows. off_Pa (n_legs,): added to the pressures at
    the bottom in which it begins. volts_share: see `rig.Controller`.
    """
    out = attempted(lambda: simulated_or_refused(machine, log, feedback, noise, off_Pa, volts_share))
    if out is not None:
        return out
    return outputs(np.full((4 * log.n_legs + 1 + (1 if log.n_legs == 1 else 6), log.n), np.nan), log.n_legs)


def simulated_or_refused(
    machine: Machine,
    log: Log,
    feedback: int,
    noise: Mapping[str, float],
    off_Pa: Array | float = 0.0,
    volts_share: float = 0.0,
) -> dict[str, Array]:
    """`simulate_log` that raises for a machine that cannot be built, with the reason."""
    finer = samples_of_sample(log.rate, float(machine.controller.rate_Hz))
    fine = log.finer(finer) if finer > 1 else log
    rig, resolved = rig_of(machine, feedback, fine.loaded, fine.rate, volts_share if finer == 1 else 0.0)
    inputs = inputs_of(fine, rig)
    start = shot(rig, inputs, start_state(rig, resolved, fine), fine, noise)
    start[motion.LEGS + motion.LEG_P1 : motion.LEGS + log.n_legs * motion.LEG_STATES : motion.LEG_STATES] += off_Pa
    out = outputs(answer_of(fine, rig, inputs, start), log.n_legs)
    return out if finer == 1 else {name: rows[..., ::finer] for name, rows in out.items()}


def answer_of(log: Log, rig: Rig, inputs: loop.Inputs, start: Array) -> Array:
    """`loop.answer`, read-only. The latest are kept while the log lives: refits begin where the last one ended."""
    each = log.n * start.itemsize * (4 * log.n_legs + 1 + len(rig.sensors.acceleration))
    most = 32 * 2**20 // each  # bytes: a refit's columns are asked for again by the next, weighed otherwise
    if most < 2:  # of a log of minutes
        return loop.answer(rig, inputs, start)
    return latest(log, "answer", (numbers_of(rig), start.tobytes()), lambda: loop.answer(rig, inputs, start), most)


def numbers_of(value: Any) -> Hashable:
    """All numbers of nested tuples and arrays, as a key."""
    if isinstance(value, tuple):
        return tuple(numbers_of(part) for part in value)
    return value.tobytes() if isinstance(value, np.ndarray) else value


def inputs_of(log: Log, rig: Rig) -> loop.Inputs:
    """What of a log drives the simulation."""
    nothing = np.zeros((log.n_legs, log.n))
    return loop.Inputs(
        setpoint=nothing if log.setpoint is None else log.setpoint,
        volts=nothing if log.volts is None else log.volts,
        position=log.position,
        near_rest=log.near_rest,
        rate_Hz=float(log.rate),
        first_tick=log.tick_phase(max(round(log.rate / rig.controller.rate_Hz), 1)),
        start_s=log.offset_s,
        slow_share=-math.expm1(-log.crossover_rad_s / log.rate),  # leaves the loop 52 degrees of phase margin
    )


def samples_of_sample(rate_Hz: float, controller_Hz: float) -> int:
    """Samples of the simulation for one of a log: a slow log is simulated with all ticks of its controller."""
    least = int(np.ceil(controller_Hz / rate_Hz * (1.0 - 1e-6)))
    if least <= 1:
        return 1
    even = (k for k in range(least, 4 * least + 1) if abs(k * rate_Hz / controller_Hz % 1.0) < 1e-6)
    return next(even, least)
