"""Bodies bolted to the platform, and machines drawn within their declared uncertainty."""

import numpy as np
import polars as pl
import pytest

import hexsim as hx
from hexsim import HexsimError, load_scenario
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import geometry
from hexsim.machine.files import changed
from hexsim.plant import Plant
from hexsim.studies import sweep

CABIN = {"name": "cabin", "mass_kg": 150.0, "position_m": [0.2, -0.1, 0.6], "inertia_kg_m2": [20.0, 25.0, 15.0]}
WIDTHS = {"base_joints_m": 1e-3, "platform_joints_m": 1e-3, "leg_zero_offsets_m": 5e-4, "bulk_modulus_Pa": 0.1}


def loaded(hexapod):
    return changed(hexapod, {"payload": [CABIN]})


def test_a_payload_joins_the_platform_by_the_parallel_axis_theorem(hexapod):
    """M = m1 + m2, c = (m1 c1 + m2 c2)/M, I_c = sum I_i + m_i (d_i.d_i 1 - d_i d_i'), d_i = c_i - c: products included."""
    body = geometry.platform_body(hexapod.load, loaded(hexapod).payload)
    total = 600.0 + 150.0
    place = np.array(CABIN["position_m"])
    centre = 150.0 * place / total
    inertia = np.diag([60.0, 60.0, 100.0]) + np.diag(CABIN["inertia_kg_m2"])
    for mass, arm in ((600.0, -centre), (150.0, place - centre)):
        inertia = inertia + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    assert body.mass == body.carried == total
    assert body.centre == pytest.approx(centre)
    assert np.array(body.inertia) == pytest.approx(inertia)


def test_the_plant_moves_as_that_body_does(hexapod):
    """MuJoCo's mass matrix of the tendon model, the platform's own joint: that of the joined body, and its weight on the legs."""
    machine = loaded(hexapod)
    plant = Plant(machine, model="tendon")
    body = geometry.moving_body(resolve(machine))
    plant_mass = plant.model.body_subtreemass[plant.model.body("platform").id]
    assert plant_mass == pytest.approx(body.mass, rel=1e-9)
    force = (
        plant.static_pressures() * machine.cylinder.area_bottom_m2
        - machine.supply.pressure_Pa * machine.cylinder.area_top_m2
    )
    wrench = plant.kinematics.jacobian(np.zeros(6)).T @ force
    weight = body.carried * machine.machine.gravity_m_s2
    assert wrench[2] == pytest.approx(weight, rel=1e-6)
    assert wrench[3:5] == pytest.approx(150.0 * 9.8 * np.array([-0.1, -0.2]), rel=1e-3)


def test_a_bench_has_no_payload(bench):
    """What rides on a bench is counted with its mass."""
    with pytest.raises(HexsimError, match=r"count it with load\.moving_mass_kg"):
        changed(bench, {"payload": [CABIN]})


def test_drawn_machines_lie_within_their_widths(hexapod):
    """60 draws: every number within its half width, some beyond half of it, and another for each draw."""
    machine = changed(hexapod, {"uncertainty": WIDTHS})
    cases = sweep.cases(load_scenario("heave"), machine, draws=60)
    draws = [case.settings_on(machine) for case in cases]
    moduli = np.array([draw["oil.bulk_modulus_Pa"] for draw in draws]) / machine.oil.bulk_modulus_Pa - 1
    offsets = np.array([[leg["length_m"] for leg in draw["effects.leg_zero_offset"]] for draw in draws])
    joints = np.array([[leg["x_m"] for leg in draw["effects.base_joint_offset"]] for draw in draws])
    for values, width in ((moduli, 0.1), (offsets, 5e-4), (joints, 1e-3)):
        assert 0.5 * width < np.abs(values).max() <= width
        assert len(np.unique(values)) == values.size
    assert sweep.cases(load_scenario("heave"), machine, draws=4)[3].settings_on(machine) == draws[3]


def test_a_displaced_joint_is_unknown_to_the_motion_computer(hexapod):
    """Base joint 1 built 2 mm off: setpoints as declared, pose such that the displaced kinematics give the pistons, within 1 um."""
    displaced = {"effects.base_joint_offset": {"where": "leg 1", "x_m": 2e-3}}
    short = {"scenario.duration_s": 0.3, "scenario.fade_s": 0.0}
    run, plain = (hx.run("combined", hexapod, set=short | more, fast=True, seed=1) for more in (displaced, {}))
    log, machine = run.log, run.machine
    legs = [f"setpoint_{leg}_m" for leg in range(1, 7)]
    assert log.select(legs).equals(plain.log.select(legs))
    pose = log.select(pl.col("^platform_.*$")).to_numpy()
    pistons = log.select(pl.col("^true_position_.*$")).to_numpy()
    assert pistons == pytest.approx(resolve(machine).mechanics.piston_positions(pose), abs=1e-6)
    assert np.abs(pistons - hexapod.mechanics.piston_positions(pose))[:, 0].min() > 1e-4


def test_a_sweep_draws_machines(hexapod):
    """Two draws, two compensators: four cases, each draw with both compensators."""
    machine = changed(hexapod, {"uncertainty": WIDTHS})
    made = sweep.cases(load_scenario("heave"), machine, compensators=("none", "exact"), draws=2)
    assert [case.compensator for case in made] == ["none", "exact", "none", "exact"]
    assert made[0].settings_on(machine) == made[1].settings_on(machine) != made[2].settings_on(machine)
    assert made[2].settings_on(machine) == made[3].settings_on(machine)


def test_joint_uncertainty_is_in_metres(hexapod):
    """0.2 would be 200 mm."""
    with pytest.raises(HexsimError, match=r"base_joints_m = 0.2 must be a half width in metres"):
        changed(hexapod, {"uncertainty.base_joints_m": 0.2})
