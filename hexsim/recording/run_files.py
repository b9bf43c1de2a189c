"""Everything a run leaves: log, summary, configuration, figures, report and recording, written into one folder."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w

from hexsim import __version__
from hexsim.machine.files import machine_tables
from hexsim.recording.atomic import write_text
from hexsim.recording.formats import LogFormat
from hexsim.recording.log_files import write_log
from hexsim.recording.signals import Signals

if TYPE_CHECKING:
    from hexsim.simulation import Run

VERSIONS_OF = ("mujoco", "numpy", "scipy", "numba", "polars")
MIN_ROWS = 100  # of a log that figures and a recording are made of


def write_run(
    run: Run,
    folder: Path,
    *,
    log_format: LogFormat = "parquet",
    recording: bool = True,
    report: bool = True,
    step: Callable[[str], None] = lambda name: None,
) -> list[Path]:
    """Write the files of a run into `folder`; `step(name)` is called before each. A very short run has no plots."""
    written = [folder / f"log.{log_format}", folder / "config.toml", folder / "summary.json"]
    step("log")
    write_log(run.log, written[0])
    write_text(written[1], tomli_w.dumps(config_tables(run)))
    if any(run.compensator_parameters):
        written.append(folder / "learned.json")
        write_json(written[-1], {"compensator": run.compensator, "legs": run.compensator_parameters})
    if run.log.height >= MIN_ROWS:
        written += _write_plots(run, folder, recording=recording, report=report, step=step)
    write_json(written[2], summary_of(run))
    return written


def _write_plots(run: Run, folder: Path, *, recording: bool, report: bool, step: Callable[[str], None]) -> list[Path]:
    """Figures with the report, and the recording."""
    signals, written = Signals.of_run(run), []
    if report:
        from hexsim.recording.figure_style import png
        from hexsim.recording.figures import run_figures
        from hexsim.recording.report import run_report

        step("figures")
        pictures = {name: png(figure) for name, figure in run_figures(signals).items()}
        (folder / "figures").mkdir(exist_ok=True)
        for name, data in pictures.items():
            written.append(folder / "figures" / f"{name}.png")
            written[-1].write_bytes(data)
        written.append(folder / "report.html")
        write_text(written[-1], run_report(run, pictures))
    if recording:
        from hexsim.recording.rerun_recording import write_recording
        from hexsim.recording.summary_table import markdown

        step("recording")
        label = run.scenario.name
        text = {label: markdown(run.summary, signals.driven_axes, run)}
        written.append(folder / "run.rrd")
        write_recording(written[-1], {label: signals}, text, {label: run.messages})
    return written


def summary_of(run: Run) -> dict[str, Any]:
    """summary.json; an interrupted or diverged run says so."""
    if run.complete:
        return run.summary
    return {**run.summary, "partial": True, "reason": run.reason}


def config_tables(run: Run) -> dict[str, Any]:
    """All that was resolved: with it the run can be repeated to the bit on the same versions."""
    return plain(
        {
            "run": {
                "scenario": run.scenario.name,
                "machine": run.machine.name,
                "compensator": run.compensator,
                "seed": run.seed,
                "model": run.model,
                "scheme": run.scheme,
                "complete": run.complete,
                "reason": run.reason,
            },
            "versions": {"hexsim": __version__, "python": platform.python_version(), **_versions()},
            "scenario": run.scenario.to_dict(),
            "machine": machine_tables(run.machine),
        }
    )


def _versions() -> dict[str, str]:
    found = {}
    for name in VERSIONS_OF:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def write_json(path: Path, data: Any) -> None:
    """Write strict JSON whole or not at all."""
    write_text(path, dumps(data) + "\n")


def dumps(data: Any) -> str:
    """Strict JSON: what is not a finite number becomes null."""
    return json.dumps(plain(data, none_for_nan=True), indent=2, allow_nan=False, ensure_ascii=False)


def plain(data: Any, none_for_nan: bool = False) -> Any:
    """numpy values, tuples and paths as what JSON and TOML hold; keys without a value go, unless `none_for_nan`."""
    if isinstance(data, Mapping):
        items = {str(key): plain(value, none_for_nan) for key, value in data.items()}
        return items if none_for_nan else {key: value for key, value in items.items() if value is not None}
    if isinstance(data, np.ndarray):
        data = data.tolist()
    if isinstance(data, (list, tuple)):
        return [plain(value, none_for_nan) for value in data]
    if isinstance(data, np.generic):
        data = data.item()
    if isinstance(data, float) and not math.isfinite(data):
        return None if none_for_nan else data
    if isinstance(data, Path):
        return str(data)
    return data
