"""What a machine file may not say: each refusal names file, table and key, and what is allowed."""

import copy
import math

import mujoco
import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.machine import load_machine, machine_from_dict
from hexsim.machine.files import changed, machine_tables
from hexsim.plant import Plant

NAN, INF = math.nan, math.inf

IMPOSSIBLE = [  # machine, key, value, what the sentence must say besides "my.toml", table and key
    ("bench", "cylinder.piston_diameter_m", -0.04, ["= -0.04", "greater than or equal to 0.001", "SI units"]),
    ("bench", "cylinder.piston_diameter_m", 40.0, ["= 40.0", "less than or equal to 2", "SI units"]),  # mm for m
    ("bench", "cylinder.rod_diameter_m", 0.05, ["= 0.05", "smaller than piston_diameter_m = 0.04"]),
    ("bench", "cylinder.rod_diameter_m", 0.04, ["= 0.04", "smaller than piston_diameter_m = 0.04"]),  # no annulus
    ("bench", "cylinder.stroke_m", 0.0, ["= 0.0", "greater than or equal to 0.005"]),
    ("bench", "cylinder.cushion_length_m", 0.1, ["= 0.1", "shorter than half of stroke_m = 0.2"]),
    ("bench", "cylinder.rod_side", "tank", ["= 'tank'", "'supply', 'chamber' or 'valve'"]),
    ("bench", "valve.overlap_m", 2e-3, ["= 0.002", "smaller than spool_travel_max_m = 0.0011"]),
    ("bench", "valve.overlap_m", -2e-3, ["= -0.002", "smaller than spool_travel_max_m = 0.0011"]),
    ("bench", "valve.overlap_m", 5.0, ["= 5", "smaller than spool_travel_max_m = 0.0011"]),  # um for m
    ("bench", "valve.overlap_m", NAN, ["= nan", "finite number"]),
    ("bench", "valve.edge_rounding_m", INF, ["= inf", "finite number"]),
    ("bench", "valve.discharge_coefficient", 1.2, ["= 1.2", "less than or equal to 1"]),
    ("bench", "valve.discharge_coefficient", 0.0, ["= 0.0", "greater than or equal to 0.05"]),
    ("bench", "valve.flow_area", "cubic", ["= 'cubic'", "'overlap' or 'quadratic'"]),
    ("bench", "supply.pressure_Pa", 70.0, ["= 70.0", "greater than or equal to 200000", "SI units"]),  # bar for Pa
    ("bench", "supply.pressure_Pa", NAN, ["= nan", "finite number"]),
    ("bench", "supply.pressure_Pa", "70 bar", ["= '70 bar'", "a number is needed", "7e+06 for 70 bar"]),
    ("bench", "supply.tank_pressure_Pa", 8e6, ["= 8e+06", "below pressure_Pa = 7e+06"]),
    ("bench", "supply.tank_pressure_Pa", -2e5, ["= -200000.0", "greater than or equal to -101325"]),  # below vacuum
    ("bench", "oil.density_kg_m3", 0.86, ["= 0.86", "greater than or equal to 500"]),  # kg/l for kg/m3
    ("bench", "oil.bulk_modulus_Pa", 1.5, ["= 1.5", "greater than or equal to 10000000"]),  # GPa for Pa
    ("bench", "oil.bulk_modulus_Pa", -1.5e9, ["greater than or equal to 10000000"]),
    ("bench", "friction.coulomb_extend_N", -65.0, ["= -65.0", "greater than or equal to 0"]),
    (
        "bench",
        "friction.stribeck_velocity_m_s",
        0.0,
        ["= 0.0", "greater than or equal to 0.000001 (1e-06 to 10 is possible"],
    ),
    ("bench", "friction.viscous_extend_N_s_m", INF, ["= inf", "finite number"]),
    ("bench", "controller.rate_Hz", 0.0, ["= 0.0", "greater than or equal to 1 (1 to 10000 is possible"]),
    ("bench", "controller.rate_Hz", 1e6, ["= 1000000.0", "less than or equal to 10000"]),
    ("bench", "sensors.position_offset_m", NAN, ["= nan", "finite number"]),
    ("bench", "load.moving_mass_kg", 0.0, ["= 0.0", "greater than or equal to 0.0001"]),
    ("bench", "machine.kind", "tripod", ["= 'tripod'", "'bench' or 'hexapod'"]),
    ("bench", "machine.gravity_m_s2", -9.8, ["= -9.8", "greater than or equal to 0"]),
    ("bench", "uncertainty.bulk_modulus_Pa", 10.0, ["= 10", "relative half width in [0, 1)"]),  # per cent
    ("micro_motion_system", "load.platform_inertia_kg_m2", [60.0, 60.0, 130.0], ["none larger than the sum"]),
    ("micro_motion_system", "load.platform_inertia_kg_m2", [60.0, 60.0, -1.0], ["three positive moments"]),
    ("micro_motion_system", "load.platform_inertia_kg_m2", [60.0, 60.0], ["= [60.0, 60.0]"]),
    ("bench", "friction.coulomb_extend_N", 6.5e7, ["= 65000000.0", "0 to 1e+07 is possible"]),
    ("bench", "friction.coulomb_extend_N", 8800.0, ["= 8800", "below the largest force of the oil", "= 8.8e+03 N"]),
    ("bench", "sensors.position_noise_m", 1e300, ["= 1e+300", "0 to 0.1 is possible"]),
    ("bench", "sensors.pressure_gain", 1e300, ["= 1e+300", "0.01 to 100 is possible"]),
    ("bench", "sensors.position_resolution_m", 1e-300, ["= 1e-300", "0 or at least 1e-12"]),
    ("bench", "valve.voltage_max_V", 1e-300, ["= 1e-300", "0.01 to 1000 is possible"]),
    ("bench", "valve.spool_frequency_Hz", 1e-300, ["= 1e-300", "0 or at least 0.1"]),
    ("bench", "cylinder.rod_diameter_m", 0.0, ["= 0.0", "0.0005 to 2 is possible"]),
    ("bench", "controller.rate_Hz", 1e-12, ["= 1e-12", "1 to 10000 is possible"]),
    ("bench", "load.moving_mass_kg", 1e300, ["= 1e+300", "0.0001 to 1e+07 is possible"]),
    ("bench", "power_unit.accumulator_volume_m3", 1e-300, ["= 1e-300", "1e-06 to 100 is possible"]),
    ("bench", "power_unit.relief_pressure_Pa", 8.0, ["= 8.0", "200000 to 1e+08 is possible"]),
    ("bench", "power_unit.line_diameter_m", 1e-300, ["= 1e-300", "0.001 to 1 is possible"]),
    ("bench", "power_unit.line_diameter_m", 1e300, ["= 1e+300", "0.001 to 1 is possible"]),
    ("bench", "power_unit.pump_leakage_m3_s_Pa", 2.4e-6, ["= 2.4e-06", "0 to 1e-08 is possible"]),
    ("bench", "power_unit.pump_leakage_m3_s_Pa", 1e-9, ["= 1e-09", "less than pump_flow_max_m3_s = 0.0003"]),
    ("bench", "load.moving_mass_kg", True, ["= True", "valid number"]),  # strict: neither a truth value
    ("bench", "load.moving_mass_kg", "7", ["= '7'", "a number is needed, without quotes"]),  # nor text is a number
    ("bench", "machine.name", "a\nb", ["printable characters on one line"]),
    ("bench", "machine.name", "a" * 25_000, ["... (25002 characters)", "at most 100 characters"]),
    ("micro_motion_system", "geometry.base_half_angle_deg", 60.0, ["= 60.0", "less than 60"]),
    ("micro_motion_system", "geometry.base_radius_m", 0.0, ["= 0.0", "greater than or equal to 0.001"]),
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
    assert "\n" not in text and len(text) < 1000


def test_whole_numbers_are_numbers(bench):
    """40 stands for 40.0: people leave the point away."""
    assert changed(bench, {"load.moving_mass_kg": 40}) == bench


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
        "machine",
        "supply",
        "oil",
        "cylinder",
        "valve",
        "friction",
        "controller",
    }
    assert {k[2] for k in keys if k[1] == "geometry"} == {
        "base_radius_m",
        "base_half_angle_deg",
        "platform_radius_m",
        "platform_half_angle_deg",
        "neutral_leg_length_m",
    }


