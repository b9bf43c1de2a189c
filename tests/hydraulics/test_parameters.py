"""Each declared number arrives in its place of the row; neutral effects leave rows as declared."""

import math

import numpy as np
import pytest

from hexsim.hydraulics import effects, parameters
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import load_machine
from hexsim.machine.files import changed

WALTHER = [math.log10(math.log10(nu + 0.7)) for nu in (46.0, 7.9)]  # ASTM D341 at 40 and 100 degC
STEP = math.log10(308.15 / 313.15) / math.log10(373.15 / 313.15)
TELLUS_35_m2_s = 1e-6 * (10 ** (10 ** (WALTHER[0] + STEP * (WALTHER[1] - WALTHER[0]))) - 0.7)
PLACES = [  # key, a value that no other key has, place in the row, what must stand there
    ("supply.pressure_Pa", 6.1e6, P.SUPPLY_PRESSURE, 6.1e6),
    ("supply.tank_pressure_Pa", 1.1e5, P.TANK_PRESSURE, 1.1e5),
    ("oil.density_kg_m3", 871.0, P.DENSITY, 871.0),
    ("oil.bulk_modulus_Pa", 1.31e9, P.BULK_MODULUS, 1.31e9),
    ("cylinder.piston_diameter_m", 0.05, P.AREA_BOTTOM, math.pi / 4 * 0.05**2),
    ("cylinder.rod_diameter_m", 0.02, P.AREA_TOP, math.pi / 4 * (0.04**2 - 0.02**2)),
    ("cylinder.stroke_m", 0.3, P.STROKE, 0.3),
    ("cylinder.pipeline_volume_m3", 7e-7, P.PIPELINE_VOLUME, 7e-7),
    ("cylinder.rod_side_volume_m3", 8e-7, P.ROD_SIDE_VOLUME, 8e-7),
    ("cylinder.rod_side_conductance_m3_s_sqrtPa", 3e-6, P.ROD_SIDE_CONDUCTANCE, 3e-6),
    ("cylinder.cushion_length_m", 0.007, P.CUSHION_LENGTH, 0.007),
    ("cylinder.cushion_stiffness_N_m", 3.3e6, P.CUSHION_STIFFNESS, 3.3e6),
    ("cylinder.cushion_damping_N_s_m", 1.7e4, P.CUSHION_DAMPING, 1.7e4),
    ("cylinder.cushion_orifice_m3_s_sqrtPa", 1e-7, P.CUSHION_CHOKE_LOW, (math.pi / 4 * 0.04**2) ** 3 / 1e-14),
    (
        "cylinder.cushion_orifice_m3_s_sqrtPa",
        1e-7,
        P.CUSHION_CHOKE_HIGH,
        (math.pi / 4 * (0.04**2 - 0.03**2)) ** 3 / 1e-14,
    ),
    ("valve.voltage_max_V", 5.0, P.SPOOL_GAIN, 1.1e-3 / 5.0),
    ("valve.spool_travel_max_m", 1.3e-3, P.SPOOL_TRAVEL, 1.3e-3),
    ("valve.spool_diameter_m", 0.012, P.AREA_GRADIENT_SUPPLY, math.pi * 0.012),
    ("valve.spool_diameter_m", 0.012, P.AREA_GRADIENT_TANK, math.pi * 0.012),
    ("valve.overlap_m", 20e-6, P.OVERLAP_SUPPLY, 20e-6),
    ("valve.overlap_m", 20e-6, P.OVERLAP_TANK, 20e-6),
    ("valve.edge_rounding_m", 1.5e-6, P.ROUNDING_SUPPLY, 1.5e-6),
    ("valve.edge_rounding_m", 1.5e-6, P.ROUNDING_TANK, 1.5e-6),
    ("valve.discharge_coefficient", 0.7, P.DISCHARGE, 0.7),
    ("valve.pressure_width_Pa", 2e4, P.PRESSURE_WIDTH, 2e4),
    ("valve.laminar_reynolds", 12.0, P.LAMINAR, 6.0 * TELLUS_35_m2_s),
    ("valve.flow_area", "quadratic", P.QUADRATIC_GAIN, 300.0),
    ("valve.spool_frequency_Hz", 45.0, P.SPOOL_OMEGA, 2 * math.pi * 45.0),
    ("valve.spool_damping", 0.6, P.SPOOL_DAMPING, 0.6),
    ("friction.viscous_extend_N_s_m", 2100.0, P.VISCOUS_EXTEND, 2100.0),
    ("friction.viscous_retract_N_s_m", 1700.0, P.VISCOUS_RETRACT, 1700.0),
    ("friction.coulomb_extend_N", 66.0, P.COULOMB_EXTEND, 66.0),
    ("friction.coulomb_retract_N", 61.0, P.COULOMB_RETRACT, 61.0),
    ("friction.static_extend_N", 31.0, P.STATIC_EXTEND, 31.0),
    ("friction.static_retract_N", 32.0, P.STATIC_RETRACT, 32.0),
    ("friction.stribeck_velocity_m_s", 0.006, P.STRIBECK_VELOCITY, 0.006),
    ("friction.sharpness_m_s", 3e-4, P.SHARPNESS, 3e-4),
    ("friction.form", "report", P.ARCTAN_SLOPE, 100.0),
    ("cylinder.rod_side", "chamber", P.ROD_SIDE_CHAMBER, 1.0),
]


