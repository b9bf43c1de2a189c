"""An algorithm is one file: in the package, in a folder on the path, or announced by an installed distribution."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

import compensation
from compensation import Context, Sample

ALGORITHM = '''
from dataclasses import dataclass
from compensation.compensator import Compensator


@dataclass(frozen=True, kw_only=True)
class Constant(Compensator):
    """Adds the same volts at every tick.

    A second paragraph, which lists do not show.
    """

    name: str = "constant"
    added_V: float = 0.01
    variants = {"constant_large": {"added_V": 0.02}}

    def start(self, context):
        return None

    def step(self, state, sample):
        return self.added_V, state

    def parameters(self, state):
        return {}

    def restore(self, context, parameters):
        return None
'''


@pytest.fixture
def algorithm_file(tmp_path, monkeypatch):
    """A folder that holds constant_algorithm.py; what is imported from it is forgotten afterwards."""
    (tmp_path / "constant_algorithm.py").write_text(ALGORITHM)
    yield tmp_path
    for name in ("constant_algorithm", "compensation.constant_algorithm"):
        sys.modules.pop(name, None)
    vars(compensation).pop("constant_algorithm", None)


def added_V(name: str) -> float:
    """Volts of the first tick of the algorithm called so."""
    made = compensation.create(name)
    at_rest = Sample(0.0, 0.1, np.full(1, 0.1), 0.1, 0.0, 0.0, 3.3e6, 7e6)
    return made.step(made.start(Context()), at_rest)[0]


def test_a_file_in_the_package_is_an_algorithm(algorithm_file, monkeypatch) -> None:
    """A module beside the built-in ones, with no entry anywhere: it and its variant are listed after them, created,
    and described."""
    before = compensation.available()
    monkeypatch.setattr(compensation, "__path__", [*compensation.__path__, str(algorithm_file)])
    assert compensation.available() == [*before, "constant", "constant_large"]
    assert (added_V("constant"), added_V("constant_large")) == (0.01, 0.02)
    assert compensation.create("constant").description == "Adds the same volts at every tick."
    assert compensation.create("constant_large").description == "Adds the same volts at every tick. (added_V 0.02)"


def test_a_file_on_the_path_is_an_algorithm(algorithm_file, monkeypatch) -> None:
    """module:Class from a folder on the path is created, with its configuration."""
    monkeypatch.syspath_prepend(str(algorithm_file))
    assert added_V("constant_algorithm:Constant") == 0.01
    assert compensation.create("constant_algorithm:Constant", added_V=0.03).inner.added_V == 0.03


def test_an_announced_file_is_an_algorithm(algorithm_file, monkeypatch) -> None:
    """A distribution on the path with an entry point in the group hexsim.compensators: its algorithm is listed after
    the built-in ones and created by its name."""
    about = algorithm_file / "constant_algorithm-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: constant-algorithm\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[hexsim.compensators]\nsteady = constant_algorithm:Constant\n")
    before = compensation.available()
    monkeypatch.syspath_prepend(str(algorithm_file))
    assert compensation.available() == [*before, "steady"]
    assert added_V("steady") == 0.01


def test_an_announced_file_that_does_not_load_is_named(tmp_path, monkeypatch) -> None:
    """An entry point whose module is missing is listed, and refused with its name and the reason."""
    about = tmp_path / "broken-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[hexsim.compensators]\nbroken = no_such_module:Thing\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "broken" in compensation.available()
    with pytest.raises(ValueError, match="'broken' is announced by an installed package but does not load: No module"):
        compensation.create("broken")


def test_the_list_describes_the_algorithms_and_not_the_guard() -> None:
    """`hexsim list compensators`: every algorithm has a description of its own, and none is the guard's."""
    from hexsim.cli import app

    done = CliRunner().invoke(app, ["list", "compensators", "--json"])
    rows = {row["name"]: row["what it is"] for row in json.loads(done.stdout)}
    assert list(rows)[:2] == ["none", "exact"]
    assert len(set(rows.values())) == len(rows)
    assert not any("guard" in text for text in rows.values())
    assert rows["exact"].startswith("Inverse of a known flow curve")
    assert rows["iterative_report_1"].endswith("(function 1, form report)")
