"""The library of effects: each vanishes at its neutral value, acts at its typical one, and has bounds that hold."""

import math

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.hydraulics import effects as effect_library
from hexsim.hydraulics import leg
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import load_machine, machine_from_dict
from hexsim.plant import Plant

BENCH, HEXAPOD, FOUR_WAY = (load_machine(name) for name in ("bench", "micro_motion_system", "servo_bench"))
NAMED = [name for name, effect in effect_library.library().items() if effect.parameters]


def machine_for(effect):
    return FOUR_WAY if effect.four_way else BENCH if "bench" in effect.kinds else HEXAPOD


def with_effect(machine, name, values):
    """The machine as if its file carried the effect; the power unit goes where the effect brings its own supply."""
    tables = machine.model_dump(exclude_none=True)
    tables.pop("power_unit", None)
    return machine_from_dict(tables | {"effects": {name: values} if name else {}})


def numbers(machine):
    """Everything that an effect may change, as one list of numbers."""
    resolved = resolve(machine)
    modes = [v for m in resolved.payload_modes for v in (m.mass_kg, m.frequency_Hz, m.damping_ratio)]
    load, sensors = resolved.load.model_dump(), resolved.sensors.model_dump()
    plain = [v for v in (*load.values(), *sensors.values()) if isinstance(v, float)]
    tuples = [x for v in load.values() if isinstance(v, tuple) for x in v]
    legs = np.concatenate(list(resolved.leg_sensors.values()))
    built = [resolved.mechanics.base_joints, resolved.mechanics.platform_joints, resolved.mechanics.retracted_length_m]
    built += [resolved.imu_turn_rad, resolved.imu_place_m, resolved.loop_gain, resolved.loop_delay_ticks]
    built += [resolved.position_ripple]
    built = np.concatenate([np.ravel(array) for array in built])
    return np.concatenate(
        [resolved.rows.ravel(), resolved.supply, legs, resolved.gravity_m_s2, plain, tuples, modes, built]
    )


def values_of(effect, size):
    """Size as the first number, the others typical."""
    values = {p.name: p.default if p.default is not None else p.typical for p in effect.parameters}
    return values | {effect.parameters[0].name: size}


@pytest.mark.parametrize("name", NAMED)
def test_an_effect_changes_the_machine(name):
    """At its typical size an effect changes at least one number that plant and tracing read."""
    effect = effect_library.library()[name]
    before = numbers(with_effect(machine_for(effect), None, {}))
    after = numbers(with_effect(machine_for(effect), name, values_of(effect, effect.parameters[0].typical)))
    assert len(before) != len(after) or np.any(before != after)


@pytest.mark.parametrize(
    "name", [n for n in NAMED if effect_library.library()[n].parameters[0].neutral == 0.0 and n != "supply_droop"]
)
def test_an_effect_vanishes_at_its_neutral_size(name):
    """A size of zero leaves every number as declared, exactly. (A pump line has no zero: it is left out instead.)"""
    effect = effect_library.library()[name]
    shape_only = {  # a wave of no height may have a length, a flow of none a threshold
        "relief_flow": {P.RELIEF_OPENS},
        "null_warm_up": {P.NULL_WARM_UP_TIME},
        "friction_warm_up": {P.FRICTION_WARM_UP_TIME},
        "worn_bore": {P.WEAR_PLACE, P.WEAR_WIDTH},
        "position_dependent_friction": {P.RIPPLE_LENGTH, P.RIPPLE_PHASE},
        "outside_force_tone": {P.TONE_FREQUENCY, P.TONE_PHASE},
    }
    before = numbers(with_effect(machine_for(effect), None, {}))
    after = numbers(with_effect(machine_for(effect), name, values_of(effect, 0.0)))
    changed = np.flatnonzero(before != after)
    assert set(changed.tolist()) <= shape_only.get(name, set())


@pytest.mark.parametrize("name", NAMED)
def test_bounds_hold(name):
    """A number beyond its bounds is refused with a sentence that names effect, number and bounds."""
    effect = effect_library.library()[name]
    parameter = effect.parameters[0]
    with pytest.raises(HexsimError, match=rf"{name}.*{parameter.name}.*must lie in"):
        with_effect(machine_for(effect), name, values_of(effect, parameter.bounds[1] * 1.01))


@pytest.mark.parametrize(("declared_cold", "start", "end"), [(0.0, 1.25, 1.0), (1.0, 1.0, 0.8)])
def test_friction_warms_up_from_the_declared_one_or_to_it(declared_cold, start, end):
    """A quarter more than warm at the start: a declared friction that is the cold one falls by a fifth of it."""
    values = values_of(effect_library.library()["friction_warm_up"], 0.25) | {"declared_cold": declared_cold}
    row = resolve(with_effect(BENCH, "friction_warm_up", values)).rows[0]
    assert leg.cold_factor(row, 0.0) == pytest.approx(start, rel=1e-12)
    assert leg.cold_factor(row, 1e4) == pytest.approx(end, rel=1e-12)


def test_an_effect_in_one_leg_leaves_the_others():
    """`where = "leg 2"` reaches leg 2 alone."""
    machine = with_effect(HEXAPOD, "leakage_supply_to_chamber", {"conductance_m3_s_Pa": 1e-12, "where": "leg 2"})
    before = resolve(with_effect(HEXAPOD, None, {})).rows
    changed = np.flatnonzero(np.any(resolve(machine).rows != before, axis=1))
    assert changed.tolist() == [1]


