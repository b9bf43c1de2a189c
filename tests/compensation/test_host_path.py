"""A host that knows no future drives the tests' own leg through the motion computer's packets."""

from __future__ import annotations

import numpy as np
import pytest
from leg_plant import run, sine

import compensation
from hexsim.machine import load_machine
from hexsim.simulation.hosted import Host, played


@pytest.mark.parametrize(("buffer_s", "limit"), [(0.0, 0.06), (0.02, 0.05)])
def test_a_sine_of_rare_packets_is_compensated(buffer_s: float, limit: float) -> None:
    """60 packets a second, late by a fifth of a period, 2 % lost: the bump of 0.48 m/s2 falls to the issue's limit."""

    def pose(time):
        return np.column_stack([(sine()(time) - 0.1) * (k == 2) for k in range(6)])

    host = Host(rate_Hz=60.0, jitter=0.2, loss=0.02, buffer_s=buffer_s, seed=11)
    wanted = played(load_machine("bench"), pose, host, 9000, 15)[:, 0]
    made = run(compensation.create("adaptive"), setpoint=lambda time: wanted[: len(time)], duration_s=17.9)
    assert made.peak(12.0, 17.8) <= limit
