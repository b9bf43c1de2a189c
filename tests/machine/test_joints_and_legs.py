"""Joints where they were measured, legs that differ: identities with the two circles and the shared tables, hand calculations."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from hexsim import HexsimError, load_scenario
from hexsim.machine import load_machine, machine_from_dict
from hexsim.machine.files import changed, machine_tables
from hexsim.motion_computer import limits
from hexsim.motion_computer.computer import MotionComputer
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.plant import Plant
from hexsim.simulation import simulate

DECLARED = load_machine("micro_motion_system")
CIRCLES = machine_tables(DECLARED)


def with_joints(base=None, platform=None, **more):
    """The report's machine with its joints as two tables."""
    tables = {
        "base_joints_m": (DECLARED.mechanics.base_joints if base is None else base).tolist(),
        "platform_joints_m": (DECLARED.mechanics.platform_joints if platform is None else platform).tolist(),
        "neutral_leg_length_m": CIRCLES["geometry"]["neutral_leg_length_m"],
    }
    return machine_from_dict(CIRCLES | {"geometry": tables | more})


def with_toml(text, tables=CIRCLES):
    return machine_from_dict(tables | tomllib.loads(text), "my.toml")


def short_run(machine, fast=False):
    """0.3 s of motion in all axes at once."""
    scenario = replace(load_scenario("combined", duration_s=0.3), fade_s=0.0)
    return simulate(machine, scenario, fast=fast, seed=3).log


@pytest.mark.parametrize("fast", [False, True], ids=["full legs", "tendons"])
def test_a_table_equal_to_the_circles_gives_the_same_log(fast):
    """Tables with the circles' own numbers: every column equal to the bit."""
    assert short_run(with_joints(), fast).equals(short_run(load_machine("micro_motion_system"), fast))


def test_leg_tables_equal_to_the_shared_ones_give_the_same_log():
    """[[leg]] tables that repeat the machine's numbers: every column equal to the bit."""
    names = ("cylinder", "valve", "friction")
    some = {"piston_diameter_m", "stroke_m", "spool_diameter_m", "overlap_m", "coulomb_extend_N"}
    own = {name: {k: v for k, v in CIRCLES[name].items() if k in some} for name in names}
    own |= {"sensors": {"position_noise_m": 3e-6, "position_gain": 1.0}, "controller": {"gain_V_per_m": 50.0}}
    machine = machine_from_dict(CIRCLES | {"leg": [{"number": number} | own for number in (2, 5)]})
    assert short_run(machine).equals(short_run(load_machine("micro_motion_system")))


def test_a_displaced_joint_moves_its_own_leg_as_by_hand():
    """Base joint 2 moved by d: l2 = |p + R b2 - a2 - d|, the other legs as before."""
    shift, pose = np.array([1e-3, -2e-3, 0.5e-3]), np.array([0.01, -0.02, 0.03, 0.04, -0.05, 0.06])
    base = DECLARED.mechanics.base_joints.copy()
    base[1] += shift
    moved = with_joints(base).mechanics
    place = pose[:3] + np.array([0, 0, moved.neutral_height_m])
    ends = place + DECLARED.mechanics.platform_joints @ moved.rotation(pose).T
    by_hand = np.linalg.norm(ends - base, axis=1)
    assert moved.leg_lengths(pose) == pytest.approx(by_hand, abs=1e-14)
    higher = np.array([0, 0, moved.neutral_height_m - DECLARED.mechanics.neutral_height_m, 0, 0, 0])
    others = [0, 2, 3, 4, 5]
    assert moved.leg_lengths(pose)[others] == pytest.approx(
        DECLARED.mechanics.leg_lengths(pose + higher)[others], abs=1e-14
    )
    assert np.mean(moved.leg_lengths(np.zeros(6))) == pytest.approx(0.70, abs=1e-13)


