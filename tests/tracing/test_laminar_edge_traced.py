"""Laminar metering edges of a second plant: the same flows, and the tracer names them where they are and nowhere else."""

import numpy as np
import pytest
from other_equations import valve_flows
from other_plant import declared_plant, write_machine

import hexsim as hx
from hexsim.hydraulics import ports
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import load_machine
from hexsim.machine.files import changed

REYNOLDS = 15.0


def hexsims_row(degC=35.0):
    """The bench with laminar edges and the second plant's rounding."""
    keys = {"valve.laminar_reynolds": REYNOLDS, "valve.edge_rounding_m": 2e-6, "oil.temperature_degC": degC}
    return resolve(changed(load_machine("bench"), keys)).rows[0]


@pytest.mark.parametrize("x", [-3e-5, -8e-6, -4e-6, 4e-6, 8e-6, 3e-5])
@pytest.mark.parametrize("pressure", [2e5, 35e5, 75e5])
def test_the_second_plant_has_the_same_flows(x, pressure):
    """Its bent root law, written apart with 56.9 mm2/s at 35 degC: 1e-3 of the flow; both edges, a chamber above the supply."""
    leg = declared_plant("bench").legs[0]
    leg["laminar"] = REYNOLDS
    into, out = valve_flows(leg, x, x / 1.1e-4, 0.1, pressure, 7e6)
    row = hexsims_row()
    assert ports.supply_edge_flow(row, x, pressure, 7e6) == pytest.approx(into, rel=2e-3, abs=1e-15)
    assert ports.tank_edge_flow(row, x, pressure) == pytest.approx(out, rel=2e-3, abs=1e-15)


@pytest.mark.parametrize(("law", "narrow", "wide"), [(1.0, 1e-3, 1e-3), (2.0, 0.15, 0.06)])
def test_other_laws_have_the_same_limits(law, narrow, wide):
    """Merritt's corner; and a C_d that bends from the first and overshoots by 14 %, of which 6 % are left at Re = 1100."""
    leg = declared_plant("bench").legs[0]
    leg["laminar"], leg["rounding"] = REYNOLDS, 1e-12
    found = []
    for chosen in (0.0, law):
        leg["laminar_law"] = chosen
        found.append([valve_flows(leg, 5e-6 + opening, 0.0, 0.1, 35e5, 7e6)[0] for opening in (3e-7, 6e-4)])
    assert found[1][0] == pytest.approx(found[0][0], rel=narrow)
    assert found[1][1] == pytest.approx(found[0][1], rel=wide)


@pytest.fixture
def named(tmp_path):
    """What the tracer names on a bench of the second plant: effect -> (values, standard errors)."""

    def of(seed, effects):
        write_machine(tmp_path, seed, effects)
        found = hx.trace(tmp_path, ["fit", "sweep"]).report["effects"]
        return {one["name"]: (one["parameters"], one["standard_error"]) for one in found}

    return of


@pytest.mark.slow
@pytest.mark.parametrize("size", [8.0, 40.0])
def test_laminar_edges_are_named_with_their_number(named, size):
    """Nothing else, no overlap, no gain, no clearance; the number within 3 standard errors and 1 %."""
    [(name, (values, errors))] = named(831, {"laminar_edge": size}).items()
    assert name == "laminar_edge"
    assert values["reynolds"] == pytest.approx(size, abs=3 * errors["reynolds"] + 0.01 * size)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effects", "name"), [({"overlap": None}, "overlap_change"), ({"leakage_clearance": None}, "clearance_leakage")]
)
def test_turbulent_edges_are_not_called_laminar(named, effects, name):
    """An overlap or leaking lands of root-law edges keep their name."""
    assert list(named(832, effects)) == [name]


@pytest.mark.slow
def test_a_clean_machine_has_no_laminar_edge(named):
    """Turbulent edges, numbers off within their declared uncertainty: nothing is named."""
    assert np.size(list(named(833, {}))) == 0
