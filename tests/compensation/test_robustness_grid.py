"""The plant of the robustness grid: its balances, its parts against their closed forms, its order, its loop, its perfect inverse."""

from __future__ import annotations

import dataclasses
import importlib
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import compensation

ROOT = Path(__file__).parents[2]
QUIET = {"position_noise_m": 0.0, "position_resolution_m": 0.0, "pressure_noise_Pa": 0.0, "volts_bits": 40.0}


@pytest.fixture(scope="module")
def grid() -> Any:
    sys.path.insert(0, str(ROOT))
    try:
        yield importlib.import_module("benchmarks.robustness_grid")
    finally:
        sys.path.remove(str(ROOT))


@pytest.fixture(scope="module")
def plant(grid: Any) -> Any:
    return importlib.import_module("benchmarks.grid.plant")


@pytest.fixture(scope="module")
def priors(grid: Any) -> Any:
    return importlib.import_module("benchmarks.grid.priors")


@pytest.fixture(scope="module")
def short(grid: Any) -> Any:
    """A sine of 6 s."""
    return dataclasses.replace(grid.motion_of("sine", 0), duration_s=6.0)


def rates(plant: Any, row: np.ndarray, state: np.ndarray, volts: float = 0.0) -> np.ndarray:
    out = np.empty(plant.N_STATES)
    plant.rates(state, volts, row[0], 0.0, out)
    return out


def stepped(plant: Any, row: np.ndarray, state: np.ndarray, volts: float, seconds: float, pieces: int) -> np.ndarray:
    """Positions, or all states (steps + 1, n), under held volts."""
    h, s, made = plant.TICK_S / pieces, state.copy(), [state.copy()]
    k, mid = np.empty((4, plant.N_STATES)), np.empty(plant.N_STATES)
    for i in range(round(seconds / h)):
        plant.step(s, volts, row[0], i * h, h, k, mid)
        made.append(s.copy())
    return np.array(made)


def test_plant_knows_nothing_of_what_it_judges() -> None:
    """plant.py and priors.py import neither hexsim nor compensation."""
    for name in ("plant", "priors"):
        text = (ROOT / "benchmarks" / "grid" / f"{name}.py").read_text()
        lines = [line for line in text.splitlines() if line.startswith(("import ", "from "))]
        assert lines and not [line for line in lines if "hexsim" in line or "compensation" in line]


def test_free_fall(plant: Any, priors: Any) -> None:
    """Without oil pressure and friction the load falls with g."""
    row = priors.one_row({"friction": 0.0})
    state = np.zeros(plant.N_STATES)
    state[plant.Y] = 0.1
    assert rates(plant, row, state)[plant.V] == pytest.approx(-plant.GRAVITY)


@pytest.mark.parametrize("four_way", [0.0, 1.0])
def test_balance_at_rest(plant: Any, priors: Any, four_way: float) -> None:
    """At rest with the valve shut in its overlap nothing moves: force and flows balance; 10 kg more fall with their share of g."""
    row = priors.one_row({"four_way": four_way, "overlap_m": 3e-5, "null_V": 0.05, "spring_N_m": 500.0})
    grown = priors.one_row(
        {"four_way": four_way, "overlap_m": 3e-5, "null_V": 0.05, "spring_N_m": 500.0, "mass_kg": 60.0}
    )
    c = row.view(np.recarray)[0]
    state = plant.balanced(c, 0.13)
    found = rates(plant, row, state, c.null_V)
    assert np.abs(found[[plant.Y, plant.V, plant.X]]).max() < 1e-9
    assert (
        np.abs(found[[plant.P1, plant.P2]]).max() < 100.0
    )  # Pa/s: what a rounded edge of 0.5 um at 30 um lets through
    assert rates(plant, grown, state)[plant.V] == pytest.approx(-plant.GRAVITY * 10.0 / 60.0)


