"""Qualification: the motion tests of the field on a machine, one report and one file of numbers.

    qualify(machine, "out")     out/report.html, out/qualify.json

    measure(log, machine, "out")     the same figures of a log

Half-hertz noise, describing function, linearity, hysteresis, dynamic threshold, leg balance, turn-around and
repeatability.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import tomli_w

from compensation import Compensator
from hexsim.declaration import Machine
from hexsim.files.atomic import write_text
from hexsim.machine.files import machine_tables
from hexsim.qualification.battery import QUICK, Battery, Findings, Plan
from hexsim.qualification.measured import Imu, measure
from hexsim.qualification.page import page
from hexsim.qualification.rig import MachineRig, Motion, Record, Rig
from hexsim.qualification.rows import Row
from hexsim.scenarios.settings import loaded

__all__ = [
    "QUICK",
    "Battery",
    "Findings",
    "Imu",
    "MachineRig",
    "Motion",
    "Plan",
    "Rig",
    "Row",
    "judged",
    "measure",
    "write_qualification",
]


def judged(
    machine: Machine | str | Path,
    quick: bool = False,
    progress: Callable[[float], None] | None = None,
    compensator: str | Compensator = "none",
    record: Record = lambda scenario, motion: None,
) -> tuple[dict[str, Any], Findings]:
    """Run all motion tests: what qualify.json holds, and the rows and curves behind it. record: is given each motion."""
    machine, _ = loaded(machine, "heave")
    report = progress or (lambda fraction: None)
    rig = MachineRig(machine, compensator, record)
    found = Battery(rig, QUICK if quick else Plan(), lambda fraction, what: report(0.95 * fraction)).run()
    name = compensator if isinstance(compensator, str) else compensator.name
    result = {
        "machine": machine.name,
        "compensator": name,
        "quick": quick,
        "model": rig.model,
        "scheme": "rk4",
        "bandwidth_Hz": 50.0,
        "passed": all(row.passed is not False for row in found.rows),
        "rows": [asdict(row) | {"passed": row.passed} for row in found.rows],
        "describing_function": found.curves["describing_function"],
    }
    report(1.0)
    return result, found


def write_qualification(
    result: dict[str, Any], found: Findings, machine: Machine | str | Path, out: str | Path
) -> None:
    """qualify.json and report.html, in the folder `out`."""
    folder = Path(out)
    machine, _ = loaded(machine, "heave")
    write_text(folder / "qualify.json", json.dumps(result, indent=1))
    config = tomli_w.dumps(machine_tables(machine))
    write_text(folder / "report.html", page(f"Qualification of {machine.name}", _how(result), found, config))


def _how(result: dict[str, Any]) -> str:
    control = "proportional control" if result["compensator"] == "none" else f"compensator {result['compensator']}"
    scheme = "RK4, step chosen" + (", few frequencies" if result["quick"] else "")
    return f"{control} · {scheme} · accelerations in the {result['bandwidth_Hz']:g} Hz band"
