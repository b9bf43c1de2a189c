"""Scenario files: what they may say, and one sentence for what they may not."""

from pathlib import Path

import pytest
import tomli_w

import hexsim as hx
from hexsim import HexsimError, load_scenario
from hexsim.machine import load_machine
from hexsim.scenarios import scenario_from_dict
from hexsim.simulation import simulate

HEAVE = {"name": "mine", "duration_s": 0.1, "axes": {"z": {"kind": "sine", "amplitude": 0.01, "frequency_Hz": 1.0}}}


@pytest.mark.parametrize("name", hx.available()["scenarios"])
def test_tables_make_the_scenario_again(name):
    """to_dict and scenario_from_dict are each other's inverse, for every scenario that travels with hexsim."""
    scenario = load_scenario(name)
    assert scenario_from_dict(scenario.to_dict()) == scenario


def test_the_old_name_of_the_description_is_read():
    """Files written before the key was renamed say `says`."""
    assert scenario_from_dict({**HEAVE, "says": "up and down"}).description == "up and down"


def test_a_scenario_without_a_name_bears_its_files(tmp_path):
    """The stem of the file."""
    (tmp_path / "rocking.toml").write_text(tomli_w.dumps({"axes": HEAVE["axes"]}))
    assert load_scenario(tmp_path / "rocking.toml").name == "rocking"


WRONG = [
    ({"figures_from_s": "abc"}, r"figures_from_s = 'abc': a number is needed, without quotes, in SI units"),
    ({"figures_from_s": float("nan")}, r"figures_from_s = nan: input should be a finite number"),
    ({"machine": "x"}, r"machine = 'x': must be a table"),
    ({"machine": [float("nan")]}, r"machine = \[nan\]: must be a table"),
    ({"faults": 3}, r"faults = 3: must be a list"),
    ({"faults": ["x"]}, r"faults = 'x': must be a table"),
    ({"machine_name": 3}, r"machine_name = 3: input should be a valid string"),
    ({"name": "a\0b"}, r"name = 'a\\x00b': must be printable"),
    ({"name": "a\x1b[31mb"}, r"must be printable"),
    ({"name": "x" * 300}, r"at most 100 characters"),
    ({"axes": {"z": float("inf")}}, r"\[axes\] z = inf: must be a table"),
    ({"axes": {"z": "x"}}, r"\[axes\] z = 'x': must be a table"),
    ({"axes": {"z": {"kind": ["sine"]}}}, r"\[axes\.z\] kind = \['sine'\]: allowed are constant, sine"),
    ({"axes": {"w": {"kind": "constant"}}}, r"unknown axis 'w'; in mode 'dof' give any of x, y, z"),
    ({"axes": 3}, r"axes = 3: must be a table"),
    ({"mode": "legs"}, r"mode = 'legs': input should be 'dof' or 'actuator'"),
    ({"duration_s": 0.0}, r"duration_s = 0.0: input should be greater than 0"),
    ({"duration_s": 1e308}, r"duration_s = 1e\+308: input should be less than or equal to 86400"),
    ({"colour": "red"}, r"colour is not a known key: allowed are name, description, mode"),
    ({"axes": {"z": {"kind": "constant_velocity_strokes", "cycles": 10**18}}}, r"1 to 1000 is possible"),
]


@pytest.mark.parametrize(("change", "description"), WRONG, ids=lambda value: str(value)[:40])
def test_what_no_scenario_says_is_refused(change, description):
    """Each ended in a traceback or was taken in silence: one short sentence that names file, key, value and what is
    allowed."""
    with pytest.raises(HexsimError, match=description) as caught:
        scenario_from_dict({**HEAVE, **change}, "mine.toml")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 500


FAULTS = [
    ({"kind": "valve_stuck", "leg": 1.0, "time_s": 0.0}, r"fault 1 \(valve_stuck\): leg = 1.0: .*valid integer"),
    ({"kind": "valve_stuck", "leg": 1, "time_s": 0.0, "at": {}}, r"fault 1 \(valve_stuck\): \[at\]: .*'open', 'shut'"),
    ({"kind": "pump_trip", "time_s": 1e308}, r"time_s = 1e\+308: .*0 to 86400 is possible"),
    ({"kind": ["pump_trip"], "time_s": 0.0}, r"fault 1: kind = \['pump_trip'\]: allowed are valve_stuck"),
    ({}, r"fault 1: kind = None: allowed are valve_stuck"),
]


@pytest.mark.parametrize(("fault", "description"), FAULTS, ids=lambda value: str(value)[:40])
def test_a_fault_that_cannot_be_is_refused_before_the_run(fault, description):
    """Kind, key, what was given and what is allowed."""
    with pytest.raises(HexsimError, match=description):
        simulate(load_machine("bench"), scenario_from_dict({**HEAVE, "faults": [fault]}))


@pytest.mark.parametrize("path", ["x" * 300, "x\0y", ""])
def test_names_that_no_file_can_have_are_unknown_scenarios(path):
    """300 characters, a NUL: the sentence lists what there is."""
    with pytest.raises(HexsimError, match=r"unknown scenario .*give one of combined, "):
        load_scenario(path)


@pytest.mark.parametrize("path", ["nosuch.toml", "x" * 300 + ".toml", "a/../../b.csv", "folder/heave"])
def test_a_file_that_is_not_there_is_no_unknown_scenario(path):
    """What can only be a file is said to be absent, and from where it was sought; a file of another kind is said to be one."""
    with pytest.raises(HexsimError, match=r"there is no scenario file .*: check the path, from /"):
        load_scenario(path)
    with pytest.raises(HexsimError, match=r"test_scenario_files.py is no scenario file"):
        load_scenario(__file__)


def test_names_and_files_stand_for_machine_and_scenario():
    """simulate("bench", "heave.toml") runs; what is neither is refused in a sentence."""
    path = str(Path(hx.__file__).parent / "scenarios" / "heave.toml")
    with pytest.raises(HexsimError, match=r"duration .* is shorter than two samples"):
        simulate("bench", load_scenario(path, duration_s=1e-4))
    with pytest.raises(HexsimError, match=r"unknown machine 'benc'"):
        simulate("benc", path)
    with pytest.raises(HexsimError, match=r"a dict stands where a Scenario is needed: give one, its name, as 'heave'"):
        simulate("bench", {"name": "heave"})


def test_amplitudes_and_frequencies_of_the_command_line_are_checked():
    """--amplitude nan and --frequency 0 are refused by the signal's own bounds."""
    with pytest.raises(HexsimError, match=r"amplitude = nan: input should be a finite number"):
        load_scenario("heave", amplitude=float("nan"))
    with pytest.raises(HexsimError, match=r"frequency_Hz = 0: .*1e-06 to 1000 is possible"):
        load_scenario("heave", frequency_Hz=0)


def test_settings_reach_signals_and_faults_are_kept():
    """`scenario.axes.z.amplitude` changes the signal, and the rest of the scenario stays."""
    scenario = load_scenario("heave", duration_s=0.05)
    changed = hx.run(scenario, set={"scenario.axes.z.amplitude": 0.02}, fast=True).scenario
    assert changed.signals["z"].amplitude == 0.02
    assert {**changed.to_dict(), "axes": None} == {**scenario.to_dict(), "axes": None}
    with pytest.raises(HexsimError, match=r"leads through 31 tables"):
        hx.run(scenario, set={".".join(["valve"] * 32): 1.0})
