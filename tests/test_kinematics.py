"""Kinematics: identities, finite differences, hand calculations, messages."""

import timeit
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from hexsim import HexsimError
from hexsim.mechanics import kinematics
from hexsim.mechanics.workspace import excursions

MEASURED = Path(__file__).parents[2] / "shared" / "measured" / "hexapod_none"
GEOMETRIES = {  # base radius, half angle, platform radius, half angle, neutral leg, stroke
    "micro": (0.60, 7.66, 0.50, 9.21, 0.70, 0.2),
    "one metre stroke": (2.0, 8.0, 1.5, 8.0, 2.5, 1.0),
}
MOVED = np.array(
    [0.02, -0.03, 0.04, 0.06, -0.05, 0.10]
)  # a pose with every coordinate different, inside both workspaces


def of_circles(
    base_radius_m, base_half_angle_deg, platform_radius_m, platform_half_angle_deg, neutral_leg_length_m, stroke_m
):
    """Joints in pairs on two circles, all legs alike."""
    joints = kinematics.joints_on_circles(
        base_radius_m, base_half_angle_deg, platform_radius_m, platform_half_angle_deg
    )
    return kinematics.HexapodKinematics.from_joints(*joints, neutral_leg_length_m, stroke_m)


@pytest.fixture(params=list(GEOMETRIES))
def hexapod(request) -> kinematics.HexapodKinematics:
    return of_circles(*GEOMETRIES[request.param])


@pytest.fixture
def micro() -> kinematics.HexapodKinematics:
    return of_circles(*GEOMETRIES["micro"])


def reachable_poses(hexapod: kinematics.HexapodKinematics, count: int, seed: int = 1) -> np.ndarray:
    """Uniform in the box of the six excursions, those kept that no leg refuses: corners of the workspace included."""
    rng = np.random.default_rng(seed)
    low, high = np.array([(e.minimum, e.maximum) for e in excursions(hexapod)]).T
    kept = []
    while sum(len(poses) for poses in kept) < count:
        poses = rng.uniform(low, high, (200_000, 6))
        positions = hexapod.piston_positions(poses)
        kept.append(poses[np.all((positions >= 0.0) & (positions <= hexapod.stroke_m), axis=-1)])
    return np.concatenate(kept)[:count]


def path_of_poses(time):
    """A smooth motion (n, 6) in all coordinates at once, with its exact rates and accelerations."""
    w = 2.0 * np.pi * np.array([0.5, 0.7, 0.9, 1.1, 0.6, 0.8])
    a = np.array([0.03, 0.02, 0.03, 0.06, 0.07, 0.08])
    angle = w * np.asarray(time)[..., None] + np.arange(6)
    return a * np.sin(angle), a * w * np.cos(angle), -a * w**2 * np.sin(angle)


def central(function, at, step, direction=1.0):
    return (function(at + step * direction) - function(at - step * direction)) / (2.0 * step)


def test_neutral_pose_has_all_pistons_at_half_stroke(hexapod):
    """Neutral: six legs of the neutral length, pistons at half stroke; identity to rounding."""
    assert hexapod.piston_positions(np.zeros(6)) == pytest.approx(np.full(6, 0.5 * hexapod.stroke_m), abs=1e-15)


def test_joints_stand_where_the_machine_file_says(micro):
    """Legs in pairs at 0, 120, 240 deg: leg 1 at +7.66 deg, leg 2 at -7.66; platform +50.79, -50.79; and so on."""
    base = np.degrees(np.arctan2(micro.base_joints[:, 1], micro.base_joints[:, 0])) % 360.0
    platform = np.degrees(np.arctan2(micro.platform_joints[:, 1], micro.platform_joints[:, 0])) % 360.0
    assert base == pytest.approx([7.66, 352.34, 127.66, 112.34, 247.66, 232.34])
    assert platform == pytest.approx([50.79, 309.21, 170.79, 69.21, 290.79, 189.21])
    assert np.linalg.norm(micro.base_joints, axis=1) == pytest.approx(0.60)
    assert np.linalg.norm(micro.platform_joints, axis=1) == pytest.approx(0.50)


