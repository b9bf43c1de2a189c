"""`hexsim run` of a machine of one's own: fit where nothing was fitted yet, free runs of every log, what they leave."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from markupsafe import Markup

from hexsim.files.json_files import write_json
from hexsim.files.log_files import write_log
from hexsim.inference.likelihood import Fit
from hexsim.inference.verdict import at_end
from hexsim.own.declaration import ModelTables
from hexsim.own.folder import OwnFolder
from hexsim.own.problem import OwnProblem, fit_own, problem_of
from hexsim.own.simulate import Record, Simulator, record_of, records_of
from hexsim.recording import palette
from hexsim.recording.figure_style import png
from hexsim.recording.page import Column, Report, Section, table
from hexsim.recording.quantity import quantity
from hexsim.recording.zoom import Curve, Panel, still, zoomable
from hexsim.signals.log import Log

Array = np.ndarray


def run_folder_of(folder: OwnFolder, out: Path | None, tell=lambda step, share: None) -> dict[str, Any]:
    """Fit the runs of [runs] fit, simulate every run from its inputs, write logs, report.json and report.html into `out`."""
    tell("compiling the equations", 0.05)
    problem = problem_of(folder.model, folder.fit, folder.where)
    tell("fitting", 0.2)
    fitted = fit_own(problem)
    tell("simulating", 0.8)
    made = {log.name: simulated(fitted, log, folder.where) for log in (*folder.fit, *folder.validate)}
    report = report_of(folder, fitted, {name: rms for name, (_, rms) in made.items()})
    if out is not None:
        tell("writing the report", 0.9)
        out.mkdir(parents=True, exist_ok=True)
        for name, (table, _) in made.items():
            write_log(table, out / f"{name.replace('/', '_')}.parquet")
        write_json(out / "report.json", report)
        (out / "report.html").write_text(page(folder, report, made), encoding="utf-8")
    tell("done", 1.0)
    return report


def simulated(fitted: Fit, log: Log, where: str) -> tuple[pl.DataFrame, dict[str, float]]:
    """The log with a column `simulated_NAME` for every output and hidden state, and rms of each output's residual, of one free run."""
    model = simulator_of(fitted).model
    record = record_of(model, log, where)
    problem, theta = along(fitted, [record])
    free = problem.free_run(0, theta)
    hidden = [(name, free.states[:, k]) for k, name in enumerate(model.states) if name not in model.outputs]
    columns = [(name, free.outputs[:, k]) for k, name in enumerate(model.outputs)] + hidden
    table = log.table.with_columns([pl.Series(f"simulated_{name}", values) for name, values in columns])
    left, count = (free.outputs - record.measured) * record.weight, record.weight.sum(axis=0)
    rms = {name: float(np.sqrt(np.sum(left[:, k] ** 2) / count[k])) for k, name in enumerate(model.outputs) if count[k]}
    return table, rms


def mean_squares(folder: OwnFolder, fitted: Fit) -> Array:
    """Mean square of each output's residual over the runs of [runs] validate, begun anew as in a fit. Infinite after a divergence."""
    records = [one for log in folder.validate for one in records_of(simulator_of(fitted).model, log, folder.where)]
    problem, theta = along(fitted, records)
    left = problem.residuals(theta, range(len(problem.pieces)))
    total = sum((np.sum(one**2, axis=0) for one in left), np.zeros(len(problem.channels)))
    count = sum((one.weight.sum(axis=0) for one in records), np.zeros(len(problem.channels)))
    return np.nan_to_num(total[count > 0] / count[count > 0], nan=np.inf)


def along(fitted: Fit, records: list[Record]) -> tuple[OwnProblem, Array]:
    """The problem of other records, and the numbers of the fit there."""
    problem, known = OwnProblem(simulator_of(fitted), records), dict(zip(fitted.names, fitted.theta, strict=True))
    theta = [known.get(number.name, mean_of(number.name, known, number.start)) for number in problem.numbers]
    return problem, np.array(theta)


def simulator_of(fitted: Fit) -> Simulator:
    assert isinstance(fitted.problem, OwnProblem)
    return fitted.problem.simulator


