"""Everything a run leaves: log, summary, configuration, figures, report and recording, written into one folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import tomli_w

from hexsim.files.atomic import write_text
from hexsim.files.formats import LogFormat
from hexsim.files.json_files import write_json
from hexsim.files.log_files import write_log
from hexsim.recording.config import config_tables, summary_of
from hexsim.recording.figure_style import png
from hexsim.recording.figures import run_figures
from hexsim.recording.report import run_report
from hexsim.recording.rerun_recording import write_recording
from hexsim.recording.signals import Signals
from hexsim.recording.summary_table import markdown
from hexsim.simulation import Run

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
        step("figures")
        pictures = {name: png(figure) for name, figure in run_figures(signals).items()}
        (folder / "figures").mkdir(exist_ok=True)
        for name, data in pictures.items():
            written.append(folder / "figures" / f"{name}.png")
            written[-1].write_bytes(data)
        written.append(folder / "report.html")
        write_text(written[-1], run_report(run, pictures))
    if recording:
        step("recording")
        label = run.scenario.name
        text = {label: markdown(run.summary, signals.driven_axes, run)}
        written.append(folder / "run.rrd")
        write_recording(written[-1], {label: signals}, text, {label: run.messages})
    return written