@pytest.mark.parametrize("table", ["machine", "supply", "oil", "cylinder", "valve", "friction", "controller", "load"])
def test_missing_table_is_named(bench, table):
    """Without a required table the sentence names it in brackets."""
    tables = machine_tables(bench)
    del tables[table]
    with pytest.raises(HexsimError) as caught:
        machine_from_dict(tables, "my.toml")
    assert str(caught.value) == f"my.toml: [{table}] is missing: add it (SI units)"


def test_number_of_further_problems_is_told(bench):
    """Two keys missing: both by name; of five, three and how many more."""
    tables = machine_tables(bench)
    del tables["oil"]["density_kg_m3"], tables["supply"]["pressure_Pa"]
    with pytest.raises(HexsimError) as caught:
        machine_from_dict(tables, "my.toml")
    assert "[oil] density_kg_m3 is missing: add it (SI units)" in str(caught.value)
    assert "[supply] pressure_Pa is missing: add it (SI units)" in str(caught.value)
    for key in ("stroke_m", "piston_diameter_m", "rod_diameter_m"):
        del tables["cylinder"][key]
    with pytest.raises(HexsimError, match=r"\(and 2 more\)$"):
        machine_from_dict(tables, "my.toml")


def test_a_misspelled_key_is_the_cause_and_is_not_hidden(bench):
    """stroke_mm for stroke_m: the unknown key comes first, with the one that is meant, then the one that is missing."""
    tables = machine_tables(bench)
    tables["cylinder"]["stroke_mm"] = tables["cylinder"].pop("stroke_m")
    with pytest.raises(
        HexsimError, match=r"stroke_mm is not a known key: did you mean stroke_m\?.*; .*stroke_m is missing"
    ):
        machine_from_dict(tables, "my.toml")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("20um", "2e-05 for 20um"),
        ("70 bar", "7e\\+06 for 70 bar"),
        ("3 furlong", "without the unit furlong"),
        ("much", "without quotes"),
    ],
)
def test_a_number_with_a_unit_says_what_to_write(bench, text, says):
    """Numbers are in the unit of their key: the sentence converts what it can."""
    with pytest.raises(HexsimError, match=rf"overlap_m = '{text}': a number is needed.*{says}"):
        changed(bench, {"valve.overlap_m": text})


