"""`hexsim trace` of a folder with balances of its own: verdicts, budget, what remains, the fitted file."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from hexsim.files.json_files import write_json
from hexsim.own.declaration import Declaration
from hexsim.own.files import FILES
from hexsim.own.state_file import StateFile
from hexsim.tracing.own.analysis import OwnTrace, next_step, trace_balance
from hexsim.tracing.own.events import said
from hexsim.tracing.own.folder import OwnMachine, load_own
from hexsim.tracing.own.page import own_page

Progress = Callable[[str, float], None]


def trace_folder(
    folder: Path, fit: Sequence[str] = (), validate: Sequence[str] = (), out: Path | None = None,
    progress: Progress | None = None, keep: Callable[[dict[str, Any]], None] = lambda report: None,
    state: StateFile | None = None,
) -> tuple[OwnMachine, list[OwnTrace], dict[str, Any]]:  # fmt: skip
    """Every balance of the folder traced; report.json, report.html and fitted balances.toml in `out` if given. keep: called with the
    report of the balances that are traced, as each ends. state: what was fitted until now, and where it is kept."""
    tell, started = progress or (lambda step, share: None), time.perf_counter()
    tell("reading logs", 0.0)
    machine = load_own(folder, fit, validate)
    notes = None
    if state is not None:
        files = [folder / name for name in (*FILES, "mapping.toml")]
        notes = state.notebook(files, [point.log for point in (*machine.fit, *machine.validate)])
    traces = []
    for k, balance in enumerate(machine.balances):
        tell(f"balance {balance.name}", 0.1 + 0.8 * k / len(machine.balances))
        traces.append(trace_balance(balance, machine, notes))
        keep(report_of(machine, traces, time.perf_counter() - started))
    report = report_of(machine, traces, time.perf_counter() - started)
    if out is not None:
        tell("writing the report", 0.92)
        out.mkdir(parents=True, exist_ok=True)
        write_json(out / "report.json", report)
        (out / "report.html").write_text(own_page(machine, traces, report), encoding="utf-8")
        text = tomli_w.dumps(fitted(machine.declaration, traces, folder).model_dump(by_alias=True, exclude_none=True))
        (out / "balances.toml").write_text(text, encoding="utf-8")
        if (folder / "mapping.toml").is_file():
            (out / "mapping.toml").write_bytes((folder / "mapping.toml").read_bytes())
    tell("done", 1.0)
    return machine, traces, report


def report_of(machine: OwnMachine, traces: Sequence[OwnTrace], seconds: float) -> dict[str, Any]:
    """The content of report.json."""
    return {
        "machine": machine.name,
        "verdict": {trace.balance.name: trace.verdict.verdict for trace in traces},
        "balances": [entry_of(trace) for trace in traces],
        "findings": machine.sentences,
        "seconds": round(seconds, 2),
    }


def entry_of(trace: OwnTrace) -> dict[str, Any]:
    verdict, declared = trace.verdict, {term.name: term for term in trace.balance.terms}
    units = {term.name: term.unit for term in (*trace.balance.terms, *trace.balance.candidates)}
    return {
        "name": verdict.balance,
        "unit": verdict.unit,
        "verdict": verdict.verdict,
        "remarks": trace.remarks,
        "named": list(verdict.named),
        "coefficients": {
            name: {
                "value": value, "standard_error": error, "unit": units[name],
                "declared": declared[name].declared if name in declared else None,
            }
            for name, (value, error) in verdict.coefficients.items()
        },
        "places": {name: {"place": at, "spread": finite(spread)} for name, (at, spread) in verdict.places.items()},
        "refused": list(verdict.refused),
        "budget": [
            {"run": fold.held_out, "held_out": "fold", "declared": fold.declared, "refit": fold.refit,
             "with_terms": fold.with_terms, "chosen": list(fold.chosen), "acting": fold.acting}
            for fold in verdict.folds
        ] + [{"run": run, "held_out": "validate", **row} for run, row in trace.held_out.items()],
        "rest_share": verdict.rest_share,
        "depends_on": {"signal": verdict.depends_on[0], "r2": verdict.depends_on[1]},
        "extremes": trace.extremes,
        "events": {run: [event.to_json() for event in found] for run, found in trace.events.items() if found},
        "pulses": {run: said(found, trace.balance.unit) for run, found in trace.events.items() if found},
        "detectable": {name: {"theta_min": finite(size), "unit": unit} for name, (size, unit) in trace.detectable.items()},
        "next": next_step(trace),
    }  # fmt: skip


def finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


def fitted(asked: Declaration, traces: Sequence[OwnTrace], folder: Path) -> Declaration:
    """The declaration with fitted values; named candidates are terms now, hinges where they were found."""
    tables = []
    for table, trace in zip(asked.balances, traces, strict=True):
        numbers, places = trace.verdict.coefficients, trace.verdict.places

        def known(one: Any, numbers: dict[str, tuple[float, float]] = numbers, places: dict = places) -> Any:
            value, error = numbers[one.name]
            place = places[one.name][0] if one.name in places else one.place
            return one.model_copy(update={"declared": value, "uncertainty": max(error, 0.0), "place": place})

        named = [known(one) for one in table.candidates if one.name in trace.verdict.named]
        rest = [one for one in table.candidates if one.name not in trace.verdict.named]
        tables.append(
            table.model_copy(update={"terms": [known(one) for one in table.terms] + named, "candidates": rest})
        )
    runs = asked.runs.model_copy(update={"folder": str((folder / asked.runs.folder).resolve())})
    return asked.model_copy(update={"balances": tables, "runs": runs})
