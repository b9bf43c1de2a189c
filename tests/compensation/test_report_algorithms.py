"""The report's functions and algorithms: identities first, then what its chapter 5 shows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from leg_plant import Leg, Record, run

import compensation
from compensation import flow_curve, report_functions

REPORT_LEG = dict(quadratic=True, spool_Hz=0.0, sharpness_m_s=0.0)  # chapter 3 and 5: Eq. 3.11, no spool, arctan
REPORT = dict(rate_Hz=1e4, noise=False)  # its simulation ran at 10 kHz with clean signals
LONG = REPORT | dict(rate_Hz=2e3)  # what takes many periods to see


@pytest.fixture(scope="module")
def uncompensated() -> float:
    """Peak deviation without compensation [m/s2], no band limit: 0.438 in the errata."""
    return run(compensation.create("none"), Leg(**REPORT_LEG), duration_s=8.0, **REPORT).peak(6.0, 8.0, band_Hz=None)


def test_function_2_is_the_exact_inverse_of_the_quadratic_curve() -> None:
    """Eq. 5.3 with a = q/4, b = 1/q, c = 0 makes v = C u^2 the line v = C q u, to rounding, at 2001 voltages."""
    q, gain = 1.3, 0.16
    for u in np.linspace(-2 * q, 2 * q, 2001):
        total = u + report_functions.function_2(u, q / 4, 1 / q, 0.0)
        assert gain * total * abs(total) == pytest.approx(gain * q * u, abs=1e-14)


@pytest.mark.parametrize(
    ("function", "end"), [(report_functions.function_1, math.pi), (report_functions.function_2, 1.0)]
)
def test_functions_are_odd_and_peak_at_a(function, end) -> None:
    """Both functions are odd about c/b, zero at c/b and at the end of their range, and a is their largest value."""
    a, b, c = 0.25, 1.7, 0.2
    zero = c / b
    u = np.linspace(0, end / b, 20001)
    values = np.array([function(zero + x, a, b, c) for x in u])
    assert values.max() == pytest.approx(a, rel=1e-7)
    assert abs(values[0]) < 1e-7 and abs(values[-1]) < 1e-3  # the root magnifies rounding at the ends
    mirrored = np.array([function(zero - x, a, b, c) for x in u[1:-1]])
    assert mirrored == pytest.approx(-values[1:-1], abs=1e-6)


def test_flow_curve_and_its_inverse_undo_each_other() -> None:
    """velocity(voltage(v)) = v on both sides; the overlap's ends are at +-45.45 mV for 5 um of 1.1 mm at 10 V."""
    for curve in (flow_curve.overlap_curve(), flow_curve.quadratic_curve()):
        for v in np.linspace(-0.5, 0.5, 101):
            assert curve.velocity(curve.voltage(v)) == pytest.approx(v, abs=1e-12)
    curve = flow_curve.overlap_curve()
    assert curve.velocity(0.045) == 0.0 == curve.velocity(-0.045)
    assert curve.voltage(1e-9) == pytest.approx(5e-6 / 1.1e-4, rel=1e-6)
    assert curve.voltage(-1e-9) == pytest.approx(-5e-6 / 1.1e-4, rel=1e-6)


def test_a_wrong_flow_curve_is_refused() -> None:
    """Falling velocities, unequal lengths and NaN are told apart."""
    with pytest.raises(ValueError, match="never fall"):
        flow_curve.FlowCurve((0.0, 1.0), (1.0, 0.0))
    with pytest.raises(ValueError, match="as many velocities"):
        flow_curve.FlowCurve((0.0, 1.0), (1.0,))
    with pytest.raises(ValueError, match="not finite"):
        flow_curve.FlowCurve((0.0, 1.0), (1.0, math.nan))


def test_exact_inverse_of_the_quadratic_curve_leaves_almost_nothing(uncompensated) -> None:
    """Report 5.2: with the curve known, a twentieth of the bump is left (smooth friction hides the rest, errata Eq.
    3.9)."""
    exact = compensation.create("exact", curve=flow_curve.quadratic_curve(), slope_m_s_V=0.15)
    left = run(exact, Leg(**REPORT_LEG), duration_s=8.0, **REPORT).peak(6.0, 8.0, band_Hz=None)
    assert uncompensated == pytest.approx(0.438, rel=0.02)  # the errata's independent figure
    assert left < uncompensated / 10


