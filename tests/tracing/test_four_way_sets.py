"""Four-way machines traced: measured sets whose truth is known, and what a log without pressures still says."""

import json
from dataclasses import replace

import pytest
from four_edge_plant import write_machine
from test_real_machines import MEASURED

from hexsim.machine import load_machine
from hexsim.tracing.steps.logs import read_runs
from hexsim.tracing.steps.violations import lost_balances
from hexsim.tracing.trace import trace

servo_logs = pytest.mark.skipif(
    not (MEASURED / "servo_none").is_dir(), reason="no measured servo sets beside the repository"
)


@servo_logs
@pytest.mark.slow
def test_a_servo_actuator_as_declared_lacks_nothing():
    """The measured set without an effect: nothing missing, in all balances of both chambers."""
    result = trace(MEASURED / "servo_none", ["fit", "sweep"], ["validate"])
    assert result.verdict == "nothing missing"
    assert "continuity of the rod side" in {line.name for line in result.violations}


@servo_logs
@pytest.mark.slow
def test_leakage_across_the_piston_is_found_with_its_number():
    """The measured set with 6e-13 m3/s/Pa across the piston: that effect alone, within 2 %."""
    result = trace(MEASURED / "servo_leakage", ["fit", "sweep"], ["validate"])
    truth = json.loads((MEASURED / "servo_leakage" / "truth.json").read_text())["undeclared"]["cross_leak"]
    [effect] = result.effects
    assert effect.candidate.effect.name == "leakage_across_piston"
    assert effect.values["conductance_m3_s_Pa"] == pytest.approx(truth, rel=0.02)


@pytest.mark.parametrize(
    ("columns", "lost"),
    [
        ((), set()),
        (("pressure_top_Pa",), {"continuity of the rod side", "force"}),
        (("pressure_top_Pa", "pressure_bottom_Pa"), {"continuity", "continuity of the rod side", "force"}),
    ],
    ids=["both pressures", "bottom alone", "none"],
)
def test_what_cannot_be_said_is_said(tmp_path, columns, lost):
    """A four-way log without pressures: the balances that it does not allow and the channels that they lack, in a sentence."""
    write_machine(tmp_path, 1, duration_s=9.0)
    machine = load_machine(tmp_path)
    [log], _ = read_runs(tmp_path, ["fit"], machine)
    log = replace(log, **{column.removesuffix("_Pa"): None for column in columns})
    found = lost_balances([log], machine)
    said = " ".join(finding.description for finding in found)
    assert all(name in said for name in (*columns, *lost))
    assert bool(found) == bool(columns)
