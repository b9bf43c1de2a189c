"""What the setpoints of all legs give each leg to carry, from the declared body and geometry."""

from __future__ import annotations

import numpy as np
import pytest

from hexsim import load_scenario
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import geometry, load_machine
from hexsim.mechanics import rigid_body
from hexsim.motion_computer import leg_load

TICK_s = 0.002
RESOLVED = resolve(load_machine("micro_motion_system"))


@pytest.fixture(scope="module")
def expected() -> leg_load.ExpectedLoad:
    found = leg_load.ExpectedLoad.of(RESOLVED)
    assert found is not None
    return found


def leg_forces(poses: np.ndarray, rates: np.ndarray, accelerations: np.ndarray) -> np.ndarray:
    """Inverse dynamics of the platform (m, 6) [N]: J' F = the wrench that its motion and weight ask for."""
    k, body = RESOLVED.machine.mechanics, geometry.moving_body(RESOLVED)
    twist, twist_rate = k.twist(poses, rates), k.twist_rate(poses, rates, accelerations)
    gravity = np.einsum("a,nab->nb", RESOLVED.gravity_m_s2, k.rotation(poses))
    felt, turning = k.to_platform_frame(poses, twist_rate), k.to_platform_frame(poses, twist)[:, 3:]
    wrench = rigid_body.joint_wrenches(body, felt, np.ascontiguousarray(turning), gravity)
    world = k.from_platform_frame(poses, wrench)
    return np.linalg.solve(np.swapaxes(k.jacobian(poses), 1, 2), world[..., None])[..., 0]


def test_it_is_the_inverse_dynamics_of_the_platform(expected: leg_load.ExpectedLoad) -> None:
    """Six sines at once: over the mean mass of a leg the forces of the rigid body are the load and a constant, within 4 %
    of what varies; the leg's own acceleration and place leave more than a third."""
    t = np.arange(2.0, 16.0, TICK_s)
    poses, rates, accelerations = load_scenario("combined").evaluate(t)
    forces, pistons = leg_forces(poses, rates, accelerations), RESOLVED.machine.mechanics.piston_positions(poses)
    load, own = (
        expected.accelerations(pistons, TICK_s),
        np.gradient(np.gradient(pistons, TICK_s, axis=0), TICK_s, axis=0),
    )
    mass = np.linalg.lstsq(load - load.mean(0), forces - forces.mean(0), rcond=None)[0]
    for leg in range(6):
        varies = np.std(forces[:, leg])
        terms = np.stack([np.ones_like(t), load[:, leg]], axis=1)
        alone = np.stack([np.ones_like(t), own[:, leg], pistons[:, leg]], axis=1)
        left, left_alone = (
            np.std(forces[:, leg] - x @ np.linalg.lstsq(x, forces[:, leg], rcond=None)[0]) for x in (terms, alone)
        )
        assert left < 0.04 * varies and left_alone > 0.33 * varies
    assert np.diag(mass) == pytest.approx(expected.mass_kg, rel=0.05)


def test_legs_that_move_alike_carry_their_own_acceleration(expected: leg_load.ExpectedLoad) -> None:
    """Heave, up and down: each row of the inertia sums to 1, and the load is the acceleration and the row sum of K times
    the travel, to 1e-9 m/s2; at both ends of the preview that of the tick beside."""
    assert expected.inertia.sum(axis=1) == pytest.approx(1.0, abs=1e-9)
    assert expected.inertia == pytest.approx(expected.inertia.T, abs=1e-12)
    for side in (1.0, -1.0):
        y = side * 1e-2 * np.cos(np.pi * TICK_s * np.arange(15))
        load = expected.accelerations(expected.neutral + y[:, None], TICK_s)
        a = np.diff(y, 2) / TICK_s**2
        own = np.concatenate([a[:1], a, a[-1:]])
        wanted = own[:, None] + y[:, None] * expected.stiffness.sum(axis=1)
        assert load == pytest.approx(wanted, abs=1e-9)


def test_forces_of_the_legs_give_each_its_acceleration(expected: leg_load.ExpectedLoad) -> None:
    """The rigid body's inverse dynamics in six motions at once about neutral: through the mobility, the legs' forces give each leg's
    acceleration within 1 % of the largest."""
    random = np.random.default_rng(3)
    none = np.zeros((1, 6))
    rest = leg_forces(none, none, none)
    asked = random.standard_normal((8, 6))
    forces = leg_forces(np.zeros((8, 6)), np.zeros((8, 6)), asked) - rest
    legs = asked @ RESOLVED.machine.mechanics.jacobian(none)[0].T
    assert forces @ expected.mobility.T / expected.mass_kg == pytest.approx(legs, abs=0.01 * np.abs(legs).max())


def test_forces_give_accelerations_away_from_neutral_too(expected: leg_load.ExpectedLoad) -> None:
    """Six motions at once, up to 5 cm and 4 deg from neutral, 0.1 m/s and 0.1 rad/s: the legs' forces give each leg's acceleration
    by the load of the pose, with an error of at most a fifth of what mobility and stiffness of neutral leave without the speeds, which is
    more than 0.2 m/s2."""
    random, mechanics = np.random.default_rng(5), RESOLVED.machine.mechanics
    poses = random.uniform(-1.0, 1.0, (20, 6)) * (0.02, 0.02, 0.05, 0.07, 0.07, 0.07)
    rates, asked = 0.1 * random.uniform(-1.0, 1.0, (20, 6)), random.standard_normal((20, 6))
    none = np.zeros((1, 6))
    forces = (leg_forces(poses, rates, asked) - leg_forces(none, none, none)) / expected.mass_kg
    twist = mechanics.twist(poses, rates)
    legs = mechanics.leg_accelerations(poses, twist, mechanics.twist_rate(poses, rates, asked))
    speeds, pistons = mechanics.leg_velocities(poses, twist), mechanics.piston_positions(poses)
    load, worst, neutral = leg_load.PoseLoad.of(RESOLVED, expected), 0.0, 0.0
    for force, acceleration, place, speed in zip(forces, legs, pistons, speeds, strict=True):
        mobility, held = load.at(place, speed)
        own = np.diag(expected.mobility + load.by_place @ (place - expected.neutral))
        worst = max(worst, np.abs(own * (mobility @ force - held) - acceleration).max())
        fixed = expected.mobility @ (force - expected.stiffness @ (place - expected.neutral))
        neutral = max(neutral, np.abs(fixed - acceleration).max())
    assert worst < neutral / 5.0 and neutral > 0.2


def test_weight_topples_a_platform_that_leans(expected: leg_load.ExpectedLoad) -> None:
    """A leg that is longer than the others carries less: K is negative on its diagonal, and symmetric."""
    assert np.diag(expected.stiffness).max() < 0.0
    assert expected.stiffness == pytest.approx(expected.stiffness.T, abs=1e-3)


def test_a_leg_alone_is_told_nothing() -> None:
    """A bench's leg carries its own mass; two setpoints tell no acceleration."""
    assert leg_load.ExpectedLoad.of(resolve(load_machine("bench"))) is None
    found = leg_load.ExpectedLoad.of(RESOLVED)
    assert found is not None and np.all(found.accelerations(np.tile(found.neutral, (2, 1)), TICK_s) == 0.0)
