"""`trace`: a declared machine and its logs in, a verdict out. The steps are those of docs/tracing.md."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hexsim.errors import HexsimError
from hexsim.tracing.report.content import report_of, write_report
from hexsim.tracing.state import StepRecord, Trace
from hexsim.tracing.steps import STEPS
from hexsim.tracing.steps.logs import begin

Progress = Callable[[str, float], None]
READING, WRITING = 0.02, 0.06  # shares of the time of a usual trace


def trace(
    machine_folder: Path | str,
    fit: Sequence[str] = ("fit",),
    validate: Sequence[str] = ("validate",),
    out: Path | str | None = None,
    progress: Progress | None = None,
    load_kg: float | None = None,
    loaded: Sequence[str] = (),
) -> Trace:
    """Hold the declared machine against its logs and name what it lacks.

    fit: logs that everything is chosen and fitted on; validate: held-out logs. Raises HexsimError for bad data.
    load_kg: what people can put on the machine, default its `load.additional_mass_kg`; loaded: logs taken with it on.
    Writes report.json, machine.toml, report.html and scenarios into `out` if given.
    """
    tell = progress or (lambda step, fraction: None)
    tell("reading logs", 0.0)
    started = time.perf_counter()
    state = recorded(begin(machine_folder, fit, validate, load_kg, loaded), "logs", started)
    done, scale = READING, (1.0 - READING - WRITING) / sum(step.share for step in STEPS)
    for step in STEPS:
        tell(step.doing, done)
        started = time.perf_counter()
        try:
            state = step.run(state, lambda doing, done=done: tell(doing, done))
        except np.linalg.LinAlgError as error:
            raise HexsimError(
                f"trace of {machine_folder}, step {step.name}: its least squares has no solution ({error}). The logs do not "
                "follow this machine at all: check signs and units of the columns, and that valve_V is a valve's command"
            ) from error
        state = recorded(state, step.name, started)
        done += scale * step.share
    state = replace(state, report=report_of(state))
    if out is not None:
        tell("writing the report", 1.0 - WRITING)
        write_report(state, Path(out))
    tell("done", 1.0)
    return state


def recorded(state: Trace, name: str, started: float) -> Trace:
    """The state with a line for the step that has just ended."""
    line = StepRecord(name=name, seconds=time.perf_counter() - started, sentence=state.decided)
    return replace(state, steps=(*state.steps, line), decided="")
