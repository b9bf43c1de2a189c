"""A trace is a sequence of steps: each says what it decided; bad or poor logs end in a sentence; Ctrl-C ends it."""

import os
import re
import shutil
import signal
import threading
from contextlib import suppress
from pathlib import Path

import polars as pl
import pytest
from typer.testing import CliRunner

import hexsim as hx
from hexsim.cli import app
from hexsim.tracing import trace as tracing

DATA = Path(__file__).parents[1] / "data" / "bench_none"
DOCS = Path(__file__).parents[2] / "docs" / "tracing.md"


def poor_machine(folder: Path, columns: list[str], seconds: float = 4.0) -> Path:
    """The measured bench with these columns alone and the first seconds of each log."""
    shutil.copy(DATA / "machine.toml", folder)
    for name in ("fit", "validate"):
        log = pl.read_csv(DATA / f"{name}.csv.gz").filter(pl.col("time_s") < seconds)
        log.select("time_s", *columns).write_csv(folder / f"{name}.csv")
    return folder


def test_time_and_position_alone_drive_no_model(tmp_path):
    """Neither setpoint nor volts: refused with a sentence that says what nothing can be said without."""
    with pytest.raises(
        hx.HexsimError, match=r"log fit has no valve_V.*nothing drives the model.*log the valve's volts"
    ):
        hx.trace(poor_machine(tmp_path, ["position_m"]))


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("drive", [pytest.param("valve_V", marks=pytest.mark.slow), "setpoint_m"])
def test_position_and_one_drive_end_in_a_verdict(tmp_path, drive):
    """With no pressure and no acceleration there is no balance: the trace says so and judges by the position alone."""
    result = hx.trace(poor_machine(tmp_path, ["position_m", drive]))
    assert result.verdict in ("nothing missing", "unexplained") and result.report["balances"] == []
    (lost,) = (
        f["description"] for f in result.report["findings"]["all logs"] if "cannot be formed" in f["description"]
    )
    assert "pressure_bottom_Pa" in lost and "continuity, controller, force, sensor, supply" in lost
    page = (result.to_folder(tmp_path / "out") / "report.html").read_text(encoding="utf-8")
    assert lost.split(":")[0] in page.replace("&#39;", "'")
    assert result.report["steps"][1]["sentence"] == "the logs allow no balance"


def test_every_step_says_what_it_decided(tmp_path):
    """report.json lists the steps in their order, as docs/tracing.md does, each with seconds and one sentence."""
    result = hx.trace(poor_machine(tmp_path, ["position_m", "setpoint_m"]))
    names = re.findall(r"^\d+\. \*\*(.*?)\*\*:", DOCS.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(names) > 5 and [line["name"] for line in result.report["steps"]] == names
    for line in result.report["steps"]:
        assert line["seconds"] >= 0.0 and len(line["sentence"]) > 5 and "\n" not in line["sentence"]


def test_one_log_cannot_be_fitted_and_held_out(tmp_path):
    """A held-out log must be another one than those of the fit, however it is named."""
    folder = poor_machine(tmp_path, ["position_m", "setpoint_m"])
    with pytest.raises(hx.HexsimError, match=r"log .*fit\.csv is given to fit and to validate"):
        hx.trace(folder, ["fit"], ["validate", str(folder / "fit.csv")])


def test_a_library_that_swallows_ctrl_c_does_not_hold_a_trace_up(tmp_path, monkeypatch):
    """The work is in a thread, the signal's answer is not: exit code 130 and a sentence within a second, nothing written."""
    before = signal.getsignal(signal.SIGINT)  # ignored where a shell started the tests in the background
    over = threading.Event()

    def swallowing(folder, fit, validate, out, progress, load_kg, loaded, keep, mapping):
        os.kill(os.getpid(), signal.SIGINT)
        while not over.wait(0.05):
            with suppress(KeyboardInterrupt):
                progress("as if nothing had been", 0.1)

    def ended(code):
        raise SystemExit(code)

    monkeypatch.setattr(tracing, "trace", swallowing)
    monkeypatch.setattr(os, "_exit", ended)
    result = CliRunner().invoke(app, ["trace", str(DATA), "--out", str(tmp_path / "out")])
    over.set()
    assert result.exit_code == 130
    assert "interrupted by the user; nothing was known yet and nothing was kept" in result.stderr
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(signal.SIGINT) is before
