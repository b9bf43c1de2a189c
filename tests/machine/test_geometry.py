"""From the [geometry] table to joints, lengths and limits."""

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.machine import geometry
from hexsim.machine.files import changed


def test_joints_stand_in_pairs_on_two_circles(hexapod):
    """Base pairs at 0, 120, 240 deg +- 7.66; platform joints of legs 1 and 2 at +-(60 - 9.21), and so on by 120."""
    kinematics = geometry.machine_kinematics(hexapod)
    base_angles = np.array([7.66, -7.66, 127.66, 112.34, 247.66, 232.34])
    platform_angles = np.array([50.79, -50.79, 170.79, 69.21, 290.79, 189.21])
    base, platform = kinematics.base_joints, kinematics.platform_joints
    for joints, radius, degrees in ((base, 0.6, base_angles), (platform, 0.5, platform_angles)):
        angles = np.radians(degrees)
        expected = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
        np.testing.assert_allclose(joints, expected, atol=1e-12)


def test_neutral_is_half_stroke_on_all_legs(hexapod):
    """At the neutral pose all legs are 0.70 m long, pistons at 0.1 m, and the height closes the triangle."""
    kinematics = geometry.machine_kinematics(hexapod)
    neutral = np.zeros(6)
    np.testing.assert_allclose(kinematics.leg_lengths(neutral), 0.70, rtol=1e-12)
    np.testing.assert_allclose(kinematics.piston_positions(neutral), 0.1, atol=1e-12)
    across = kinematics.platform_joints[0] - kinematics.base_joints[0]
    assert kinematics.neutral_height_m == pytest.approx(np.sqrt(0.70**2 - across @ across), rel=1e-12)


def test_limits_come_from_the_stroke(hexapod):
    """Retracted length = neutral - stroke/2; a longer stroke takes the limits along."""
    for stroke in (0.2, 0.3):
        kinematics = geometry.machine_kinematics(changed(hexapod, {"cylinder.stroke_m": stroke}))
        np.testing.assert_allclose(kinematics.retracted_length_m, 0.70 - stroke / 2)
        np.testing.assert_allclose(kinematics.piston_positions(np.zeros(6)), stroke / 2, atol=1e-12)


def test_legs_too_short_to_reach_the_platform_are_refused(hexapod):
    """A neutral leg shorter than the horizontal distance of its joints cannot stand: a clear sentence, not NaN."""
    with pytest.raises(HexsimError, match="neutral_leg_length_m"):
        geometry.machine_kinematics(changed(hexapod, {"geometry.neutral_leg_length_m": 0.4}))


def test_bench_has_no_hexapod_geometry(bench):
    """Asked of a bench, the sentence names it and says what to use."""
    with pytest.raises(
        HexsimError, match="machine bench is a bench and has no hexapod geometry: use a hexapod machine"
    ):
        geometry.machine_kinematics(bench)