def test_lengths_agree_with_a_calculation_by_rotation_matrices(hexapod):
    """l = |x + (0, 0, h0) + R b - a| with R = Rz Ry Rx from scipy, pose by pose."""
    for pose in reachable_poses(hexapod, 20):
        rotation = Rotation.from_euler("ZYX", pose[[5, 4, 3]])
        joints = (
            pose[:3] + np.array([0.0, 0.0, hexapod.neutral_height_m]) + rotation.apply(hexapod.platform_joints.copy())
        )
        expected = np.linalg.norm(joints - hexapod.base_joints, axis=1)
        assert hexapod.leg_lengths(pose) == pytest.approx(expected, abs=1e-14)
        assert hexapod.rotation(pose) == pytest.approx(rotation.as_matrix(), abs=1e-15)


@pytest.mark.parametrize(
    ("log", "driven", "size"), [("validate_heave", 2, 0.05), ("validate_roll", 3, np.radians(4.0))]
)
def test_setpoints_of_measured_logs_move_one_degree_of_freedom(micro, log, driven, size):
    """Leg setpoints written by another program come back as pure heave of 0.05 m and pure roll of 4 deg.

    2e-8: the digits of the log.
    """
    path = MEASURED / f"{log}.csv.gz"
    if not path.exists():
        pytest.skip(f"measured logs are not here: {path}")
    table = pl.read_csv(path)
    poses = micro.forward(table.select([f"setpoint_{leg}_m" for leg in range(1, 7)]).to_numpy())
    assert np.abs(poses[:, driven]).max() == pytest.approx(size, abs=2e-8)
    assert np.abs(np.delete(poses, driven, axis=1)).max() < 2e-8


def test_forward_inverts_inverse_on_ten_thousand_poses(hexapod):
    """Round trip better than 1e-9 m and 1e-9 rad on 10,000 random reachable poses, from the neutral guess alone."""
    poses = reachable_poses(hexapod, 10_000)
    assert np.abs(hexapod.forward(hexapod.inverse(poses)) - poses).max() < 1e-9


def test_one_forward_call_takes_less_than_a_control_period_by_far(micro):
    """One pose in less than 100 us (best of 20: the machine may be busy); the control period is 2 ms."""
    positions = micro.piston_positions(MOVED)
    micro.forward(positions)
    best = min(timeit.repeat(lambda: micro.forward(positions), number=50, repeat=20)) / 50
    assert best < 100e-6


def test_leading_axes_pass_through(micro):
    """Poses (2, 3, 6) give the same numbers as one by one."""
    poses = reachable_poses(micro, 6).reshape(2, 3, 6)
    lengths, jacobians = micro.leg_lengths(poses), micro.jacobian(poses)
    assert lengths.shape == (2, 3, 6)
    assert jacobians.shape == (2, 3, 6, 6)
    assert np.array_equal(lengths[1, 2], micro.leg_lengths(poses[1, 2]))
    assert np.array_equal(micro.forward(micro.inverse(poses))[0, 1], micro.forward(micro.inverse(poses[0, 1])))
    assert micro.condition_number(poses).shape == (2, 3)


def test_twist_jacobian_by_finite_differences(hexapod):
    """l' for a velocity and an angular velocity in the world frame: the platform turned by a small rotation vector."""
    twist = np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6])
    for pose in reachable_poses(hexapod, 20):
        start = Rotation.from_euler("ZYX", pose[[5, 4, 3]])

        def lengths(time, pose=pose, start=start):
            angles = (Rotation.from_rotvec(twist[3:] * time) * start).as_euler("ZYX")[::-1]
            return hexapod.leg_lengths(np.concatenate([pose[:3] + twist[:3] * time, angles]))

        assert hexapod.leg_velocities(pose, twist) == pytest.approx(central(lengths, 0.0, 1e-5), abs=1e-8)


def test_twist_of_a_motion_is_the_rate_of_its_rotation(micro):
    """omega from pose rates is that of R' R^T, and omega' is its derivative (central differences of 1e-5 s: 1e-8)."""
    time = np.linspace(0.0, 2.0, 21)
    pose, rate, acceleration = path_of_poses(time)
    spin = central(lambda t: micro.rotation(path_of_poses(t)[0]), time, 1e-5) @ np.swapaxes(micro.rotation(pose), 1, 2)
    omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
    assert micro.twist(pose, rate)[:, 3:] == pytest.approx(omega, abs=1e-8)
    assert np.array_equal(micro.twist(pose, rate)[:, :3], rate[:, :3])
    numeric = central(lambda t: micro.twist(*path_of_poses(t)[:2]), time, 1e-5)
    assert micro.twist_rate(pose, rate, acceleration) == pytest.approx(numeric, abs=1e-7)


