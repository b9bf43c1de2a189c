"""Dependence of a residual: the signal that made it is found, in its form, and noise depends on nothing."""

import numpy as np
import pytest

from hexsim.tracing.dependence import dependence_of

RATE = 200.0
ORDER = ("velocity_m_s", "position_m", "time_s")


def motion(n=4000, seed=0):
    """A multisine motion of 20 s: signals and velocity."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    phases = rng.uniform(0, 2 * np.pi, 5)
    f = np.array([0.17, 0.43, 0.73, 1.1, 1.9])
    y = sum(0.02 / k * np.sin(2 * np.pi * k * t + p) for k, p in zip(f, phases, strict=True))
    v = np.gradient(y, 1 / RATE)
    return {"position_m": y, "velocity_m_s": v, "time_s": t}, v, rng.standard_normal(n)


def found_in(residual):
    signals, v, noise = motion()
    return dependence_of([residual(signals, v) + 0.1 * noise], [signals], [v], RATE, ORDER)


@pytest.mark.parametrize(
    ("signal", "form", "residual"),
    [
        ("velocity_m_s", "plain", lambda s, v: (v / np.std(v)) ** 3),
        ("position_m", "plain", lambda s, v: np.sin(40 * s["position_m"])),
        ("position_m", "product", lambda s, v: v / np.std(v) * s["position_m"] / np.std(s["position_m"])),
        ("position_m", "direction", lambda s, v: np.sign(v) * np.exp(-((s["position_m"] / 0.06) ** 2))),
        ("time_s", "product", lambda s, v: v / np.std(v) * (s["time_s"] / 10 - 1)),
    ],
)
def test_the_signal_that_made_it(signal, form, residual):
    """A residual made from one signal in one form is traced to both, with R^2 on unseen blocks above 0.8."""
    dependence = found_in(residual)
    assert (dependence.signal, dependence.form) == (signal, form)
    assert dependence.r2_cv > 0.8


def test_noise_depends_on_nothing():
    """White noise has no R^2 on unseen blocks above 0.02, whatever the signal."""
    dependence = found_in(lambda s, v: 0.0 * v)
    assert max(dependence.table.values()) < 0.02


def test_an_outside_line_is_a_frequency():
    """A line at 23 Hz that the motion does not have is reported as an outside source at 23 Hz within 0.1 %."""
    dependence = found_in(lambda s, v: np.sin(2 * np.pi * 23.0 * s["time_s"] + 0.3))
    assert dependence.signal == "time" and dependence.form == "tone"
    assert dependence.frequency_Hz == pytest.approx(23.0, rel=1e-3)
