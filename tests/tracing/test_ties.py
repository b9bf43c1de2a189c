"""Ties are found among all effects, and what no simulation can know is not held against a model."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from hexsim import readers
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.signals import channels
from hexsim.tracing import balances
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.fitting import parameters, screening, selection
from hexsim.tracing.problems import balance
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.simulation import start as starts
from hexsim.tracing.steps import ties
from hexsim.tracing.steps.one_term import read_as

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture(scope="module")
def bench():
    """The declared bench and the opening seconds of its held-out log."""
    machine = load_machine(DATA / "bench_none")
    return machine, readers.read_log(DATA / "bench_none" / "validate.csv.gz").head(5.0)


def test_more_oil_can_stand_for_a_softer_hose(bench):
    """V/E + C_hose: a dead volume E C_hose is the same capacity, so it stands for a hose, with that size; a mass does not."""
    machine, log = bench
    problem = SimulatedProblem(logs=(log,), noise=channels.noise_of(machine, [log]))
    soft = changed(machine, {"effects.hose_compliance.compliance_m3_Pa": 3e-14})
    problem = SimulatedProblem(logs=(problem.simulated(soft, 0),), noise=problem.noise)
    fit = least_squares.with_effects(
        least_squares.start_fit(machine, parameters.priors(machine), problem),
        [parameters.named("hose_compliance")],
        0.6,
        problem,
    )
    fit = least_squares.evaluate(dataclasses.replace(fit, values=({"compliance_m3_Pa": 3e-14},)), problem)
    fit = least_squares.parameter_columns(fit, problem)
    found = {
        candidate.effect.name: size
        for candidate, size in ties.stand_ins(fit, 0, parameters.candidates(machine), problem)
    }
    assert "mass_change" not in found
    volume = found["dead_volume"] * parameters.named("dead_volume").effect.parameters[0].typical
    assert volume == pytest.approx(
        3e-14 * machine.oil.bulk_modulus_Pa, rel=0.15
    )  # tangents; E itself is free beside it


def test_what_no_simulation_can_know(bench):
    """On the declared loop a tenth of the position's noise moves no channel by more than a third of its noise in the median,
    and what is counted never falls below the sensors' noise. All of the noise moves the acceleration ten times as much, but
    for what friction bends of it (a fifth)."""
    machine, log = bench
    noise = channels.noise_of(machine, [log])
    problem = SimulatedProblem(logs=(log,), noise=noise)
    quiet = dataclasses.replace(problem, noise=noise | {"position_m": 0.1 * noise["position_m"]})
    plain, known = problem.sigma(0), quiet.with_input_uncertainty(machine).input_uncertainty
    wide = dataclasses.replace(problem, input_uncertainty=known).sigma(0)
    assert np.all(wide >= plain)
    assert np.all(wide[problem.channels(0).index("acceleration_m_s2")] > plain[-1])  # every difference moves the load
    assert np.all(np.median(wide, axis=1) < np.hypot(1.0, 1 / 3) * plain[:, 0])
    all_of_it = problem.with_input_uncertainty(machine).sigma(0)
    spread, tenth = (np.median(np.sqrt(s[-1] ** 2 - plain[-1] ** 2)) for s in (all_of_it, wide))
    assert spread == pytest.approx(10.0 * tenth, rel=0.2)


def test_oil_that_rings_as_a_log_begins_has_any_phase(bench):
    """20 kPa at 120 Hz from the first sample on: they widen what the pressure may be off by to half of them at least in the
    first 20 ms, and by nothing after five seconds, as the model's oil comes to rest. Noise alone does not ring."""
    machine, log = bench
    noise = channels.noise_of(machine, [log])
    ringing = dataclasses.replace(
        log, pressure=log.pressure + 2e4 * np.sin(2 * np.pi * 120.0 * (log.time - log.time[0]))
    )
    found = starts.ringing_Pa(ringing, noise["pressure_bottom_Pa"])
    assert found == pytest.approx([2e4 / np.sqrt(2.0)], rel=0.15)  # in 100 samples, with noise
    assert starts.ringing_Pa(log, noise["pressure_bottom_Pa"]) == 0.0
    quiet, wide = (
        SimulatedProblem(logs=(own,), noise=noise).with_input_uncertainty(machine).input_uncertainty[0]
        for own in (log, ringing)
    )
    k, tenth = list(channels.channel_arrays(log)).index("pressure_bottom_Pa"), round(0.1 * log.rate)
    assert wide[k, :20].min() > 1e4 > 5 * quiet[k, :20].max()
    assert np.allclose(wide[k, -tenth:], quiet[k, -tenth:], rtol=0.1)


