"""Four-way valves with a backlash, and with an overlap that the spool jumps across. No code of hexsim."""

from __future__ import annotations

import numpy as np
import pytest
from leg_plant import sine
from pair_plant import PairLeg, context_of, run_pair

from compensation import create
from compensation.adaptive.crossing_oil import STAY_OIL_M, stay_on_side
from compensation.adaptive.feedback import cross_backlash
from compensation.adaptive.layout import INVERSE
from compensation.records import empty


def peaks_of(leg: PairLeg, seed: int) -> list[float]:
    """Largest deviation of the last three of twelve periods, 0.05 m at 0.5 Hz, without and with compensation."""
    return [
        float(run_pair(create(name), leg, sine(0.05, 0.5), 24.0, period_s=2.0, seed=seed).peaks(2.0)[-3:].max())
        for name in ("none", "adaptive")
    ]


@pytest.mark.parametrize("mass_kg", (250.0, 500.0))
def test_with_a_backlash_of_30_mV_an_eighth_of_plain_controls_bump_is_left(mass_kg: float) -> None:
    """Nothing learned before; a quarter to a third was left while the damping's volts stayed within the backlash."""
    plain, compensated = peaks_of(PairLeg(mass_kg=mass_kg, backlash_V=0.03), 9719)
    assert compensated < plain / 8


def test_across_20_um_a_fifth_of_plain_controls_bump_is_left() -> None:
    """Nothing learned before, 250 kg; 0.4 of it was left while the oil of the crossing was not reckoned."""
    plain, compensated = peaks_of(PairLeg(overlap_m=2e-5), 9720)
    assert compensated < plain / 5


def asked(flow_m_s: float, velocity_m_s: float, acceleration_m_s2: float, missing_m: float = 0.0) -> float:
    """Flow that is left of one that reverses to `flow_m_s`, where a leak of -1.4 mm/s asks for 1.4 mm/s; it was positive."""
    inverse, leak_m_s = empty(INVERSE), -1.4e-3
    inverse.tick_s, inverse.started, inverse.flows_m_s[1] = 2e-3, 1, 1e-3
    oil_m = stay_on_side(inverse, (flow_m_s + leak_m_s) * 2e-3, leak_m_s, velocity_m_s, acceleration_m_s2, missing_m)
    return oil_m / 2e-3 - leak_m_s


def test_the_spool_stays_on_its_side_for_little_oil_alone() -> None:
    """Half of the bound is owed: it stays, its flow none. Twice of it, the rest of friction's step or a motion that goes on in
    the new direction: it crosses. The motion turns back after (0.4 mm/s)^2 / (2 * 0.1 m/s2) = 0.8 um, or 20 um."""
    little = 0.5 * STAY_OIL_M / 2e-3
    assert asked(-little, 0.0, -0.5) == pytest.approx(0.0, abs=1e-8)
    assert asked(-4.0 * little, 0.0, -0.5) == pytest.approx(-4.0 * little)
    assert asked(-little, 0.0, -0.5, missing_m=-STAY_OIL_M) == pytest.approx(-little)
    assert asked(-little, -1.8e-3, -0.5) == pytest.approx(-little)
    assert asked(-little, -1.8e-3, 0.1) == pytest.approx(0.0, abs=1e-8)
    assert asked(-little, -3.4e-3, 0.1) == pytest.approx(-little)
    assert np.isclose(asked(2.0 * little, 1e-3, -0.5), 2.0 * little)


def test_behind_a_backlash_there_is_what_is_asked_for() -> None:
    """Volts drawn as a random walk of 8 mV a tick, which turns within the backlash of 60 mV: behind it they are off by less
    than the 2 mV from which it is crossed; sent as they are they would be off by up to 30 mV."""
    numbers = create("adaptive").start(context_of(PairLeg(), None)).inner.numbers
    for edge in numbers.valve.edges:
        edge.backlash_V = 0.03
    walk = np.cumsum(np.random.default_rng(3).normal(0.0, 8e-3, 500))
    sent_V, behind_V, off_V = 0.0, 0.0, []
    for asked_V in walk:
        sent_V = float(asked_V) + cross_backlash(numbers, 0.25, sent_V, float(asked_V) - 0.25)
        behind_V = min(max(behind_V, sent_V - 0.03), sent_V + 0.03)
        off_V.append(abs(behind_V - asked_V))
    assert max(off_V) < 2e-3 + 1e-9