def test_iterative_with_function_2_shrinks_and_stays(uncompensated) -> None:
    """Report Fig. 5.10: the peaks fall steadily to a fifth and stay; a reaches q/4 within 15 %
    (q is the largest voltage ever seen, a little beyond where the curves cross)."""
    made = run(
        compensation.create("iterative", function=2, form="report", gain=2.0, velocity_bandwidth_Hz=None),
        Leg(**REPORT_LEG),
        duration_s=22.0,
        **LONG,
    )
    peaks = made.peaks(band_Hz=None)
    assert peaks[-1] < uncompensated / 5
    assert np.all(np.diff(peaks[:4]) < 0)
    assert peaks[-3:].max() < 1.1 * peaks[-3:].min()
    assert made.known["a_V"] == pytest.approx(made.known["q_V"] / 4, rel=0.15)


@pytest.mark.slow  # its function's peak is above; the algorithm shrinks and stays with the other one
def test_iterative_with_function_1_shrinks_then_grows() -> None:
    """Report Fig. 5.7, 5.8: with function (1) the error never ends, a blows up past q/2 and the peaks grow again."""
    made = run(
        compensation.create("iterative", function=1, form="report", gain=2.0, velocity_bandwidth_Hz=None),
        Leg(**REPORT_LEG),
        duration_s=60.0,
        **LONG,
    )
    peaks = made.peaks(first_s=6.0, band_Hz=None)
    lowest = int(peaks.argmin())
    assert peaks[lowest] < 0.5 * peaks[0]
    assert peaks[lowest:].max() > 2 * peaks[lowest]
    assert made.known["a_V"] > made.known["q_V"] / 2


def test_the_half_width_of_5_3_makes_it_worse(uncompensated) -> None:
    """Errata: r printed as the half width of u at v = 0 shifts the curve and the peaks grow; as the mean they
    shrink."""
    printed, mended = (
        run(
            compensation.create("iterative", form="report", offset=offset, gain=0.5, velocity_bandwidth_Hz=None),
            Leg(**REPORT_LEG),
            duration_s=16.0,
            **LONG,
        )
        for offset in ("half width", "mean")
    )
    assert printed.peaks(band_Hz=None)[-1] > 1.5 * uncompensated
    assert mended.peaks(band_Hz=None)[-1] < 0.75 * uncompensated


@pytest.fixture(scope="module")
def buffered_as_reported() -> Record:
    return run(compensation.create("buffered", form="report"), Leg(**REPORT_LEG), duration_s=8.0, **REPORT)


@pytest.mark.parametrize("form", ["report", "corrected"])
def test_buffered_is_nearly_right_after_its_first_update(form, uncompensated, buffered_as_reported) -> None:
    """Report 5.5: after the first two buffers a is within 20 % of q/4, and the peak is about halved at least."""
    corrected = form == "corrected"
    made = (
        run(compensation.create("buffered"), Leg(**REPORT_LEG), duration_s=8.0, **REPORT)
        if corrected
        else buffered_as_reported
    )
    a, q, _ = made.known["curves"][0]
    assert a == pytest.approx(q / 4, rel=0.2)
    assert made.peak(6.0, 8.0) < uncompensated / 1.8


def test_buffered_is_unmoved_by_velocity_noise(buffered_as_reported) -> None:
    """Report 5.5: 2 mm/s of white velocity noise moves a and q by less than 2 %."""
    made = run(
        compensation.create("buffered", form="report"),
        Leg(**REPORT_LEG),
        duration_s=8.0,
        velocity_noise_m_s=2e-3,
        **REPORT,
    )
    clean, noisy = (record.known["curves"][0] for record in (buffered_as_reported, made))
    assert noisy[:2] == pytest.approx(clean[:2], rel=0.02)


@pytest.mark.slow  # the buffer learns what it is in the tests above
def test_buffered_follows_an_oil_step_both_ways() -> None:
    """15 degC at 12 s (10 kg/m3 lighter, a third of the viscous friction gone): the corrected form's peak is back
    within 25 s."""

    def warmer(time_s: float, leg: Leg) -> None:
        if time_s >= 12.0:
            leg.density_kg_m3, leg.friction = 850.0, 0.67

    made = run(compensation.create("buffered"), Leg(**REPORT_LEG), duration_s=26.0, change=warmer, **LONG)
    assert made.peak(24.0, 26.0) < 0.25 * 0.43


def test_two_curves_beat_one_on_a_valve_with_hysteresis() -> None:
    """Report chapter 6: on a valve with backlash, a curve for each sign of acceleration finds offsets of opposite
    sign."""
    made = run(
        compensation.create("buffered", two_sided=True), Leg(**REPORT_LEG, backlash_V=0.05), duration_s=14.0, **LONG
    )
    falling, rising = (curve[2] for curve in made.known["curves"])
    assert rising > 0.01 > -0.01 > falling


def test_wrong_choices_are_named() -> None:
    """A function or form that does not exist is refused with what there is."""
    with pytest.raises(ValueError, match=r"choose 1 .* or 2"):
        compensation.create("buffered", function=3)
    with pytest.raises(ValueError, match="report or corrected"):
        compensation.create("iterative", form="new")