def test_leg_velocity_and_acceleration_are_the_derivatives_of_length(micro):
    """l' and l'' along a motion in all coordinates against central differences of 1e-5 s."""
    time = np.linspace(0.0, 2.0, 41)
    pose, rate, acceleration = path_of_poses(time)
    twist, twist_rate = micro.twist(pose, rate), micro.twist_rate(pose, rate, acceleration)

    def velocities(t):
        return micro.leg_velocities(path_of_poses(t)[0], micro.twist(*path_of_poses(t)[:2]))

    numeric = central(lambda t: micro.leg_lengths(path_of_poses(t)[0]), time, 1e-5)
    assert micro.leg_velocities(pose, twist) == pytest.approx(numeric, abs=1e-8)
    numeric = central(velocities, time, 1e-5)
    assert micro.leg_accelerations(pose, twist, twist_rate) == pytest.approx(numeric, abs=1e-7)


def test_axial_acceleration_is_that_of_the_joint_along_the_leg(micro):
    """u . p'': the joint's position differentiated twice (1e-4 s: 1e-6), projected on the leg by hand."""
    time = np.linspace(0.1, 1.9, 19)
    pose, rate, acceleration = path_of_poses(time)

    def joints(t):
        moved = path_of_poses(t)[0]
        turned = np.einsum("nab,ib->nia", micro.rotation(moved), micro.platform_joints)
        return moved[:, None, :3] + [0.0, 0.0, micro.neutral_height_m] + turned

    second = (joints(time + 1e-4) - 2.0 * joints(time) + joints(time - 1e-4)) / 1e-8
    legs = joints(time) - micro.base_joints
    along = np.sum(second * legs, axis=-1) / np.linalg.norm(legs, axis=-1)
    twist, twist_rate = micro.twist(pose, rate), micro.twist_rate(pose, rate, acceleration)
    assert micro.joint_axial_accelerations(pose, twist, twist_rate) == pytest.approx(along, abs=1e-6)


def test_measured_accelerations_turn_into_the_world_frame(micro):
    """A platform rolled by 90 deg and no more: its y axis points up, its z axis to the right (-y)."""
    pose = np.array([0.0, 0.0, 0.0, 0.5 * np.pi, 0.0, 0.0])
    motion = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    world = micro.from_platform_frame(pose, motion)
    assert world == pytest.approx([1.0, -3.0, 2.0, 4.0, -6.0, 5.0])
    assert micro.to_platform_frame(pose, world) == pytest.approx(motion)


def test_pitch_and_yaw_turn_the_right_way(micro):
    """Positive pitch lowers the nose, positive yaw turns it to the left, positive roll lifts the left side."""
    nose = micro.rotation(np.array([0, 0, 0, 0, 0.1, 0.0]))[:, 0]
    assert nose[2] == pytest.approx(-np.sin(0.1))
    nose = micro.rotation(np.array([0, 0, 0, 0, 0.0, 0.1]))[:, 0]
    assert nose[1] == pytest.approx(np.sin(0.1))
    left = micro.rotation(np.array([0, 0, 0, 0.1, 0.0, 0.0]))[:, 1]
    assert left[2] == pytest.approx(np.sin(0.1))


def test_legs_share_a_weight_by_hand(micro):
    """Neutral: 600 kg rest on six equal legs of slope h0 / l, each m g l / (6 h0) of thrust."""
    weight = 600.0 * 9.81
    forces = micro.static_leg_forces(np.zeros(6), [0.0, 0.0, weight, 0.0, 0.0, 0.0])
    assert forces == pytest.approx(np.full(6, weight / 6.0 * 0.70 / micro.neutral_height_m), rel=1e-12)


