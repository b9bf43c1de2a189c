"""Pictures of `hexsim trace --explain` show what their effect is known by."""

import numpy as np
import pytest

from hexsim.hydraulics import effects
from hexsim.tracing import signature as signatures


@pytest.mark.parametrize(
    ("name", "period", "words"),
    [
        ("position_ripple", 1e-3, "position within a period of 1 mm"),
        ("outside_force_tone", 1.0 / 17.0, "time within a period of 0.0588 s"),
    ],
)
def test_a_wave_is_shown_over_one_of_its_periods(name, period, words):
    """The first harmonic over the axis takes most of the residual: over the stroke a hundred periods are a cloud."""
    found = signatures.signature(name)
    assert found.period == pytest.approx(period) and np.all((found.x >= 0.0) & (found.x < period))
    waves = [np.exp(2j * np.pi * found.x / period), np.exp(-2j * np.pi * found.x / period)]
    amplitude = np.linalg.lstsq(np.stack(waves, axis=1), found.residual.astype(complex), rcond=None)[0]
    left = found.residual - (np.stack(waves, axis=1) @ amplitude).real
    assert np.var(left) < 0.2 * np.var(found.residual)
    assert words in signatures.drawn(found)[-1]


def test_what_settles_is_shown_over_time_and_inertia_where_it_acts():
    """Friction that warms up: larger in the first third of the time than in the last. Inertia: moments of the platform."""
    warm = signatures.signature("friction_warm_up")
    assert warm.signal == "time_s"
    first, _, last = np.array_split(np.abs(warm.residual), 3)
    assert first.mean() > 1.3 * last.mean()
    assert signatures.signature("inertia_change").balance.name == "platform"


def test_a_payload_on_a_spring_is_shown_over_the_frequency_of_a_sweep():
    """The residual swings most within 5 % of the payload's own frequency, where the picture has a line, five times as far as a third
    of that below: a resonance of damping 0.05 answers 0.4 s late, in which the sweep goes on by 2 %, and peaks 0.25 % below."""
    found = signatures.signature("flexible_payload")
    assert found.signal == "frequency_Hz"
    own = found.values["frequency_Hz"]
    assert found.x[np.argmax(np.abs(found.residual))] == pytest.approx(own, rel=0.05)
    at_rest, swinging = (np.abs(found.residual[np.abs(found.x / f - 1.0) < 0.15]).max() for f in (own / 3.0, own))
    assert swinging > 5.0 * at_rest
    marked = [line for line in signatures.picture(found).axes[0].lines if f"{own:g} Hz" in str(line.get_label())]
    assert [list(line.get_xdata()) for line in marked] == [[own, own]]


def test_inertia_is_a_line_through_zero():
    """Its moment over the acceleration: the slope is the inertia that was added, within a tenth (turning about the other axes adds to
    it), and of the residual's variance the line leaves less than a tenth. Jolts where legs turn would leave most."""
    found = signatures.signature("inertia_change")
    axis = found.signal.split("_")[2]
    slope = float(found.x @ found.residual / (found.x @ found.x))
    assert slope == pytest.approx(found.values[f"{axis}_kg_m2"], rel=0.1)
    assert np.var(found.residual - slope * found.x) < 0.1 * np.var(found.residual)


@pytest.mark.parametrize("name", ["base_joint_offset", "position_offset"])
def test_what_does_nothing_in_all_legs_alike_is_shown_in_one(name):
    """All base joints shifted alike move the machine and nothing in it: leg 1 alone leaves a residual that its motion explains, or
    a constant one, three times what sampling leaves at least."""
    found = signatures.signature(name)
    constant = abs(found.residual.mean()) > 3.0 * found.residual.std()
    over_motion = found.residual[np.argsort(found.x)]
    curve = np.convolve(over_motion, np.ones(101) / 101.0, "valid")
    assert constant or np.var(over_motion[50:-50] - curve) < 0.5 * np.var(over_motion)
    assert signatures.rms(found.residual) > 3.0 * signatures.rms(found.without)


def test_a_relief_valve_leaves_nothing_below_its_opening_pressure():
    """From the opening pressure on the residual is the conductance times what is above it, within a twentieth; below nothing."""
    found = signatures.signature("relief_flow")
    above = found.x - found.values["opening_pressure_Pa"]
    flow = found.values["conductance_m3_s_Pa"] * above.max()
    open_, shut = above > 0.5 * above.max(), above < -0.2 * above.max()
    assert np.median(found.residual[open_] / above[open_]) == pytest.approx(
        found.values["conductance_m3_s_Pa"], rel=0.05
    )
    assert np.median(np.abs(found.residual[shut])) < 0.1 * flow


def test_a_moment_of_a_platform_is_in_newton_metres():
    """The pitch row of the platform's balance, whose forces are in newtons."""
    found = signatures.signature("inertia_change")
    assert (found.where, signatures.unit_of(found)) == ("platform pitch", "N m")


@pytest.mark.slow
def test_every_effect_has_a_picture_that_shows_it():
    """Three tenths of the samples lie at least half as far again from zero as without the effect: jolts where legs turn, which
    sampling leaves with it and without, are fewer."""
    for name, effect in effects.library().items():
        if effect.parameters:
            found = signatures.signature(name)
            far, usual = (np.quantile(np.abs(rows), 0.7) for rows in (found.residual, found.without))
            assert far > 1.5 * usual, name
