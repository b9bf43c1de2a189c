"""Dependence of a residual: the signal that made it is found, in its form, and noise depends on nothing."""

import numpy as np
import pytest

from hexsim.tracing import dependence as dependences

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


def found_in(residual, columns=None):
    signals, v, noise = motion()
    own = None if columns is None else {key: [column(signals, v)[:, None]] for key, column in columns.items()}
    return dependences.dependence_of([residual(signals, v) + 0.1 * noise], [signals], [v], RATE, ORDER, own)


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


def test_a_memory_is_told_from_the_speed_of_the_moment():
    """Friction that grows with the mean speed of the last 0.4 s is a memory of the velocity, with that time constant."""

    def residual(s, v):
        lately, past = np.zeros(len(v)), abs(v[0])
        for i, now in enumerate(np.abs(v)):
            past += (now - past) / (0.4 * RATE)
            lately[i] = past
        return np.sign(v) * lately / np.std(lately)

    dependence = found_in(residual)
    assert (dependence.signal, dependence.form, dependence.memory_s) == ("velocity_m_s", "memory", 0.4)


def test_a_channel_that_comes_late_is_named_only_when_its_own_column_fits():
    """A residual in proportion to what lateness of the position would do is "late" in the position; a plain curve stays plain."""
    columns = {("position_m", "late"): lambda s, v: np.sign(v) * np.sqrt(np.abs(v)) * np.cos(3 * s["time_s"])}
    late = found_in(lambda s, v: 3.0 * columns["position_m", "late"](s, v) / np.std(v), columns)
    assert (late.signal, late.form) == ("position_m", "late") and late.r2_cv > 0.8 and len(late.curve) == 0
    plain = found_in(lambda s, v: (v / np.std(v)) ** 3, columns)
    assert (plain.signal, plain.form) == ("velocity_m_s", "plain")


def test_a_rest_of_either_sign_is_traced_by_its_size():
    """A random rest whose spread grows with |v| follows no signal; its size does, and says so."""
    dependence = found_in(lambda s, v: np.random.default_rng(5).standard_normal(len(v)) * (v / np.std(v)) ** 2)
    assert (dependence.signal, dependence.form) == ("velocity_m_s", "size")
    assert max(dependence.table.values()) < 0.1 < dependence.r2_cv


def test_noise_depends_on_nothing():
    """White noise has no R^2 on unseen blocks above 0.02, whatever the signal."""
    dependence = found_in(lambda s, v: 0.0 * v)
    assert max(dependence.table.values()) < 0.02


def test_an_outside_line_is_a_frequency():
    """A line at 23 Hz that the motion does not have is reported as an outside source at 23 Hz within 0.1 %."""
    dependence = found_in(lambda s, v: np.sin(2 * np.pi * 23.0 * s["time_s"] + 0.3))
    assert dependence.signal == "time" and dependence.form == "tone"
    assert dependence.frequency_Hz == pytest.approx(23.0, rel=1e-3)