def test_leg_forces_balance_the_wrench(micro):
    """Sum of the leg vectors' forces and moments is the wrench asked for, anywhere in the workspace."""
    wrench = np.array([100.0, -50.0, 5000.0, 30.0, -20.0, 10.0])
    for pose in reachable_poses(micro, 10):
        arms = micro.platform_joints @ micro.rotation(pose).T
        legs = pose[:3] + np.array([0.0, 0.0, micro.neutral_height_m]) + arms - micro.base_joints
        forces = micro.static_leg_forces(pose, wrench)[:, None] * legs / np.linalg.norm(legs, axis=1)[:, None]
        assert forces.sum(axis=0) == pytest.approx(wrench[:3], abs=1e-9)
        assert np.cross(arms, forces).sum(axis=0) == pytest.approx(wrench[3:], abs=1e-9)


def test_excursions_end_where_a_leg_ends(micro):
    """At each end of each excursion one piston stands at 0 or at full stroke, and no leg is outside; both signs."""
    for index, excursion in enumerate(excursions(micro)):
        assert excursion.dof == kinematics.DOF_NAMES[index]
        for value, limit in [
            (excursion.minimum, excursion.minimum_limited_by),
            (excursion.maximum, excursion.maximum_limited_by),
        ]:
            pose = np.zeros(6)
            pose[index] = value
            positions = micro.piston_positions(pose)
            room = np.minimum(positions, micro.stroke_m - positions)
            assert room.min() == pytest.approx(0.0, abs=1e-9)
            assert room[int(limit.removeprefix("leg ")) - 1] == pytest.approx(0.0, abs=1e-9)


def test_heave_excursion_by_hand(micro):
    """Pure heave: h = sqrt(l^2 - d^2) with l = 0.6 and 0.8 m, d the distance of the joints in plan."""
    across = np.sqrt(0.70**2 - micro.neutral_height_m**2)
    heave = excursions(micro)[2]
    assert heave.minimum == pytest.approx(np.sqrt(0.60**2 - across**2) - micro.neutral_height_m, abs=1e-10)
    assert heave.maximum == pytest.approx(np.sqrt(0.80**2 - across**2) - micro.neutral_height_m, abs=1e-10)


def test_sides_are_mirror_images(micro):
    """The machine is symmetric about its x-z plane: sway, roll and yaw go as far to one side as to the other."""
    table = {excursion.dof: excursion for excursion in excursions(micro)}
    for dof in ("y", "roll", "yaw"):
        assert table[dof].minimum == pytest.approx(-table[dof].maximum, abs=1e-9)


def test_condition_number_of_a_known_jacobian(micro):
    """With L = 0.1 m the rotations of the same Jacobian count ten times what they do with L = 1 m: cond by hand."""
    jacobian = micro.jacobian(MOVED)
    for length in (0.1, 1.0):
        singular = np.linalg.svd(jacobian * np.repeat([1.0, 1.0 / length], 3), compute_uv=False)
        assert micro.condition_number(MOVED, length) == pytest.approx(singular[0] / singular[-1])
    assert micro.condition_number(MOVED) == pytest.approx(micro.condition_number(MOVED, 0.50))  # the platform's radius


def test_condition_number_is_infinite_for_equal_parallel_legs():
    """Platform as large as the base, joints above each other: it shifts sideways freely, and Newton says so."""
    square = of_circles(0.5, 20.0, 0.5, 40.0, 0.7, 0.2)
    assert square.condition_number(np.zeros(6)) > 1e12
    with pytest.raises(HexsimError, match="No pose found"):
        square.forward(np.full(6, 0.1) + 0.01 * np.array([1, -1, 1, -1, 1, -1]))


def test_unreachable_pose_names_leg_length_and_limits(micro):
    """0.2 m of heave: the message says which leg, how long it would be, and from where to where it goes."""
    length = micro.leg_lengths([0, 0, 0.2, 0, 0, 0])[0]
    with pytest.raises(
        HexsimError, match=rf"leg 1 would need to be {length:.4f} m long, allowed is 0.6000 to 0.8000 m"
    ):
        micro.inverse([0, 0, 0.2, 0, 0, 0])


def test_unreachable_pose_names_the_worst_leg(micro):
    """Rolled far to the left, a leg of the left side is the one named; downward, a leg too short is named."""
    pose = np.array([0.0, 0.0, 0.0, 0.4, 0.0, 0.0])
    worst = int(np.argmax(np.abs(micro.piston_positions(pose) - 0.1))) + 1
    with pytest.raises(HexsimError, match=rf"leg {worst} would need"):
        micro.inverse(pose)
    with pytest.raises(HexsimError, match=r"would need to be 0\.5[0-9]+ m long, allowed is 0\.6000"):
        micro.inverse([0, 0, -0.2, 0, 0, 0])