def test_coarser_volts_are_known_less(bench):
    """Where logged volts drive the model, ten times their resolution spreads the acceleration at least three times as much."""
    machine, log = bench
    spreads = []
    for resolution in (3e-4, 3e-3):
        rounded = dataclasses.replace(log, volts=resolution * np.round(log.volts / resolution))
        problem = SimulatedProblem(logs=(rounded,), noise=channels.noise_of(machine, [log]), feedback=1)
        k = problem.channels(0).index("acceleration_m_s2")
        driven = problem.with_input_uncertainty(machine).input_uncertainty[0][k]
        spreads.append(np.sqrt(np.mean(driven[problem.settle(0) :] ** 2)))
    assert spreads[1] > 3 * spreads[0]


def test_a_log_of_a_wrong_gain_starts_where_the_piston_is(bench):
    """A sensor that shows 3 % and 1 mm too much began at (y_m - 1 mm)/1.03, moving y_m'/1.03."""
    _, log = bench
    ramp = dataclasses.replace(log, position=(0.08 + 0.01 * (log.time - log.time[0]))[None])
    start, speed = starts.start_of(ramp, gain=np.array([1.03]), offset=np.array([1e-3]))
    assert start == pytest.approx(0.079 / 1.03, abs=1e-9)
    assert speed == pytest.approx(0.01 / 1.03, rel=1e-6)


@pytest.mark.parametrize("effect", ["centre_of_mass", "inertia_change"])
def test_any_component_can_be_the_size(effect):
    """A vector effect is screened along each axis, and at size 0 all its numbers are neutral: nothing but the size is added."""
    machine = load_machine("micro_motion_system")
    own = [candidate for candidate in parameters.candidates(machine) if candidate.effect.name == effect]
    assert len({candidate.effect.parameters[0].name for candidate in own}) == 3
    assert all(value == 0.0 for candidate in own for value in candidate.start().values())


def test_a_hose_and_a_dead_volume_are_one_term(bench):
    """C_hose = V/E in every balance, in any motion: each is tied with the other, whatever a refit says, with the size that does
    the same; with air in the oil, E depends on the pressure and they are two. A leak is not the same term."""
    machine, log = bench
    sigma, possible = np.ones(1), parameters.candidates(machine)
    part = balance.BalanceRows(balance=balances.balance_named("continuity", machine), sigma=sigma, rows=(0,))
    for air, expected in ((0.0, {"dead_volume"}), (0.01, set())):
        aired = changed(machine, {"effects.entrained_air.volume_fraction": air})
        problem = SimulatedProblem(logs=(log,), noise=channels.noise_of(machine, [log]))
        of_balances = balance.BalanceProblem(logs=(log,), parts=(part,))
        fit = least_squares.with_effects(
            least_squares.start_fit(aired, (), problem), [parameters.named("hose_compliance")], 0.6, problem
        )
        found = ties.same_terms(fit, 0, possible, of_balances, problem)
        assert set(found) == expected
        for rival in found.values():
            hose = fit.values[0]["compliance_m3_Pa"]
            assert rival.values[0]["volume_m3"] == pytest.approx(hose * machine.oil.bulk_modulus_Pa, rel=1e-4)
            assert rival.chi2 == pytest.approx(fit.chi2, rel=1e-3)


def test_a_hose_reads_as_a_dead_volume_with_the_error_of_the_oil(bench):
    """V = C E: 1 % of C and 2 % of E, of which each may be wrong alone, are sqrt(5) % of V; wrong together
    in opposite directions, 1 %. Columns are finite differences: 1 %."""
    machine, log = bench
    part = balance.BalanceRows(balance=balances.balance_named("continuity", machine), sigma=np.ones(1), rows=(0,))
    of_balances = balance.BalanceProblem(logs=(log,), parts=(part,))
    known = tuple(own for own in parameters.priors(machine) if "bulk_modulus" in own.key)
    fit = least_squares.with_effects(
        least_squares.start_fit(machine, known, of_balances), [parameters.named("hose_compliance")], 0.6, of_balances
    )
    hose, oil = fit.values[0]["compliance_m3_Pa"], machine.oil.bulk_modulus_Pa
    in_C, in_E = 0.01 * parameters.to_coordinate(fit.candidates[0].free()[0], hose), 0.02 / known[0].half_width
    for together, expected in ((0.0, np.sqrt(5.0)), (-1.0, 1.0)):
        covariance = np.array([[in_E**2, together * in_E * in_C], [together * in_E * in_C, in_C**2]])
        read = read_as(dataclasses.replace(fit, covariance=covariance), 0, parameters.named("dead_volume"), of_balances)
        assert read.values["volume_m3"] == pytest.approx(hose * oil, rel=1e-3)
        assert read.standard_errors["volume_m3"] == pytest.approx(0.01 * expected * hose * oil, rel=1e-2)


