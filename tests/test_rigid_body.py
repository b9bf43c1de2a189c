"""Newton and Euler of the platform, and masses on springs: identities, finite differences of kinematics, energy."""

import mujoco
import numpy as np
import pytest

from hexsim.machine import geometry, load_machine
from hexsim.machine.files import changed
from hexsim.mechanics import kinematics as hexapod_geometry
from hexsim.mechanics import rigid_body as rigid
from hexsim.plant import Plant
from hexsim.tracing.simulation import rig as rigs
from hexsim.tracing.simulation import start

G = 9.81
POINTS = np.array([[0.3, 0.1, 0.2], [-0.4, 0.5, 0.6], [0.2, -0.6, 0.1], [0.1, 0.2, -0.5]])  # [m]
MASSES = np.array([120.0, 80.0, 150.0, 60.0])  # [kg]


def body_of_points(points=POINTS, masses=MASSES):
    """Point masses held together."""
    mass, centre = masses.sum(), masses @ points / masses.sum()
    arms = points - centre
    inertia = sum(m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a in zip(masses, arms, strict=True))
    return rigid.rigid_body(mass, centre, inertia, carried=mass)


def spring_along(axis, mass=70.0, place=(0.2, -0.1, 0.5), gravity=(0.0, 0.0, -G)):
    """A mass on a spring of 6 Hz, unstressed where gravity asks for it."""
    omega, n = 2 * np.pi * 6.0, np.array(axis) / np.linalg.norm(axis)
    x, y, z = map(float, n)
    return rigid.Suspension(mass, omega, 0.05, (x, y, z), place, float(n @ gravity) / omega**2)


def of_circles():
    """A hexapod of some size."""
    return hexapod_geometry.HexapodKinematics.from_joints(
        *hexapod_geometry.joints_on_circles(1.6, 6.0, 1.2, 8.0), 1.8, 0.6
    )


def random_motion(seed=0):
    """(a, w', w, gravity) as tuples, of the size of a platform's."""
    rng = np.random.default_rng(seed)
    return [tuple(map(float, scale * rng.standard_normal(3))) for scale in (3.0, 5.0, 1.0, 9.0)]


def test_at_rest_the_joints_carry_the_weight():
    """F = m_c g upwards, M = c x F, to rounding; a mass on a spring along any axis adds its weight where it stands."""
    body = body_of_points()._replace(carried=500.0)
    none, down = (0.0, 0.0, 0.0), (0.0, 0.0, -G)
    force, moment = rigid.joint_wrench(body, none, none, none, down)
    assert force == pytest.approx((0.0, 0.0, 500.0 * G), rel=1e-14)
    assert moment == pytest.approx(np.cross(body.centre, force), rel=1e-12)
    for axis in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.3, -0.5, 0.7)):
        spring = spring_along(axis, 50.0)
        force, moment, _ = rigid.ride_wrench(spring, none, none, none, down, spring.rest, 0.0)
        assert force == pytest.approx((0.0, 0.0, 50.0 * G), rel=1e-12, abs=1e-10)
        assert moment == pytest.approx(np.cross(spring.place, force), rel=1e-12, abs=1e-10)


def test_wrench_is_what_accelerates_every_point():
    """sum m p'' and sum r x m p'' of point masses on a moving platform, by finite differences of its kinematics: 1e-5.

    Central differences of 0.5 ms err by 1e-6 of the third derivatives here.
    """
    kinematics = of_circles()
    body, h = body_of_points(), 5e-4
    amplitude, w = np.array([0.05, 0.04, 0.06, 0.1, 0.12, 0.08]), np.array([5.0, 7.0, 6.0, 8.0, 6.5, 9.0])

    def pose(t):
        return amplitude * np.sin(w * t + np.arange(6))

    t = 0.3
    here, rate, second = pose(t), amplitude * w * np.cos(w * t + np.arange(6)), -(w**2) * pose(t)
    rotation = kinematics.rotation(here)
    twist_rate = kinematics.to_platform_frame(here, kinematics.twist_rate(here, rate, second))
    omega = kinematics.to_platform_frame(here, kinematics.twist(here, rate))[3:]
    wrench = rigid.joint_wrenches(body, twist_rate[None], omega[None], np.zeros((1, 3)))[0]

    def places(t):
        return pose(t)[:3] + POINTS @ kinematics.rotation(pose(t)).T

    pulls = MASSES[:, None] * (places(t + h) - 2 * places(t) + places(t - h)) / h**2 @ rotation
    assert wrench[:3] == pytest.approx(pulls.sum(axis=0), rel=1e-5)
    assert wrench[3:] == pytest.approx(np.cross(POINTS, pulls).sum(axis=0), rel=1e-5)