def mean_of(name: str, known: Mapping[str, float], start: float) -> float:
    """Of a number that each run has of its own: its mean over the runs that were fitted."""
    if " of " not in name:
        return start
    stem = name.rsplit(" of ", 1)[0] + " of "
    values = [value for key, value in known.items() if key.startswith(stem)]
    return float(np.mean(values)) if values else start


def report_of(folder: OwnFolder, fitted: Fit, rms: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """The content of report.json."""
    declared = folder.declaration.parameters
    units = {name: table.unit for name, table in folder.declaration.outputs.items()}
    held_out, ends = {log.name for log in folder.validate}, at_end(fitted)
    return {
        "machine": folder.name,
        "numbers": {
            name: {
                "value": float(value),
                "standard_error": float(error),
                "unit": declared[name].unit if name in declared else "",
                "declared": declared[name].declared if name in declared else None,
                "at_bound": name in ends,
            }
            for name, value, error in zip(fitted.names, fitted.theta, fitted.errors, strict=True)
        },
        "runs": {
            run: {"held_out": run in held_out, "rms": dict(of_output), "unit": units} for run, of_output in rms.items()
        },
    }


def page(
    folder: OwnFolder, report: Mapping[str, Any], made: Mapping[str, tuple[pl.DataFrame, dict[str, float]]]
) -> str:
    """report.html: each run's outputs, measured and simulated, and what is left."""
    return Report(
        f"Free run of {folder.name}", sections(report, pictures(folder.declaration, made)), about=ABOUT
    ).html()


def pictures(declaration: ModelTables, made: Mapping[str, Any]) -> list[Markup]:
    """Figure of each run's outputs, measured and simulated."""
    units = {name: output.unit for name, output in declaration.outputs.items()}
    return [figure_of(name, output, units[output], free) for name, (free, rms) in made.items() for output in rms]


def figure_of(run: str, output: str, unit: str, table: pl.DataFrame) -> Markup:
    """A run's output over time, to be looked at closely, with its picture."""
    time, measured, free = (table[name].to_numpy() for name in ("time_s", output, f"simulated_{output}"))
    upper = [Curve("measured", measured, palette.REFERENCE, 2.0), Curve("simulated", free, palette.RESPONSE)]
    lower = [Curve("simulated less measured", free - measured, palette.DEVIATION)]
    panels = [
        Panel(f"{output} of {run} [{unit or '1'}]", time, upper),
        Panel(f"difference [{unit or '1'}]", time, lower),
    ]
    return zoomable(panels, png(still(panels, f"{output} of {run}")), CAPTION, SEEN)


def sections(report: Mapping[str, Any], pictures: Sequence[Markup]) -> list[Section]:
    """Runs with their figures, and numbers: what every page of a simulated machine has."""
    runs = [
        (run, "never seen by the fit" if of["held_out"] else "fitted", output, quantity(rms, of["unit"][output]))
        for run, of in report["runs"].items()
        for output, rms in of["rms"].items()
    ]
    every = report["numbers"].values()
    declared, bound = any(n["declared"] is not None for n in every), any(n["at_bound"] for n in every)
    numbers = [
        (
            name,
            quantity(n["value"], n["unit"], 5),
            quantity(n["standard_error"], n["unit"], 2),
            *([quantity(n["declared"], n["unit"], 5) if n["declared"] is not None else ""] if declared else []),
            *(["at its bound" if n["at_bound"] else ""] if bound else []),
        )
        for name, n in report["numbers"].items()
    ]
    of_runs = table(["run", Column("", "text"), Column("output", "text"), "rms of the residual"], runs)
    heads = [
        "number",
        "value",
        "± one standard error",
        *(["declared"] if declared else []),
        *([Column("", "wide")] if bound else []),
    ]
    return [
        Section("Runs", [of_runs, *pictures]),
        Section("Numbers", [table(heads, numbers)]),
    ]


ABOUT = "Simulated from recorded inputs and the first samples of each run."
CAPTION = (
    "How far is a free run from what was measured? "
    "Above measured and simulated from the inputs and the first samples alone, below simulated less measured."
)
SEEN = "Measured, and simulated from the inputs and the first samples alone."