def test_leg_zero_offset_makes_the_leg_longer_than_its_piston_says():
    """Offset e on leg 4: at the same pose its piston reads e less, the others the same."""
    offsets = np.array([0, 0, 0, 2e-3, 0, 0])
    machine = with_joints(leg_zero_offsets_m=offsets.tolist())
    pose = np.array([0.01, 0.0, 0.02, 0.0, 0.03, 0.0])
    assert machine.mechanics.piston_positions(pose) == pytest.approx(
        DECLARED.mechanics.piston_positions(pose) - offsets, abs=1e-14
    )


@pytest.mark.parametrize("fast", [False, True], ids=["full legs", "tendons"])
def test_displaced_joints_are_displaced_in_the_plant(fast):
    """All twelve joints off by some mm: the plant's pistons stand where the kinematics of its pose says, within 1 um.

    Full legs are closed by stiff joints, which give 0.1 um.
    """
    random = np.random.default_rng(4)
    base, platform = (
        j + random.uniform(-5e-3, 5e-3, (6, 3))
        for j in (DECLARED.mechanics.base_joints, DECLARED.mechanics.platform_joints)
    )
    machine = with_joints(base, platform)
    log = short_run(machine, fast)
    pose = np.column_stack(
        [log[f"platform_{axis}"] for axis in ("x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad")]
    )
    pistons = np.column_stack([log[f"true_position_{leg}_m"] for leg in range(1, 7)])
    assert np.ptp(pistons, axis=0).min() > 1e-4
    assert pistons == pytest.approx(machine.mechanics.piston_positions(pose), abs=1e-6)


def test_a_leg_with_another_cylinder_carries_by_another_pressure():
    """At rest P1 A1 - Ps A2 is the same force, so P1' = (F + Ps A2')/A1': by hand from the pressures of equal legs."""
    plain, other = (
        load_machine("micro_motion_system"),
        with_toml("[[leg]]\nnumber = 3\n[leg.cylinder]\npiston_diameter_m = 0.05"),
    )
    Ps = plain.supply.pressure_Pa
    force = Plant(plain).static_pressures() * plain.cylinder.area_bottom_m2 - Ps * plain.cylinder.area_top_m2
    own = other.legs[2].cylinder
    assert own.area_bottom_m2 == pytest.approx(np.pi / 4 * 0.05**2)
    pressures = Plant(other).static_pressures()
    # the rod is as heavy as before: the load differs by the piston's inertia alone, which does nothing at rest
    assert pressures[2] == pytest.approx((force[2] + Ps * own.area_top_m2) / own.area_bottom_m2, rel=1e-3)
    others = np.delete(pressures, 2)
    assert others == pytest.approx(
        np.delete((force + Ps * plain.cylinder.area_top_m2) / plain.cylinder.area_bottom_m2, 2), rel=1e-3
    )


def test_a_legs_own_keys_replace_those_that_say_the_same():
    """A lap in % in place of one in m; the other legs keep theirs."""
    machine = with_toml("[[leg]]\nnumber = 6\n[leg.valve]\noverlap_percent = 2.0")
    overlaps = [leg.valve.overlaps_m[0] for leg in machine.legs]
    assert overlaps == pytest.approx([5e-6] * 5 + [0.02 * 1.1e-3])


REFUSED = {
    "number = 2\n[leg.cylinder]\npiston_diameter_m = 0.01": "leg 2: [leg.cylinder] rod_diameter_m = 0.03 must be smaller",
    "number = 2\n[leg.cylinder]\npiston_diameter_m = 'x'": "[leg.cylinder] piston_diameter_m = 'x': a number is needed",
    "number = 2\n[leg.cylinder]\nstroke_m = 1e9": "[leg.cylinder] stroke_m = 1000000000.0: .*0.005 to 10 is possible",
    "number = 2\n[leg.cylinder]\nrod_side = 'valve'": "[leg.cylinder] rod_side is not a known key",
    "number = 2\n[leg.valves]\nx = 1": "[leg] valves is not a known key: did you mean valve. allowed are number, cylinder",
    "number = 7": "[leg] number = 7: .*1 to 6 is possible",
    "number = 2\n[[leg]]\nnumber = 2": "number = 2 stands twice: put its keys into one table",
    "number = 2\n[leg.friction]\ncoulomb_extend_N = 99999.0": "leg 2: friction.coulomb_extend_N = 99999 must be below",
    "cylinder = 3\nnumber = 1": "[leg] cylinder = 3: must be a table",
}


