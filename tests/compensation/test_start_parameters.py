"""What start parameters hand over of the oil, of bristles, of a leak and of rounded edges, and what an armed start does to them."""

from __future__ import annotations

import pytest
from leg_plant import Leg, run

import compensation
from compensation import Context, preview_count
from compensation.adaptive import Adaptive
from compensation.adaptive.delay import SPOOL_LAGS_S, found_delay_s, found_lateness_s, softness_m_Pa
from compensation.adaptive.layout import LATES, SPOOLS
from compensation.adaptive.presliding import LENGTHS_M

LAG_S = 2 * 0.7 / (2 * 3.141592653589793 * 60.0)  # of the leg's spool


def test_softer_oil_and_bristles_are_handed_over() -> None:
    """A compliance of 4e-11 m/Pa beyond the data sheet's, told by ten reversals, and bristles of 20 um: the next start has
    both. A file without them starts without."""
    algorithm = Adaptive()
    state = algorithm.start(Context())
    numbers = state.numbers
    numbers.delay.reversals, numbers.delay.pressure_square, numbers.delay.pressure_product = 10, 1e12, 40.0
    presliding = numbers.friction.presliding
    presliding.squares[:], presliding.shapes[:], presliding.weight = 1e4, 1.0, 30.0
    presliding.squares[5] = 0.0
    kept = algorithm.parameters(state)
    again = algorithm.restore(Context(), kept).numbers
    assert softness_m_Pa(again.delay) == softness_m_Pa(numbers.delay) == pytest.approx(4e-11, rel=0.2)
    assert again.friction.presliding.length_m == pytest.approx(LENGTHS_M[5], rel=1e-6)
    del kept["presliding"], kept["delay"]["oil"]
    older = algorithm.restore(Context(), kept).numbers
    assert softness_m_Pa(older.delay) == 0.0 and older.friction.presliding.length_m == 0.0


@pytest.mark.parametrize(("supply", "tank", "true_m_s"), [(2e-12, 0.0, 5.57e-3), (0.0, 2e-12, -5.57e-3)])
def test_a_leak_that_goes_with_its_drop_leaves_the_lag_alone(supply, tank, true_m_s) -> None:
    """2e-12 m3/s/Pa from the supply, and to the tank: the leak at 3.5 MPa within 4 %, the spool's lag within 0.03 ms (taken
    as constant the leak made it 0.05 ms too long and too short)."""
    leg = Leg(leak_supply_m3_s_Pa=supply, leak_tank_m3_s_Pa=tank)
    valve = run(compensation.create("adaptive"), leg, duration_s=16.0).state.inner.numbers.valve
    assert valve.leak_m_s == pytest.approx(true_m_s, rel=0.04)
    assert valve.lag_s == pytest.approx(LAG_S, abs=3e-5)


@pytest.mark.parametrize("late_s", [0.4e-3, 0.6e-3])
def test_a_position_that_is_late_by_a_part_of_a_tick_is_found(late_s) -> None:
    """0.4 and 0.6 ms, of a tick of 2 ms: found within 0.25 ms after 20 reversals."""
    found = run(compensation.create("adaptive"), Leg(position_delay_s=late_s), duration_s=24.0).state.inner.numbers
    assert found.lateness.late_s == pytest.approx(late_s, abs=2.5e-4)