@pytest.mark.parametrize(
    ("key", "given", "place", "stands"), PLACES, ids=lambda value: getattr(value, "name", str(value))
)
def test_declared_number_stands_in_its_place(bench, key, given, place, stands):
    """A changed key arrives, and the place did not hold that value before."""
    assert parameters.declared_rows(changed(bench, {key: given}))[0, place] == pytest.approx(stands, rel=1e-12)
    assert parameters.declared_rows(bench)[0, place] != pytest.approx(stands, rel=1e-3)


@pytest.mark.parametrize(("key", "given"), sorted({(key, given) for key, given, _, _ in PLACES}, key=str))
def test_declared_number_moves_no_other_place(bench, key, given):
    """A changed key moves the places that the table above gives it, those that follow by formula, and no more."""
    follows = {
        "cylinder.piston_diameter_m": {P.AREA_TOP},  # A2 = pi/4 (D^2 - d^2)
        "valve.spool_travel_max_m": {P.SPOOL_GAIN},  # x_max/u_max
    }
    expected = {place for k, _, place, _ in PLACES if k == key} | follows.get(key, set())
    moved = {
        P(i)
        for i in np.flatnonzero(
            parameters.declared_rows(changed(bench, {key: given}))[0] != parameters.declared_rows(bench)[0]
        )
    }
    assert moved == expected


def test_all_legs_are_declared_alike(hexapod, bench):
    """Six equal rows for a hexapod, one for a bench of the same cylinder: the mass is not the row's."""
    rows = parameters.declared_rows(hexapod)
    assert rows.shape == (6, parameters.N_PARAMETERS)
    assert np.all(rows == rows[0])
    np.testing.assert_array_equal(rows[0], parameters.declared_rows(bench)[0])


def test_places_are_numbered_without_gap_or_overlap():
    """0, 1, 2 .. and the learned table behind them: no hole and no double in MuJoCo's `actuator_user`."""
    assert [int(place) for place in P] == list(range(parameters.LEARNED_TABLE))
    assert len(P.__members__) == parameters.LEARNED_TABLE  # no second name for a place


def neutral_settings(effect):
    """The effect's table with every parameter at its neutral value, or None where neutral is a limit (infinity)."""
    table = {}
    for parameter in effect.parameters:
        value = parameter.neutral if parameter.default is None else parameter.default
        if not (math.isfinite(value) and parameter.bounds[0] <= value <= parameter.bounds[1]):
            return None
        table[parameter.name] = value
    return table


ROW_EFFECTS = [
    name
    for name, effect in effects.library().items()
    if effect.apply is None and neutral_settings(effect) is not None and "bench" in effect.kinds
]


def test_most_effects_of_the_row_have_a_neutral_value_in_reach():
    """The list that the next test goes through is not empty by mistake: at least ten effects."""
    assert len(ROW_EFFECTS) >= 10


@pytest.mark.parametrize("name", ROW_EFFECTS)
def test_neutral_effect_leaves_the_rows_untouched(bench, name):
    """Switched on at its neutral value, an effect that adds to the row's places leaves every number as declared."""
    effect = effects.library()[name]
    bench = load_machine("servo_bench") if effect.four_way else bench
    with_effect = resolve(changed(bench, {f"effects.{name}": neutral_settings(effect)}))
    scaled = [p.slot for p in effect.parameters if p.slot is not None and p.default is None]
    assert scaled, "an effect of the row has a place that scales it"
    np.testing.assert_array_equal(with_effect.rows[:, scaled], parameters.declared_rows(bench)[:, scaled])


def everything(machine):
    """All that an effect may change, as one list of numbers and tables."""
    made = resolve(machine)
    legs = made.mechanics
    numbers = [
        made.rows,
        made.supply,
        made.gravity_m_s2,
        *made.leg_sensors.values(),
        made.imu_turn_rad,
        made.imu_place_m,
        made.loop_gain,
        made.loop_delay_ticks,
        made.position_ripple,
    ]
    numbers += [legs.base_joints, legs.platform_joints, legs.retracted_length_m]
    return [n.tolist() for n in numbers], made.load, made.sensors, made.payload_modes


@pytest.mark.parametrize(
    "name", [name for name in effects.library() if name != "learned_term"]
)  # it has a curve, no strength
def test_believable_effect_changes_something_and_only_its_legs(hexapod, bench, name):
    """Every effect shows at its typical strength; in leg 2 it leaves the other legs' rows as declared."""
    effect = effects.library()[name]
    hexapod = load_machine("servo_hexapod") if effect.four_way else hexapod
    machine = hexapod if "hexapod" in effect.kinds else bench
    table = {parameter.name: parameter.typical for parameter in effect.parameters}
    assert everything(changed(machine, {f"effects.{name}": table})) != everything(machine)
    if effect.places == "leg" and machine is hexapod:
        rows = resolve(changed(machine, {f"effects.{name}": {**table, "where": "leg 2"}})).rows
        np.testing.assert_array_equal(
            np.delete(rows, 1, axis=0), np.delete(parameters.declared_rows(machine), 1, axis=0)
        )


def test_effect_of_two_tables_adds_up(hexapod):
    """The same effect twice, in leg 1 and in legs 1 and 4: leg 1 has the sum."""
    tables = [{"offset_V": 0.1, "where": "leg 1"}, {"offset_V": 0.2, "where": ["leg 1", "leg 4"]}]
    rows = resolve(changed(hexapod, {"effects.null_offset": tables})).rows
    np.testing.assert_allclose(rows[:, P.NULL_OFFSET], [0.3, 0, 0, 0.2, 0, 0], atol=1e-15)
