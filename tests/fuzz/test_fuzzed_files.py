"""Machine and scenario files, mutated, through the command line."""

import json
import tomllib
from pathlib import Path

from harness import MORE, command, fuzz, sandbox
from hypothesis import strategies as st
from mutations import as_toml, at_bounds, mutated, torn
from typer.testing import CliRunner

import hexsim
from hexsim.cli import app

MODELS = Path(__file__).parents[2] / "models"
SCENARIO_FILES = Path(hexsim.__file__).parent / "scenarios"
BENCH = tomllib.loads((MODELS / "bench" / "machine.toml").read_text())
EFFECTS = {
    "null_offset": {"offset_V": 0.1},
    "spool_lag": {"frequency_Hz": 60.0, "where": "leg 1"},
    "entrained_air": {"fraction": 0.01},
}
POWER_UNIT = tomllib.loads((MODELS / "micro_motion_system" / "power_unit.toml").read_text())
MACHINES = [BENCH, BENCH | {"effects": EFFECTS}, POWER_UNIT]
SCENARIOS = [tomllib.loads(path.read_text()) for path in sorted(SCENARIO_FILES.glob("*.toml"))]
FAULTY = {"name": "faulty", "axes": {"z": {"kind": "sine", "amplitude": 0.02, "frequency_Hz": 1.0}}}
FAULTS = [
    {"kind": "valve_stuck", "leg": 1, "time_s": 0.01, "at": "open"},
    {"kind": "spool_lag", "leg": 1, "time_s": 0.01, "frequency_Hz": 1.0},
    {"kind": "position_sensor", "leg": 1, "time_s": 0.01, "how": "jump", "jump_m": 0.02},
    {"kind": "pressure_loss", "time_s": 0.01, "pressure_Pa": 2e6, "within_s": 0.02},
    {"kind": "hose_burst", "leg": 1, "time_s": 0.0, "conductance_m3_s_Pa": 5e-11},
    {"kind": "payload_shift", "time_s": 0.0, "mass_kg": 150.0, "within_s": 0.03},
    {"kind": "power_loss", "time_s": 0.02, "buffered": False},
]
QUICKLY = ("--fast", "--no-report", "--no-recording", "--out", "out")


def run_with(folder, machine: str | bytes | None, scenario: str | bytes | None) -> None:
    with sandbox(folder) as work:
        for name, text in (("machine.toml", machine), ("mine.toml", scenario)):
            if text is not None:
                (work / name).write_bytes(text.encode() if isinstance(text, str) else text)
        what = "mine.toml" if scenario is not None else "heave"
        where = "machine.toml" if machine is not None else "bench"
        command("run", what, "-m", where, "--duration", "0.05", *QUICKLY)


@MORE
def test_machine_files(tmp_path, examples):
    """Keys dropped, renamed and new, numbers of every size, other types: run or refused."""
    fuzz(mutated(MACHINES), lambda tables: run_with(tmp_path, as_toml(tables), None), examples)


def possible() -> dict[tuple[str, str], tuple[float, float]]:
    """(table, key) -> the range of the JSON schema."""
    schema = json.loads(CliRunner().invoke(app, ["export", "schema", "machine"]).stdout)
    found = {}
    for table, place in schema["properties"].items():
        name = str(place.get("$ref") or place.get("anyOf", [{}])[0].get("$ref")).rsplit("/")[-1]
        for key, field in schema["$defs"].get(name, {}).get("properties", {}).items():
            number = field.get("anyOf", [field])[0]
            if "minimum" in number and "maximum" in number:
                found[table, key] = number["minimum"], number["maximum"]
    return found


def test_there_are_ranges():
    """The machines below are not the good ones by mistake."""
    assert len(possible()) > 60 and possible()["cylinder", "stroke_m"] == (5e-3, 10.0)


@MORE
def test_machines_at_their_bounds(tmp_path, examples):
    """What each number alone may be, together: run, refused, or diverged with a sentence."""
    fuzz(at_bounds(MACHINES, possible()), lambda tables: run_with(tmp_path, as_toml(tables), None), examples)


@MORE
def test_scenario_files(tmp_path, examples):
    """The same for scenarios, with faults."""
    good = [*SCENARIOS, *({**FAULTY, "faults": [fault]} for fault in FAULTS)]
    fuzz(mutated(good), lambda tables: run_with(tmp_path, None, as_toml(tables)), examples)


@MORE
def test_torn_files(tmp_path, examples):
    """Pieces cut out, doubled, overwritten with bytes: what is no TOML is said to be none."""
    texts = st.one_of(
        torn(as_toml(BENCH)).map(lambda text: (text, None)), torn(as_toml(FAULTY)).map(lambda text: (None, text))
    )
    fuzz(texts, lambda pair: run_with(tmp_path, *pair), examples)
