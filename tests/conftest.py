"""Machines that many tests share. Machines are frozen, so one of each serves the session."""

import os
from pathlib import Path

import pytest

from hexsim.hydraulics.parameters import declared_rows
from hexsim.machine import Machine, load_machine

os.environ["HEXSIM_NO_PROGRESS"] = "1"  # stderr holds sentences alone, on a slow computer and with an empty cache too
TESTS = Path(__file__).parent
COMPILES = ("compensation", "export", "hydraulics", "motion_computer", "plant")  # half of all tests
NEEDS_LITTLE = ("inference", "machine", "own", "readers", "recording", "signals", "tracing", "web")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """With an empty cache a third of the suite's time is compilation, and workers that need a function at once all compile it.

    So one of two workers begins with what compiles, and the other with what needs little of it.
    """

    def turn(item: pytest.Item) -> int:
        folder = item.path.relative_to(TESTS).parts[0]
        return 0 if folder in COMPILES else 1 if folder in NEEDS_LITTLE else 2

    items.sort(key=turn)


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
    return declared_rows(bench)[0]
