"""Volts to spool to opening to flow, against Eq. 3.2-3.4 and 3.11 written out with the report's numbers."""

import math

import numpy as np
import pytest

from hexsim.hydraulics import valve

OVERLAP, DIAMETER, TRAVEL, GAIN = 5e-6, 1e-2, 1.1e-3, 1.1e-3 / 10  # [m], [m], [m], [m/V]
DISCHARGE, DENSITY, WIDTH = 0.611, 860.0, 1.0e4


@pytest.mark.parametrize(
    ("volts", "spool"),
    [(0.0, 0.0), (1.0, 1.1e-4), (-1.0, -1.1e-4), (10.0, 1.1e-3), (-10.0, -1.1e-3), (25.0, 1.1e-3), (-25.0, -1.1e-3)],
)
def test_spool_is_proportional_and_saturates(volts, spool):
    """Eq. 3.2: 0.11 mm a volt, and no further than 1.1 mm either way."""
    assert valve.spool_command(volts, 0.0, GAIN, TRAVEL) == pytest.approx(spool, rel=1e-12, abs=0)


def test_null_offset_moves_the_centre():
    """With the null at 0.3 V the spool is centred there and 1.1e-4 m off at 1.3 and -0.7 V."""
    assert valve.spool_command(0.3, 0.3, GAIN, TRAVEL) == 0.0
    for volts, sign in ((1.3, 1), (-0.7, -1)):
        assert valve.spool_command(volts, 0.3, GAIN, TRAVEL) == pytest.approx(sign * 1.1e-4, rel=1e-12)


def test_spool_is_a_second_order_system():
    """x'' = w^2 (c - x) - 2 zeta w x' overshoots a step by exp(-pi zeta/sqrt(1 - zeta^2)), after pi/w_d."""
    omega, zeta, step = 2 * math.pi * 60.0, 0.5, 1e-6
    position = speed = highest = 0.0
    time_of_highest = 0.0
    for k in range(20_000):
        speed += step * valve.spool_acceleration(position, speed, 1.0, omega, zeta)
        position += step * speed
        if position > highest:
            highest, time_of_highest = position, (k + 1) * step
    damped = math.sqrt(1 - zeta**2)
    # semi-implicit Euler of first order: w h = 4e-4
    assert highest == pytest.approx(1 + math.exp(-math.pi * zeta / damped), rel=1e-3)
    assert time_of_highest == pytest.approx(math.pi / (omega * damped), rel=2e-3)


@pytest.mark.parametrize(
    ("x", "opening"),
    [
        (0.0, 0.0),
        (OVERLAP, 0.0),
        (OVERLAP * (1 - 1e-9), 0.0),
        (2 * OVERLAP, OVERLAP),
        (TRAVEL, TRAVEL - OVERLAP),
        (-OVERLAP, 0.0),
        (-TRAVEL, 0.0),
    ],
)
def test_sharp_overlap_law(x, opening):
    """Eq. 3.3: closed up to and at the overlap and for all travel the other way, x - O beyond."""
    assert valve.opening(x, OVERLAP, 0.0) == pytest.approx(opening, rel=1e-12, abs=0)


def test_both_edges_are_the_same_law_mirrored():
    """a_1(x) and a_2(x) of Eq. 3.3 over the whole travel, both signs: pi d (x - O), -pi d (x + O), 0 between."""
    for x in np.linspace(-TRAVEL, TRAVEL, 441):
        a1 = valve.edge_area(x, OVERLAP, 0.0, math.pi * DIAMETER, 0.0)
        a2 = valve.edge_area(-x, OVERLAP, 0.0, math.pi * DIAMETER, 0.0)
        assert a1 == pytest.approx(math.pi * DIAMETER * (x - OVERLAP) if x > OVERLAP else 0.0, rel=1e-12, abs=0)
        assert a2 == pytest.approx(-math.pi * DIAMETER * (x + OVERLAP) if x < -OVERLAP else 0.0, rel=1e-12, abs=0)


def test_underlap_leaves_both_edges_open_at_rest():
    """With overlap -20 um each edge is open by 20 um at x = 0 and shuts at 20 um travel the other way."""
    assert valve.opening(0.0, -20e-6, 0.0) == pytest.approx(20e-6)
    assert valve.opening(-20e-6, -20e-6, 0.0) == 0.0