def test_trajectory_names_the_first_time_out_of_the_workspace(micro):
    """A heave of 0.15 m at 0.5 Hz leaves at arcsin(0.1202 / 0.15) / pi = 0.2956 s: the next sample of 1 ms is named."""
    time = np.arange(0.0, 2.0, 0.001)
    poses = np.zeros((len(time), 6))
    poses[:, 2] = 0.15 * np.sin(np.pi * time)
    leaves = np.arcsin(excursions(micro)[2].maximum / 0.15) / np.pi
    first = time[np.searchsorted(time, leaves)]
    with pytest.raises(HexsimError, match=rf"at t = {first:.4f} s: leg 1 would need to be 0.80"):
        micro.check_trajectory(time, poses)


def test_trajectory_margin_is_kept_at_both_ends(micro):
    """0.118 m of heave fits; with 10 mm of margin it does not, up or down, and the tighter limits are named."""
    for sign in (1.0, -1.0):
        poses = np.zeros((3, 6))
        poses[:, 2] = sign * np.array([0.0, 0.05, 0.118])
        micro.check_trajectory([0.0, 1.0, 2.0], poses)
        with pytest.raises(HexsimError, match=r"t = 2.0000 s: leg 1 .* allowed is 0.6100 to 0.7900 m"):
            micro.check_trajectory([0.0, 1.0, 2.0], poses, margin_m=0.01)


def test_trajectory_with_nan_is_refused(micro):
    """A NaN is not inside the workspace."""
    poses = np.zeros((3, 6))
    poses[1, 4] = np.nan
    with pytest.raises(HexsimError, match=r"t = 0.5000 s: leg 1 would need to be nan m"):
        micro.check_trajectory([0.0, 0.5, 1.0], poses)


def test_trajectory_through_a_singular_pose_is_refused():
    """Long legs that let the platform yaw until they cross: all within stroke, and refused all the same."""
    loose = of_circles(1.5, 10.0, 0.6, 12.0, 2.4, 1.6)
    time = np.linspace(0.0, 1.0, 101)
    poses = np.zeros((101, 6))
    poses[:, 5] = 2.0 * time
    limit = excursions(loose)[5]
    assert limit.maximum_limited_by == "singularity"
    assert limit.maximum == pytest.approx(0.5 * np.pi, abs=1e-6)  # legs of each pair then pass through the axis
    assert np.all(np.abs(loose.piston_positions(poses) - 0.8) <= 0.8)
    with pytest.raises(HexsimError, match=r"singular pose before t = 0.7900 s"):
        loose.check_trajectory(time, poses)


def test_forward_names_lengths_that_belong_to_no_pose(micro):
    """Five legs at 0 and one at a metre: no platform fits; the row is named."""
    positions = np.full((2, 6), 0.1)
    positions[1] = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    with pytest.raises(HexsimError, match=r"No pose found .* \(row 1, residual"):
        micro.forward(positions)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"neutral_leg_length_m": 0.40}, "neutral_leg_length_m is 0.4, but the joints of leg 1 are 0.4149 m apart"),
        ({"stroke_m": 0.0}, "stroke_m is 0.0; the pistons need a stroke"),
        ({"stroke_m": 1.5}, "retracted_length_m is -0.05"),
    ],
)
def test_impossible_geometry_is_refused(change, message):
    """A leg too short for its circles, no stroke, a stroke longer than twice the leg: one sentence each."""
    names = ("base_radius_m", "base_half_angle_deg", "platform_radius_m", "platform_half_angle_deg")
    given = dict(zip((*names, "neutral_leg_length_m", "stroke_m"), GEOMETRIES["micro"], strict=True))
    with pytest.raises(HexsimError, match=message):
        of_circles(**(given | change))


def test_a_pose_of_five_numbers_is_refused(micro):
    """The shape is named."""
    with pytest.raises(HexsimError, match=r"pose has shape \(5,\); it needs 6 numbers"):
        micro.leg_lengths(np.zeros(5))
