"""Points of interest and the IMU's place: rigid-body formula by hand, finite difference of positions, both signs, way back."""

import numpy as np
import pytest

import hexsim as hx
from hexsim import HexsimError
from hexsim.machine.files import changed
from hexsim.mechanics import points as point_motion
from hexsim.recording import figures as figures_of_run
from hexsim.recording import summary_table
from hexsim.recording.signals import Signals
from hexsim.signals import table
from hexsim.signals.log import Log
from hexsim.simulation import simulate
from hexsim.tracing.checks.imu import at_origin

HEAD = [0.3, -0.2, 1.1]
IDEAL = {f"sensors.{key}": 0.0 for key in ("acceleration_noise_m_s2", "angular_acceleration_noise_rad_s2")}


@pytest.fixture(scope="module")
def run(hexapod):
    """0.6 s of all axes at once with a driver's head, and an IMU elsewhere and turned."""
    changes = {"points": {"driver_head": HEAD, "below": [0.0, 0.0, -1.1]}}
    machine = changed(hexapod, IDEAL | changes)
    imu = {"sensors.imu_position_m": HEAD, "sensors.imu_orientation_deg": [10.0, -20.0, 90.0]}
    return hx.run("combined", machine, set={"scenario.duration_s": 0.6, "scenario.fade_s": 0.0, **imu}, fast=True)


def test_acceleration_at_a_point_by_hand():
    """a + w' x r + w x (w x r) for one motion, and both signs: r, w' turned about give the other sign of w' x r only."""
    a, turning, omega, r = (
        np.array([[1.0, 2.0, 3.0]]),
        np.array([[0.0, 0.0, 2.0]]),
        np.array([[0.0, 0.0, 3.0]]),
        [0.5, 0, 0],
    )
    assert point_motion.point_acceleration(a, turning, omega, r) == pytest.approx(
        np.array([[1.0 - 9 * 0.5, 2.0 + 2 * 0.5, 3.0]])
    )
    assert point_motion.point_acceleration(a, -turning, -omega, r) == pytest.approx(
        np.array([[1.0 - 9 * 0.5, 2.0 - 2 * 0.5, 3.0]])
    )
    assert point_motion.point_acceleration(a, turning, omega, [-0.5, 0, 0]) == pytest.approx(
        np.array([[1.0 + 9 * 0.5, 2.0 - 1.0, 3.0]])
    )


def test_log_agrees_with_the_second_difference_of_the_points_place(run):
    """x_p = p + R r differentiated twice, turned into the platform's axes: within 2 % of the largest acceleration.

    The log is at 1 kHz; differences over 8 ms smooth the friction's jolts in both.
    """
    log, legs = run.log, run.machine.mechanics
    names = ("x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad")
    pose = np.column_stack([log[f"platform_{name}"] for name in names])
    rotation, h, k = legs.rotation(pose), 1e-3, 8
    for point, place in run.machine.points.items():
        at = pose[:, :3] + rotation @ np.array(place)
        world = (at[2 * k :] - 2 * at[k:-k] + at[: -2 * k]) / (k * h) ** 2
        expected = np.einsum("nij,ni->nj", rotation[k:-k], world)
        logged = np.column_stack([log[f"acceleration_at_{point}_{axis}_m_s2"] for axis in "xyz"])
        triangle = np.convolve(np.ones(k) / k, np.ones(k) / k)
        smooth = np.column_stack([np.convolve(column, triangle, mode="valid") for column in logged.T])
        assert len(smooth) == len(logged) - 2 * k + 2
        assert smooth[1:-1] == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


def test_opposite_points_feel_opposite_turning(run):
    """r and -r: the mean of both is the acceleration of the origin less the centripetal parts, which are equal and small."""
    log = run.log
    mirrored = point_motion.point_acceleration(*(np.zeros((1, 3)),) * 3, HEAD)
    assert mirrored == pytest.approx(np.zeros((1, 3)))
    origin = np.column_stack([log[f"true_acceleration_{axis}_m_s2"] for axis in "xyz"])
    turning = np.column_stack([log[f"true_angular_acceleration_{axis}_rad_s2"] for axis in "xyz"])
    below = np.column_stack([log[f"acceleration_at_below_{axis}_m_s2"] for axis in "xyz"])
    assert below[:, 0] - origin[:, 0] == pytest.approx(-1.1 * turning[:, 1], abs=5e-3)
    assert below[:, 1] - origin[:, 1] == pytest.approx(1.1 * turning[:, 0], abs=5e-3)
    assert np.abs(turning[:, :2]).max() > 0.1