@pytest.mark.parametrize(("text", "sentence"), REFUSED.items(), ids=range(len(REFUSED)))
def test_impossible_leg_tables_are_refused(text, sentence):
    """One sentence with file, table, key, value and what is allowed."""
    pattern = sentence.replace("[", r"\[").replace("]", r"\]")
    with pytest.raises(HexsimError, match=rf"^my.toml: .*{pattern}"):
        with_toml(f"[[leg]]\n{text}")


def test_a_bench_has_one_leg():
    """[[leg]] 2 of a bench is refused, leg 1 is its only one."""
    bench = machine_tables(load_machine("bench"))
    with pytest.raises(HexsimError, match="number = 2: the machine has 1 leg"):
        with_toml("[[leg]]\nnumber = 2", bench)
    assert with_toml("[[leg]]\nnumber = 1\n[leg.cylinder]\nstroke_m = 0.5", bench).mechanics.stroke_m == [0.5]


def test_both_forms_of_joints_are_refused_together():
    """Circles and tables in one file: which two keys, and what to do."""
    with pytest.raises(HexsimError, match=r"\[geometry\]: base_joints_m and base_radius_m both say where joints are"):
        changed(with_joints(), {"geometry.base_radius_m": 0.6})


def test_joints_that_hold_nothing_are_refused():
    """Equal joints above and below: six parallel legs."""
    with pytest.raises(HexsimError, match="cannot hold the platform"):
        _ = with_joints(DECLARED.mechanics.platform_joints).mechanics


def test_declared_tables_survive_a_file():
    """To TOML's tables and back: the same machine."""
    machine = with_toml("[[leg]]\nnumber = 2\n[leg.valve]\noverlap_percent = 3.0")
    assert machine_from_dict(machine_tables(machine)) == machine
    assert machine_from_dict(machine_tables(with_joints())) == with_joints()


def test_each_leg_has_its_own_gain_and_limit():
    """Half the gain on leg 2, a valve of 5 V on leg 3: volts of the same error, by hand."""
    machine = with_toml(
        "[[leg]]\nnumber = 2\n[leg.controller]\ngain_V_per_m = 25.0\n[[leg]]\nnumber = 3\n[leg.valve]\nvoltage_max_V = 5.0"
    )
    loop = PositionLoop(machine, [], None)
    middle = machine.mechanics.neutral_positions
    assert loop.tick(0.0, middle[None] + 0.004, middle, None, 7e6) == pytest.approx([0.2, 0.1, *[0.2] * 4])
    assert loop.tick(0.0, middle[None] + 0.5, middle, None, 7e6) == pytest.approx([10.0, 10.0, 5.0, 10.0, 10.0, 10.0])


def test_the_motion_computer_takes_each_leg_to_its_own_neutral():
    """A longer stroke and a zero offset: the neutral pose, and clear of every leg's own cushions."""
    machine = with_joints(leg_zero_offsets_m=[0.0, 2e-3, 0.0, 0.0, 0.0, 0.0])
    machine = changed(machine, {"leg": [{"number": 5, "cylinder": {"stroke_m": 0.3}}]})
    by_hand = np.array([0.1, 0.1 - 2e-3, 0.1, 0.1, 0.15, 0.1])
    assert MotionComputer(machine).neutral == pytest.approx(by_hand, abs=1e-12)
    room = (
        np.minimum(by_hand, machine.mechanics.stroke_m - by_hand)
        - machine.cylinder.cushion_length_m
        - limits.LEG_MARGIN_m
    )
    assert limits.leg_limits(machine).excursion == pytest.approx(room, abs=1e-12)
