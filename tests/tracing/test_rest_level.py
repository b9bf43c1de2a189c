"""At the level of the rest: nuisance effects keep to their size, a large effect is found with its number beside them."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import create_autospec

import numpy as np
import pytest
from other_plant import write_machine
from rough_machines import draw

from hexsim.machine import load_machine
from hexsim.signals import weak_form
from hexsim.signals.log import Log
from hexsim.tracing import balances, rules
from hexsim.tracing.balances import balance as points
from hexsim.tracing.balances import continuity, null
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.fitting import parameters, rest_evidence, rest_level, rest_priors
from hexsim.tracing.problems import balance as balance_problem
from hexsim.tracing.problems import problem as problems
from hexsim.tracing.steps import balance_search, dominant, logs, shapes, violations

DATA = Path(__file__).parents[1] / "data"
BENCH = load_machine(DATA / "bench_none")
ROUGH = {
    "small_spool_lag": 150.0,
    "small_position_delay": 0.4,
    "small_null_offset": 0.006,
    "friction_warm_up": 0.06,
    "scale_ripple": 3e-6,
}


def violated(folder, names=("fit", "sweep"), held_out=("validate",)):
    trace = logs.begin(folder, names, held_out)
    for step in (violations.STEP, shapes.STEP):
        trace = step.run(trace, lambda doing: None)
    return trace


def test_accelerometer_of_a_clean_bench_has_no_slope_against_the_second_derivative_of_position():
    """Samples miss 4 % of an acceleration that bends between ticks; with what they miss the slope is below 0.5 %."""
    trace = logs.begin(DATA / "bench_none", ["fit"], ["validate"])
    point = points.sensed_leg(trace.fit_problem.logs[0], points.resolved_machine(trace.machine), 0)
    kept = slice(500, -500)
    rest, a = point.disagreement()[kept], point.window.mean(point.acceleration)[kept]
    missed = point.between_ticks()[kept]
    assert abs(rest @ a) / (a @ a) < 0.005
    assert abs((rest + missed) @ a) / (a @ a) > 0.025


def test_small_realities_are_held_to_their_ordinary_size():
    """Every one of the table is an effect of the library with one number, which cannot leave its ordinary size, and what the
    machine file means by it."""
    possible = parameters.candidates(load_machine(DATA / "bench_none"))
    small = {candidate.effect.name: candidate for candidate in rest_level.ordinary_effects(possible)}
    assert set(small) == set(rules.ORDINARY)
    for name, candidate in small.items():
        number, *meant = candidate.effect.parameters
        assert all(other.of_the_file for other in meant)
        reach = number.bounds[0] if np.isinf(number.neutral) else number.bounds[1]
        assert reach == pytest.approx(rules.ORDINARY[name])


def test_a_small_reality_costs_as_much_at_its_reach_as_a_declared_parameter_at_its_half_width():
    """3 each, of either sign, at infinity too: else what a small one can do of a large effect is taken off its number."""
    small = tuple(rest_level.ordinary_effects(parameters.candidates(load_machine(DATA / "bench_none"))))
    values = tuple(c.start() | {c.effect.parameters[0].name: 0.0} for c in small)
    bare = least_squares.Fit(
        machine=load_machine(DATA / "bench_none"), priors=(), deviations=np.zeros(0), candidates=(*small, parameters.named("spring")),
        values=(*values, {"stiffness_N_m": 0.0}), chi2=0.0, n=0, misfit=[],
    )  # fmt: skip
    *precision, last = rest_level.prior_precision(bare)
    for candidate, number in ((c, number) for c in small for number in c.free()):
        low, high = parameters.coordinate_bounds(number)
        reach = 0.5 * (high - low) if number.of_the_file else max(-low, high)
        assert precision.pop(0) * reach**2 == pytest.approx(3.0), (candidate.label, number.name)
    assert last == 0.0 and not precision


def test_friction_that_fades_does_so_from_a_declared_value_of_a_cold_or_of_a_warm_machine():
    """Which one no log shows: 3 of J at either end, nothing in the middle, where it begins. It fades and never grows: with
    either sign it would be a change of all friction by a tenth."""
    [warm] = [
        c
        for c in rest_level.ordinary_effects(parameters.candidates(load_machine(DATA / "bench_none")))
        if "warm_up" in c.label
    ]
    for cold, cost in ((warm.start()["declared_cold"], 0.0), (0.0, 3.0), (1.0, 3.0)):
        fit = least_squares.Fit(
            machine=load_machine(DATA / "bench_none"), priors=(), deviations=np.zeros(0), candidates=(warm,),
            values=({"share_at_start": 0.0, "declared_cold": cold},), chi2=0.0, n=0, misfit=[],
        )  # fmt: skip
        assert rest_level.prior_precision(fit) @ rest_priors.off_prior(fit) ** 2 == pytest.approx(cost)
    assert warm.start()["declared_cold"] == 0.5
    assert warm.effect.parameters[0].bounds == (0.0, rules.ORDINARY["friction_warm_up"])


@pytest.mark.slow
def test_a_pressure_gain_is_no_offset_where_friction_fades_from_a_value_near_its_reach(tmp_path):
    """Coulomb friction 10 % below its declaration of 12 %, which fades by 6.6 %: with the friction declared of the warm
    machine alone an offset of 1.4 bar left less than the gain that is there. The gain within 5 %, which took the offset's
    place as a tie."""
    effects, _ = draw(1515, "pressure_gain")
    write_machine(tmp_path, 1515, effects)
    [own] = (found := dominant.sure_effects(violated(tmp_path), lambda doing: None)).named
    assert own.candidate.effect.name == "pressure_gain"
    fit = found.best.fit
    [gain] = fit.values[fit.candidates.index(own.candidate)].values()
    assert gain == pytest.approx(effects["pressure_gain"], rel=0.05)


def soft_bench(compliance):
    """(declared machine, that with a hose, a problem whose log is the simulated run of the second with noise)."""
    problem = logs.begin(DATA / "bench_none", ["fit"], ["validate"]).fit_problem
    declared = load_machine(DATA / "bench_none")
    soft = parameters.with_settings(
        declared, {}, [(parameters.named("hose_compliance"), {"compliance_m3_Pa": compliance})]
    )
    resolution = declared.sensors.position_resolution_m
    log = null.with_noise(problem.simulated(soft, 0), problem.noise, resolution, np.random.default_rng(3))
    return declared, soft, replace(problem, logs=(log,))


def test_a_soft_chamber_stands_out_of_the_fast_continuity():
    """A hose of 5e-14 m3/Pa: mean square above the noise three times that of the slow part; with the hose it is noise."""
    declared, soft, problem = soft_bench(5e-14)
    joint = balance_search.with_fast_rows(
        balance_problem.BalanceProblem(logs=problem.logs, parts=()), problem, declared
    )
    stiff, right = (float(rest_level.row_sizes([joint.residual(machine, 0)])[0]) for machine in (declared, soft))
    assert stiff > 1.5 and right == pytest.approx(1.0, abs=0.08)
    slow = [
        balances.balance_named("continuity", machine).residual(problem.logs[0], machine)[0, 500:-100]
        for machine in (declared, soft)
    ]
    assert (stiff / right) ** 2 - 1.0 > 3.0 * ((np.std(slow[0]) / np.std(slow[1])) ** 2 - 1.0)


def test_noise_of_the_pressure_does_not_ask_for_a_stiffer_chamber():
    """Undivided the fast residual of noise alone grows with the chamber's capacity; over what noise makes of it, it does not."""
    declared, _, problem = soft_bench(0.0)
    joint = balance_search.with_fast_rows(
        balance_problem.BalanceProblem(logs=problem.logs, parts=()), problem, declared
    )
    [fast] = [part.balance for part in joint.parts]
    quiet = problem.simulated(declared, 0)
    softer = parameters.with_settings(
        declared, {}, [(parameters.named("hose_compliance"), {"compliance_m3_Pa": 1e-13})]
    )

    def noise(balance, machine):
        return float(
            np.std((balance.residual(problem.logs[0], machine) - balance.residual(quiet, machine))[:, 500:-100])
        )

    assert noise(continuity.FastContinuity(), softer) > 1.4 * noise(continuity.FastContinuity(), declared)
    assert noise(fast, softer) == pytest.approx(noise(fast, declared), rel=0.08)


