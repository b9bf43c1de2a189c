"""Pictures of `hexsim trace --explain` show what their effect is known by."""

import numpy as np
import pytest

from hexsim.tracing.signature import drawn, signature


@pytest.mark.parametrize(
    ("name", "period", "words"),
    [
        ("position_ripple", 1e-3, "position within a period of 1 mm"),
        ("outside_force_tone", 1.0 / 17.0, "time within a period of 0.0588 s"),
    ],
)
def test_a_wave_is_shown_over_one_of_its_periods(name, period, words):
    """The first harmonic over the axis takes most of the residual: over the stroke a hundred periods are a cloud."""
    found = signature(name)
    assert found.period == pytest.approx(period) and np.all((found.x >= 0.0) & (found.x < period))
    waves = [np.exp(2j * np.pi * found.x / period), np.exp(-2j * np.pi * found.x / period)]
    amplitude = np.linalg.lstsq(np.stack(waves, axis=1), found.residual.astype(complex), rcond=None)[0]
    left = found.residual - (np.stack(waves, axis=1) @ amplitude).real
    assert np.var(left) < 0.2 * np.var(found.residual)
    assert words in drawn(found)[-1]


def test_what_settles_is_shown_over_time_and_inertia_where_it_acts():
    """Friction that warms up: larger in the first third of the time than in the last. Inertia: moments of the platform."""
    warm = signature("friction_warm_up")
    assert warm.signal == "time_s"
    first, _, last = np.array_split(np.abs(warm.residual), 3)
    assert first.mean() > 1.3 * last.mean()
    assert signature("inertia_change").balance.name == "platform"