def test_rounded_edge_converges_to_the_sharp_one():
    """The rounded law is nowhere below the sharp one and at most s log 2 above it, at the corner: of order 1 in s."""
    x = np.concatenate([np.linspace(-60e-6, 60e-6, 2001), [OVERLAP]])
    for rounding in (4e-6, 2e-6, 1e-6, 0.5e-6):
        excess = np.array([valve.opening(v, OVERLAP, rounding) - valve.opening(v, OVERLAP, 0.0) for v in x])
        assert excess.max() == pytest.approx(rounding * math.log(2), rel=1e-9)
        assert x[np.argmax(excess)] == pytest.approx(OVERLAP, abs=1e-12)
        assert excess.min() >= -1e-18  # rounding of 60e-6


def test_rounded_edge_is_smooth_over_its_cut_offs():
    """The cut-offs at z = +-40 leave a step below 1e-17 of the rounding (exp(-40)), so no jump in flow."""
    rounding = 1e-6
    for z in (40.0, -40.0):
        inside = valve.opening(OVERLAP + rounding * z * (1 - 1e-12), OVERLAP, rounding)
        beyond = valve.opening(OVERLAP + rounding * z * (1 + 1e-12), OVERLAP, rounding)
        assert abs(beyond - inside) < 2e-10 * rounding  # 80e-12 of it is the step in x itself


def test_quadratic_law():
    """Eq. 3.11: 300 x^2 towards the edge, nothing the other way; the overlap plays no part."""
    for x in (1e-6, 1.05e-4, TRAVEL):
        assert valve.edge_area(x, OVERLAP, 0.0, math.pi * DIAMETER, 300.0) == pytest.approx(
            300 * x**2, rel=1e-12, abs=0
        )
        assert valve.edge_area(-x, OVERLAP, 0.0, math.pi * DIAMETER, 300.0) == 0.0


def test_quadratic_law_meets_the_overlap_law_near_one_volt():
    """300 x^2 = pi d (x - O) at 0.0995 mm (0.90 V) and inside 6 um, nowhere else; 10 times too large at full stroke.

    By hand x = (pi d +- sqrt((pi d)^2 - 1200 pi d O))/600. The erratum's "near 0.105 mm (0.95 V)" is the crossing
    without overlap, pi d/300 = 0.1047 mm.
    """
    gradient = math.pi * DIAMETER

    def difference(x, overlap):
        sharp = valve.edge_area(x, overlap, 0.0, gradient, 0.0)
        return valve.edge_area(x, overlap, 0.0, gradient, 300.0) - sharp

    crossing = (gradient + math.sqrt(gradient**2 - 1200 * gradient * OVERLAP)) / 600
    assert difference(crossing, OVERLAP) == pytest.approx(0.0, abs=1e-15)
    assert crossing / GAIN == pytest.approx(0.904, abs=0.001)
    assert difference(gradient / 300, 0.0) == pytest.approx(0.0, abs=1e-15)
    assert gradient / 300 / GAIN == pytest.approx(0.95, abs=0.005)
    ratio = valve.edge_area(TRAVEL, OVERLAP, 0.0, gradient, 300.0) / valve.edge_area(
        TRAVEL, OVERLAP, 0.0, gradient, 0.0
    )
    assert 10.0 < ratio < 11.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_orifice_equation_in_both_directions(sign):
    """Eq. 3.4 at 36 bar and a fully open edge: 115 l/min of the field's sizes, forward and back."""
    area = math.pi * DIAMETER * (TRAVEL - OVERLAP)
    flow = valve.orifice_flow(area, sign * 36e5, DISCHARGE, DENSITY, WIDTH)
    by_hand = sign * DISCHARGE * area * math.sqrt(2 * 36e5 / DENSITY)
    assert flow == pytest.approx(by_hand, rel=1e-5)  # (w/dp)^2/4 = 2e-6 is the regularisation's share
    assert abs(flow) * 60e3 == pytest.approx(115, abs=1)


def test_smooth_root_stays_within_its_bound():
    """Within 0.3 % of sqrt(|dp|) beyond 10 widths and 1/4 (w/dp)^2 in general; odd; 0 at 0."""
    for dp in np.geomspace(10 * WIDTH, 1e8, 60):
        error = 1 - valve.smooth_root(dp, WIDTH) / math.sqrt(dp)
        assert 0 <= error < 0.003
        assert error == pytest.approx(0.25 * (WIDTH / dp) ** 2, rel=0.02, abs=1e-15)
        assert valve.smooth_root(-dp, WIDTH) == -valve.smooth_root(dp, WIDTH)
    assert valve.smooth_root(0.0, WIDTH) == 0.0


