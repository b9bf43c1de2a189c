"""Small equations beneath the algorithms: the spool, the controller's own feedback, least squares, the damping's filter."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from compensation import Context, damping_design, least_squares, loop_feedback, records, spool_model

TICK_S, SPOOL_S, DAMPING, LOW_Hz, HIGH_Hz, TAPS = 2e-3, 3.7e-3, 0.7, 15.0, 65.0, 7
DESIGN = records.record(damping_count="i8", damping_low_Hz="f8", damping_high_Hz="f8", spool_damping="f8", tick_s="f8")
FED_BACK = (
    "velocity_gain_V_s_per_m", "velocity_pole", "velocity_share", "pressure_gain_V_per_Pa", "pressure_pole", "pressure_share"
)  # fmt: skip


def taps_of(delay_s: float, resonance_Hz: float = 0.0, viscous: float = 0.0, spool_s: float = SPOOL_S) -> np.ndarray:
    """Taps for a spool of such a lag behind a delay; viscous: b/m over the damping's rate."""
    settings, taps = records.empty(DESIGN), np.zeros(TAPS)
    settings.damping_count, settings.tick_s, settings.spool_damping = TAPS, TICK_S, DAMPING
    settings.damping_low_Hz, settings.damping_high_Hz = LOW_Hz, HIGH_Hz
    damping_design.damping_filter(
        records.empty(damping_design.WORK), taps, spool_s + delay_s, delay_s, (resonance_Hz, viscous), settings
    )
    return taps


def through(taps: np.ndarray, f_Hz: np.ndarray, delay_s: float, spool_s: float = SPOOL_S) -> Any:
    """Complex flow for a pressure oscillation of 1, written apart: taps, hold, spool and delay."""
    w = 2 * np.pi * f_Hz
    spool = 1 / (1 + 1j * w * spool_s - (w * spool_s / (2 * DAMPING)) ** 2)
    valve = spool * np.exp(-1j * w * (0.5 * TICK_S + delay_s)) * np.sinc(TICK_S * f_Hz)
    return valve * (np.exp(-1j * TICK_S * np.outer(w, np.arange(TAPS))) @ taps)


@pytest.mark.parametrize("spool_s", [0.0, 2e-3, 3.7e-3])
def test_damping_opposes_the_pressure_between_20_and_60_hz(spool_s) -> None:
    """Taps, hold and spool together have a phase within 50 degrees of the pressure there, and pass nothing at rest."""
    taps = taps_of(0.0, spool_s=spool_s)
    assert taps.sum() == pytest.approx(0.0, abs=1e-12)
    flow = through(taps, np.linspace(20, 60, 9), 0.0, spool_s)
    assert np.abs(np.angle(flow, deg=True)).max() < 50 and np.abs(flow).min() > 0.5


@pytest.mark.parametrize("delay_s", [0.0, 2e-3, 6e-3])
def test_damping_gives_way_where_it_would_feed_the_oscillation(delay_s) -> None:
    """At no frequency from 15 to 250 Hz does the flow follow the pressure by more than the bound."""
    share = through(taps_of(delay_s), np.linspace(15, 250, 60), delay_s).real
    assert -share.min() <= 1.05 * damping_design.DESIGN.most_wrong  # the bound holds on a grid of its own


@pytest.mark.parametrize("resonance_Hz", [55.0, 70.0, 110.0])
@pytest.mark.parametrize("delay_s", [0.0, 2e-3, 4e-3, 6e-3])
def test_damping_feeds_no_mode_of_the_load(resonance_Hz, delay_s) -> None:
    """Where a mode of the load may lie it takes away at most half of what viscous friction damps (here 0.4 of the damping's rate at
    110 Hz, less at a heavier load), and it damps the resonance itself; of a light load no band from 10 to 80 Hz is fed by more
    than 0.2."""
    viscous = 0.4 * (resonance_Hz / 110.0) ** 2
    taps, f = taps_of(delay_s, resonance_Hz, viscous), resonance_Hz * np.linspace(0.72, 1.48, 50)
    assert (-through(taps, f, delay_s).real <= 0.55 * viscous * (f / resonance_Hz) ** 2).all()
    assert through(taps, np.array([resonance_Hz]), delay_s).real[0] > 0.1
    assert resonance_Hz < 110.0 or through(taps, np.linspace(10.0, 80.0, 71), delay_s).real.min() > -0.2


