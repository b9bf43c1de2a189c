"""Acceleration peaks of the 600 kg platform in heave and roll (50 Hz band)."""

import dataclasses

import numpy as np
import pytest

from hexsim import load_scenario, smoothness
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation import simulate

AXIS = {"heave": ("z", "m_s2"), "roll": ("roll", "rad_s2")}
DRY = {f"friction.{kind}_{way}_N": 0.0 for kind in ("coulomb", "static") for way in ("extend", "retract")}
NO_FRICTION = DRY | {f"friction.viscous_{way}_N_s_m": 0.0 for way in ("extend", "retract")}
QUIET = {"sensors.position_noise_m": 0.0, "sensors.position_resolution_m": 0.0}


def run(name, changes=None, duration=8.0):
    scenario = dataclasses.replace(load_scenario(name, duration_s=duration), figures_from_s=duration / 2)
    return simulate(changed(load_machine("micro_motion_system"), changes or {}), scenario, fast=True)


@pytest.fixture(scope="module", params=sorted(AXIS))
def overlaps(request):
    runs = {overlap: run(request.param, {"valve.overlap_m": overlap * 1e-6}) for overlap in (0, 5, 20)}
    return request.param, runs


def test_peaks_grow_with_overlap(overlaps):
    """Peak deviation grows with overlap 0 < 5 < 20 um, by at least 10 % a step."""
    name, runs = overlaps
    axis, unit = AXIS[name]
    peaks = [runs[k].summary["axes"][axis][f"peak_band_{unit}"] for k in (0, 5, 20)]
    assert peaks[1] > 1.1 * peaks[0]
    assert peaks[2] > 1.1 * peaks[1]


def test_parasitic_axes_are_reported_and_smaller(overlaps):
    """Every axis has its figures; what heave leaks into the others stays under a tenth of its own peak, roll under one."""
    name, runs = overlaps
    axes = runs[5].summary["axes"]
    assert set(axes) == {"x", "y", "z", "roll", "pitch", "yaw"}
    if name == "heave":
        others = [axes[a]["peak_band_m_s2"] for a in "xy"]
        assert 0 < max(others) < 0.1 * axes["z"]["peak_band_m_s2"]
    else:
        others = [axes[a]["peak_band_rad_s2"] for a in ("pitch", "yaw")]
        assert 0 < max(others) < axes["roll"]["peak_band_rad_s2"]


def test_top_peak_is_larger_in_heave():
    """In heave the peak at the top exceeds that at the bottom, as the report's measurement shows (4.2)."""
    log = run("heave").log
    time = log["time_s"].to_numpy()
    part = smoothness.harmonic_deviation(time, log["true_acceleration_z_m_s2"].to_numpy(), 0.5, start_s=4.0)
    height = np.interp(part.time_s, time, log["platform_z_m"].to_numpy())
    assert np.abs(part.band[height > 0.03]).max() > 1.1 * np.abs(part.band[height < -0.03]).max()


@pytest.mark.parametrize("name", sorted(AXIS))
def test_without_overlap_and_friction_a_balanced_machine_is_smooth(name):
    """Zero overlap, no friction, ideal sensors, load such that P1 = Ps/2: under 2 % of the fundamental is left."""
    changes = {"valve.overlap_m": 0.0, "load.platform_mass_kg": 247.0, **NO_FRICTION, **QUIET}
    figures = run(name, changes, duration=12.0)
    axis, unit = AXIS[name]
    pressure = figures.log["true_pressure_bottom_1_Pa"].mean()
    assert pressure == pytest.approx(3.5e6, rel=0.01)
    figures = figures.summary["axes"][axis]
    assert figures[f"peak_band_{unit}"] < 0.02 * figures[f"fundamental_{unit}"]


def test_what_600_kg_leave_is_the_valves_two_gains():
    """At 600 kg zero overlap and no friction leave 20 to 27 % in heave, because a three-way valve has two velocity gains.

    v = k+ u upwards, k- u downwards with k ~ sqrt(Ps - P1), sqrt(P1): at P1 = 40.7 bar 0.85 to 1. A P loop then turns at
    v = 0 from lag 1/(Kp k+) to 1/(Kp k-): the velocity has to step by a |1/k- - 1/k+| / Kp, at the loop's rate Kp k:
        peak = a k |1/k+ - 1/k-|
    An error of the law, not of valve or friction: 2 % as asked for would need P1 = Ps/2 (the test above).
    """
    log = run("heave", {"valve.overlap_m": 0.0, **NO_FRICTION, **QUIET}, duration=12.0)
    figures = log.summary["axes"]["z"]
    pressure = log.log["true_pressure_bottom_1_Pa"].mean()
    up, down = np.sqrt(7.0e6 - pressure), np.sqrt(pressure)
    mean = (up + down) / 2
    by_hand = figures["fundamental_m_s2"] * mean * abs(1 / up - 1 / down)
    # the estimate leaves out the oil's ringing on this step, which adds up to half of it
    assert by_hand < figures["peak_band_m_s2"] < 1.6 * by_hand
