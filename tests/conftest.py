"""Machines that many tests share. Machines are frozen, so one of each serves the session."""

import gc
import os
from functools import cache

import compiled_first
import pytest
import typer.testing

from hexsim import Machine
from hexsim.hydraulics import parameters
from hexsim.machine import load_machine

# the signatures of all commands are read once, and not with every call of one
typer.testing._get_command = cache(typer.testing._get_command)
os.environ["HEXSIM_NO_PROGRESS"] = "1"  # stderr holds sentences alone, on a slow computer and with an empty cache too


def pytest_sessionstart(session) -> None:
    """Each of several workers compiles a part of what most tests stand on."""
    if given := getattr(session.config, "workerinput", None):
        first, step = int(given["workerid"].removeprefix("gw")), given["workercount"]
        for part in compiled_first.PARTS[first::step]:
            part()


def pytest_collection_finish() -> None:
    """What the imports have left is no garbage: collections during the tests pass it over, and come a fifteenth as often as
    Python's default, which takes a fifteenth of the tests' time."""
    gc.freeze()
    gc.set_threshold(10_000)


@pytest.fixture(scope="session")
def bench() -> Machine:
    """One vertical leg with 40 kg."""
    return load_machine("bench")


@pytest.fixture(scope="session")
def hexapod() -> Machine:
    """The 600 kg machine."""
    return load_machine("micro_motion_system")


@pytest.fixture
def row(bench):
    """A fresh row (N_PARAMETERS,) of the bench's leg, to be changed at will."""
    return parameters.declared_rows(bench)[0]


@pytest.fixture
def undrawn(monkeypatch):
    """Figures stay white, half of a page's time, where a test looks at none; another test of the same page draws it."""
    monkeypatch.setattr("hexsim.recording.figure_style.FigureCanvasAgg.draw", lambda canvas: canvas.get_renderer())
