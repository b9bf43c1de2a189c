"""Progress of long commands: a line every few seconds where there is no terminal, and what compiling costs."""

import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from numba.core import event

from hexsim.cli import console


def test_without_a_terminal_progress_is_lines(monkeypatch, capsys):
    """The work that is going on, its share and the time left, once a period; nothing after the end."""
    monkeypatch.setattr(console, "LINE_EVERY_s", 0.05)
    monkeypatch.delenv("HEXSIM_NO_PROGRESS")
    with console.progress() as bar:
        done = console.fraction_of(bar, "heave on [bench]")
        for share in (0.0, 0.25, 0.5):
            done(share)
            time.sleep(0.12)
        done(1.0)
        console.step_of(bar)("figures")
        time.sleep(0.12)
    said = capsys.readouterr().err.splitlines()
    assert "hexsim: heave on [bench]: 0 %" in said
    assert any(line.startswith("hexsim: heave on [bench]: 50 %, about ") and line.endswith(" s left") for line in said)
    assert said[-1] == "hexsim: writing figures"
    time.sleep(0.12)
    assert capsys.readouterr().err == ""


def test_a_line_of_progress_says_that_it_compiles(monkeypatch, capsys):
    """While a compensator is compiled for a minute, 0 % alone would look like a standstill; afterwards the words are gone."""
    monkeypatch.setattr(console, "LINE_EVERY_s", 0.05)
    monkeypatch.delenv("HEXSIM_NO_PROGRESS")
    with console.progress() as bar:
        console.fraction_of(bar, "adaptive")(0.0)
        kept = SimpleNamespace(_cache=SimpleNamespace(_cache_file="step.nbi"))  # numba says so of what it keeps
        with event.trigger_event("numba:compile", data={"dispatcher": kept}):
            time.sleep(0.12)
        time.sleep(0.12)
    said = capsys.readouterr().err.splitlines()
    assert "hexsim: adaptive: 0 %, compiling (once)" in said and said[-1] == "hexsim: adaptive: 0 %"


@pytest.mark.slow  # compiles every equation anew
def test_compiling_is_said_and_is_no_part_of_the_speed(tmp_path):
    """With an empty cache the command says that it compiles; with a full one it does not; both report the same
    kind of real-time factor (counted with its compilation the first would be a hundredth of the second)."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "NUMBA_CACHE_DIR": str(tmp_path / "c")}
    del environment["HEXSIM_NO_PROGRESS"]
    arguments = ["run", "heave", "-m", "bench", "--duration", "1", "--no-report", "--no-recording", "--json", "--out"]
    said, factors = [], []
    for name in ("cold", "warm"):
        ended = subprocess.run(
            [sys.executable, "-m", "hexsim", *arguments, str(tmp_path / name)],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        said.append(ended.stderr.count("compiling (once)"))
        factors.append(float(ended.stdout.split('"realtime_factor": ')[1].split(",")[0]))
    assert said[0] >= 1 and said[1] == 0
    assert factors[0] > 0.1 * factors[1]
