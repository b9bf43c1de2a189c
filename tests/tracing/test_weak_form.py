"""The window of the weak form: exact on polynomials, and its derivative needs no difference of noisy samples."""

import numpy as np
import pytest

from hexsim.mechanics import rigid_body
from hexsim.signals import weak_form

RATE = 1000.0
T = np.arange(2000) / RATE
INSIDE = slice(100, -100)


def test_constants_and_ramps_pass_unchanged():
    """<w, x> = x for a ramp, <w, dx/dt> = slope, to rounding."""
    window, ramp = weak_form.Window(RATE), 3.0 + 2.0 * T
    assert window.mean(ramp)[INSIDE] == pytest.approx(ramp[INSIDE], rel=1e-12)
    assert window.rate(ramp)[INSIDE] == pytest.approx(2.0, rel=1e-9)


def test_second_derivative_of_a_parabola():
    """<w'', x> of 2.5 t^2 is 5, to rounding."""
    assert weak_form.Window(RATE, 0.03).second_rate(2.5 * T**2)[INSIDE] == pytest.approx(5.0, rel=1e-6)


def test_rate_equals_the_mean_of_the_exact_rate():
    """Integration by parts: -<w', x> = <w, x'> for a sine of 3 Hz; rest is the sampling of the window, below 1e-4."""
    window = weak_form.Window(RATE)
    x, exact = np.sin(2 * np.pi * 3 * T), 6 * np.pi * np.cos(2 * np.pi * 3 * T)
    difference = window.rate(x)[INSIDE] - window.mean(exact)[INSIDE]
    assert np.max(np.abs(difference)) < 1e-4 * np.max(np.abs(exact))


def test_velocity_joins_both_sensors():
    """Position alone smooths a 60 Hz vibration away; with the accelerometer the velocity is right within 2 %."""
    w = 2 * np.pi * 60
    y, a, exact = 1e-4 * np.sin(w * T), -1e-4 * w**2 * np.sin(w * T), 1e-4 * w * np.cos(w * T)
    together = weak_form.velocity(y[None], a[None], RATE)[0, INSIDE]
    alone = weak_form.velocity(y[None], None, RATE)[0, INSIDE]
    assert np.max(np.abs(together - exact[INSIDE])) < 0.02 * np.max(exact)
    assert np.max(np.abs(alone)) < 0.2 * np.max(exact)


@pytest.mark.parametrize("frequency", [3.0, 8.0])
def test_a_payload_on_a_spring_gives_back_what_its_transfer_function_says(frequency):
    """Driven at a frequency the reaction has the gain of (2 zeta w p + w^2)/(p^2 + 2 zeta w p + w^2), at rest it is the weight.

    Bilinear rule: the resonance is off by (w T)^2/12 = 2e-4 at 8 Hz, felt near it by 2 % at most at zeta 0.05.
    """
    rate, mode = 1000.0, rigid_body.Suspension(mass=1.0, omega=2 * np.pi * 6.0, damping=0.05)
    t = np.arange(20_000) / rate
    felt = 9.81 + np.sin(2 * np.pi * frequency * t)
    back = rigid_body.pushed_back(mode, felt, rate)
    w, p = 2 * np.pi * 6.0, 2j * np.pi * frequency
    expected = abs((0.1 * w * p + w**2) / (p**2 + 0.1 * w * p + w**2))
    last = back[-5000:] - 9.81
    assert np.sqrt(2 * np.mean(last**2)) == pytest.approx(expected, rel=0.02)
    assert np.allclose(rigid_body.pushed_back(mode, np.full(100, 9.81), rate), 9.81, rtol=1e-9, atol=0)


@pytest.mark.parametrize("half_width_s", [0.006, 0.02, 0.04])
def test_some_samples_are_as_of_all(half_width_s):
    """Mean, rate and second rate at every 20th sample are those of all samples, to rounding; also where the window leaves the run."""
    x = np.random.default_rng(0).standard_normal((2, len(T)))
    for at in (slice(100, 1950, 20), slice(3, None, 20)):
        whole, some = weak_form.Window(RATE, half_width_s), weak_form.Window(RATE, half_width_s, at)
        for name in ("mean", "rate", "second_rate"):
            expected = getattr(whole, name)(x)[:, at]
            assert getattr(some, name)(x) == pytest.approx(expected, abs=1e-12 * np.max(np.abs(expected)))