def test_what_the_samples_of_a_late_accelerometer_leave_is_its_own_machines():
    """5.24 ms late its acceleration bends between two samples. With what the declared machine's samples leave the sensors agree best at
    5.1 ms, and not to the noise; with what each machine's own leave, at 5.24 ms, to the noise."""
    problem, declared = logs.begin(DATA / "bench_none", ["fit"], ["validate"]).fit_problem, BENCH

    def late_by(delay_s):
        return parameters.with_settings(declared, {}, [(parameters.named("accelerometer_delay"), {"delay_s": delay_s})])

    quiet = problem.simulated(late_by(5.24e-3), 0)
    log = null.with_noise(quiet, problem.noise, declared.sensors.position_resolution_m, np.random.default_rng(3))
    balance = balances.balance_named("sensor", declared)
    noise = balance.residual(log, late_by(5.24e-3)) - balance.residual(quiet, late_by(5.24e-3))
    clean = (null.used(log, balance.residual(problem.simulated(declared, 0), declared)),)
    sigma = np.std(null.used(log, noise), axis=1)
    held = balance_problem.BalanceProblem(
        logs=(log,), parts=(balance_problem.BalanceRows(balance=balance, sigma=sigma, rows=(0,), clean=clean),)
    )
    delays = (5.1e-3, 5.24e-3, 5.38e-3)
    of_declared, own = (
        [float(np.sqrt(np.mean(one.residual(late_by(delay), 0) ** 2))) for delay in delays]
        for one in (held, held.beside_own_samples(replace(problem, logs=(log,))))
    )
    assert np.argmin(of_declared) == 0 and min(of_declared) > 1.5
    assert np.argmin(own) == 1 and own[1] == pytest.approx(1.0, abs=0.05) and own[0] > 1.1


