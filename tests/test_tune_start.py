"""`hexsim tune`: start parameters from the twin, taken by other commands in place of a compensator's name."""

import json

import pytest
from typer.testing import CliRunner

import hexsim as hx
from hexsim.cli import app

BRIEF = {"scenario.duration_s": 0.5, "scenario.fade_s": 0.1}


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
    done = hx.run("heave", "bench", str(path), BRIEF)
    assert done.summary["compensator"] == found["compensator"] == "adaptive" and len(found["legs"]) == 1
    assert json.loads(path.read_text()) == found
    with pytest.raises(hx.HexsimError, match=r"is for 1 legs; micro_motion_system has 6: tune that machine"):
        hx.run("heave", "micro_motion_system", str(path), BRIEF)
    with pytest.raises(hx.HexsimError, match=r"cannot read start parameters .*: make them|; make them with"):
        hx.run("heave", "bench", str(path.parent / "none.json"), BRIEF)
    wrong = path.parent / "wrong.json"
    wrong.write_text(json.dumps({"compensator": "adaptive", "legs": [{}]}))
    with pytest.raises(
        hx.HexsimError, match=r"wrong\.json, leg 1: start parameters of adaptive: .+ is missing; learn them anew"
    ):
        hx.run("heave", "bench", str(wrong), BRIEF)


def test_a_leg_without_start_parameters_stays_under_plain_control(taught) -> None:
    """null in the place of a leg's parameters: nothing is added to it, and the other five start with what a bench has learned."""
    path, found = taught
    partly = path.parent / "partly.json"
    partly.write_text(json.dumps({"compensator": "adaptive", "legs": [None, *found["legs"] * 5]}))
    done = hx.run("heave", "micro_motion_system", str(partly), BRIEF)
    assert [leg["reason"] for leg in done.summary["compensation"]] == ["plain control was asked for", *[""] * 5]
    added = done.log.select([f"compensation_{leg}_V" for leg in range(1, 7)]).to_numpy().any(axis=0)
    assert added.tolist() == [False, *[True] * 5]


def test_an_algorithm_that_learns_nothing_is_refused(tmp_path) -> None:
    """The exact inverse has no parameters to start with."""
    refused = CliRunner().invoke(app, ["tune", "bench", "--compensator", "none", "--out", str(tmp_path / "none")])
    assert refused.exit_code == 2 and "learns nothing: give adaptive or repetitive" in refused.stderr
    assert not (tmp_path / "none").exists()