def test_acceleration_undoes_wrench():
    """The motion that asks for a wrench is the motion that the wrench makes, with a mass on a spring: 1e-12."""
    body, spring, none = body_of_points(), spring_along((0.3, -0.5, 0.7)), (0.0, 0.0, 0.0)
    a, turning, omega, gravity = random_motion()
    asked = np.array(rigid.joint_wrench(body, a, turning, omega, gravity))
    asked += rigid.ride_wrench(spring, a, turning, omega, gravity, spring.rest, 0.3)[:2]
    asked -= rigid.ride_wrench(spring, none, none, omega, gravity, spring.rest, 0.3)[:2]
    compliance = np.linalg.inv(rigid.mass_matrix(body, spring))
    back = rigid.body_acceleration(body, compliance, tuple(asked[0]), tuple(asked[1]), omega, gravity)
    assert np.concatenate(back) == pytest.approx(np.concatenate([a, turning]), rel=1e-12)


def test_a_mass_on_a_spring_feels_its_own_path():
    """What a mass on a slide in a turning body is pushed with is m (p'' - g) of its path, by finite differences: 1e-5.

    Its travel is a sine of its own; along the slide the spring would have to push as the wrench's share along it says.
    """
    spring, h, t = spring_along((0.3, -0.5, 0.7), gravity=(0.0, 0.0, 0.0)), 1e-4, 0.3
    kinematics = of_circles()
    amplitude, w = np.array([0.05, 0.04, 0.06, 0.1, 0.12, 0.08]), np.array([5.0, 7.0, 6.0, 8.0, 6.5, 9.0])
    phase, n = np.arange(6), np.array(spring.axis)

    def path(t):
        pose, q = amplitude * np.sin(w * t + phase), 0.02 * np.sin(20.0 * t)
        return pose[:3] + kinematics.rotation(pose) @ (spring.place + q * n)

    here, rate, second = amplitude * np.sin(w * t + phase), amplitude * w * np.cos(w * t + phase), 0.0
    second = -(w**2) * here
    a = kinematics.to_platform_frame(here, kinematics.twist_rate(here, rate, second))
    omega = kinematics.to_platform_frame(here, kinematics.twist(here, rate))[3:]
    q, speed, turn = 0.02 * np.sin(20.0 * t), 0.4 * np.cos(20.0 * t), -8.0 * np.sin(20.0 * t)
    force, moment, felt = rigid.ride_wrench(spring, tuple(a[:3]), tuple(a[3:]), tuple(omega), (0.0, 0.0, 0.0), q, speed)
    true = (path(t + h) - 2 * path(t) + path(t - h)) / h**2 @ kinematics.rotation(here)
    along = -rigid.spring_acceleration(spring, q, speed)
    assert np.array(force) / spring.mass == pytest.approx(true + (along - n @ true) * n, rel=1e-5)
    assert moment == pytest.approx(np.cross(spring.place + q * n, force), rel=1e-12)
    assert felt == pytest.approx(n @ true - turn, rel=1e-5)


def test_along_the_axis_it_is_the_third_row():
    """A body that only moves along z: the platform's equation without turning and with its centre on the axis."""
    body = rigid.rigid_body(600.0, [0.0, 0.0, 0.3], np.eye(3), carried=650.0)
    none, down = (0.0, 0.0, 0.0), (0.0, 0.0, -G)
    a = rigid.axial_acceleration(body, 9000.0, -G, 400.0)
    assert rigid.joint_wrench(body, (0.0, 0.0, a), none, none, down)[0][2] + 400.0 == pytest.approx(9000.0, rel=1e-14)


def test_two_bodies_joined_are_their_points_together():
    """Parallel-axis theorem: the halves joined equal the whole, to rounding."""
    whole = body_of_points()
    halves = rigid.joined(body_of_points(POINTS[:2], MASSES[:2]), body_of_points(POINTS[2:], MASSES[2:]))
    assert rigid.mass_matrix(halves) == pytest.approx(rigid.mass_matrix(whole), rel=1e-12, abs=1e-10)