def test_inverse_effects_fade_as_their_number_grows():
    """An effect whose neutral value is infinity does less the larger its number is: a spool at 2 kHz is nearly none."""

    def lag(values):
        row = resolve(with_effect(BENCH, "spool_lag" if values else None, values)).rows[0]
        return 2 * row[P.SPOOL_DAMPING] / row[P.SPOOL_OMEGA] if row[P.SPOOL_OMEGA] > 0 else 0.0

    added = [lag({"frequency_Hz": frequency}) - lag({}) for frequency in (20.0, 200.0, 2000.0)]
    assert added == pytest.approx([2 * 0.7 / (2 * math.pi * frequency) for frequency in (20.0, 200.0, 2000.0)])


def test_learned_term_wants_a_whole_curve():
    """A curve with a missing key or another number of values is refused with what is wanted."""
    curve = {"balance": "force", "signal": "position_m", "start": 0.0, "step": 0.01, "values": [0.0] * 33}
    resolve(with_effect(BENCH, "learned_term", {"curve": curve}))
    with pytest.raises(HexsimError, match="give 33"):
        resolve(with_effect(BENCH, "learned_term", {"curve": curve | {"values": [0.0] * 5}}))
    with pytest.raises(HexsimError, match="needs balance, signal"):
        resolve(with_effect(BENCH, "learned_term", {"curve": {"balance": "force"}}))


@pytest.mark.parametrize("name", NAMED)
def test_two_tables_of_an_effect_add_up_or_are_refused(name):
    """On the same legs the second neither replaces the first nor is lost; on legs of their own both stand."""
    effect = effect_library.library()[name]
    machine, first = machine_for(effect), values_of(effect, effect.parameters[0].typical)
    second = values_of(effect, 0.5 * effect.parameters[0].typical)
    try:
        both = numbers(with_effect(machine, name, [first, second]))
    except HexsimError as error:
        assert effect.once and "twice" in str(error)
        return
    assert not effect.once
    for alone in (first, second):
        only = numbers(with_effect(machine, name, alone))
        assert len(only) != len(both) or np.any(only != both)


def test_an_effect_that_a_leg_has_once_may_differ_from_leg_to_leg():
    """Worn bores of legs 1 and 2 stand side by side; one of all legs and one of leg 2 are refused, and two supply lines too."""
    tables = [{"conductance_m3_s_Pa": 1e-12, "where": "leg 1"}, {"conductance_m3_s_Pa": 2e-12, "where": "leg 2"}]
    rows = resolve(with_effect(HEXAPOD, "worn_bore", tables)).rows
    assert rows[:3, P.WEAR_CONDUCTANCE].tolist() == [1e-12, 2e-12, 0.0]
    with pytest.raises(HexsimError, match=r"worn_bore\] is given twice for leg 2"):
        with_effect(HEXAPOD, "worn_bore", [{"conductance_m3_s_Pa": 1e-12}, tables[1]])
    plain = BENCH.model_dump(exclude_none=True)
    lines = {"supply_droop": {"line_resistance_Pa_s_m3": 1e9}, "gas_accumulator": {}}
    with pytest.raises(HexsimError, match="keep one of them"):
        machine_from_dict(plain | {"effects": lines})


@pytest.mark.parametrize("order", [1, -1])
def test_an_inclined_base_that_is_out_of_level_too(order):
    """Both turn gravity, in either order: by 0.1 about y and 0.01 about x, to second order."""
    effects = [("incline", {"angle_rad": 0.1}), ("gravity_direction", {"about_x_rad": 0.01})][::order]
    g = resolve(machine_from_dict(HEXAPOD.model_dump(exclude_none=True) | {"effects": dict(effects)})).gravity_m_s2
    np.testing.assert_allclose(g / np.linalg.norm(g), [math.sin(0.1), -0.01, -math.cos(0.1)], atol=2e-3 * 0.1)


@pytest.mark.parametrize(
    ("machine", "effects", "sentence"),
    [
        (BENCH, {"flexible_payload": {"mass_kg": 50.0}}, "leave -10 kg"),
        (BENCH, {"flexible_payload": {"mass_kg": 40.0}}, "leave 0 kg"),
        (BENCH, {"mass_change": {"mass_kg": -41.0}}, "leave -1 kg"),
        (BENCH, {"flexible_payload": {"mass_kg": 30.0}, "mass_change": {"mass_kg": -15.0}}, "leave -5 kg"),
        (HEXAPOD, {"mass_change": {"mass_kg": -601.0}}, "leave -1 kg"),
        (HEXAPOD, {"flexible_payload": {"mass_kg": 600.0, "height_m": 0.5}}, "leave 0 kg"),
        (HEXAPOD, {"inertia_change": {"x_kg_m2": -100.0}}, "each moment must be above 0"),
        (HEXAPOD, {"inertia_change": {"z_kg_m2": 1e3}}, "sum of the other two"),
    ],
)
def test_a_load_that_no_body_can_be_is_refused(machine, effects, sentence):
    """Effects that take all mass, or leave moments of inertia of no body: one sentence instead of MuJoCo's traceback."""
    with pytest.raises(HexsimError, match=sentence):
        Plant(machine_from_dict(machine.model_dump(exclude_none=True) | {"effects": effects}))
