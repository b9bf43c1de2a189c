"""Any effect of the library can begin at a time of a run: `[[faults]]` of kind "effect"."""

import dataclasses

import mujoco
import numpy as np
import pytest

from hexsim import HexsimError, load_scenario
from hexsim.hydraulics import effects
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant
from hexsim.simulation import simulate

BEGIN_S = 0.6
# a learned term has a curve, no strength
NAMES = [name for name, effect in effects.library().items() if name != "learned_term" and not effect.built_in]


def typical(name: str) -> dict:
    """Typical numbers; a relief that opens below the 3.4 MPa of a bench at rest, or it would do nothing."""
    below = {"opening_pressure_Pa": 3.0e6} if name == "relief_flow" else {}
    return {parameter.name: parameter.typical for parameter in effects.library()[name].parameters} | below


def machine_for(name: str):
    if effects.library()[name].four_way:
        return load_machine("servo_bench")
    return load_machine("bench" if "bench" in effects.library()[name].kinds else "micro_motion_system")


@pytest.mark.parametrize("name", NAMES)
def test_a_plant_with_the_effect_switched_on_is_the_plant_that_always_had_it(name):
    """Rows, supply, masses, springs and gravity are those of a plant built with the effect; before, those without."""
    machine = machine_for(name)
    plant = Plant(machine, later=[effects.effect_setting(machine, name, typical(name), "test:")])
    np.testing.assert_array_equal(plant.rows, Plant(machine).rows)
    plant.tick(np.zeros(machine.n_legs))
    plant.switch_on(*effects.effect_setting(machine, name, typical(name), "test:"))
    always = Plant(changed(machine, {f"effects.{name}": typical(name)}))
    np.testing.assert_array_equal(plant.rows, always.rows)
    np.testing.assert_array_equal(plant.resolved.supply, always.resolved.supply)
    for array in (
        "actuator_user",
        "body_mass",
        "body_ipos",
        "body_inertia",
        "jnt_stiffness",
        "qpos_spring",
        "dof_damping",
    ):
        np.testing.assert_array_equal(getattr(plant.model, array), getattr(always.model, array))
    np.testing.assert_array_equal(plant.model.opt.gravity, always.model.opt.gravity)
    plant.tick(np.zeros(machine.n_legs))
    plant.check()


def log_with(name: str, machine, **fault):
    scenario = load_scenario("heave", duration_s=1.0)
    if fault or name:
        fault = {"kind": "effect", "time_s": BEGIN_S, "effect": name, "parameters": typical(name), **fault}
        scenario = dataclasses.replace(scenario, faults=(fault,))
    result = simulate(machine, scenario, fast=True)
    assert result.complete, result.reason
    return result.log


@pytest.fixture(scope="module")
def without():
    """Logs without an effect, under the motion computer: an effect that begins after the end."""
    machines = {name: load_machine(name) for name in ("bench", "micro_motion_system", "servo_bench")}
    return {name: log_with("null_offset", machine, time_s=1e3) for name, machine in machines.items()}


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_begins_at_its_time(name, without):
    """Before its time the log is that of the sound machine, after it some column differs, and the run goes on.

    Equal to 1e-6 of each column's range (a spring's mode weighs a millionth before it is there), to 2e-3 where the load
    will move and stands 2 um off centre.
    """
    machine = machine_for(name)
    log, sound = log_with(name, machine), without[machine.name.split("/")[-1]]
    early = log["time_s"].to_numpy() < BEGIN_S
    differs = False
    for column in sound.columns:
        a, b = log[column].to_numpy().astype(float), sound[column].to_numpy().astype(float)
        near = 2e-3 if name == "centre_of_mass" else 1e-6
        np.testing.assert_allclose(a[early], b[early], atol=near * max(np.ptp(b), 1e-9), rtol=1e-6, err_msg=column)
        differs |= not np.allclose(a[~early], b[~early], rtol=1e-6, atol=1e-6 * max(np.ptp(b), 1e-12))
    assert differs or name == "spool_rate_limit"  # a heave of 0.5 Hz moves its spool slower than that


def test_an_effect_begins_in_its_leg_only():
    """A leak in leg 2 shows in leg 2's flow from its time on."""
    machine = load_machine("micro_motion_system")
    leak = dict(parameters={"conductance_m3_s_Pa": 2e-11}, where="leg 2")
    log = log_with("leakage_supply_to_chamber", machine, **leak)
    step = [np.abs(np.diff(log[f"flow_{i}_m3_s"].to_numpy()))[round(BEGIN_S * 1000) - 1] for i in (1, 2)]
    assert step[1] > 20 * step[0]


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ({"effect": "rust"}, "unknown effect 'rust'"),
        ({"effect": "null_offset", "parameters": {"offset_V": 1e9}}, "offset_V = 1e\\+09 must lie in"),
        ({"effect": "null_offset", "parameters": {}}, "offset_V is missing"),
        ({"effect": "null_offset", "parameters": {"offset_V": 0.1}, "where": "leg 7"}, "where = 'leg 7' must be"),
        ({"effect": "incline", "oil": 3.0}, "oil"),
        ({"effect": "leakage_across_piston", "parameters": {"conductance_m3_s_Pa": 1e-13}}, 'rod_side = "valve"'),
    ],
)
def test_a_wrong_effect_is_refused_before_the_run(fault, sentence):
    """Name, parameters, bounds and place are checked as in a machine file."""
    scenario = dataclasses.replace(load_scenario("heave"), faults=({"kind": "effect", "time_s": 1.0, **fault},))
    with pytest.raises(HexsimError, match=sentence):
        simulate(load_machine("bench"), scenario)


def test_a_moved_centre_of_mass_couples_heave_and_pitch():
    """A plant whose load has moved has the mass matrix of one built with that centre: MuJoCo drops the coupling of a
    body that it takes for centred, so a plant is told that its load will move."""
    machine = load_machine("micro_motion_system")
    moved = Plant(machine, load_moves=True)
    moved.move_centre_of_mass(np.array([0.1, 0.0, 0.0]))
    built = Plant(changed(machine, {"load.centre_of_mass_m": [0.1, 0.0, 0.0]}))
    matrices = []
    for plant in (moved, built):
        mujoco.mj_forward(plant.model, plant.data)
        full = np.zeros((plant.model.nv, plant.model.nv))
        mujoco.mj_fullM(plant.model, plant.data, full)
        matrices.append(full)
    assert abs(matrices[1][2, 4]) > 10.0
    np.testing.assert_allclose(matrices[0], matrices[1], atol=1e-6)