def test_a_delay_that_is_told_stands() -> None:
    """Told 0.41 ms, 0.3 of them the position's, beside twelve reversals that say another: taken as told, but no more than a lag
    leaves beside the fastest spool, and kept. A file without it, and nothing told, go by the reversals."""
    algorithm = Adaptive()
    state = algorithm.start(Context())
    state.numbers.delay.reversals, state.numbers.delay.sums[:] = 12, 40.0
    state.numbers.delay.sums[LATES * 5] = 0.0  # a spool of 2.7 ms, nothing late
    learned = algorithm.parameters(state)
    told = learned | {"delay": learned["delay"] | {"told_s": [4.1e-4, 3e-4]}}
    for start in (told, algorithm.parameters(algorithm.restore(Context(), told))):
        delay = algorithm.restore(Context(), start).numbers.delay
        assert (found_delay_s(delay, 4e-3), found_lateness_s(delay, 4e-3)) == (4.1e-4, 3e-4)
        assert found_delay_s(delay, 1.4e-3) == pytest.approx(1.4e-3 - SPOOL_LAGS_S[0])
    older = {name: value for name, value in learned["delay"].items() if name != "told_s"}
    for start in (learned, learned | {"delay": older}):
        delay = algorithm.restore(Context(), start).numbers.delay
        assert found_delay_s(delay, 4e-3) == pytest.approx(1.3e-3, rel=0.1)  # 6 % of caution
        assert found_lateness_s(delay, 4e-3) == pytest.approx(0.0, abs=1e-6)


@pytest.fixture(scope="module")
def rounded():
    """Learned beside a leak on a valve with edges of 2 um, the rounding as its file has it, nothing of the delay."""
    algorithm = compensation.create("adaptive")
    leg = Leg(rounding_m=2e-6, leak_supply_m3_s_Pa=1.7e-12)
    learned = algorithm.parameters(run(algorithm, leg, duration_s=20.0).state)
    return leg, learned | {
        "rounding_V": 2e-6 / 1.1e-4,
        "delay": {"sums": [0.0] * SPOOLS, "reversals": 0.0, "late_s": 0.0},
    }


def test_rounded_edges_are_no_delay(rounded) -> None:
    """Edges rounded by 18 mV, as given: less than 0.25 ms of delay is found where there is none."""
    leg, learned = rounded
    algorithm = compensation.create("adaptive")
    state = algorithm.restore(Context(), learned)
    found = run(algorithm, leg, duration_s=20.0, state=state, seed=1).state.inner.numbers
    assert found.delay_s < 2.5e-4


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_where_a_motion_begins_nothing_known_is_lost(rounded, seed) -> None:
    """An armed start, 0.4 s: the beginning of the motion is no reversal to tell Stribeck friction by (it took 20 of 24 kPa),
    and one window moves neither mass nor edge."""
    leg, learned = rounded
    algorithm = compensation.create("adaptive")
    state = algorithm.restore(Context(), learned)
    found = run(algorithm, leg, duration_s=0.4, state=state, seed=seed).state.inner.numbers
    assert found.friction.stribeck.pressure_Pa == pytest.approx(learned["friction"]["stribeck_Pa"], abs=500.0)
    assert found.friction.fit.theta[1] == pytest.approx(learned["friction"]["theta_MPa"][1], rel=0.1)
    assert found.valve.edges[1].dead_band_V == pytest.approx(learned["flow"]["extend"]["dead_band_V"], abs=1.5e-3)


def test_a_learned_lag_asks_for_no_more_preview_than_it_needs() -> None:
    """From nothing a lag may be any: 28 ms. Started with a lag of 3.7 ms 20 ms are looked at, and what lies beyond changes
    no volt; 18 ms are too few, and the future is predicted then. With 4 ms of valve delay, two ticks more."""
    algorithm = compensation.create("adaptive")
    assert preview_count(algorithm, Context(), algorithm.start(Context())) == preview_count(algorithm, Context()) == 15
    learned = algorithm.parameters(run(algorithm, duration_s=16.0).state)
    enough = algorithm.preview_of(algorithm.restore(Context(), learned))
    assert enough == pytest.approx(0.020, abs=1e-9)
    volts = []
    for seconds in (0.028, enough, enough - 0.002):
        made = compensation.create("adaptive", preview_s=seconds)
        volts.append(run(made, duration_s=4.0, state=made.restore(Context(), learned)).added_V)
    assert volts[0].any() and (volts[0] == volts[1]).all() and (volts[0] != volts[2]).any()
    late = algorithm.parameters(run(algorithm, Leg(valve_delay_s=4e-3), duration_s=16.0).state)
    assert algorithm.preview_of(algorithm.restore(Context(), late)) == pytest.approx(0.024, abs=1e-9)
