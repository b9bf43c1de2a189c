"""A host that knows no future drives the tests' own leg through the motion computer's packets."""

from __future__ import annotations

import numpy as np
import pytest
from leg_plant import Leg, run, sine
from scipy.signal import butter, sosfiltfilt

import compensation
from compensation import started as warm_start
from hexsim.machine import load_machine
from hexsim.simulation import hosted


@pytest.mark.parametrize(("buffer_s", "limit"), [(0.0, 0.08), (0.02, 0.055)])
@pytest.mark.slow  # compensation without a preview is in test_undeclared.py, the host's path in motion_computer/test_host_prediction.py
def test_a_sine_of_rare_packets_is_compensated(buffer_s: float, limit: float) -> None:
    """60 packets a second, late by a fifth of a period, 2 % lost: the bump of 0.53 m/s2 falls to the limit from 14 s on."""

    def pose(time):
        return np.column_stack([(sine()(time) - 0.1) * (k == 2) for k in range(6)])

    host = hosted.Host(rate_Hz=60.0, jitter=0.2, loss=0.02, buffer_s=buffer_s, seed=11)
    wanted = hosted.played(load_machine("bench"), pose, host, 9000, 15)[:, 0]
    made = run(compensation.create("adaptive"), setpoint=lambda time: wanted[: len(time)], duration_s=17.9)
    assert made.peak(14.0, 17.8) <= limit


@pytest.mark.slow
@pytest.mark.parametrize("mass_kg", [40.0, 160.0])
def test_what_a_twin_taught_acts_from_the_first_motion(mass_kg: float) -> None:
    """Start parameters of 30 s with other noise: the peak of the second reversal is less than a third of plain control's, those of the
    last four less than a tenth."""
    adaptive, plain = compensation.create("adaptive"), compensation.create("none")
    taught = adaptive.parameters(run(adaptive, Leg(mass_kg=mass_kg), duration_s=30.0, seed=1).state)
    started, bare = (bumps(made, mass_kg) for made in (warm_start.Started(adaptive, taught), plain))
    assert started[0] < bare[0] / 3.0 and (started[1:] < bare[1:] / 10.0).all()


def bumps(made: compensation.Compensator, mass_kg: float) -> np.ndarray:
    """Half the swing between 3 and 50 Hz [m/s2] at the second reversal and the last four of 12 s."""
    acceleration = run(made, Leg(mass_kg=mass_kg), duration_s=12.0, seed=2).acceleration_m_s2
    band = sosfiltfilt(butter(4, [3.0, 50.0], btype="band", fs=1e4, output="sos"), acceleration)
    times = (1.563, 8.5, 9.5, 10.5, 11.5)
    return np.array([0.5 * np.ptp(band[round((t - 0.1) * 1e4) : round((t + 0.35) * 1e4)]) for t in times])