def test_a_flow_without_bound_leaves_no_number_and_no_warning():
    machine = load_machine(DATA / "bench_none")
    log = logs.begin(DATA / "bench_none", ["fit"], ["validate"]).fit_problem.logs[0]
    resolved = points.resolved_machine(machine)
    point = points.measured_point(log, machine, resolved, 0)
    left = continuity.fast_residual_of(resolved.rows[0], point, np.full(log.n, np.inf), weak_form.Window(log.rate))
    assert np.all(np.isnan(left))


def test_a_hexapod_and_a_slow_log_have_no_fast_continuity():
    machine = load_machine(DATA / "bench_none")
    log = logs.begin(DATA / "bench_none", ["fit"], ["validate"]).fit_problem.logs[0]
    assert continuity.FastContinuity().wants(log, machine)
    assert not continuity.FastContinuity().wants(replace(log, rate=200.0), machine)
    assert not continuity.FastContinuity().wants(log, load_machine("micro_motion_system"))


def test_a_row_whose_rest_is_new_five_times_as_often_counts_five_times():
    log = Log(name="fit", kind="bench", time=np.arange(1000) * 1e-2, rate=100.0, position=np.zeros((1, 1000)))
    slow = balance_problem.BalanceRows(balance=balances.balance_named("continuity", BENCH), sigma=np.ones(1), rows=(0,))
    problem = balance_problem.BalanceProblem(
        logs=(log,), parts=(slow, replace(slow, rest_time_s=rules.REST_TIME_S / 5.0))
    )
    assert rest_level.row_counts(problem) == pytest.approx([1.0, 5.0])
    assert rest_level.row_counts(problem.slow_alone()) == pytest.approx([1.0, 0.0])
    plain = replace(problem, parts=(slow,))
    assert plain.slow_alone() is plain


TIME_s = np.arange(2000) * 1e-2


