"""The platform by Newton and Euler against MuJoCo's tendons: MuJoCo is the second plant here."""

import ctypes

import mujoco
import numpy as np
import pytest

from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant, newton_euler

WRITTEN = ("qacc", "act_dot", "ten_length", "ten_velocity", "actuator_force")
OF_LEGS = ("actuator_length", "actuator_velocity")  # the supply's actuator acts on no leg
OF_PLATFORM = ("xpos", "xmat", "xquat", "xipos")
STATE = ("qpos", "qvel", "act")
PAYLOAD = [{"mass_kg": 80.0, "position_m": [0.3, -0.2, 0.4], "inertia_kg_m2": [5.0, 8.0, 4.0]}]


def two_of(machine):
    """A plant in any state on its way, and the same with MuJoCo's evaluation of it."""
    ours, theirs = (Plant(machine, model="tendon") for _ in range(2))
    ours.prepare(500.0)
    for k in range(60):
        ours.tick(3.0 * np.sin(0.1 * k + np.arange(6.0)))
    body = ours.model.body("platform").id
    for plant in (ours, theirs):
        plant.move_centre_of_mass(np.array([0.05, -0.02, 0.1]))
        plant.data.xfrc_applied[body] = [300.0, -200.0, 100.0, 20.0, 30.0, -40.0]
        plant.model.opt.timestep = 5e-4
        for name in (*STATE, "ctrl"):
            getattr(plant.data, name)[:] = getattr(ours.data, name)
        plant.data.time = ours.data.time
    return ours, theirs


def by_us(plant, what):
    ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)(newton_euler.native_platform().address)(
        plant.model._address, plant.data._address, what
    )


@pytest.mark.parametrize("name", ["micro_motion_system", pytest.param("power_unit", marks=pytest.mark.slow)])
def test_a_platform_moves_as_mujoco_says(name):
    """Turned, moving, its centre of mass aside, with a payload and pushed from outside: all that an evaluation leaves behind is
    MuJoCo's to 1e-11 of the largest, and after a step of RK4 to 1e-9."""
    machine = load_machine("micro_motion_system/power_unit" if name == "power_unit" else name)
    ours, theirs = two_of(changed(machine, {"payload": PAYLOAD}))
    assert ours.is_one_body
    assert np.abs(ours.data.qvel).min() > 1e-4  # every direction moves
    by_us(ours, newton_euler.What.LENGTHS)
    by_us(ours, newton_euler.What.EVALUATE)
    mujoco.mj_forward(theirs.model, theirs.data)
    for field in WRITTEN:
        found, asked = getattr(ours.data, field), getattr(theirs.data, field)
        np.testing.assert_allclose(found, asked, rtol=0.0, atol=1e-11 * np.abs(asked).max(), err_msg=field)
    for field in OF_LEGS:
        found, asked = (getattr(plant.data, field)[: plant.n_legs] for plant in (ours, theirs))
        np.testing.assert_allclose(found, asked, rtol=0.0, atol=1e-11, err_msg=field)
    for field in OF_PLATFORM:
        found, asked = (getattr(plant.data.body("platform"), field) for plant in (ours, theirs))
        np.testing.assert_allclose(found, asked, rtol=0.0, atol=1e-12, err_msg=field)
    by_us(ours, newton_euler.What.RUNGE_KUTTA)
    mujoco.mj_RungeKutta(theirs.model, theirs.data, 4)
    for field in (*STATE, "qacc", "act_dot"):
        found, asked = getattr(ours.data, field), getattr(theirs.data, field)
        np.testing.assert_allclose(found, asked, rtol=0.0, atol=1e-9 * np.abs(asked).max(), err_msg=field)
    assert ours.data.time == theirs.data.time


def test_a_payload_on_a_spring_keeps_mujocos_steps():
    """Two bodies that move are MuJoCo's: the platform falls back on its steps, and the payload swings."""
    machine = changed(
        load_machine("micro_motion_system"),
        {"effects": {"flexible_payload": {"mass_kg": 60.0, "frequency_Hz": 8.0, "damping_ratio": 0.05}}},
    )
    plant = Plant(machine, model="tendon")
    plant.prepare(500.0)
    for _ in range(20):
        plant.tick(np.full(6, 2.0))
    assert not plant.is_one_body
    assert abs(plant.data.qpos[7]) > 1e-6
