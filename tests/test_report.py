"""The figures of report DCT 2005.79, chapter 3: one leg, 40 kg, 0.05 m at 0.5 Hz, Kp every 0.1 ms.

Expected values come from an independent calculation converged in step size (shared report/ERRATA.md), unchanged to 0.5 %
down to steps of 2 us; they hold within 2 %.
"""

import dataclasses

import numpy as np
import pytest
from scipy.signal import find_peaks

from hexsim import load_scenario
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation import simulate

CASES = {
    "overlap": ({}, 0.731, 0.449, (31.0, 37.0)),
    "quadratic": ({"valve.flow_area": "quadratic"}, 0.438, 0.439, (30.8, 37.2)),
    "zero lap": ({"valve.overlap_m": 0.0}, 0.052, 0.453, (31.0, 37.0)),
}


@pytest.fixture(scope="module")
def runs():
    scenario = dataclasses.replace(load_scenario("report", duration_s=12.0), figures_from_s=6.0)
    return {name: simulate(changed(load_machine("bench"), case[0]), scenario) for name, case in CASES.items()}


def settled(run):
    return run.log.filter(run.log["time_s"] >= 6.0)


@pytest.mark.parametrize("name", CASES)
def test_peak_deviation_from_the_basic_harmonic(runs, name):
    """Peaks of 0.731 (overlap), 0.438 (quadratic), 0.052 m/s2 (zero lap), no band limit, within 2 %."""
    assert runs[name].summary["axes"]["leg"]["peak_raw_m_s2"] == pytest.approx(CASES[name][1], rel=0.02)


@pytest.mark.parametrize("name", CASES)
def test_basic_harmonic(runs, name):
    """Basic harmonic 0.449, 0.439, 0.453 m/s2 within 2 %."""
    assert runs[name].summary["axes"]["leg"]["fundamental_m_s2"] == pytest.approx(CASES[name][2], rel=0.02)


@pytest.mark.parametrize("name", CASES)
def test_bottom_pressure_range(runs, name):
    """P1 between 31.0 and 37.0 bar (quadratic 30.8 and 37.2), within 0.1 bar of rounding."""
    pressure = settled(runs[name])["true_pressure_bottom_Pa"] / 1e5
    assert pressure.min() == pytest.approx(CASES[name][3][0], abs=0.1)
    assert pressure.max() == pytest.approx(CASES[name][3][1], abs=0.1)


def spectrum(run):
    log = settled(run)
    acceleration = log["true_acceleration_m_s2"].to_numpy()
    step = log["time_s"][1] - log["time_s"][0]
    amplitude = np.abs(np.fft.rfft(acceleration * np.hanning(len(acceleration)))) * 4 / len(acceleration)
    return np.fft.rfftfreq(len(acceleration), step), amplitude


def test_eigenfrequency_in_the_spectrum(runs):
    """109 Hz = sqrt(2 E A1/(M Ls))/2 pi rings with the sharp overlap law and is absent with the quadratic one (Fig. 3.6, 3.9)."""
    frequency, sharp = spectrum(runs["overlap"])
    _, smooth = spectrum(runs["quadratic"])
    above = frequency > 70  # below stand the harmonics of the motion
    peak = frequency[above][np.argmax(sharp[above])]
    # the volume at the reversals is that of y = 0.05 .. 0.15 m, so the frequency lies about 109 Hz by sqrt(0.1/y)
    assert 109.4 * np.sqrt(0.1 / 0.151) < peak < 109.4 * np.sqrt(0.1 / 0.0495)
    assert smooth[above].max() < 0.05 * sharp[above].max()


def test_two_peaks_a_reversal(runs):
    """With the quadratic law each reversal shows two peaks of opposite sense (Fig. 3.9)."""
    log = settled(runs["quadratic"])
    time, acceleration = log["time_s"].to_numpy(), log["true_acceleration_m_s2"].to_numpy()
    omega = np.pi
    basis = np.column_stack([np.ones_like(time), np.sin(omega * time), np.cos(omega * time)])
    deviation = acceleration - basis @ np.linalg.lstsq(basis, acceleration, rcond=None)[0]
    velocity = log["velocity_m_s"].to_numpy()
    crossings = time[1:][np.diff(np.sign(velocity)) != 0]
    groups = np.split(crossings, np.where(np.diff(crossings) > 0.3)[0] + 1)
    reversals = [g.mean() for g in groups if 6.4 < g.mean() < 11.6]
    assert len(reversals) >= 5
    for reversal in reversals:
        window = np.abs(time - reversal) < 0.25
        part = deviation[window]
        up = find_peaks(part, prominence=0.1)[0]
        down = find_peaks(-part, prominence=0.1)[0]
        assert len(up) >= 1 and len(down) >= 1


def test_dead_band_of_the_flow_curve(runs):
    """No flow within +-45 mV of valve volts, flow beyond (Fig. 3.5): overlap 5 um of 1.1 mm at 10 V."""
    log = settled(runs["overlap"])
    volts, flow = log["valve_V"].to_numpy(), log["flow_m3_s"].to_numpy()
    dead = 10.0 * 5e-6 / 1.1e-3
    assert dead == pytest.approx(0.0455, abs=1e-4)
    assert np.all(flow[np.abs(volts) < 0.999 * dead] == 0.0)
    assert np.all(np.sign(flow[np.abs(volts) > 1.001 * dead]) == np.sign(volts[np.abs(volts) > 1.001 * dead]))


@pytest.mark.slow  # the chosen step's error is in plant/test_step_error.py
def test_peak_is_converged_in_step_size(runs):
    """Half the time step changes the peak by less than 0.5 %: the figure is the model's, not the integrator's."""
    scenario = dataclasses.replace(load_scenario("report", duration_s=12.0), figures_from_s=6.0)
    finer = simulate(load_machine("bench"), scenario, timestep=5e-5)
    peak = runs["overlap"].summary["axes"]["leg"]["peak_raw_m_s2"]
    assert finer.summary["axes"]["leg"]["peak_raw_m_s2"] == pytest.approx(peak, rel=0.005)
