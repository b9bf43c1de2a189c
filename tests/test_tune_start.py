"""`hexsim tune`: start parameters from the twin, taken by other commands in place of a compensator's name."""

import json

import pytest
from typer.testing import CliRunner

from hexsim import HexsimError
from hexsim.cli import app
from hexsim.machine import load_machine
from hexsim.simulation import make_compensators


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tune") / "start"
    ended = CliRunner().invoke(app, ["tune", "bench", "--out", str(folder), "--json"])
    return folder / "compensator.json", json.loads(ended.stdout)


def test_the_second_reversal_is_compensated(taught) -> None:
    """Bench, 0.05 m 0.5 Hz: the second bump is less than a third of plain control's 0.84 m/s2, the last ones less than a fifteenth."""
    _, found = taught
    plain_m_s2 = max(bump for _, bump in found["plain_m_s2"])
    assert found["second_m_s2"] < plain_m_s2 / 3 and found["final_m_s2"] < plain_m_s2 / 15


def test_the_file_is_taken_as_a_compensator(taught) -> None:
    """By the name that it teaches, one a leg; a machine with other legs, and files that are none, are refused."""
    path, found = taught
    name, made = make_compensators(str(path), load_machine("bench"))
    assert name == found["compensator"] == "adaptive" and len(made) == 1
    assert json.loads(path.read_text()) == found
    with pytest.raises(HexsimError, match=r"is for 1 legs; micro_motion_system has 6: tune that machine"):
        make_compensators(str(path), load_machine("micro_motion_system"))
    with pytest.raises(HexsimError, match=r"cannot read start parameters .*: make them|; make them with"):
        make_compensators(str(path.parent / "none.json"), load_machine("bench"))
    wrong = path.parent / "wrong.json"
    wrong.write_text(json.dumps({"compensator": name, "legs": [{}]}))
    with pytest.raises(
        HexsimError, match=rf"wrong\.json, leg 1: start parameters of {name}: .+ is missing; learn them anew"
    ):
        make_compensators(str(wrong), load_machine("bench"))


def test_a_leg_without_start_parameters_stays_under_plain_control(taught) -> None:
    """null in the place of a leg's parameters: it gets plain control's compensator, the other five the one that starts."""
    path, found = taught
    partly = path.parent / "partly.json"
    partly.write_text(json.dumps({"compensator": "adaptive", "legs": [None, *found["legs"] * 5]}))
    _, made = make_compensators(str(partly), load_machine("micro_motion_system"))
    assert [one.name for one in made] == ["none"] + ["adaptive"] * 5


def test_an_algorithm_that_learns_nothing_is_refused(tmp_path) -> None:
    """The exact inverse has no parameters to start with."""
    refused = CliRunner().invoke(app, ["tune", "bench", "--compensator", "none", "--out", str(tmp_path / "none")])
    assert refused.exit_code == 2 and "learns nothing: give adaptive or repetitive" in refused.stderr
    assert not (tmp_path / "none").exists()
