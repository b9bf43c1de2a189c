"""Joints, leg zeros, IMU mounting and gravity's direction: the simulation and the balances of a hexapod agree on them."""

import numpy as np
import pytest
from other_plant import write_machine

import hexsim as hx
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import scenario_from_dict
from hexsim.signals import channels
from hexsim.tracing import balances
from hexsim.tracing.design import motions
from hexsim.tracing.problems.simulated import SimulatedProblem

NOISE = {
    "position_m": 3e-6, "pressure_bottom_Pa": 4e3, "pressure_supply_Pa": 4e3, "acceleration_m_s2": 0.02,
    "angular_acceleration_rad_s2": 0.03,
}  # fmt: skip
MOTION = {
    "name": "all axes", "mode": "dof", "duration_s": 4.0, "fade_s": 1.0,
    "axes": {
        axis: {"kind": "sine", "amplitude": size, "frequency_Hz": f}
        for axis, size, f in (("x", 0.02, 0.7), ("z", 0.02, 1.1), ("roll", 0.06, 0.9), ("yaw", 0.06, 0.6))
    },
}  # fmt: skip
CASES = {
    "base_joint_offset": ({"x_m": 1e-3, "where": "leg 3"}, "platform"),
    "platform_joint_offset": ({"z_m": 1e-3, "where": "leg 3"}, "platform"),
    "leg_zero_offset": ({"length_m": 5e-4, "where": "leg 3"}, "platform"),
    "gravity_direction": ({"about_x_rad": 2e-3}, "platform"),
    "imu_orientation": ({"y_rad": 0.0175}, "sensor"),
    "imu_position": ({"x_m": 0.05, "z_m": 0.02}, "sensor"),
}


@pytest.fixture(scope="module")
def hexapod():
    """The micro motion system with massless legs, ideal sensors and a constant supply."""
    tables = load_machine("micro_motion_system").model_dump(exclude_none=True)
    tables.pop("power_unit", None)
    tables["sensors"], tables["load"]["leg_mass_kg"] = {}, 0.0
    return type(load_machine("bench")).model_validate(tables)


@pytest.mark.parametrize("name", CASES)
def test_a_balance_holds_again_with_the_effect(hexapod, name):
    """A noise-free log of the machine that is built so: what the effect leaves in its balance falls below a fifth of what it
    makes there; the rest (held volts, reversals) is in both."""
    table, violated = CASES[name]
    balance = balances.balance_named(violated, hexapod)
    built = changed(hexapod, {f"effects.{name}": table})
    problem = SimulatedProblem(logs=(motions.setpoint_log(hexapod, MOTION).head(4.0),), noise=NOISE)
    usual, log = problem.simulated(hexapod, 0), problem.simulated(built, 0)
    first = int((channels.SETTLE_S + 0.1) * log.rate)
    floor = balance.residual(usual, hexapod)[:, first:-100]
    without, with_it = (balance.residual(log, machine)[:, first:-100] for machine in (hexapod, built))
    assert np.linalg.norm(with_it - floor) < 0.2 * np.linalg.norm(without - floor)


def test_how_a_machine_is_built_cannot_begin_in_a_run(hexapod):
    """A joint does not move at a time of a run: refused with a sentence that says where it belongs."""
    fault = {"kind": "effect", "time_s": 1.0, "effect": "leg_zero_offset", "parameters": {"length_m": 1e-3}}
    with pytest.raises(hx.HexsimError, match=r"leg_zero_offset is how the machine is built.*\[effects\]"):
        hx.run(scenario_from_dict(MOTION | {"faults": [fault | {"where": "leg 2"}]}), hexapod)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("built", "leg", "seed", "name", "number", "size"),
    [
        ("leg_zero", 2, 21, "leg_zero_offset", "length_m", 5e-4),
        ("platform_joint_z", 5, 22, "platform_joint_offset", "z_m", 1e-3),
        ("base_joint_x", 4, 23, "base_joint_offset", "x_m", 1e-3),
        ("imu_turn", None, 24, "imu_orientation", "y_rad", 0.017453),
    ],
)
def test_what_is_built_otherwise_is_found_with_its_leg(tmp_path, built, leg, seed, name, number, size):
    """A hexapod of the second plant, traced whole: explained, that effect alone, in that leg, within 10 %."""
    write_machine(tmp_path, seed, {built: None}, "hexapod", leg=leg)
    result = hx.trace(tmp_path, ["fit"], ["validate_heave", "validate_roll"])
    assert result.verdict == "explained"
    [effect] = result.report["effects"]
    assert (effect["name"], effect["where"]) == (name, "all legs" if leg is None else f"leg {leg}")
    assert effect["parameters"][number] == pytest.approx(size, rel=0.1)
