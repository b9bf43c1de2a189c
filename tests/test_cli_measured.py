"""Commands on measured logs and on the running machine: trace, friction, qualify, serve."""

import json
import re
import shutil
import tomllib
from pathlib import Path
from types import SimpleNamespace

import polars as pl
import pytest
from typer.testing import CliRunner

from hexsim.cli import app
from hexsim.machine import load_machine

BENCH = Path(__file__).parent / "data" / "bench_none"
REPORT = {
    "verdict": "explained",
    "balances": [],
    "effects": [
        {
            "name": "leakage_supply_to_chamber",
            "balance": "continuity",
            "where": "leg 2",
            "tied_with": ["clearance_leakage"],
            "parameters": {"conductance_m3_s_Pa": 2.4e-12},
            "standard_error": {"conductance_m3_s_Pa": 1e-13},
            "evidence": {"block_cv_gain": 0.41, "blocks": 8, "dBIC": -310},
            "description": "oil leaks from the supply",
        }
    ],
    "unexplained": [
        {
            "balance": "force",
            "where": "leg 1",
            "rms": 12.0,
            "unit": "N",
            "depends_on": "position_m",
            "r2_cv": 0.82,
            "frequency_Hz": None,
            "form": "plain",
            "memory_s": None,
            "r2_of_signals": {"position_m": 0.82},
        }
    ],
    "error": {"validate": {"position_m": {"declared": 1e-4, "refit": 9e-5, "with_effect": 6e-6, "noise": 3e-6}}},
}


@pytest.fixture
def traced(monkeypatch):
    """`hexsim.tracing.trace.trace` that finds what REPORT says, at once; the search itself has its own tests."""
    import hexsim.tracing.trace as module

    asked = {}

    def trace(machine, fit, validate, out, progress, load_kg, loaded, keep, mapping=None):
        asked.update(machine=machine, fit=fit, validate=validate)
        progress("screening", 0.5)
        (Path(out) / "report.json").write_text(json.dumps(REPORT))
        declared = load_machine(BENCH)
        return SimpleNamespace(machine=declared, fitted=declared, report=REPORT)

    monkeypatch.setattr(module, "trace", trace)
    return asked


def test_trace_prints_verdict_effects_and_errors(traced, tmp_path):
    """The table at the end names verdict, effect with place, number and error, ties, what is left, before and after."""
    arguments = [
        "trace",
        str(BENCH),
        "--fit",
        "fit",
        "--fit",
        "sweep",
        "--validate",
        "validate",
        "--out",
        str(tmp_path / "t"),
    ]
    result = CliRunner().invoke(app, [*arguments, "--no-recording"])
    assert result.exit_code == 0, result.stderr
    assert traced["fit"] == ["fit", "sweep"] and traced["validate"] == ["validate"]
    shown = " ".join(result.stdout.split())
    assert re.search(r"verdict explained", shown)
    for text in (
        "leakage_supply_to_chamber",
        "leg 2",
        "2.4e-12 ± 1e-13",
        "clearance_leakage",
        "0.410",
        "position_m",
        "12.0 N",
    ):
        assert text in shown
    assert re.search(r"validate position_m 0\.0001 9e-05 6e-06 3e-06", shown)
    assert json.loads((tmp_path / "t" / "report.json").read_text()) == REPORT


def test_trace_writes_a_recording_of_the_held_out_log(traced, tmp_path):
    """--json prints the report alone; the recording of each held-out log lies beside it."""
    result = CliRunner().invoke(app, ["trace", str(BENCH), "--out", str(tmp_path / "t"), "--json"])
    assert json.loads(result.stdout) == REPORT
    assert (tmp_path / "t" / "validate.rrd").stat().st_size > 100_000


def test_friction_needs_the_machine_of_the_log(tmp_path):
    """A log without machine.toml beside it asks for --machine; with it the declared friction comes back within 5 %.

    A run's folder is a log with its machine.
    """
    arguments = [
        "run",
        "friction",
        "--fast",
        "--no-report",
        "--no-recording",
        "--duration",
        "60",
        "--out",
        str(tmp_path / "run"),
    ]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    log = str(shutil.copy(tmp_path / "run" / "log.parquet", tmp_path / "alone.parquet"))
    refused = CliRunner().invoke(app, ["friction", log])
    assert refused.exit_code == 2 and "give --machine" in refused.stderr and refused.stdout == ""
    result = CliRunner().invoke(app, ["friction", log, "-m", "bench", "--json", "--out", str(tmp_path / "f")])
    assert result.exit_code == 0, result.stderr
    found, declared = json.loads(result.stdout)["parameters"], load_machine("bench").friction
    for key in ("viscous_extend_N_s_m", "viscous_retract_N_s_m", "coulomb_extend_N", "coulomb_retract_N"):
        assert found[key] == pytest.approx(getattr(declared, key), rel=0.05)
    assert {path.name for path in (tmp_path / "f").iterdir()} == {"friction.json", "friction.png", "machine.toml"}
    of_the_run = CliRunner().invoke(app, ["friction", str(tmp_path / "run"), "--json"])
    assert json.loads(of_the_run.stdout)["parameters"] == found