def test_a_free_body_keeps_its_energy_and_its_spin():
    """Without forces v' M v/2 and the angular momentum in the world stay: within 1e-9 over two turns by RK4 in 2,000 steps."""
    body = body_of_points()
    matrix = rigid.mass_matrix(body)
    compliance, none = np.linalg.inv(matrix), (0.0, 0.0, 0.0)

    def rates(s):
        """q, then velocity of the origin and rates in the body's frame: v' = a - w x v there."""
        omega = (s[7], s[8], s[9])
        a, turning = rigid.body_acceleration(body, compliance, none, none, omega, none)
        return np.concatenate(
            [rigid.quaternion_rate((s[0], s[1], s[2], s[3]), omega), a - np.cross(omega, s[4:7]), turning]
        )

    def figures(s):
        momentum = matrix @ s[4:]
        rotation = np.array(rigid.rotation_of((s[0], s[1], s[2], s[3])))
        about_centre = momentum[3:] - np.cross(body.centre, momentum[:3])
        return np.concatenate([[0.5 * s[4:] @ momentum], rotation @ momentum[:3], rotation @ about_centre])

    state = np.array([1.0, 0, 0, 0, 0.3, -0.2, 0.5, 2.0, -1.5, 1.0])
    before, h = figures(state), 2.5e-3
    for _ in range(2000):
        k1 = rates(state)
        k2 = rates(state + 0.5 * h * k1)
        k3 = rates(state + 0.5 * h * k2)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(state + h * k3))
    assert figures(state) == pytest.approx(before, rel=1e-8)


def test_a_quaternion_turns_by_its_direction_alone():
    """0.7 rad about (1, 2, 2)/3 by Rodrigues' formula, from quaternions of length 1, 0.5 and 3: rounding makes them so in a long run."""
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    rotation = np.eye(3) + np.sin(0.7) * cross + (1.0 - np.cos(0.7)) * cross @ cross
    for length in (1.0, 0.5, 3.0):
        w, x, y, z = length * np.array([np.cos(0.35), *(np.sin(0.35) * axis)])
        assert np.array(rigid.rotation_of((w, x, y, z))) == pytest.approx(rotation, abs=1e-14)


def test_the_spring_in_time_is_its_transfer_function():
    """q'' = -(w^2 q + 2 zeta w q') - felt integrated in 20 steps a sample gives back what `pushed_back` says: 2 % of its size."""
    spring, rate = rigid.Suspension(mass=1.0, omega=2 * np.pi * 6.0, damping=0.05), 1000.0
    felt = G + np.sin(2 * np.pi * 3.0 * np.arange(3000) / rate)
    travel, speed, back, h = -felt[0] / spring.omega**2, 0.0, [], 1 / rate / 20
    for value in felt:
        back.append(-rigid.spring_acceleration(spring, travel, speed))
        for _ in range(20):
            speed += h * (-rigid.spring_acceleration(spring, travel, speed) - value)
            travel += h * speed
    error = np.array(back) - rigid.pushed_back(spring, felt, rate)
    assert np.std(error) < 0.02 * np.std(back)


def test_legs_that_have_mass_carry_the_weight_of_a_payload_once():
    """At rest six thrusts carry m_carried g and the payload's m g: legs that share their weight with the base do not scale it."""
    payload = {"flexible_payload": {"mass_kg": 120.0, "frequency_Hz": 6.0, "damping_ratio": 0.05}}
    machine = changed(load_machine("micro_motion_system"), {"effects": payload})
    rig, resolved = rigs.rig_of(machine)
    kinematics = geometry.machine_kinematics(machine)
    thrust = start.load_at(rig, resolved, kinematics.piston_positions(np.zeros(6)), np.zeros(6))[0]
    carried = geometry.moving_body(resolved).carried
    assert resolved.load.leg_mass_kg > 0
    assert kinematics.jacobian(np.zeros(6))[:, 2] @ thrust == pytest.approx(
        -(carried + 120.0) * resolved.gravity_m_s2[2], rel=1e-12
    )


def test_legs_at_neutral_resist_as_those_of_the_full_model():
    """What the platform does under six unit wrenches, full legs in MuJoCo without oil and gravity: as the fit's simulation has it
    within 1e-3 of every row; the one body that stands for the legs in the tendon model is off by 3e-3 in surge and sway."""
    machine = load_machine("micro_motion_system")
    plant = Plant(machine)
    model, data = plant.model, plant.data
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    answers = np.zeros((6, 6))
    for k in range(6):
        data.xfrc_applied[model.body("platform").id] = 1000.0 * np.eye(6)[k]
        mujoco.mj_forward(model, data)
        answers[:, k] = data.qacc[:6] / 1000.0
    rig, resolved = rigs.rig_of(machine)
    size = np.sqrt(np.diag(answers))
    assert np.max(np.abs(rig.load.compliance - answers) / np.outer(size, size)) < 1e-3
    body = np.linalg.inv(rigid.mass_matrix(geometry.moving_body(resolved)))
    assert np.all(np.abs(body - answers).diagonal()[:2] / size[:2] ** 2 > 3e-3)