def spring_beside(misfit, column):
    """A fitted spring whose column over 20 s at 100 Hz is `column` (1, 2000), what is left `misfit` (1, 2000), and its problem."""
    log = Log(name="fit", kind="bench", time=TIME_s, rate=100.0, position=np.zeros((1, 2000)))
    row = balance_problem.BalanceRows(balance=balances.balance_named("continuity", BENCH), sigma=np.ones(1), rows=(0,))
    fit = least_squares.Fit(
        machine=BENCH, priors=(), deviations=np.zeros(0), candidates=(parameters.named("spring"),), values=({"stiffness_N_m": 0.0},),
        chi2=0.0, n=2000, misfit=[misfit],
    )  # fmt: skip
    found = rest_level.RestFit(fit=fit, columns=[column[None]], cost=0.0)
    return found, balance_problem.BalanceProblem(logs=(log,), parts=(row,))


def test_a_number_that_every_block_shifts_alike_is_known_no_better_than_what_is_left_allows():
    """A rest of size 2 in 100 correlation times knows a column of size 1 to 0.2, though the scores of all blocks of 2 s are 0."""
    wave, across = (np.sqrt(2.0) * own(np.pi * TIME_s)[None] for own in (np.sin, np.cos))
    found, problem = spring_beside(2.0 * wave, across)
    assert np.sqrt(rest_level.covariance_of(found, problem, [])[0, 0]) == pytest.approx(0.2, rel=1e-3)


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_a_number_is_no_sharper_than_what_may_be_there_unseen(monkeypatch, share):
    """An effect that does the same moves a number by as much of it as machines have without being remarkable; of one that does a
    part of the same, the logs see the other part, and no more of it can hide than they leave; what does something else takes nothing."""
    own, other = (np.sqrt(2.0) * wave(np.pi * TIME_s)[None] for wave in (np.sin, np.cos))
    found, problem = spring_beside(2.0 * np.sqrt(2.0) * np.sin(7.0 * np.pi * TIME_s)[None], own)
    unfitted = parameters.named("hardening_spring")
    column = share * own + np.sqrt(1.0 - share**2) * other
    monkeypatch.setattr(rest_level, "columns_of", lambda fit, candidates, problem: [[column] for _ in candidates])
    alone, beside = (
        rest_level.covariance_of(found, problem, some)[0, 0] for some in ([], [unfitted, parameters.named("spring")])
    )
    known = 100.0 / 4.0  # 1/variance of a column of size 1 beside a rest of size 2 in 100 correlation times
    hidden = 1.0 / (known * (1.0 - share**2) + 3.0 / rest_priors.least_remarkable(unfitted) ** 2)
    assert beside - alone == pytest.approx(share**2 * hidden, rel=1e-2, abs=1e-9)


def test_an_effect_in_one_leg_is_told_with_what_all_legs_share_of_it():
    """1.3e-12 beside 0.2e-12 in all legs is a leak of 1.5e-12 in that leg; bandwidths of spools do not add up."""
    machine = load_machine("micro_motion_system")
    small = {
        candidate.effect.name: candidate for candidate in rest_level.ordinary_effects(parameters.candidates(machine))
    }
    shared, leak = small["leakage_chamber_to_tank"], parameters.named("leakage_chamber_to_tank", "leg 4")
    slow, spool = small["spool_lag"], parameters.named("spool_lag", "leg 4")
    values = tuple(
        {own.effect.parameters[0].name: size}
        for own, size in ((shared, 0.2e-12), (slow, 200.0), (leak, 1.3e-12), (spool, 30.0))
    )
    fit = least_squares.Fit(
        machine=machine, priors=(), deviations=np.zeros(0), candidates=(shared, slow, leak, spool), values=values,
        chi2=0.0, n=0, misfit=[],
    )  # fmt: skip
    assert rest_evidence.values_in_leg(fit, leak) == {leak.effect.parameters[0].name: pytest.approx(1.5e-12)}
    assert rest_evidence.values_in_leg(fit, spool) == values[3]


SURE = rest_evidence.Evidence(
    candidate=parameters.named("spring"), share=0.9, unseen=0.9, own=1.0, restored=(0.9, 0.9), remarkable=2.0, tied=(),
)  # fmt: skip


