"""A run says when a position loop swings by itself."""

from __future__ import annotations

import numpy as np
import pytest

from hexsim import load_scenario
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation import run_warnings, simulate

BENCH = load_machine("bench")
TIME = np.arange(0.0, 3.0, 1.0 / BENCH.controller.rate_Hz)
SETPOINT = 0.1 + 0.05 * np.sin(2.0 * np.pi * 0.5 * TIME)
FOLLOWS = np.gradient(SETPOINT, TIME) / 0.15


def said(volts: np.ndarray, setpoint: np.ndarray = SETPOINT) -> list[str]:
    return run_warnings.swing_warnings(BENCH, volts[:, None], setpoint[:, None])


def test_a_loop_with_too_much_gain_is_named() -> None:
    """The bench with a gain at which its oil column is unstable says so, with its leg; with its own gain it does not."""
    scenario = load_scenario("heave", duration_s=3.0)
    wild, calm = (
        simulate(machine, scenario).warnings for machine in (changed(BENCH, {"controller.gain_V_per_m": 3000.0}), BENCH)
    )
    assert [text for text in wild if text.startswith("position loop of leg 1: swings by itself")]
    assert not [text for text in calm if "swings" in text]


def test_frequency_and_beginning_are_those_of_the_swing() -> None:
    """A swing of 20 Hz from 1.5 s on: 20 Hz within 2, not before 1.2 s; a smaller one than a third of the volts is not said."""
    swing = np.sin(2.0 * np.pi * 20.0 * TIME) * (TIME > 1.5)
    (text,) = said(FOLLOWS + 3.0 * swing)
    words = text.split()
    assert float(words[words.index("Hz,") - 1]) == pytest.approx(20.0, abs=2.0)
    assert float(words[words.index("from") + 1]) > 1.2
    assert said(FOLLOWS + 0.05 * swing) == []


def test_what_is_asked_for_is_no_swing() -> None:
    """A setpoint of 20 Hz, edges of an overlap at each reversal, noise of the sensor at rest, a run shorter than a window: nothing."""
    fast = 0.1 + 1e-3 * np.sin(2.0 * np.pi * 20.0 * TIME)
    assert said(np.gradient(fast, TIME) / 0.15, fast) == []
    assert said(FOLLOWS + 0.3 * np.sign(FOLLOWS)) == []
    noise = 3e-6 * BENCH.controller.gain_V_per_m * np.random.default_rng(1).standard_normal(len(TIME))
    assert said(noise, np.full(len(TIME), 0.1)) == []
    assert said(FOLLOWS[:100], SETPOINT[:100]) == []