def test_unknown_key_lists_the_known_ones(bench):
    """A key with another unit in its name, stroke_mm, is answered with the table's keys."""
    with pytest.raises(HexsimError) as caught:
        changed(bench, {"cylinder.stroke_mm": 200}, "my.toml")
    assert str(caught.value).startswith(
        "my.toml: [cylinder] stroke_mm is not a known key: did you mean stroke_m? allowed are piston_diameter_m, "
    )
    assert "stroke_m," in str(caught.value)


def test_unknown_table_lists_the_known_ones(bench):
    """[valves] for [valve]."""
    with pytest.raises(
        HexsimError,
        match=r"^my.toml: \[valves\] is not a known table: did you mean valve\? allowed are machine, supply, .*valve, ",
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


@pytest.mark.parametrize("share", [0.5, 0.05])
def test_the_tendon_model_turns_with_the_full_legs_moments_of_inertia(hexapod, share):
    """At neutral, in heave and about each axis; with rods of 5 % of the leg's mass the legs alone would be no rigid body.

    Full legs: T^T M T with the joints' rates that the six ball ends leave free (T), tolerance that of the linear solve.
    """
    machine, matrices = changed(hexapod, {"load.rod_mass_fraction": share}), []
    for kind in ("full", "tendon"):
        plant = Plant(machine, model=kind)
        model, data = plant.model, plant.data
        mujoco.mj_forward(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        first = model.body_dofadr[model.body("platform").id]
        free = np.arange(first, first + 6)
        bound = np.setdiff1d(np.arange(model.nv), free)
        turn = np.zeros((model.nv, 6))
        turn[free] = np.eye(6)
        if len(bound):
            held = data.efc_J.reshape(-1, model.nv)[:18]
            turn[bound] = -np.linalg.solve(held[:, bound], held[:, free])
        matrices.append(turn.T @ mass @ turn)
    full, tendon = (np.diag(matrix)[2:] for matrix in matrices)
    np.testing.assert_allclose(tendon, full, rtol=1e-6)


def test_legs_that_no_rigid_body_stands_for_are_refused_by_the_tendon_model(hexapod):
    """Light rods under a platform whose own moments are nearly impossible (z = x + y): full legs take it."""
    light = changed(hexapod, {"load.rod_mass_fraction": 0.05, "load.platform_inertia_kg_m2": [50.0, 50.0, 99.99]})
    with pytest.raises(HexsimError, match=r"load.rod_mass_fraction a share of 0.3 or more, or take full legs"):
        Plant(light, model="tendon")
    assert Plant(light, model="full").model.nbody > 12


@pytest.mark.parametrize(
    ("text", "description"),
    [
        ("a = " + "[" * 5000, "lists within each other more than 20 deep"),
        ("a = " + "[" * 30 + "]" * 30, "lists within each other more than 20 deep"),
        (".".join(["a"] * 5000) + " = 1", "lists within each other more than 20 deep"),
        ("a = " + "9" * 5000, "limit"),
        ("a = " + "9" * 400, "an integer beyond 64 bits"),
    ],
)
def test_toml_that_no_person_writes_is_refused(tmp_path, text, description):
    """Deep nesting and endless integers end in one short sentence with the file, not in RecursionError or ValueError."""
    (tmp_path / "machine.toml").write_text(text)
    with pytest.raises(HexsimError) as caught:
        load_machine(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / 'machine.toml'} is not valid TOML: ")
    assert description in str(caught.value) and len(str(caught.value)) < 300


@pytest.mark.parametrize("name", ["x" * 300, "x\0y", "/", "..", ""])
def test_names_that_no_file_can_have_are_unknown_machines(name):
    """300 characters, a NUL, folders without a machine: one sentence each."""
    with pytest.raises(HexsimError, match=r"unknown machine|has no machine.toml"):
        load_machine(name)


def test_a_close_name_comes_first():
    """A slip of the pen is answered with what was meant, then with all there are."""
    with pytest.raises(HexsimError, match=r"unknown machine 'bensh': did you mean bench\? give one of bench, micro"):
        load_machine("bensh")
