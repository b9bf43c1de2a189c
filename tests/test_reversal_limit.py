"""What of friction's reversal the valve cannot keep from the load: the formula at characteristic points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks import reversal_limit

LEG = {"step_m_s2": 4.6, "resonance_Hz": 109.0, "damping_ratio": 0.04}
T = np.arange(-0.01, 0.05, 1e-5)


def test_oil_that_comes_as_friction_goes_leaves_nothing() -> None:
    """Delivered within friction's own reversal, at once: no acceleration, to 1e-12 m/s2."""
    assert np.abs(reversal_limit.acceleration(T, **LEG, delivery_s=8e-4, friction_s=8e-4)).max() < 1e-12


@pytest.mark.parametrize("late_s", [1e-3, -1e-3])
@pytest.mark.parametrize("step_m_s2", [4.6, -4.6])
def test_late_oil_leaves_the_force_and_then_an_oscillation(late_s: float, step_m_s2: float) -> None:
    """Sharp, without damping, a millisecond late or early: the whole step at once, against friction where the oil comes too
    late; then an oscillation of 2 S sin(w |late|/2)."""
    a = reversal_limit.acceleration(
        T, step_m_s2=step_m_s2, resonance_Hz=60.0, damping_ratio=0.0, delivery_s=2e-6, friction_s=2e-6, late_s=late_s
    )
    first = a[np.argmax(np.abs(a) > 1e-6) + 2]
    assert first == pytest.approx(-step_m_s2 * math.copysign(1.0, late_s), rel=1e-2)
    size = 2 * abs(step_m_s2) * math.sin(math.pi * 60.0 * 1e-3)
    assert np.abs(a[T > 2e-3]).max() == pytest.approx(size, rel=1e-3)


def test_it_is_the_motion_of_the_load_on_the_oil() -> None:
    """Balance: a + 2 zeta w v + w^2 x is the oil's force less friction, over the mass, to 0.1 % of the step."""
    w, zeta = 2 * math.pi * LEG["resonance_Hz"], LEG["damping_ratio"]
    a = reversal_limit.acceleration(T, **LEG, delivery_s=4e-3, friction_s=8e-4, late_s=1e-3)
    v = np.cumsum(a) * 1e-5 - 0.5e-5 * a
    x = np.cumsum(v) * 1e-5
    force = 4.6 * (np.interp(T - 1e-3, [-2e-3, 2e-3], [0, 1]) - np.interp(T, [-4e-4, 4e-4], [0, 1]))
    assert np.abs(a + 2 * zeta * w * v + w * w * x - force).max() < 0.02


def test_a_soft_slow_load_feels_half_the_step() -> None:
    """Far below the resonance's period the peak is S/2 (1 - friction/delivery), of either sign, within 1 %."""
    a = reversal_limit.acceleration(
        T, step_m_s2=2.0, resonance_Hz=1.0, damping_ratio=0.1, delivery_s=4e-3, friction_s=1e-3
    )
    assert a.max() == pytest.approx(0.75, rel=0.01) and a.min() == pytest.approx(-0.75, rel=0.01)


def test_the_spool_needs_two_ticks_or_its_range() -> None:
    """60 Hz over 0.09 V of 10 V: 4 ms, two ticks of 2 ms. 5 Hz: 2 sqrt(0.009)/w = 6 ms."""
    assert reversal_limit.delivery_s(2e-3, 60.0, 0.09, 10.0) == 4e-3
    assert reversal_limit.delivery_s(2e-3, 5.0, 0.09, 10.0) == pytest.approx(2 * math.sqrt(0.009) / (10 * math.pi))


def test_late_and_soft_oil_cost_most() -> None:
    """In 50 Hz: a millisecond late is five times as much as in time, half the stiffness doubles it; late and early cost
    the same within 10 %, and the sign of the step is no matter."""
    moving = {**LEG, "delivery_s": 4e-3, "friction_s": 8e-4}
    in_time, late, early = (reversal_limit.peak_in_band(**moving, late_s=s) for s in (0.0, 1e-3, -1e-3))
    assert 4.0 < late / in_time < 6.0 and early == pytest.approx(late, rel=0.1)
    soft = reversal_limit.peak_in_band(**{**moving, "resonance_Hz": 109.0 / math.sqrt(2.0)})
    assert 1.8 < soft / in_time < 4.0
    assert reversal_limit.peak_in_band(**{**moving, "step_m_s2": -4.6}) == pytest.approx(in_time, rel=1e-9)
