"""JSON schemas: what editors check a machine or scenario file against."""

import copy
import json
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

import hexsim
from hexsim.cli import app
from hexsim.hydraulics import effects

MODELS = Path(__file__).parents[1] / "models"
DATA = Path(__file__).parent / "data"
SCENARIO_FILES = Path(hexsim.__file__).parent / "scenarios"
MACHINES = [*MODELS.glob("*/*.toml"), *DATA.glob("*/machine.toml")]
SCENARIOS = list(SCENARIO_FILES.glob("*.toml"))


def schema_of(what):
    """What `hexsim export schema` prints."""
    return json.loads(CliRunner().invoke(app, ["export", "schema", what]).stdout)


@pytest.fixture(scope="module")
def machine():
    return Draft202012Validator(schema_of("machine"))


@pytest.fixture(scope="module")
def scenario():
    return Draft202012Validator(schema_of("scenario"))


def test_there_are_files_to_check():
    """The lists below are not empty by mistake."""
    assert len(MACHINES) >= 7 and len(SCENARIOS) >= 12


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_machine_file_has_the_form(machine, path):
    """All machines that travel with hexsim, and those of the tests."""
    machine.validate(tomllib.loads(path.read_text()))


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_every_scenario_file_has_the_form(scenario, path):
    """All scenarios that travel with hexsim."""
    scenario.validate(tomllib.loads(path.read_text()))


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("valve", "overlap_mm", 5.0),
        ("valve", "voltage_max_V", 1e300),
        ("load", "moving_mass_kg", "40"),
        ("machine", "kind", "tripod"),
        ("effects", "null_offset", {"offset_V": 50.0}),
        ("effects", "no_such_effect", {}),
    ],
)
def test_a_bad_machine_file_has_not(machine, table, key, value):
    """An unknown key, an impossible value, a text for a number, and an effect out of bounds."""
    tables = tomllib.loads((MODELS / "bench" / "machine.toml").read_text())
    tables.setdefault(table, {})[key] = value
    assert not machine.is_valid(tables)


@pytest.mark.parametrize(
    "change",
    [
        {"axes": {"z": {"kind": "sinus"}}},
        {"axes": {"z": {"kind": "sine", "amplitude": 0.1}}},
        {"faults": [{"kind": "pump_trip"}]},
        {"faults": [{"kind": "valve_stuck", "leg": 1, "time_s": 1.0, "at": "ajar"}]},
        {"colour": "red"},
        {"figures_from_s": "abc"},
    ],
    ids=str,
)
def test_a_bad_scenario_file_has_not(scenario, change):
    """An unknown kind, a missing key, a fault without its time or with a wrong word, an unknown key."""
    good = tomllib.loads((SCENARIO_FILES / "heave.toml").read_text())
    assert not scenario.is_valid({**copy.deepcopy(good), **change})


def test_every_key_says_what_it_is(machine):
    """Each number of the machine's tables has a description with its unit in brackets."""
    for name, table in machine.schema["$defs"].items():
        for key, field in table["properties"].items():
            assert "description" in field, f"{name}.{key}"
            if field.get("type") == "number":
                assert field["description"].endswith("]") or "[" in field["description"], f"{name}.{key}"
    assert set(machine.schema["properties"]["effects"]["properties"]) == set(effects.library())


def test_a_mapping_is_checked_and_each_key_says_what_it_is():
    """A mapping with every key is valid, one with a key that there is not is none; each key has a description."""
    schema = json.loads(CliRunner().invoke(app, ["export", "schema", "mapping"]).stdout)
    mapping = Draft202012Validator(schema)
    whole = {
        "from": "a",
        "unit": "mm",
        "offset": 0.1,
        "delay_s": 0.0,
        "time": "t",
        "missing": [-9.0],
        "held": True,
        "unwrap": 9.0,
    }
    assert mapping.is_valid({"kind": "bench", "file": {"header_row": 3}, "columns": {"position_{leg}_m": whole}})
    assert not mapping.is_valid({"columns": {"position_m": {"form": "a"}}})
    for table in ("FileLayout", "Channel"):
        assert all("description" in field for field in schema["$defs"][table]["properties"].values())


@pytest.mark.parametrize("what", ["machine", "scenario", "mapping"])
def test_the_command_prints_or_writes_it(tmp_path, what):
    """`hexsim export schema machine` on stdout, `--out` into a file: the same."""
    printed = CliRunner().invoke(app, ["export", "schema", what])
    assert (
        printed.exit_code == 0
        and CliRunner().invoke(app, ["export", "schema", what, "-o", str(tmp_path / "s.json")]).exit_code == 0
    )
    assert json.loads(printed.stdout) == json.loads((tmp_path / "s.json").read_text())
    Draft202012Validator.check_schema(json.loads(printed.stdout))
