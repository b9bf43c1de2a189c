"""The window of the weak form: exact on polynomials, and its derivative needs no difference of noisy samples."""

import numpy as np
import pytest

from hexsim.tracing.weak_form import Window, velocity

RATE = 1000.0
T = np.arange(2000) / RATE
INSIDE = slice(100, -100)


def test_constants_and_ramps_pass_unchanged():
    """<w, x> = x for a ramp, <w, dx/dt> = slope, to rounding."""
    window, ramp = Window(RATE), 3.0 + 2.0 * T
    assert window.mean(ramp)[INSIDE] == pytest.approx(ramp[INSIDE], rel=1e-12)
    assert window.rate(ramp)[INSIDE] == pytest.approx(2.0, rel=1e-9)


def test_second_derivative_of_a_parabola():
    """<w'', x> of 2.5 t^2 is 5, to rounding."""
    assert Window(RATE, 0.03).second_rate(2.5 * T**2)[INSIDE] == pytest.approx(5.0, rel=1e-6)


def test_rate_equals_the_mean_of_the_exact_rate():
    """Integration by parts: -<w', x> = <w, x'> for a sine of 3 Hz; rest is the sampling of the window, below 1e-4."""
    window = Window(RATE)
    x, exact = np.sin(2 * np.pi * 3 * T), 6 * np.pi * np.cos(2 * np.pi * 3 * T)
    difference = window.rate(x)[INSIDE] - window.mean(exact)[INSIDE]
    assert np.max(np.abs(difference)) < 1e-4 * np.max(np.abs(exact))


def test_velocity_joins_both_sensors():
    """Position alone smooths a 60 Hz vibration away; with the accelerometer the velocity is right within 2 %."""
    w = 2 * np.pi * 60
    y, a, exact = 1e-4 * np.sin(w * T), -1e-4 * w**2 * np.sin(w * T), 1e-4 * w * np.cos(w * T)
    together = velocity(y[None], a[None], RATE)[0, INSIDE]
    alone = velocity(y[None], None, RATE)[0, INSIDE]
    assert np.max(np.abs(together - exact[INSIDE])) < 0.02 * np.max(exact)
    assert np.max(np.abs(alone)) < 0.2 * np.max(exact)
