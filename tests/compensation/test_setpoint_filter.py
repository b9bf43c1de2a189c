"""A controller's setpoint filter is not felt once a compensator feeds forward."""

from __future__ import annotations

import math

import numpy as np
import pytest

from compensation import Compensator, Context, Sample
from hexsim import smoothness
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.scenarios import scenario_from_dict
from hexsim.simulation import simulate

FILTER_Hz = 14.55  # of the shipped tuned machine
DELAY_S = math.sqrt(2.0) / (2.0 * math.pi * FILTER_Hz)  # of a Butterworth filter of second order, at low frequencies


class Kept(Compensator):
    """Adds nothing and keeps the samples."""

    name, preview_s = "kept", 0.01

    def start(self, context: Context) -> list[Sample]:
        return []

    def step(self, state: list[Sample], sample: Sample) -> tuple[float, list[Sample]]:
        state.append(sample)
        return 0.0, state

    def parameters(self, state: list[Sample]) -> dict:
        return {}

    def restore(self, context: Context, parameters: dict) -> list[Sample]:
        return []


@pytest.fixture(scope="module")
def filtered():
    """A bench that feeds the velocity forward, behind the filter."""
    keys = {"setpoint_filter_Hz": FILTER_Hz, "velocity_feed_forward_V_s_per_m": 6.4}
    return changed(load_machine("bench"), {f"controller.{key}": value for key, value in keys.items()})


def test_a_compensator_is_given_setpoints_before_the_filter(filtered) -> None:
    """Its preview is what was asked for; `setpoint_m`, from which the controller's volts come, is behind the filter: of a
    ramp of 0.1 m/s 1.5 mm late."""
    loop, ramp = PositionLoop(filtered, [Kept()], None), 0.05 + 0.1 * 0.002 * np.arange(206.0)
    for k in range(200):
        loop.tick(0.002 * k, ramp[k : k + 6, None], np.array([0.1]), np.array([3.5e6]), 7e6)
    last = loop.states[0][-1]
    assert np.array_equal(last.preview_m, ramp[199:205])
    assert last.preview_m[0] - last.setpoint_m == pytest.approx(0.1 * DELAY_S, rel=0.01)
    volts = filtered.controller.gain_V_per_m * (last.setpoint_m - last.position_m) + last.feed_forward_V
    assert last.control_V == pytest.approx(volts, rel=1e-12)


@pytest.fixture(scope="module")
def heaves(filtered):
    """Half a hertz, 0.05 m, 16 s: the log by the compensator's name."""
    axes = {"z": {"kind": "sine", "amplitude": 0.05, "frequency_Hz": 0.5}}
    heave = scenario_from_dict({"name": "heave", "mode": "dof", "duration_s": 16.0, "fade_s": 2.0, "axes": axes})
    return {name: simulate(filtered, heave, compensator=name).log for name in ("none", "adaptive", "repetitive")}


@pytest.mark.parametrize(
    ("algorithm", "at_least_s", "at_most_s"),
    [("none", DELAY_S, math.inf), ("adaptive", -0.001, 0.001), ("repetitive", -0.001, 0.001)],
)
def test_the_filters_delay_is_not_felt(heaves, algorithm: str, at_least_s: float, at_most_s: float) -> None:
    """Plain control comes later than its filter, a compensated piston within half a tick of 2 ms; and
    what `repetitive` learns from period to period does not bring the filter's delay back."""
    time, piston, asked = (heaves[algorithm][name].to_numpy() for name in ("time_s", "position_m", "setpoint_m"))
    late = time > 12.0
    assert at_least_s < smoothness.response_delay_s(time[late], piston[late], asked[late]) < at_most_s


def test_volts_come_in_and_the_lag_goes_without_a_jolt(heaves) -> None:
    """The filter and the feed-forward are no part of the compensator's model of the loop: it measures what they make plain control
    lag by. The first reversal, made with what plain control has shown of the valve, is at most a fifth worse than plain control's; from
    the second period after it on a tenth is left."""
    bumps = {}
    for name in ("none", "adaptive"):
        time, felt = (heaves[name][column].to_numpy() for column in ("time_s", "true_acceleration_m_s2"))
        felt = smoothness.band_limit(time, felt)
        bumps[name] = np.array([bump(time, felt, start) for start in range(2, 16, 2)])
    assert bumps["adaptive"].max() < 1.2 * bumps["none"].max()
    assert bumps["adaptive"][3:].max() < 0.1 * bumps["none"].min()


def bump(time: np.ndarray, felt: np.ndarray, start_s: float) -> float:
    """Largest deviation from the fundamental in a period of 2 s."""
    inside = (time >= start_s) & (time < start_s + 2.0)
    phase = math.pi * time[inside]
    waves = np.stack([np.sin(phase), np.cos(phase), np.ones_like(phase)], axis=1)
    return float(np.abs(felt[inside] - waves @ np.linalg.lstsq(waves, felt[inside], rcond=None)[0]).max())