def test_smooth_root_is_finite_and_steepest_at_zero():
    """Slope 1/sqrt(w) at dp = 0, and nowhere more."""
    assert valve.smooth_root_slope(0.0, WIDTH) == pytest.approx(1 / math.sqrt(WIDTH), rel=1e-12)
    slopes = [valve.smooth_root_slope(dp, WIDTH) for dp in np.linspace(-10 * WIDTH, 10 * WIDTH, 2001)]
    assert max(slopes) <= 1 / math.sqrt(WIDTH) * (1 + 1e-12)


@pytest.mark.parametrize("dp", [-3e6, -2e4, -1e4, -10.0, 0.0, 5e3, 1e4, 1e5, 4e6])
def test_slope_of_the_root_is_its_derivative(dp):
    """Central difference of smooth_root, both signs and inside the width."""
    h = 1e-3 * max(abs(dp), WIDTH)
    numeric = (valve.smooth_root(dp + h, WIDTH) - valve.smooth_root(dp - h, WIDTH)) / (2 * h)
    assert valve.smooth_root_slope(dp, WIDTH) == pytest.approx(numeric, rel=1e-5)  # h^2 = 1e-6 of the curvature


def test_clearance_leaks_less_the_longer_the_land():
    """G at the edge, G/2 at one clearance length of sealing, no more than G when open; laminar, so a conductance."""
    G, length = 2.7e-13, 3e-6
    assert valve.clearance_conductance(OVERLAP, OVERLAP, G, length) == pytest.approx(G, rel=1e-12, abs=0)
    assert valve.clearance_conductance(OVERLAP - length, OVERLAP, G, length) == pytest.approx(G / 2, rel=1e-12, abs=0)
    assert valve.clearance_conductance(10 * OVERLAP, OVERLAP, G, length) == pytest.approx(G, rel=1e-12, abs=0)
    assert valve.clearance_conductance(-TRAVEL, OVERLAP, G, length) == pytest.approx(
        G * length / (length + OVERLAP + TRAVEL), rel=1e-12, abs=0
    )


def test_play_follows_within_its_width():
    """Backlash of half width 0.1: stays while the input is within 0.1, then is dragged 0.1 behind, both ways."""
    held, path = 0.0, []
    for volts in (0.05, 0.1, 0.3, 0.25, 0.15, 0.0, -0.5, -0.45):
        held = valve.play(volts, held, 0.1)
        path.append(held)
    np.testing.assert_allclose(path, [0.0, 0.0, 0.2, 0.2, 0.2, 0.1, -0.4, -0.4], atol=1e-15)


@pytest.mark.parametrize("omega", [2 * math.pi * 60.0, 2 * math.pi * 1300.0])
def test_a_limited_spool_slews_at_its_limit_and_stops(omega):
    """A step of 100 um at 10 mm/s takes 10 ms and the braking, never runs faster, and passes its goal by less than 3 %.

    Braking starts within 2 zeta/omega of travel time: 2.7 ms at 60 Hz, so that after 20 ms both spools are there. Without
    a limit on what is wound up the quick spool would swing past by many times the step.
    """
    position = speed = highest = fastest = 0.0
    for _ in range(400_000):
        rate, acceleration = valve.spool_rates(position, speed, 1e-4, omega, 0.7, 0.01)
        position, speed = position + 1e-7 * rate, speed + 1e-7 * acceleration
        highest, fastest = max(highest, position), max(fastest, abs(rate))
    assert fastest <= 0.01 and fastest == pytest.approx(0.01)
    assert highest < 1.03e-4
    assert position == pytest.approx(1e-4, rel=1e-3)


def test_a_pilot_of_limited_flow_moves_the_spool_in_first_order():
    """Damping 0: dx/dt = w (c - x), cut at the limit; a step larger than limit/w slews first, then closes exponentially."""
    omega, limit = 3000.0, 0.03  # linear within 10 um
    assert valve.spool_rates(0.0, 0.0, 5e-6, omega, 0.0, limit) == (pytest.approx(0.015), 0.0)
    assert valve.spool_rates(0.0, 0.0, -5e-5, omega, 0.0, limit) == (-limit, 0.0)
    assert valve.spool_rates(0.0, 7.0, 5e-5, omega, 0.0, 0.0)[0] == pytest.approx(0.15)