def test_an_imu_reads_along_its_own_axes():
    """Turned by 90 deg of yaw: what is along y of the platform is along its x, and what is along x along its -y."""
    still = np.zeros((1, 3))
    reading, turned = point_motion.imu_reading(
        np.array([[1.0, 2.0, 3.0]]), np.array([[0.1, 0.2, 0.3]]), still, [0, 0, 0], point_motion.mounting([0, 0, 90.0])
    )
    assert reading == pytest.approx(np.array([[2.0, -1.0, 3.0]]))
    assert turned == pytest.approx(np.array([[0.2, -0.1, 0.3]]))
    assert point_motion.mounting([0.0, 0.0, 0.0]) == pytest.approx(np.eye(3))


def test_reading_and_way_back():
    """`origin_motion` undoes `imu_reading` to rounding, for any place, turn and motion."""
    a, turning, omega = np.random.default_rng(2).normal(size=(3, 50, 3))
    reading = point_motion.imu_reading(a, turning, omega, HEAD, point_motion.mounting([10.0, -20.0, 120.0]))
    back = point_motion.origin_motion(*reading, omega, HEAD, [10.0, -20.0, 120.0])
    assert back[0] == pytest.approx(a, abs=1e-12)
    assert back[1] == pytest.approx(turning, abs=1e-12)


def test_a_measured_log_is_taken_to_the_origin(run, hexapod):
    """The turned and shifted IMU's readings give the accelerations of one at the origin, within 1 % of their largest."""
    measured = Log.of_table("measured", run.log, "hexapod")
    plain = changed(run.machine, {"sensors.imu_position_m": [0.0] * 3, "sensors.imu_orientation_deg": [0.0] * 3})
    origin = Log.of_table("origin", simulate(plain, run.scenario, fast=True).log, "hexapod")
    found = at_origin(measured, run.machine)
    for moved, there, asis in (
        (found.acceleration, origin.acceleration, measured.acceleration),
        (found.angular, origin.angular, measured.angular),
    ):
        assert moved == pytest.approx(there, abs=0.01 * np.abs(there).max())
        assert np.abs(asis - there).max() > 0.1 * np.abs(there).max()
    assert at_origin(origin, hexapod) is origin


def test_figures_and_words_of_a_point(run):
    """Every point has its three axes in the summary, its line in the report, its curve in the figure, its label."""
    figures = run.summary["points"]
    assert set(figures) == {"driver_head", "below"}
    for axes in figures.values():
        for axis, threshold in (("x", 0.063), ("y", 0.057), ("z", 0.154)):
            assert axes[axis]["peak_over_threshold"] == pytest.approx(axes[axis]["peak_band_m_s2"] / threshold)
    assert [text.split(":")[0] for name, text in summary_table.facts(run.summary) if name == "point"] == [
        "driver_head",
        "below",
    ]
    figure = figures_of_run.run_figures(Signals.of_run(run))["points"]
    assert {line.get_label() for line in figure.axes[0].lines} >= {"driver_head", "below"}
    assert table.label_of("acceleration_at_driver_head_z_m_s2") == "acceleration at driver_head z"


def test_points_are_of_a_platform(bench, hexapod):
    """Refused on a bench; a name that is no column name, or a place without three numbers, by their keys."""
    with pytest.raises(HexsimError, match="a bench moves along its leg alone"):
        changed(bench, {"points": {"head": HEAD}})
    for points_table in ({"Head up": HEAD}, {"head": [1.0, 2.0]}, {"head": [1.0, 2.0, 1e9]}):
        with pytest.raises(HexsimError, match=r"\[points"):
            changed(hexapod, {"points": points_table})
