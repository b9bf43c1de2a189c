"""What a machine file may not say: each refusal names file, table and key, and what is allowed."""

import copy
import math

import pytest

from hexsim.errors import HexsimError
from hexsim.machine import load_machine, machine_from_dict
from hexsim.machine.files import changed, machine_tables

NAN, INF = math.nan, math.inf

IMPOSSIBLE = [  # machine, key, value, what the sentence must say besides "my.toml", table and key
    ("bench", "cylinder.piston_diameter_m", -0.04, ["= -0.04", "greater than or equal to 0.001", "SI units"]),
    ("bench", "cylinder.piston_diameter_m", 40.0, ["= 40.0", "less than or equal to 2", "SI units"]),  # mm for m
    ("bench", "cylinder.rod_diameter_m", 0.05, ["= 0.05", "smaller than piston_diameter_m = 0.04"]),
    ("bench", "cylinder.rod_diameter_m", 0.04, ["= 0.04", "smaller than piston_diameter_m = 0.04"]),  # no annulus
    ("bench", "cylinder.stroke_m", 0.0, ["= 0.0", "greater than or equal to 0.005"]),
    ("bench", "cylinder.cushion_length_m", 0.1, ["= 0.1", "shorter than half of stroke_m = 0.2"]),
    ("bench", "cylinder.rod_side", "tank", ["= 'tank'", "'supply' or 'chamber'"]),
    ("bench", "valve.overlap_m", 2e-3, ["= 0.002", "smaller than spool_travel_max_m = 0.0011"]),
    ("bench", "valve.overlap_m", -2e-3, ["= -0.002", "smaller than spool_travel_max_m = 0.0011"]),
    ("bench", "valve.overlap_m", 5.0, ["= 5", "smaller than spool_travel_max_m = 0.0011"]),  # um for m
    ("bench", "valve.overlap_m", NAN, ["= nan", "finite number"]),
    ("bench", "valve.edge_rounding_m", INF, ["= inf", "finite number"]),
    ("bench", "valve.discharge_coefficient", 1.2, ["= 1.2", "less than or equal to 1"]),
    ("bench", "valve.discharge_coefficient", 0.0, ["= 0.0", "greater than 0"]),
    ("bench", "valve.flow_area", "cubic", ["= 'cubic'", "'overlap' or 'quadratic'"]),
    ("bench", "supply.pressure_Pa", 70.0, ["= 70.0", "greater than or equal to 200000", "SI units"]),  # bar for Pa
    ("bench", "supply.pressure_Pa", NAN, ["= nan", "finite number"]),
    ("bench", "supply.pressure_Pa", "70 bar", ["= '70 bar'", "valid number"]),
    ("bench", "supply.tank_pressure_Pa", 8e6, ["= 8e+06", "below pressure_Pa = 7e+06"]),
    ("bench", "supply.tank_pressure_Pa", -2e5, ["= -200000.0", "greater than or equal to -101325"]),  # below vacuum
    ("bench", "oil.density_kg_m3", 0.86, ["= 0.86", "greater than or equal to 500"]),  # kg/l for kg/m3
    ("bench", "oil.bulk_modulus_Pa", 1.5, ["= 1.5", "greater than or equal to 10000000"]),  # GPa for Pa
    ("bench", "oil.bulk_modulus_Pa", -1.5e9, ["greater than or equal to 10000000"]),
    ("bench", "friction.coulomb_extend_N", -65.0, ["= -65.0", "greater than or equal to 0"]),
    ("bench", "friction.stribeck_velocity_m_s", 0.0, ["= 0.0", "greater than 0"]),
    ("bench", "friction.viscous_extend_N_s_m", INF, ["= inf", "finite number"]),
    ("bench", "controller.rate_Hz", 0.0, ["= 0.0", "greater than 0"]),
    ("bench", "controller.rate_Hz", 1e6, ["= 1000000.0", "less than or equal to 10000"]),
    ("bench", "sensors.position_offset_m", NAN, ["= nan", "finite number"]),
    ("bench", "load.moving_mass_kg", 0.0, ["= 0.0", "greater than 0"]),
    ("bench", "machine.kind", "tripod", ["= 'tripod'", "'bench' or 'hexapod'"]),
    ("bench", "machine.gravity_m_s2", -9.8, ["= -9.8", "greater than or equal to 0"]),
    ("bench", "uncertainty.bulk_modulus_Pa", 10.0, ["= 10", "relative half width in [0, 1)"]),  # per cent
    ("micro_motion_system", "load.platform_inertia_kg_m2", [60.0, 60.0, 130.0], ["none larger than the sum"]),
    ("micro_motion_system", "load.platform_inertia_kg_m2", [60.0, 60.0, -1.0], ["three positive moments"]),
    ("micro_motion_system", "load.platform_inertia_kg_m2", [60.0, 60.0], ["= [60.0, 60.0]"]),
    ("micro_motion_system", "geometry.base_half_angle_deg", 60.0, ["= 60.0", "less than 60"]),
    ("micro_motion_system", "geometry.base_radius_m", 0.0, ["= 0.0", "greater than 0"]),
    (
        "micro_motion_system",
        "geometry.neutral_leg_length_m",
        0.1,
        ["= 0.1", "longer than half of cylinder.stroke_m = 0.2"],
    ),
]