@pytest.mark.parametrize(("force_N", "expected"), [(5.0, {"incline"}), (-5.0, set())])
def test_an_incline_stands_for_a_force_of_its_sign_only(bench, force_N, expected):
    """m g (1 - cos) is a constant force that lifts: of one that pulls an incline is no other name (it was one, at 0 rad)."""
    machine, log = bench
    part = balance.BalanceRows(balance=balances.balance_named("force", machine), sigma=np.ones(1), rows=(0,))
    problem = SimulatedProblem(logs=(log,), noise=channels.noise_of(machine, [log]))
    fit = least_squares.with_effects(
        least_squares.start_fit(machine, (), problem), [parameters.named("constant_force")], 0.1, problem
    )
    fit = dataclasses.replace(fit, values=({"force_N": force_N},))
    of_balances = balance.BalanceProblem(logs=(log,), parts=(part,))
    found = ties.same_terms(
        fit, 0, [parameters.named("incline"), parameters.named("mass_change")], of_balances, problem
    )
    assert set(found) == expected


@pytest.mark.parametrize(("flow_max_m3_s", "nothing"), [(1e-3, True), (1e-5, False)])
def test_a_pump_limit_that_no_motion_takes_is_the_line_alone(bench, flow_max_m3_s, nothing):
    """At 1e-3 m3/s the bench takes less at any time, and the pump is a supply droop with a number more: no name of its own.
    At 1e-5 m3/s it starves the bench."""
    machine, log = bench
    starved = changed(machine, {"effects.pump_flow_limit.flow_max_m3_s": flow_max_m3_s})
    problem = SimulatedProblem(logs=(log.head(2.0),), noise=channels.noise_of(machine, [log]))
    problem = SimulatedProblem(logs=(problem.simulated(starved, 0),), noise=problem.noise)
    fit = least_squares.with_effects(
        least_squares.start_fit(machine, (), problem),
        [parameters.named("pump_flow_limit")],
        1e-4 / flow_max_m3_s,
        problem,
    )
    assert selection.inert(fit, problem) == nothing


def test_a_column_at_one_shape_promises_the_least(bench):
    """A payload's column at a wrong frequency promises less than it takes: with more than a tenth of the best it is refitted,
    once anything reaches the alarm. What has one number must reach the alarm itself."""

    def line(name, gain):
        return screening.Screened(
            candidate=parameters.named(name), size=0.1, gain_chi2=gain, share=0.0, sd=0.01,
            explained_by_others=0.0, reach=1e9, column=(),
        )  # fmt: skip

    lines = [
        line("constant_force", 158.3),
        line("flexible_payload", 90.9),
        line("dead_volume", 42.4),
        line("pump_flow_limit", 9.0),
    ]
    listed = [own.candidate.effect.name for own in selection.shortlist(lines, 1.0, 157.6)]
    assert listed == ["constant_force", "flexible_payload"]
    others = [
        line(name, 160.0)
        for name in ("mass_change", "spring", "null_offset", "incline", "hose_compliance", "null_drift")
    ]
    listed = selection.shortlist(
        [*others, line("overlap_change", 161.0), line("pressure_gain", 159.0), *lines], 1.0, 157.6
    )
    assert len(listed) == 9 and listed[-1].candidate.effect.name == "flexible_payload"
    assert selection.shortlist(lines, 1.0, 160.0) == []


def test_only_what_the_balances_leave_open_is_tried_as_a_tie(bench):
    """In the continuity a hose and a dead volume do the same, a null offset does not; what the balance does not show (a mass)
    may be a tie, and for an effect that it does not show so may all. Nor does a mass reach a misfit that is all continuity."""
    machine, log = bench
    part = balance.BalanceRows(balance=balances.balance_named("continuity", machine), sigma=np.ones(1), rows=(0,))
    problem = balance.BalanceProblem(logs=(log,), parts=(part,))
    fit = least_squares.parameter_columns(
        least_squares.start_fit(machine, parameters.priors(machine), problem), problem
    )
    possible = [parameters.named(name) for name in ("hose_compliance", "dead_volume", "null_offset", "mass_change")]
    lines = screening.screen(fit, possible, problem)
    assert ties.alike_in_balances(possible[0], possible, lines) == [possible[0], possible[1], possible[3]]
    assert ties.alike_in_balances(possible[3], possible, lines) == possible
    reach = {line.candidate.label: line.reach for line in lines}
    assert reach["mass_change"] == 0.0
    assert reach["hose_compliance"] == pytest.approx(fit.chi2)
