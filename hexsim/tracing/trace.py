"""`trace`: a declared machine and its logs in, a verdict out. The steps are those of docs/tracing.md."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from hexsim.errors import HexsimError
from hexsim.tracing.report.content import report_of, write_report
from hexsim.tracing.report.incomplete import write_incomplete
from hexsim.tracing.state import Step, StepRecord, Trace
from hexsim.tracing.steps import STEPS
from hexsim.tracing.steps.logs import begin
from hexsim.tracing.store import FILE, Asked, Stored, save

Progress = Callable[[str, float], None]
Keep = Callable[[Trace], None]
READING = WRITING = 1.0 / (len(STEPS) + 2)  # shares of the progress bar: as much as a usual step


def trace(
    machine_folder: Path | str,
    fit: Sequence[str] = ("fit",),
    validate: Sequence[str] = ("validate",),
    out: Path | str | None = None,
    progress: Progress | None = None,
    load_kg: float | None = None,
    loaded: Sequence[str] = (),
    keep: Keep | None = None,
    mapping: Path | None = None,
) -> Trace:
    """Identify the effects that the declared machine is missing in its logs.

    fit: logs that everything is chosen and fitted on; validate: held-out logs. Raises HexsimError for bad data.
    load_kg: what people can put on the machine, default its `load.additional_mass_kg`; loaded: logs taken with it on.
    mapping: file for foreign names and units of all logs; default mapping.toml beside each.
    Writes report.json, machine.toml, report.html and scenarios into `out` if given; where it fails or is interrupted, a report of
    what is known until then.  keep: called with the state as each step ends, see `kept_in`.
    """
    tell = progress or (lambda step, fraction: None)
    tell("reading logs", 0.0)
    started = time.perf_counter()
    state = recorded(begin(machine_folder, fit, validate, load_kg, loaded, mapping), "logs", started)
    return gone_through(state, str(machine_folder), out, tell, keep)


def resume(
    folder: Path | str, out: Path | str | None = None, progress: Progress | None = None, keep: Keep | None = None
) -> Trace:
    """Go on with the trace whose state stands in a folder, from the step that it was in; the result is the same.

    Raises HexsimError where there is no such state, or the logs or the machine file have changed since.
    """
    tell = progress or (lambda step, fraction: None)
    tell("reading logs", 0.0)
    stored = Stored(Path(folder))
    stored.check_same_files()
    asked = stored.asked
    fresh = begin(asked.machine, asked.fit, asked.validate, asked.load_kg, asked.loaded, asked.mapping_file)
    state = stored.state([*fresh.fit_problem.logs, *fresh.validate_problem.logs])
    return gone_through(state, asked.machine, out, tell, keep)


def kept_in(folder: Path, asked: Asked) -> Keep:
    """A `keep` that writes the state into a folder, from which `resume` goes on. The machine and the logs are those of now."""
    hashes = asked.hashes()

    def keep(state: Trace) -> None:
        save(state, asked, hashes, folder)

    return keep


def forget(folder: Path) -> None:
    """Remove a state that a finished trace needs no more."""
    with suppress(OSError):
        (folder / FILE).unlink()


def gone_through(state: Trace, machine: str, out: Path | str | None, tell: Progress, keep: Keep | None) -> Trace:
    """The state after all steps that are not done yet."""
    begun = len(state.steps) == 1
    done, scale = READING, (1.0 - READING - WRITING) / sum(step.share for step in STEPS)
    try:
        if keep is not None and begun:
            keep(state)
        for step, left in zip(STEPS, range(len(STEPS), 0, -1), strict=True):
            if len(STEPS) - left >= len(state.steps) - 1:
                tell(step.doing, done)
                state = taken(state, step, machine, lambda doing, done=done: tell(doing, done))
                if keep is not None:
                    keep(state)
            done += scale * step.share
        state = replace(state, report=report_of(state))
        if out is not None:
            tell("writing the report", 1.0 - WRITING)
            write_report(state, Path(out), machine)
    except BaseException as error:
        if out is not None:
            with suppress(Exception):  # the first error is the one to tell
                write_incomplete(state, Path(out), why_of(error))
        raise
    tell("done", 1.0)
    return state


def taken(state: Trace, step: Step, machine: str, tell: Callable[[str], None]) -> Trace:
    """The state after a step, with its line."""
    started = time.perf_counter()
    try:
        state = step.run(state, tell)
    except np.linalg.LinAlgError as error:
        raise HexsimError(
            f"trace of {machine}, step {step.name}: its least squares has no solution ({error}). The logs do not "
            "follow this machine at all: check signs and units of the columns, and that valve_V is a valve's command"
        ) from error
    return recorded(state, step.name, started)


def why_of(error: BaseException) -> str:
    """Why a trace ended before its end, for its report."""
    if isinstance(error, KeyboardInterrupt):
        return "it was interrupted"
    return str(error) if isinstance(error, HexsimError) else f"it failed: {type(error).__name__}: {error}"


def recorded(state: Trace, name: str, started: float) -> Trace:
    """The state with a line for the step that has just ended."""
    line = StepRecord(name=name, seconds=time.perf_counter() - started, sentence=state.decided)
    return replace(state, steps=(*state.steps, line), decided="")
