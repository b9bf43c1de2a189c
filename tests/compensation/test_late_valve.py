"""A four-way valve with some ticks of delay: its windows, and that compensation stays. No code of hexsim."""

from __future__ import annotations

import numpy as np
import pytest
from leg_plant import sine
from pair_plant import PairLeg, run_pair

from compensation import create
from compensation.adaptive.spool import mean_over_lag


def test_what_a_delay_has_not_let_through_is_the_mean_over_it() -> None:
    """Volts held a tick at a time, 3, 1, 4 and 8 V of late, and 2.5 ticks of delay: 3 + 1 + 4/2 tick volts are under way."""
    assert mean_over_lag(np.array([3.0, 1.0, 4.0, 8.0]), 2.5) == pytest.approx(6.0 / 2.5)


@pytest.mark.parametrize("delay_s", (4e-3, 6e-3))
def test_with_a_late_valve_an_eighth_of_plain_controls_bump_is_left(delay_s: float) -> None:
    """0.05 m at 0.5 Hz, nothing learned before, the last four of twelve periods; it engaged and was rejected at 10 s before."""
    leg = PairLeg(valve_delay_s=delay_s)
    peaks = [
        run_pair(create(name), leg, sine(0.05, 0.5), 24.0, period_s=2.0, seed=9720).peaks(2.0)[-4:].max()
        for name in ("none", "adaptive")
    ]
    assert peaks[1] < peaks[0] / 8


def test_a_rounding_is_not_told_by_a_lag_that_is_not_known_yet() -> None:
    """6 ms late, 3 % of air, 120 kg, 0.03 m at 0.2 Hz: the first passages, made with 5 of 10 ms of lag, told 89 mV of 40, which no
    later one explained; it never engaged. A third of plain control's bump is left, a half is asked for."""
    leg = PairLeg(mass_kg=120.0, valve_delay_s=6e-3, air=0.03)
    peaks = [
        run_pair(create(name), leg, sine(0.03, 0.2), 42.0, period_s=5.0, seed=9722).peaks(5.0)[-3:].max()
        for name in ("none", "adaptive")
    ]
    assert peaks[1] < peaks[0] / 2