def test_serve_runs_for_its_time_and_says_how_far_behind():
    """A second of the bench on a free port of this computer: state, margin and packets, as a line and as JSON."""
    result = CliRunner().invoke(app, ["serve", "-m", "bench", "--port", "0", "--duration", "1", "--json"])
    assert result.exit_code == 0, result.stderr
    status = json.loads(result.stdout)
    assert status["address"].startswith("127.0.0.1:") and status["state"] == "neutral"
    assert status["time_s"] == pytest.approx(1.0, abs=0.01) and status["margin"] > 0
    assert re.search(r"bench listens on udp://127\.0\.0\.1:\d+", result.stderr)


def test_qualify_prints_what_was_judged(monkeypatch, tmp_path):
    """Rows with a limit are in the table with pass or fail, the others are counted."""
    judged = {
        "test": "turn-around",
        "figure": "deviation",
        "value": 0.836,
        "unit": "m/s²",
        "limit": 0.49,
        "passed": False,
    }
    reported = {"test": "half-hertz noise", "figure": "ratio", "value": 0.2, "unit": "1", "limit": None, "passed": None}
    rows = [{"axis": "heave z", **row} for row in (judged, reported)]
    found = {"machine": "bench", "compensator": "none", "passed": False, "rows": rows}

    def judging(machine, quick, progress, compensator):
        progress(0.5)
        return {**found, "quick": quick}, None

    def written(result, found, machine, folder):
        (folder / "qualify.json").write_text("{}")

    monkeypatch.setattr("hexsim.qualification.judged", judging)
    monkeypatch.setattr("hexsim.qualification.write_qualification", written)
    result = CliRunner().invoke(app, ["qualify", "-m", "bench", "--quick", "--out", str(tmp_path / "q")])
    assert result.exit_code == 0, result.stderr
    shown = " ".join(result.stdout.split())
    assert "NOT passed" in shown and "turn-around heave z deviation 0.836 0.490 m/s² fail" in shown
    assert "1 more figures without a limit" in shown
    assert (tmp_path / "q" / "qualify.json").exists()


def test_trace_lists_the_library_with_signatures():
    """Every effect of the library is listed, with a signature, a check and a way to mend it that are written for it; texts are
    written for no others."""
    from hexsim.hydraulics import effects

    shown = CliRunner().invoke(app, ["trace", "--list", "--json"])
    assert shown.exit_code == 0
    rows = json.loads(shown.stdout)
    written = tomllib.loads((Path(effects.__file__).parent / "advice.toml").read_text(encoding="utf-8"))
    assert {row["name"] for row in rows} == set(effects.library()) == set(written)
    for text, none in (("signature", "no signature is written"), ("check", "no check is written"), ("mend", "–")):
        assert not [row["name"] for row in rows if not row[text] or row[text].startswith(none)]


def test_trace_explains_an_effect_with_a_picture(tmp_path):
    """Coulomb friction: its texts, a step over the velocity in the force balance drawn in characters, and a figure."""
    shown = CliRunner().invoke(app, ["trace", "--explain", "coulomb_friction_change", "--out", str(tmp_path)])
    assert shown.exit_code == 0, shown.output
    for words in ("Coulomb friction differs", "force balance of leg 1", "velocity", "check", "mend"):
        assert words in shown.output
    assert (tmp_path / "coulomb_friction_change.png").stat().st_size > 10_000
    other = CliRunner().invoke(app, ["trace", "--explain", "rod_seal_leakage"])  # of cylinders with two chambers alone
    assert other.exit_code == 0 and "servo_bench" in other.output
    wrong = CliRunner().invoke(app, ["trace", "--explain", "gremlins"])
    assert wrong.exit_code != 0


def test_trace_takes_a_mapping_from_anywhere(tmp_path):
    """Logs under foreign names, their mapping not beside them: without it a refusal that names the columns, with it the verdict
    of the logs as they were."""
    machine, given = tmp_path / "rig", tmp_path / "names.toml"
    machine.mkdir()
    source = Path(__file__).parent / "data" / "bench_none"
    (machine / "machine.toml").write_text((source / "machine.toml").read_text())
    names = {"position_m": "Istweg", "setpoint_m": "Sollweg", "valve_V": "Ventil"}
    for name in ("fit", "validate"):
        pl.read_csv(source / f"{name}.csv.gz").rename(names).head(2500).write_csv(machine / f"{name}.csv")
    given.write_text("[columns]\n" + "\n".join(f'{ours} = {{from = "{theirs}"}}' for ours, theirs in names.items()))
    arguments = ["trace", str(machine), "--out", str(tmp_path / "out"), "--no-recording"]
    refused = CliRunner().invoke(app, arguments)
    assert refused.exit_code == 2 and "Istweg" in refused.output
    done = CliRunner().invoke(app, [*arguments, "--mapping", str(given)])
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / "out" / "report.json").read_text())["verdict"] == "nothing missing"
