"""The guide's valve tables are declarations that run."""

import re
import tomllib
from pathlib import Path

import pytest

from hexsim.machine import load_machine, machine_from_dict
from hexsim.machine.files import machine_tables
from hexsim.studies.valve_test import valve_test

GUIDE = (Path(__file__).parents[1] / "docs" / "declare_your_machine.md").read_text(encoding="utf-8")
TABLES = re.findall(r"```toml\n(.*?)```", GUIDE, re.S)
SHEETS = [table for table in TABLES if table.startswith("[valve]")]


@pytest.mark.parametrize(("sheet", "flow_l_min"), list(zip(SHEETS, (38.0, 40.0), strict=True)))
def test_worked_sheets_give_their_rated_flow(sheet, flow_l_min):
    """Put into the servo bench, each worked sheet passes its rated flow at full signal within its hysteresis."""
    tables = machine_tables(load_machine("servo_bench")) | tomllib.loads(sheet)
    tables["uncertainty"] = {}
    found = valve_test(machine_from_dict(tables)).figures
    assert found["rated_flow_l_min"] == pytest.approx(flow_l_min, rel=0.015)


def test_the_guides_joints_legs_and_points_are_a_machine():
    """The tables of section 6 put into the report's machine: one that stands, with its third leg as declared."""
    tables = machine_tables(load_machine("micro_motion_system"))
    for table in TABLES:
        for name, values in tomllib.loads(table).items():
            if name == "sensors":
                tables[name] |= values
            elif name != "valve":
                tables[name] = values
    machine = machine_from_dict(tables)
    assert machine.legs[2].cylinder.piston_diameter_m == 0.05
    assert machine.points == {"driver_head": (0.3, 0.0, 1.1)}
    assert machine.mechanics.neutral_positions == pytest.approx([0.1, 0.1, 0.1 - 0.0012, 0.1, 0.1, 0.1], abs=1e-4)
