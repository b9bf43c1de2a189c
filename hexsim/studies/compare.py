"""The same scenario, machine and seed with several compensators, side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w

import compensation
from compensation import Compensator
from hexsim.errors import HexsimError
from hexsim.files.atomic import write_text
from hexsim.files.formats import LogFormat
from hexsim.files.json_files import write_json
from hexsim.files.log_files import write_log
from hexsim.files.run_folder import file_name
from hexsim.machine import Machine, load_machine
from hexsim.recording.config import config_tables, summary_of
from hexsim.recording.felt import bump_chart, felt_of
from hexsim.recording.figure_style import png
from hexsim.recording.figures import comparison
from hexsim.recording.report import comparison_report
from hexsim.recording.rerun_recording import write_recording
from hexsim.recording.run_files import MIN_ROWS
from hexsim.recording.signals import Signals
from hexsim.recording.summary_table import comparison_rows, markdown
from hexsim.scenarios import Scenario
from hexsim.scenarios.settings import loaded
from hexsim.simulation import Run, make_compensators, simulate
from hexsim.simulation.hosted import Host


def names_of(text: str | None, machine: Machine | None = None) -> list[str]:
    """The compensators of a comma-separated list, checked; all that work without configuration when None."""

    machine = machine or load_machine("bench")
    if text is None:
        return [name for name in compensation.available() if _makes(name)]
    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not names:
        raise HexsimError("--compensators is empty: give names separated by commas, for example none,buffered")
    for name in names:
        make_compensators(name, machine)  # an unknown one is refused before the first run
    return names


def _makes(name: str) -> bool:

    try:
        compensation.create(name)
    except (ValueError, TypeError):
        return False
    return True


def compare(
    machine: Machine | str | Path,
    scenario: Scenario | str | Path,
    compensators: Sequence[str | Compensator],
    *,
    fast: bool = False,
    seed: int = 0,
    timestep: float | None = None,
    host: Host | None = None,
    progress: Callable[[str, float], None] = lambda name, fraction: None,
) -> dict[str, Run]:
    """Name -> run, in the order given, each a name or an object. progress(name, fraction of that run).

    host: its packets drive the machine.

    A diverged run stays in the comparison and is marked; an interruption ends the comparison after the run it met.
    """

    machine, scenario = loaded(machine, scenario)
    runs: dict[str, Run] = {}
    for one in compensators:
        name = one if isinstance(one, str) else one.name
        runs[name] = simulate(
            machine,
            scenario,
            compensator=one,
            fast=fast,
            seed=seed,
            timestep=timestep,
            host=host,
            progress=lambda f, name=name: progress(name, f),
        )
        if runs[name].interrupted:
            break
    return runs


def comparison_tables(runs: Mapping[str, Run]) -> dict[str, Any]:
    """compare.json."""

    first = next(iter(runs.values()))
    people = felt_of(runs)
    summaries = {name: {**summary_of(run), "felt": people.get(name, {})} for name, run in runs.items()}
    return {"scenario": first.scenario.name, "compensators": summaries}


def write_comparison(
    runs: Mapping[str, Run],
    folder: Path,
    *,
    log_format: LogFormat = "parquet",
    recording: bool = True,
    step: Callable[[str], None] = lambda name: None,
) -> None:
    """compare.json, config.toml, logs, figures of the driven axes, report.html, one recording on a common time line."""

    write_json(folder / "compare.json", comparison_tables(runs))
    write_text(folder / "config.toml", tomli_w.dumps(config_tables(next(iter(runs.values())))))
    step("logs")
    for name, run in runs.items():
        write_log(run.log, folder / "logs" / f"{file_name(name)}.{log_format}")
    signals = {name: Signals.of_run(run, name) for name, run in runs.items() if run.log.height >= MIN_ROWS}
    pictures: dict[str, bytes] = {}
    if signals:
        step("figures")
        for axis in next(iter(signals.values())).driven_axes:
            peaks = {
                row["name"]: row["peak_band"] for row in comparison_rows(runs, axis) if row["peak_band"] is not None
            }
            figure = comparison(signals, axis, peaks)
            if figure is not None:
                pictures[f"comparison_{axis}"] = png(figure)
            if (chart := bump_chart(signals, axis)) is not None:
                pictures[f"bumps_{axis}"] = png(chart)
        (folder / "figures").mkdir(exist_ok=True)
        for name, data in pictures.items():
            (folder / "figures" / f"{name}.png").write_bytes(data)
    write_text(folder / "report.html", comparison_report(runs, pictures, signals))
    if recording and signals:
        step("recording")
        texts = {name: markdown(runs[name].summary, s.driven_axes, runs[name]) for name, s in signals.items()}
        write_recording(folder / "run.rrd", signals, texts, {name: run.messages for name, run in runs.items()})