@pytest.mark.parametrize(("name", "dotted", "value", "description"), IMPOSSIBLE, ids=lambda v: str(v)[:40])
def test_impossible_value_is_refused_by_name(name, dotted, value, description):
    """One sentence with file, table, key, the value given and what is allowed."""
    table, key = dotted.split(".")
    with pytest.raises(HexsimError) as caught:
        changed(load_machine(name), {dotted: value}, "my.toml")
    text = str(caught.value)
    for part in ["my.toml: ", table, key, *description]:
        assert part in text, f"{part!r} is not in {text!r}"
    assert "\n" not in text


def required_keys():
    """Every key of both packaged files that has no default."""
    for name in ("bench", "micro_motion_system"):
        machine = load_machine(name)
        for table, section in machine:
            fields = type(section).model_fields if hasattr(type(section), "model_fields") else {}
            for key, field in fields.items():
                if field.is_required():
                    yield name, table, key


@pytest.mark.parametrize(("name", "table", "key"), list(required_keys()))
def test_missing_key_is_named(name, table, key):
    """Each required key of both machines, taken out in turn."""
    tables = copy.deepcopy(machine_tables(load_machine(name)))
    del tables[table][key]
    with pytest.raises(HexsimError) as caught:
        machine_from_dict(tables, "my.toml")
    assert str(caught.value) == f"my.toml: [{table}] {key} is missing: add it (SI units)"


def test_there_are_required_keys_to_miss():
    """The list above is not empty by mistake: keys of every table, and the whole of a hexapod's geometry."""
    keys = list(required_keys())
    assert {k[1] for k in keys if k[0] == "bench"} == {
        "machine", "supply", "oil", "cylinder", "valve", "friction", "controller"
    }  # fmt: skip
    assert {k[2] for k in keys if k[1] == "geometry"} == {
        "base_radius_m", "base_half_angle_deg", "platform_radius_m", "platform_half_angle_deg", "neutral_leg_length_m"
    }  # fmt: skip


@pytest.mark.parametrize("table", ["machine", "supply", "oil", "cylinder", "valve", "friction", "controller", "load"])
def test_missing_table_is_named(bench, table):
    """Without a required table the sentence names it in brackets."""
    tables = machine_tables(bench)
    del tables[table]
    with pytest.raises(HexsimError) as caught:
        machine_from_dict(tables, "my.toml")
    assert str(caught.value) == f"my.toml: [{table}] is missing: add it (SI units)"