def test_each_rule_alone_keeps_an_effect_from_being_sure():
    """Little taken, or nothing held out, and its balance not restored; another balance, a sensor's that spoils a row, a
    number at the end of its range."""
    little = {"share": 0.2, "unseen": 0.1}
    assert rest_evidence.sure(SURE)
    assert rest_evidence.sure(replace(SURE, **little))  # its own balance is at the noise again
    for changes in (
        little | {"restored": (0.9, 0.5)},
        {"unseen": -0.02, "restored": (0.9, 0.1)},
        {"own": 0.4},
        {"harm": 0.1},
        {"in_range": False},
    ):
        assert not rest_evidence.sure(replace(SURE, **changes))


def test_a_rival_that_leaves_less_held_out_is_tied_by_a_wider_margin(monkeypatch):
    """A rival 15 % worse in the fit runs is out where it is worse held out too, and tied where it leaves less there; one
    that leaves more than twice as much is out in both."""
    monkeypatch.setattr(rest_evidence, "start_fit_at", lambda fit, unseen: fit.held_out)
    noise = [np.random.default_rng(0).standard_normal((1, 5000))]

    def leaves(share, unseen):
        scaled = (SimpleNamespace(misfit=[3.0 * math.sqrt(own) * noise[0]]) for own in (share, unseen))
        return SimpleNamespace(fit=SimpleNamespace(misfit=next(scaled).misfit, held_out=next(scaled)))

    best = leaves(1.0, 1.0)
    for share, unseen, out in ((1.15, 1.05, True), (1.15, 0.95, False), (2.2, 1.05, True), (2.2, 0.95, True)):
        rival = leaves(share, unseen)
        limit = rest_evidence.tie_limit(rival, best.fit.held_out.misfit, None)
        assert rest_evidence.worse(rival, best, [0], limit) is out


def test_another_leg_is_no_witness_of_harm():
    """A pressure's gain in leg 1 mends its continuity; what all legs share shifts, and leg 4 has 7 % more: no harm of its own."""
    falls, own = np.array([1.6, 0.0, 0.0, -0.04]), [0]
    problem = balance_problem.BalanceProblem(logs=(), parts=())
    assert rest_evidence.harm_of(falls, problem, own) == 0.0
    assert rest_evidence.harm_of(falls, problem) == pytest.approx(np.exp(0.08) - 1.0)


def test_of_several_own_balances_one_that_holds_again_suffices():
    """Held out too: a slow row that something else spoils says nothing against the fast one."""
    spoiled, mended = (np.array([4.9]),) * 4, tuple(map(np.array, ([2.0], [1.05], [2.0], [1.05])))
    only_seen = tuple(map(np.array, ([2.0], [1.0], [2.0], [1.9])))
    assert min(rest_evidence.most_restored([spoiled, mended])) > 0.9
    assert min(rest_evidence.most_restored([spoiled, only_seen])) < 0.2
    assert rest_evidence.most_restored([]) == (0.0, 0.0)


def test_a_fast_row_is_no_other_residual_than_its_slow_one():
    """A delay that mends the fast part and leaves a little more in the slow one harms nothing; in the force it does."""
    log = Log(name="fit", kind="bench", time=np.arange(9) * 1e-3, rate=1e3, position=np.zeros((1, 9)))
    parts = [
        balance_problem.BalanceRows(balance=own, sigma=np.ones(1), rows=(0,))
        for own in (
            *(balances.balance_named(name, BENCH) for name in ("continuity", "force")),
            continuity.FastContinuity(),
        )
    ]
    problem = balance_problem.BalanceProblem(logs=(log,), parts=tuple(parts))
    assert rest_evidence.harm_of(np.array([-0.1, 0.0, 1.8]), problem) == pytest.approx(0.0)
    assert rest_evidence.harm_of(np.array([0.0, -0.1, 1.8]), problem) == pytest.approx(np.exp(0.2) - 1.0)