def test_the_share_that_the_design_reckons_is_that_of_the_taps() -> None:
    """`damped_share` is the real part of the flow, to 1e-9, for a valve with 3 ms of delay."""
    taps, f = taps_of(3e-3, 60.0, 0.2), np.linspace(5.0, 240.0, 48)
    valve = TICK_S, SPOOL_S + 3e-3, 3e-3, DAMPING
    found = [damping_design.damped_share(taps, TAPS, float(one), valve) for one in f]
    assert np.abs(found - through(taps, f, 3e-3).real).max() < 1e-9


def test_least_squares_is_the_solution_of_all_rows_at_once() -> None:
    """Rows rotated into a triangle one by one give the solution of numpy's lstsq, to 1e-12, with rows of weights from 1e-2 to 1e3
    among them."""
    rng, work, found = np.random.default_rng(0), records.empty(damping_design.WORK), np.zeros(7)
    rows = rng.normal(size=(200, 8)) * 10.0 ** rng.uniform(-2, 3, (200, 1))
    least_squares.start_least_squares(work, 7)
    for row in rows:
        work.row[:8] = row
        least_squares.add_row(work, 7)
    least_squares.solve(work, 7, found)
    assert np.abs(found - np.linalg.lstsq(rows[:, :7], rows[:, 7], rcond=None)[0]).max() < 1e-12


def test_feedback_in_the_motion_asked_for_is_that_of_a_known_motion() -> None:
    """A ramp of 0.1 m/s and a pressure step of 0.2 MPa: K_d 0.1 m/s once the filter is in, and K_p 0.2 MPa that falls with the
    high-pass's time constant."""
    context = Context(velocity_gain_V_s_per_m=0.6, pressure_gain_V_per_Pa=6e-8)
    loop, settings = (
        records.empty(loop_feedback.LOOP),
        records.empty(records.record(**{name: "f8" for name in FED_BACK})),
    )
    for name in FED_BACK:
        settings[name] = getattr(context, name)
    volts = [loop_feedback.fed_back_V(loop, settings, 0.1 + 0.1 * k / 500, 2e5 * (k >= 250)) for k in range(331)]
    assert volts[249] == pytest.approx(0.06, rel=1e-6)
    assert volts[250] - 0.06 == pytest.approx(0.012, rel=0.01)
    assert volts[330] - 0.06 == pytest.approx(0.012 * math.exp(-2 * math.pi * 0.16), rel=0.02)


@pytest.mark.parametrize("damping", [0.3, 0.999999999, 1.0, 1.000000001, 1.4, 30.0])
def test_the_spool_is_that_of_its_equation(damping: float) -> None:
    """x'' + 2 zeta w x' + w^2 x = 0 from c = 1, s = 0: s' = c - zeta w s and c' = -zeta w c - w^2 (1 - zeta^2) s by central
    differences, under and over critical damping and next to it."""
    w, h = 2 * math.pi * 60.0, 1e-7
    for t in (1e-4, 2e-3, 8e-3):
        (c0, s0), (c, s), (c1, s1) = (np.array(spool_model.free_motion(damping, w, t + d)) for d in (-h, 0.0, h))
        scale = 1.0 + damping
        assert (s1 - s0) / (2 * h) == pytest.approx(c - damping * w * s, abs=1e-5 * scale)
        assert (c1 - c0) / (2 * h * w) == pytest.approx(-damping * c - w * (1 - damping**2) * s, abs=1e-5 * scale**2)