@pytest.mark.parametrize("air", [0.0, 0.03])
def test_oil_is_conserved(plant: Any, priors: Any, air: float) -> None:
    """With all edges shut the piston compresses the chamber by E A1/V, softer by free air's polytropic p/(air n ..)."""
    row = priors.one_row({"overlap_m": 4e-5, "air": air, "hose_m3": 1e-5})
    c, state = row.view(np.recarray)[0], plant.balanced(row.view(np.recarray)[0], 0.1)
    state[plant.V] = -0.01
    p = state[plant.P1] + plant.ATMOSPHERE
    volume = 0.1 * c.area_bottom_m2 + c.dead_m3
    gas = air * (plant.ATMOSPHERE / p) ** (1.0 / c.polytropic) / (c.polytropic * p)
    softness = volume * ((1.0 - air) / c.bulk_Pa + gas) + c.hose_m3 / c.hose_Pa
    assert rates(plant, row, state)[plant.P1] == pytest.approx(0.01 * c.area_bottom_m2 / softness, rel=1e-6)


def test_orifice_is_turbulent_far_out_and_laminar_close_in(plant: Any, priors: Any) -> None:
    """q = Cd w h sqrt(2 dp/rho) at large dp; with a land, at small h, w h^3 dp/(12 mu L); odd in dp."""
    wide, narrow = priors.one_row({"laminar_Pa": 1.0})[0], priors.one_row({"laminar_Pa": 1e-3, "land_m": 5e-6})[0]
    w, h = math.pi * plant.SPOOL_DIAMETER_m, 1e-4
    assert plant.edge_flow(h, 4e6, wide, 0.0) == pytest.approx(0.611 * w * h * math.sqrt(2.0 * 4e6 / 860.0), rel=1e-3)
    h = 5e-7
    assert plant.edge_flow(h, 1e4, narrow, 0.0) == pytest.approx(w * h**3 * 1e4 / (12.0 * 0.04 * 5e-6), rel=1e-2)
    assert plant.edge_flow(1e-5, -2e6, narrow, 0.0) == -plant.edge_flow(1e-5, 2e6, narrow, 0.0)


def test_flows_of_four_edges_balance(plant: Any, priors: Any) -> None:
    """Equal areas, no load, no friction: extending and retracting are mirror images, P1 and P2 exchanged."""
    row = priors.one_row({"four_way": 1.0, "area_top_m2": priors.BOTTOM_m2})
    up, down = np.zeros(plant.N_STATES), np.zeros(plant.N_STATES)
    for state, sign in ((up, 1.0), (down, -1.0)):
        state[plant.Y], state[plant.X], state[plant.PS] = 0.1, sign * 0.7, 7e6
        state[plant.P1], state[plant.P2] = 3.5e6 - sign * 4e5, 3.5e6 + sign * 4e5
    first, second = rates(plant, row, up), rates(plant, row, down)
    assert first[plant.P1] == pytest.approx(second[plant.P2], rel=1e-12) and first[plant.P1] > 0.0
    assert first[plant.P2] == pytest.approx(second[plant.P1], rel=1e-12) and first[plant.P2] < 0.0