def test_the_gain_of_a_late_sensor_may_be_a_filter():
    """Of the same sensor only."""
    late = [replace(SURE, candidate=parameters.named("accelerometer_delay"))]
    assert dominant.is_sensor_lag(parameters.named("accelerometer_gain"), late)
    assert not dominant.is_sensor_lag(parameters.named("pressure_gain"), late)


def test_the_gain_against_an_accelerometer_that_is_late_by_part_of_a_sample_may_be_a_filter():
    """Its own and the position's, which are one ratio; of a pressure it may not, nor where the accelerometer is on time."""

    def late_by(delay_s):
        return SimpleNamespace(candidates=(parameters.named("accelerometer_delay"),), values=({"delay_s": delay_s},))

    for name in ("accelerometer_gain", "position_gain"):
        assert dominant.is_sensor_lag(parameters.named(name), [], late_by(4.4e-4))
        assert not dominant.is_sensor_lag(parameters.named(name), [], late_by(2e-5))
    assert not dominant.is_sensor_lag(parameters.named("pressure_gain"), [], late_by(4.4e-4))


def test_an_inclines_coordinate_is_proportional_to_its_force():
    """1 - cos of twice the coordinate is twice as much, within 2 % at 0.3 rad; to a value and back is the identity."""
    [angle] = parameters.named("incline").effect.parameters
    weight = [1.0 - np.cos(parameters.to_value(angle, x)) for x in (0.5, 1.0)]
    assert weight[1] / weight[0] == pytest.approx(2.0, rel=0.02)
    for value in (0.01, 0.3, 1.2):
        assert parameters.to_value(angle, parameters.to_coordinate(angle, value)) == pytest.approx(value)


def test_of_a_tie_what_leaves_least_of_all_runs_stands_first_and_a_nuisance_of_ordinary_size_before_it(monkeypatch):
    """A spool of 127 Hz stands before the delay of 1.6 ms that leaves less, one of 30 Hz does not; held-out rows count in full."""
    monkeypatch.setattr(dominant, "start_fit_at", lambda fit, unseen: fit)
    monkeypatch.setattr(rest_level, "cost_of_rows", lambda fit, unseen: fit.unseen)

    def rival(name, value, cost, unseen):
        candidate = parameters.named(name)
        values = {candidate.effect.parameters[0].name: value}
        return SimpleNamespace(fit=SimpleNamespace(candidates=[candidate], values=[values], unseen=unseen), cost=cost)

    late, slight = rival("valve_delay", 1.6e-3, 100.0, 50.0), rival("spool_lag", 127.0, 100.0, 59.0)
    slow, seen = rival("spool_lag", 30.0, 100.0, 59.0), rival("spool_lag", 30.0, 98.0, 51.0)
    ties = ((late, slight), (late, slow), (late, seen))
    assert [min(tie, key=lambda own: dominant.likelihood(own, None)) for tie in ties] == [slight, late, seen]


def test_a_spool_that_the_base_took_for_the_effect_is_given_back():
    """Without the small spool, else where it stood; nothing to give back where there is none."""
    declared, _, problem = soft_bench(0.0)
    [spool] = [c for c in rest_level.ordinary_effects(parameters.candidates(declared)) if c.effect.name == "spool_lag"]
    joint = balance_search.with_fast_rows(
        balance_problem.BalanceProblem(logs=problem.logs, parts=()), problem, declared
    )
    bare = least_squares.start_fit(declared, (), joint)
    fit = replace(
        bare, candidates=(spool, parameters.named("valve_delay")), values=({"frequency_Hz": 120.0}, {"delay_s": 1e-3})
    )
    lagging = rest_level.RestFit(fit=least_squares.evaluate(fit, joint), columns=[], cost=0.0)
    without = rest_level.without_lag(lagging, joint)
    assert without is not None and np.isinf(without.fit.values[0]["frequency_Hz"])
    assert without.fit.values[1] == {"delay_s": 1e-3}
    assert without.cost == rest_level.cost_of(without.fit, joint) != rest_level.cost_of(lagging.fit, joint)
    assert rest_level.without_lag(without, joint) is None


