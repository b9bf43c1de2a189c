"""Measured, declared and fitted on one time line: the held-out logs of a trace as Rerun recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hexsim.machine import Machine
from hexsim.readers import log_files, read_log
from hexsim.recording.rerun_recording import entity_name, write_recording
from hexsim.recording.signals import Signals
from hexsim.signals.channels import noise_of
from hexsim.signals.log import Log
from hexsim.signals.table import measured_columns
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps.logs import feedback_of


def write_trace_recordings(
    folder: Path,
    names: Sequence[str],
    declared: Machine,
    fitted: Machine,
    out: Path,
    text: str = "",
    mapping: Path | None = None,
) -> list[Path]:
    """One recording a held-out log: `out`/<log>.rrd. `folder` holds the machine's logs, `text` says what was found."""
    written = []
    for name in names:
        log = read_log(log_files(folder, name), mapping, declared)
        written.append(out / f"{entity_name(log.name)}.rrd")
        write_recording(written[-1], replayed(log, {"declared": declared, "fitted": fitted}), {"measured": text})
    return written


def replayed(log: Log, machines: Mapping[str, Machine]) -> dict[str, Signals]:
    """The measured log, and each machine's answer to it as fits see it; `deviation` is from the measured acceleration.

    A log without setpoints stands alone, and so does one that a machine cannot follow.
    """
    first = next(iter(machines.values()))
    begun = replace(log, time=log.time - log.time[0])
    seen = Signals(log=begun, machine=first, label="measured")
    reference = {axis: values for axis in seen.axes if (values := seen.acceleration(axis)) is not None}
    shown = {"measured": replace(seen, reference=reference)}
    if log.setpoint is None:
        return shown
    noise = noise_of(first, [log])
    problem = SimulatedProblem(logs=(log,), noise=noise, feedback=feedback_of(first, [log], noise))
    answers = in_parallel(lambda machine: problem.simulated(machine, 0), machines.values())
    for (label, machine), answer in zip(machines.items(), answers, strict=True):
        if np.all(np.isfinite(answer.position)):
            columns = {key: answer.columns[key] for key in measured_columns(log.n_legs) if key in answer.columns}
            own = Log(name=label, kind=log.kind, time=begun.time, rate=log.rate, columns=columns)
            shown[label] = Signals(log=own, machine=machine, label=label, measured=True, reference=reference)
    return shown
