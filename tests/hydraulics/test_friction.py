"""Stribeck, its two forms, LuGre and the end stops, against Eq. 2.4 and 3.9 with the report's numbers."""

import math

import numpy as np
import pytest

from hexsim.hydraulics import friction, leg, parameters
from hexsim.hydraulics.parameters import P
from hexsim.machine.files import changed

STRIBECK = 0.005  # [m/s]
REPORT = {  # sigma, F_c, F_s of appendix A
    1.0: (2200.0, 65.0, 30.0),
    -1.0: (1800.0, 60.0, 30.0),
}


def force(row, v):
    return leg.friction_force(row, 0.1, v, 3.2e6, 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("speed", [0.002, 0.005, 0.02, 0.15])
def test_sharp_form_is_equation_2_4(row, sign, speed):
    """sigma v + sign(v) (F_c + F_s exp(-|v|/c_s)) of the direction of motion, from 10 widths of the step on.

    tanh(10) leaves 4e-9 of the step.
    """
    sigma, coulomb, static = REPORT[sign]
    by_hand = sign * (sigma * speed + coulomb + static * math.exp(-speed / STRIBECK))
    assert force(row, sign * speed) == pytest.approx(by_hand, rel=1e-8)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("speed", [1e-4, 0.01, 0.15])
def test_report_form_is_equation_3_9_as_printed(bench, sign, speed):
    """arctan(100 v), unscaled."""
    row = parameters.declared_rows(changed(bench, {"friction.form": "report"}))[0]
    sigma, coulomb, static = REPORT[sign]
    by_hand = sign * (sigma * speed + math.atan(100 * speed) * (coulomb + static * math.exp(-speed / STRIBECK)))
    assert force(row, sign * speed) == pytest.approx(by_hand, rel=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_printed_form_tends_to_1_57_times_the_coulomb_force(bench, sign):
    """The erratum: arctan tends to pi/2, so the printed friction is 1.57 times Eq. 2.4 at speed; half at 10 mm/s."""
    row = parameters.declared_rows(changed(bench, {"friction.form": "report"}))[0]
    sigma, coulomb, _ = REPORT[sign]

    def dry(v):
        return (force(row, v) - sigma * v) / (sign * coulomb)

    assert dry(sign * 10.0) == pytest.approx(math.pi / 2, rel=1e-3)  # arctan(1000) is 1e-3 short of pi/2
    assert 0.75 < dry(sign * 0.01) < 0.9  # pi/4 and what is left of the static part: smeared over +-10 mm/s


def test_friction_is_continuous_and_zero_at_rest(row):
    """F(0) = 0 and no jump across v = 0 although all parameters change sides there."""
    assert force(row, 0.0) == 0.0
    v = np.linspace(-1e-4, 1e-4, 2_001)
    forces = np.array([force(row, value) for value in v])
    # steepest possible slope: (F_c + F_s)/v_s + sigma
    assert np.abs(np.diff(forces)).max() <= (95 / 2e-4 + 2200) * 1e-7 * 1.0001


def test_friction_takes_energy_out(row):
    """F v > 0 for every v but 0, so friction never drives."""
    for v in np.concatenate([np.geomspace(1e-9, 1, 80), -np.geomspace(1e-9, 1, 80)]):
        assert force(row, v) * v > 0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_stribeck_minimum(row, sign):
    """The force is least where sigma = F_s/c_s exp(-v/c_s), so at v = c_s ln(F_s/(sigma c_s)), either way.

    5.02 mm/s extending and 6.02 mm/s retracting with the report's numbers; steps of 0.01 mm/s.
    """
    sigma, _, static = REPORT[sign]
    speeds = np.arange(1.5e-3, 20e-3, 1e-5)
    curve = [sign * force(row, sign * v) for v in speeds]
    by_hand = STRIBECK * math.log(static / (sigma * STRIBECK))
    assert speeds[int(np.argmin(curve))] == pytest.approx(by_hand, abs=1e-5)


def test_sharpness_is_the_width_of_the_step(row):
    """At v_s the sign stands at tanh(1) = 0.762, and a tenth of v_s makes the step ten times as steep."""
    assert friction.direction(2e-4, row[P.SHARPNESS], 0.0) == pytest.approx(math.tanh(1.0))
    steep = friction.direction(1e-9, 2e-5, 0.0) / friction.direction(1e-9, 2e-4, 0.0)
    assert steep == pytest.approx(10, rel=1e-6)


@pytest.mark.parametrize("v", [0.001, -0.001, 0.03, -0.03])
def test_lugre_in_steady_motion_is_the_stribeck_level(row, v):
    """dz/dt = 0 at z = sign(v) g/s0, where friction is sigma v + sign(v) g(v): Eq. 2.4 with an exact sign."""
    row[P.BRISTLE_STIFFNESS], row[P.BRISTLE_DAMPING] = 1e6, 1e3
    sign = math.copysign(1.0, v)
    sigma, coulomb, static = REPORT[sign]
    level = coulomb + static * math.exp(-abs(v) / STRIBECK)
    assert leg.friction_level(row, 0.1, v, 3e6) == pytest.approx(level, rel=1e-12)
    z = sign * level / 1e6
    assert leg.bristle_rate(row, 0.1, v, 3e6, z) == pytest.approx(0.0, abs=1e-12)
    assert leg.friction_force(row, 0.1, v, 3e6, z) == pytest.approx(sigma * v + sign * level, rel=1e-9)


def test_lugre_is_a_spring_before_it_slides(row):
    """At rest the force is s0 z, and a slow push moves the bristle with the piston: dz/dt = v at z = 0."""
    row[P.BRISTLE_STIFFNESS], row[P.BRISTLE_DAMPING] = 1e6, 1e3
    assert leg.friction_force(row, 0.1, 0.0, 3e6, 2e-5) == pytest.approx(20.0)
    assert leg.bristle_rate(row, 0.1, 1e-4, 3e6, 0.0) == pytest.approx(1e-4)


def test_lugre_bristle_settles_from_any_start(row):
    """Integrated at 2 mm/s from both sides, z reaches g/s0 in a few g/(s0 v)."""
    row[P.BRISTLE_STIFFNESS], row[P.BRISTLE_DAMPING] = 1e6, 1e3
    end = leg.friction_level(row, 0.1, 2e-3, 3e6) / 1e6
    for start in (-end, 0.0, 3 * end):
        z = start
        for _ in range(2_000):
            z += 2e-4 * leg.bristle_rate(row, 0.1, 2e-3, 3e6, z)
        assert z == pytest.approx(end, rel=1e-3)


def test_bristle_without_dry_friction_stays_finite(row):
    """F_c = F_s = 0 with presliding: dz/dt is a number at rest and in motion (g is kept at 1 mN)."""
    row[P.BRISTLE_STIFFNESS] = 1e6
    for place in (P.COULOMB_EXTEND, P.COULOMB_RETRACT, P.STATIC_EXTEND, P.STATIC_RETRACT):
        row[place] = 0.0
    assert leg.bristle_rate(row, 0.1, 0.0, 3e6, 0.0) == 0.0
    assert math.isfinite(leg.bristle_rate(row, 0.1, 0.1, 3e6, 1e-9))
    row[P.BRISTLE_STIFFNESS] = 0.0
    assert force(row, 0.1) == pytest.approx(220.0)  # nothing but viscous without the bristle


def test_ripple_and_seal_add_to_the_coulomb_force(row):
    """F_c + F_r sin(2 pi y/L + phase) + c P1, never below zero; no part of it acts below tank pressure."""
    base = leg.friction_level(row, 0.1, 0.05, 0.0)
    row[P.RIPPLE_FORCE], row[P.RIPPLE_LENGTH], row[P.RIPPLE_PHASE] = 20.0, 0.05, 0.3
    for y in (0.01, 0.04, 0.1):
        by_hand = base + 20 * math.sin(2 * math.pi * y / 0.05 + 0.3)
        assert leg.friction_level(row, y, 0.05, 0.0) == pytest.approx(by_hand, rel=1e-12)
    row[P.RIPPLE_FORCE] = -1e3  # at y = L/4 - phase the sine is 1
    assert leg.friction_level(row, 0.05 * (0.25 - 0.3 / (2 * math.pi)), 0.05, 0.0) == pytest.approx(30 * math.exp(-10))
    row[P.RIPPLE_FORCE], row[P.SEAL_FRICTION] = 0.0, 5e-6
    assert leg.friction_level(row, 0.1, 0.05, 4e6) == pytest.approx(base + 20.0)
    assert leg.friction_level(row, 0.1, 0.05, -5e4) == pytest.approx(base)


STROKE, LENGTH, STIFFNESS, DAMPING = 0.2, 0.005, 4e6, 2e4


def stop(y, v):
    return friction.end_stop_force(y, v, STROKE, LENGTH, STIFFNESS, DAMPING)


def test_end_stop_is_absent_between_the_cushions():
    """Exactly zero from 5 mm to 195 mm at any speed."""
    assert [stop(y, v) for y in (LENGTH, 0.1, STROKE - LENGTH) for v in (-1.0, 0.0, 1.0)] == [0.0] * 9


@pytest.mark.parametrize("into", [0.001, 0.0025, 0.005, 0.007])
def test_end_stop_is_a_progressive_spring(into):
    """k d^2/l at rest, the same at both ends with opposite sign: 20 kN at the cylinder's end."""
    by_hand = STIFFNESS * into**2 / LENGTH
    assert stop(LENGTH - into, 0.0) == pytest.approx(by_hand, rel=1e-9)
    assert stop(STROKE - LENGTH + into, 0.0) == pytest.approx(-by_hand, rel=1e-9)


def test_end_stop_never_pulls():
    """Whatever the depth and speed it pushes inwards only; on the way out it is the spring alone."""
    for into in np.linspace(1e-5, 0.012, 25):
        for v in np.linspace(-2, 2, 21):
            assert stop(LENGTH - into, v) > 0
            assert stop(STROKE - LENGTH + into, v) < 0
        assert stop(LENGTH - into, 1.0) == stop(LENGTH - into, 0.0)
        assert stop(STROKE - LENGTH + into, -1.0) == stop(STROKE - LENGTH + into, 0.0)


def test_a_cushion_s_orifice_brakes_with_the_square_of_the_speed():
    """A pocket of 12.6 cm2 behind K = 1e-6: A (A v/K)^2 = 179 N at 0.3 m/s, over the cushion's length; 0 on the way out."""
    area, conductance = 12.566e-4, 1e-6
    choke = area**3 / conductance**2
    for speed in (0.1, 0.3):
        for y, v in ((0.0, -speed), (STROKE, speed)):
            force = friction.end_stop_force(y, v, STROKE, LENGTH, 0.0, 0.0, choke, choke)
            assert abs(force) == pytest.approx(area * (area * speed / conductance) ** 2, rel=1e-9)
            assert force * v < 0.0
            assert friction.end_stop_force(y, -v, STROKE, LENGTH, 0.0, 0.0, choke, choke) == 0.0
    assert friction.end_stop_force(0.0, -0.3, STROKE, LENGTH, 0.0, 0.0, 0.0, choke) == 0.0
    half = friction.end_stop_force(0.5 * LENGTH, -0.3, STROKE, LENGTH, 0.0, 0.0, choke, 0.0)
    assert half == pytest.approx(0.5 * choke * 0.09, rel=1e-9)


def test_end_stop_damps_the_way_in():
    """c v grows in over the cushion: half of it at half depth, all from the cylinder's end on."""
    for into, share in ((0.0025, 0.5), (0.005, 1.0), (0.01, 1.0)):
        for y, v in ((LENGTH - into, -0.3), (STROKE - LENGTH + into, 0.3)):
            assert abs(stop(y, v)) - abs(stop(y, 0.0)) == pytest.approx(share * DAMPING * 0.3, rel=1e-9)
