"""Everything a run leaves: log, summary, configuration, figures, report and recording, written into one folder."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import tomli_w

from hexsim.errors import HexsimError
from hexsim.files.atomic import write_text
from hexsim.files.formats import LogFormat
from hexsim.files.json_files import write_json
from hexsim.files.log_files import write_log
from hexsim.recording.config import config_tables, summary_of
from hexsim.recording.mcap import write_mcap
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
    mcap: bool = False,
    step: Callable[[str], None] = lambda name: None,
) -> list[Path]:
    """Write the files of a run into `folder`; `step(name)` is called before each. A very short run has no plots."""
    step("log")
    written = [folder / name for name in write_essentials(run, folder, log_format)]
    if mcap:
        step("mcap")
        written.append(folder / "run.mcap")
        write_mcap(run, written[-1])
    if run.log.height >= MIN_ROWS:
        written += _write_plots(run, folder, recording=recording, report=report, step=step)
    return written


def write_essentials(run: Run, folder: Path, log_format: LogFormat, only_what_fits: bool = False) -> list[str]:
    """Log, configuration, summary and what a compensator learned: all but plots; their names.

    only_what_fits: on a full disk, what is there already stays, and what cannot be written is left out.
    """
    learned = {"compensator": run.compensator, "legs": run.compensator_parameters}
    files: dict[str, Callable[[Path], None]] = {
        f"log.{log_format}": lambda path: write_log(run.log, path),
        "config.toml": lambda path: write_text(path, tomli_w.dumps(config_tables(run))),
    }
    if any(run.compensator_parameters):
        files["learned.json"] = lambda path: write_json(path, learned)
    files["summary.json"] = lambda path: write_json(path, summary_of(run))
    if not only_what_fits:
        for name, write in files.items():
            write(folder / name)
        return list(files)
    for name in reversed(files):  # the log last: it is the large one
        with suppress(HexsimError, OSError):
            if not (folder / name).exists():
                files[name](folder / name)
    return [name for name in files if (folder / name).exists()]


def _write_plots(run: Run, folder: Path, *, recording: bool, report: bool, step: Callable[[str], None]) -> list[Path]:
    """Figures with the report, and the recording; matplotlib and rerun are loaded for what is asked."""
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
        write_text(written[-1], run_report(run, pictures, signals))
    if recording:
        from hexsim.recording.rerun_recording import write_recording

        step("recording")
        label = run.scenario.name
        text = {label: markdown(run.summary, signals.driven_axes, run)}
        written.append(folder / "run.rrd")
        write_recording(written[-1], {label: signals}, text, {label: run.messages})
    return written