@pytest.mark.parametrize("damping", [0.4, 1.4])
def test_spool_follows_its_step_response(plant: Any, priors: Any, damping: float) -> None:
    """Second order: overshoot exp(-pi z/sqrt(1 - z^2)) of 0.4, and none of 1.4 with its slow pole's time."""
    row = priors.one_row({"spool_Hz": 50.0, "damping": damping})
    x = stepped(plant, row, plant.balanced(row.view(np.recarray)[0], 0.1), 1.0, 0.04, 80)[:, plant.X]
    if damping < 1.0:
        assert x.max() - 1.0 == pytest.approx(math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2)), abs=1e-3)
    else:
        t, w, root = np.arange(len(x)) * plant.TICK_S / 80, 100.0 * math.pi, math.sqrt(damping**2 - 1.0)
        slow, fast = w * (damping - root), w * (damping + root)
        assert x == pytest.approx(1.0 - (fast * np.exp(-slow * t) - slow * np.exp(-fast * t)) / (fast - slow), abs=1e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_bristles_are_springs_before_they_slide(plant: Any, priors: Any, sign: float) -> None:
    """A micrometre either way is answered by bristle_N_m (1 + 1/ratio) times it; far out by the level of the direction."""
    row = priors.one_row({"bristle_N_m": 4e6, "bristle_ratio": 3.0, "viscous_up_N_s_m": 0.0, "viscous_down_N_s_m": 0.0})
    c = row.view(np.recarray)[0]
    state = plant.balanced(c, 0.1)
    state[[plant.Z1, plant.Z2]] = sign * 1e-6
    assert rates(plant, row, state)[plant.V] == pytest.approx(-sign * 4e6 * (1 + 1 / 3) * 1e-6 / c.mass_kg, rel=1e-6)
    state[plant.V] = sign * 0.1
    for _ in range(2000):  # at a held speed the bristles run into their levels
        out = rates(plant, row, state)
        state[[plant.Z1, plant.Z2]] += 1e-6 * out[[plant.Z1, plant.Z2]]
    level = c.coulomb_up_N if sign > 0 else c.coulomb_down_N
    assert -sign * rates(plant, row, state)[plant.V] * c.mass_kg == pytest.approx(level, rel=1e-3)


def test_bristles_remember_past_turns(plant: Any, priors: Any) -> None:
    """After the same small stroke back and forth two unequal bristles do not give the force they gave at first: hysteresis."""
    row = priors.one_row({"bristle_N_m": 4e6, "bristle_ratio": 4.0})
    state, forces = plant.balanced(row.view(np.recarray)[0], 0.1), []
    for v in (0.02, -0.02):
        state[plant.V] = v
        for _ in range(1000):
            out = rates(plant, row, state)
            state[[plant.Z1, plant.Z2]] += 1e-6 * out[[plant.Z1, plant.Z2]]
        state[plant.V] = 0.0
        forces.append(rates(plant, row, state)[plant.V])
    assert forces[1] != pytest.approx(0.0, abs=0.05)  # m/s2; an elastic spring would be back where it began


def test_integration_is_of_fourth_order(plant: Any, priors: Any) -> None:
    """Half the step leaves at most a tenth of the error, in a motion that turns once, edges and friction soft."""
    row = priors.one_row({"rounding_m": 5e-6, "sharpness_m_s": 1e-2, "spool_Hz": 30.0})
    state = plant.balanced(row.view(np.recarray)[0], 0.1)
    ends = [stepped(plant, row, state, 0.3, 0.03, n)[-1, : plant.P1 + 1] / [1.0, 1.0, 1e6] for n in (4, 8, 64)]
    coarse, fine = (np.abs(end - ends[2]).max() for end in ends[:2])
    assert 1e-12 < fine < coarse / 10.0


def test_volts_arrive_late_by_any_time(plant: Any) -> None:
    """The mean of the held volts over each step: the area under them after a delay of 1.23 steps is exact."""
    arriving, pieces = np.zeros(100), 20
    h = plant.TICK_S / pieces
    plant.hold(arriving, 2.0, 1.23 * h, pieces)
    assert arriving[:3] == pytest.approx([0.0, 2.0 * 0.77, 2.0])
    plant.hold(arriving, -1.0, 5.5 * h, pieces)
    assert arriving[4:7] == pytest.approx([2.0, 0.5, -1.0])


def test_readings_are_late_by_any_time(grid: Any, short: Any) -> None:
    """A position that is read 3.3 ms late is the true one of 3.3 ms ago; one behind a lag of 0.8 ms follows that much later."""
    for name, late_s in (("position_delay_s", 3.3e-3), ("position_lag_s", 8e-4)):
        log = grid.run_plain(grid.draw_leg(0, "single", changes=QUIET | {name: late_s}), short).log
        t = log["time_s"]
        then = np.interp(t[500:] - late_s, t, log["true_position_m"])
        assert log["position_m"][500:] == pytest.approx(then, abs=2e-6)
        assert np.abs(log["position_m"] - log["true_position_m"])[500:].max() > 5e-5


def test_same_seed_same_run_and_compiled_as_in_python(grid: Any, short: Any) -> None:
    """A draw with jitter, bristles and droop: twice the same bits, compiled alone or around a compensator; another noise is another."""
    leg = grid.draw_leg(3, "wide", changes={"jitter_s": 2e-4, "bristle_N_m": 2e6, "line_Pa_s_m3": 5e8})
    first, again, other = (grid.run_plain(leg, short, noise=noise) for noise in (0, 0, 1))
    around = grid.run_leg(compensation.create("none"), leg, short)
    assert np.array_equal(first.acceleration_m_s2, again.acceleration_m_s2)
    assert np.array_equal(first.acceleration_m_s2, around.acceleration_m_s2)
    assert all(np.array_equal(first.log[name], around.log[name]) for name in first.log)
    assert not np.array_equal(first.acceleration_m_s2, other.acceleration_m_s2)


def test_volts_are_sent_in_counts_and_in_range(grid: Any, short: Any) -> None:
    """12 bit of 20 V: every value that is sent is a whole number of 4.88 mV within 10 V, and nothing else moves the valve."""
    log = grid.run_plain(grid.draw_leg(0, "single", changes={"volts_bits": 12.0}), short).log
    counts = log["valve_V"] / (20.0 / 4096)
    assert np.array_equal(counts, np.round(counts)) and len(np.unique(counts)) > 50
    assert np.abs(log["valve_V"] - log["control_V"]).max() <= 0.5 * 20.0 / 4096 + 1e-12


def test_draws_stay_within_their_priors(grid: Any, priors: Any) -> None:
    """Both families, 40 seeds: every number within its range or nominal; every drawn number takes more than one value."""
    for family in ("reality", "wide"):
        legs = [grid.draw_leg(seed, family).truth for seed in range(40)]
        for number in priors.NUMBERS:
            values, prior = [leg[number.name] for leg in legs], getattr(number, family)
            if prior is None:
                assert set(values) == {number.nominal}
            else:
                assert all(prior.low <= v <= prior.high + 1e-12 or v == number.nominal for v in values)
                assert len(set(values)) > 1


def test_right_sheet_says_the_truth_and_a_sheet_is_near(grid: Any) -> None:
    """Declared rightly: the spool's numbers are the leg's; from a sheet within its uncertainty and not equal; nothing: the usual."""
    right, sheet, nothing = (grid.draw_leg(5, declared=how) for how in ("right", "sheet", "nothing"))
    assert right.context.spool_frequency_Hz == pytest.approx(right.c.spool_Hz)
    assert 0.0 < abs(sheet.context.spool_frequency_Hz / sheet.c.spool_Hz - 1.0) <= 0.15
    assert nothing.context.spool_frequency_Hz == 0.0 and right.truth == sheet.truth == nothing.truth


def test_sequential_test_decides_both_ways(grid: Any) -> None:
    """All good is decided for, all bad against, a share between the two shares is not decided after 20."""
    assert grid.evidence(20, 0) > grid.bound() and grid.evidence(0, 20) < -grid.bound()
    assert abs(grid.evidence(15, 5)) < grid.bound()


@pytest.mark.slow  # the inverse alone compiles for 12 s
@pytest.mark.parametrize("four_way", [False, True])
def test_perfect_inverse_leaves_next_to_nothing_without_noise(grid: Any, four_way: bool) -> None:
    """A drawn leg, 20 mV of hysteresis and a valve delay of 1.3 ms, no noise, fine volts: at most a thirtieth of plain control's."""
    changes = QUIET | {"backlash_V": 0.02, "valve_delay_s": 1.3e-3}
    leg = grid.draw_leg(1005, four_way=four_way, changes=changes)
    motion = dataclasses.replace(grid.motion_of("sine", 0), duration_s=9.0)
    plain, left = (
        grid.late(grid.bumps(run), motion) for run in (grid.run_plain(leg, motion), grid.perfect(leg, motion))
    )
    assert plain > 0.2 and left < plain / 30.0


def test_every_drawn_hexapod_is_a_machine(grid: Any) -> None:
    """20 seeds: the changes make a valid machine file with the drawn spool and load, and a sheet is off by at most a factor of 2."""
    platform = importlib.import_module("benchmarks.grid.platform")
    for seed in range(20):
        changes, off = platform.drawn_machine(seed)
        machine = platform.changed(platform.load_machine(platform.MACHINE), changes)
        assert machine.valve.spool_frequency_Hz == changes["valve.spool_frequency_Hz"]
        assert 450.0 <= machine.load.platform_mass_kg <= 960.0
        assert all(0.5 <= factor <= 2.0 for _, factor in off)


def test_compensator_of_a_wrong_sheet_is_told_wrong_numbers(grid: Any) -> None:
    """The context that the algorithm starts with is off by the factors, and right in everything else."""
    platform = importlib.import_module("benchmarks.grid.platform")

    class Keeps(type(compensation.create("none"))):
        def start(self, context: compensation.Context) -> Any:
            return context

    right = compensation.Context()
    told = platform.Told(Keeps(), (("spool_damping", 1.2), ("edge_V", 0.7))).start(right)
    assert told == dataclasses.replace(right, spool_damping=0.7 * 1.2, edge_V=0.5 * 0.7)


def test_a_linear_answer_that_comes_in_late_is_no_bump(grid: Any) -> None:
    """Motion of twelve sines without any bump, that lags by 0.1 s until 15 s and follows at once from 19 s on, as a compensation that
    comes in late makes it: less than 0.04 m/s2 is left, one linear answer for both leaves more than 0.1, and no reversal is worse."""
    figures, motion = importlib.import_module("benchmarks.grid.figures"), grid.motion_of("irregular", 4)
    t, h = np.arange(round(motion.duration_s * figures.OUT_HZ)) / figures.OUT_HZ, 5e-3

    def asked(late_s: float) -> np.ndarray:
        path = [motion.path(np.maximum(t - late_s + shift, 0.0)) for shift in (-h, 0.0, h)]
        return (path[0] - 2.0 * path[1] + path[2]) / h**2

    come, behind = np.clip((t - 15.0) / 4.0, 0.0, 1.0), asked(0.1)
    mixed = come * asked(0.0) + (1.0 - come) * behind
    found = figures.figures_of([mixed, behind, behind], motion, 15.0, 15.0)
    low, linear = figures.answer(mixed, motion)
    assert found.left < 0.04 and found.worse == 0
    assert figures.late(figures.largest(low - linear, motion), motion) > 0.1


def test_a_shake_counts_though_the_volts_leave_again(grid: Any, short: Any) -> None:
    """Plain control with a pulse of 2 m/s2 at the third reversal, by volts that are in for 0.4 s alone: one reversal is worse, by about
    that. Nothing has engaged."""
    plain = grid.run_plain(grid.draw_leg(1005), short)
    at_s = short.reversals()[2]
    time_s = plain.log["time_s"]
    log = plain.log | {"added_V": np.where(np.abs(time_s - at_s) < 0.2, 0.1, 0.0)}
    pulse = 2.0 * np.exp(-(((np.arange(len(plain.acceleration_m_s2)) * 1e-4 - at_s) / 0.03) ** 2))
    shaken = dataclasses.replace(plain, log=log, acceleration_m_s2=plain.acceleration_m_s2 + pulse)
    found = grid.figures(shaken, plain, plain)
    assert (found.engaged_s, found.worse, found.beyond) == (None, 1, 1)
    assert 1.0 < found.growth < 2.5  # plain control's own bump stands beside it