def test_number_of_further_problems_is_told(bench):
    """Two keys missing: the first by name, and "(and 1 more)"."""
    tables = machine_tables(bench)
    del tables["oil"]["density_kg_m3"], tables["valve"]["overlap_m"]
    with pytest.raises(HexsimError, match=r"\[oil\] density_kg_m3 is missing: add it \(SI units\) \(and 1 more\)$"):
        machine_from_dict(tables, "my.toml")


def test_unknown_key_lists_the_known_ones(bench):
    """A key with another unit in its name, stroke_mm, is answered with the table's keys."""
    with pytest.raises(HexsimError) as caught:
        changed(bench, {"cylinder.stroke_mm": 200}, "my.toml")
    assert str(caught.value).startswith(
        "my.toml: [cylinder] stroke_mm is not a known key: allowed are piston_diameter_m, "
    )
    assert "stroke_m," in str(caught.value)


def test_unknown_table_lists_the_known_ones(bench):
    """[valves] for [valve]."""
    with pytest.raises(
        HexsimError, match=r"^my.toml: \[valves\] is not a known table: allowed are machine, supply, .*valve, "
    ):
        changed(bench, {"valves.overlap_m": 5e-6}, "my.toml")


def test_hexapod_needs_its_tables(hexapod, bench):
    """A hexapod without geometry or platform mass, and a bench without moving mass, say what they need."""
    tables = machine_tables(hexapod)
    del tables["geometry"]
    with pytest.raises(HexsimError, match=r"my.toml: the file: a hexapod needs a \[geometry\] table"):
        machine_from_dict(tables, "my.toml")
    tables = machine_tables(hexapod)
    del tables["load"]["platform_mass_kg"]
    with pytest.raises(HexsimError, match=r"a hexapod needs load.platform_mass_kg and load.platform_inertia_kg_m2"):
        machine_from_dict(tables, "my.toml")
    tables = machine_tables(bench)
    tables["load"] = {}
    with pytest.raises(HexsimError, match=r"a bench needs load.moving_mass_kg"):
        machine_from_dict(tables, "my.toml")


EFFECT_ERRORS = [
    ({"effects.leak": {}}, ["unknown effect 'leak'", "known are", "leakage_supply_to_chamber"]),
    ({"effects.null_offset": {}}, ["[effects.null_offset]", "offset_V is missing: add it in V"]),
    ({"effects.null_offset": {"offset_V": NAN}}, ["[effects.null_offset] offset_V = nan", "finite number in V"]),
    ({"effects.null_offset": {"offset_V": True}}, ["offset_V = True", "finite number in V"]),
    ({"effects.null_offset": {"offset_V": 50.0}}, ["offset_V = 50 must lie in [-5, 5] V"]),
    ({"effects.null_offset": {"offset_mV": 50.0}}, ["offset_mV is not a known key: allowed are offset_V, where"]),
    ({"effects.null_offset": {"offset_V": 0.1, "where": "leg 2"}}, ["where = 'leg 2'", '"leg 1".."leg 1"']),
    ({"effects.centre_of_mass": {}}, ["[effects.centre_of_mass] is for a hexapod, not a bench"]),
]


@pytest.mark.parametrize(("changes", "description"), EFFECT_ERRORS, ids=lambda v: str(v)[:50])
def test_wrong_effect_is_refused_by_name(bench, changes, description):
    """An unknown effect, key, place or machine kind, and a value out of bounds, say what there is."""
    with pytest.raises(HexsimError) as caught:
        changed(bench, changes, "my.toml")
    for part in ["my.toml: ", *description]:
        assert part in str(caught.value)


def test_machines_are_frozen(bench):
    """A declared machine cannot be changed in place."""
    with pytest.raises(ValueError, match="frozen"):
        bench.valve.overlap_m = 1e-5


def test_areas_are_the_reports(bench):
    """A1 = pi/4 0.04^2, A2 = pi/4 (0.04^2 - 0.03^2) of appendix A."""
    assert bench.cylinder.area_bottom_m2 == pytest.approx(12.566e-4, rel=1e-4)
    assert bench.cylinder.area_top_m2 == pytest.approx(5.498e-4, rel=1e-4)