def test_a_delay_is_held_against_its_spool_with_every_later_effect(monkeypatch):
    """Coulomb friction beside a delay: begun without the small spool it leaves less, and is kept; beside a leak, which does
    not act late, no other beginning is tried."""
    base = SimpleNamespace(cost=1000.0)
    problem = SimpleNamespace(logs=[SimpleNamespace(time=np.array([0.0, 20.0]))])

    def beside(label):
        fit = SimpleNamespace(candidates=(parameters.named(label), parameters.named("coulomb_friction_change")))
        return SimpleNamespace(fit=fit, cost=742.0)

    given_back = SimpleNamespace(fit=beside("valve_delay").fit, cost=733.0)
    monkeypatch.setattr(rest_level, "without_lag", lambda rival, problem: given_back)
    monkeypatch.setattr(rest_level, "renewed", lambda rival, problem: rival)
    late, leaking = beside("valve_delay"), beside("leakage_across_piston")
    assert dominant.contenders([late], base, problem) == [given_back]
    assert dominant.contenders([leaking], base, problem) == [leaking]


def test_effects_whose_columns_tell_little_leave_room_for_those_that_promise_most():
    """Of six legs and all of them such an effect takes one place of the list, the best; a leak that promises most is in it."""
    machine = load_machine("micro_motion_system")
    possible = [c for c in parameters.candidates(machine) if c.effect.name != "incline"]
    asked = [(float(k), candidate, 0.1) for k, candidate in enumerate(possible)]
    leak = parameters.named("leakage_supply_to_chamber", "leg 3")
    asked.insert(0, (1e4, leak, 1.0))
    listed = dominant.worth_a_refit(asked, bending=True)
    bending = [job for job in listed if np.isinf(job[1].effect.parameters[0].neutral)]
    assert any(candidate is leak for _, candidate, _ in listed)
    assert len(bending) > 3 and len({candidate.effect.name for _, candidate, _ in bending}) == len(bending)
    lags = [candidate.label for _, candidate, _ in asked if candidate.effect.name == "spool_lag"]
    assert [c.label for _, c, _ in bending if c.effect.name == "spool_lag"] == [lags[-1]]
    assert dominant.worth_a_refit(asked, bending=False)[0][1] is leak


def test_own_rows_of_an_effect_in_one_leg_of_a_hexapod(hexapod):
    """A leak's is its leg's continuity alone; friction's and a spring's are the platform's six, which hold the legs' forces."""
    positions = np.zeros((6, 2))
    log = Log(name="fit", kind="hexapod", time=np.arange(2) * 1e-3, rate=1e3, position=positions)
    parts = [
        balance_problem.BalanceRows(balance=own, sigma=np.ones(6), rows=tuple(range(6)))
        for own in (balances.balance_named(name, hexapod) for name in ("continuity", "platform"))
    ]
    problem = balance_problem.BalanceProblem(logs=(log,), parts=tuple(parts))
    assert rest_evidence.own_rows(parameters.named("leakage_supply_to_chamber", "leg 3"), problem) == [2]
    assert rest_evidence.own_rows(parameters.named("valve_hysteresis"), problem) == [0, 1, 2, 3, 4, 5]
    for name in ("coulomb_friction_change", "pressure_dependent_friction", "spring"):
        assert rest_evidence.own_rows(parameters.named(name, "leg 3"), problem) == [6, 7, 8, 9, 10, 11]


class LegFlows(problems.FitProblem):
    """Six legs whose flow is leak times pressure plus null offset times gain. true: (leaks [1e-12], offsets [V]), six each."""

    def __init__(self, leaks, offsets):
        rng, time = np.random.default_rng(9), np.arange(2000) * 0.02
        self.logs = (Log(name="fit", kind="hexapod", time=time, rate=50.0, position=np.zeros((6, 2000))),)
        self.pressure, self.gain = 50.0 * (1.0 + 0.2 * rng.standard_normal((2, 6, 2000)))
        self.flow = (
            leaks[:, None] * self.pressure + 100.0 * offsets[:, None] * self.gain + rng.standard_normal((6, 2000))
        )

    def used(self, i):
        return 2000

    def channels(self, i):
        return [f"continuity of leg {k + 1}" for k in range(6)]

    def residual(self, machine, i):
        def of_legs(name, key):
            tables = machine.effects.get(name, [])
            tables = tables if isinstance(tables, list) else [tables]
            legs = [f"leg {k + 1}" for k in range(6)]
            return np.array([sum(t[key] for t in tables if t.get("where", leg) == leg) for leg in legs])

        leaks, offsets = of_legs("leakage_chamber_to_tank", "conductance_m3_s_Pa"), of_legs("null_offset", "offset_V")
        return self.flow - 1e12 * leaks[:, None] * self.pressure - 100.0 * offsets[:, None] * self.gain


def test_a_legs_own_null_offset_takes_nothing_from_the_leak_in_it():
    """A leak of 1.7e-12 in leg 3 beside -5 mV that no other leg has: 5 % off with what all legs share, right beside its own."""
    problem = LegFlows(np.array([0, 0, 1.7, 0, 0, 0]), np.array([2e-3, 2e-3, -5e-3, 2e-3, 2e-3, 2e-3]))
    machine = load_machine("micro_motion_system")
    small = [c for c in rest_level.ordinary_effects(parameters.candidates(machine)) if c.effect.name == "null_offset"]
    leak = parameters.named("leakage_chamber_to_tank", "leg 3")
    bare = least_squares.start_fit(machine, (), problem)
    begun = least_squares.with_effects(least_squares.with_effects(bare, small, 0.0, problem), [leak], 1.0, problem)
    shared = rest_level.refined(begun, problem)
    own = dominant.beside_its_own(shared, ["leg 3"], small, problem)

    def number(found):
        return rest_evidence.values_in_leg(found.fit, leak)["conductance_m3_s_Pa"]

    assert [c.label for c in own.fit.candidates] == ["null_offset", leak.label, "null_offset in leg 3"]
    assert number(shared) < 0.95 * 1.7e-12
    assert number(own) == pytest.approx(1.7e-12, rel=0.01)
    assert rest_evidence.values_in_leg(own.fit, own.fit.candidates[-1])["offset_V"] == pytest.approx(-5e-3, rel=0.1)
    assert dominant.beside_its_own(shared, [], small, problem) is shared


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect, value, name, unit_value",
    [
        ("leakage_supply_to_chamber", 2e-12, "leakage_supply_to_chamber", 2e-12),
        ("mass", 0.2, "mass_change", None),
        (None, None, None, None),
    ],
)
def test_a_large_effect_is_named_over_five_small_ones_and_none_where_there_is_none(
    tmp_path, effect, value, name, unit_value
):
    """Right name, number within 10 %; without a large effect nothing is sure."""
    write_machine(tmp_path, 41, ROUGH | ({} if effect is None else {effect: value}))
    found = dominant.sure_effects(violated(tmp_path), lambda doing: None)
    assert [own.candidate.effect.name for own in found.named] == ([] if name is None else [name])
    if unit_value is not None:
        fit = found.best.fit
        [number] = fit.values[fit.candidates.index(found.named[0].candidate)].values()
        assert number == pytest.approx(unit_value, rel=0.1)


def test_a_tie_takes_the_effect_that_was_named_since(monkeypatch):
    """Begun at the size that the named fit has, whatever its column promises; one that has it already is left out."""
    asked = create_autospec(rest_level.with_effect, return_value="fit")
    monkeypatch.setattr(rest_level, "with_effect", asked)
    monkeypatch.setattr(rest_level, "size_of", lambda fit: 0.3)
    monkeypatch.setattr(rest_priors, "is_held", lambda candidate: False)
    tie, best = (
        SimpleNamespace(fit=SimpleNamespace(candidates=[SimpleNamespace(label=label)])) for label in ("air", "leak")
    )
    assert dominant.propagate(tie, best, "problem") == "fit"
    assert asked.call_args.args == (tie, best.fit.candidates[-1], "problem", 0.3)
    assert dominant.propagate(best, best, "problem") is None
