"""A fit of the opening seconds ends as soon as what its columns promise cannot bring it to the noise; no other fit does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hexsim import readers
from hexsim.machine import load_machine
from hexsim.signals import channels
from hexsim.tracing import rules
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.fitting import parameters, rest_level, selection
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps import hypotheses

DATA = Path(__file__).parents[1] / "data" / "bench_leakage"


def noise(n: int = 4000) -> np.ndarray:
    """White noise of two channels."""
    return np.random.default_rng(0).standard_normal((2, n))


@pytest.mark.parametrize(("width", "limit"), rules.NOISE_WINDOWS)
def test_what_the_best_change_of_its_size_takes_is_what_it_may_take(width, limit):
    """A misfit above one window's limit: the change along it with the least sum of squares that brings it to the limit is a fall
    of chi2 that may bring it there, and one with 10 % less of it may not."""
    m = np.repeat(noise(4000 // width)[:1], width, axis=1) / np.sqrt(width)
    m *= 2.0 * limit / np.sqrt(width * np.mean(m**2))  # twice the limit in means over `width`, less in shorter ones
    needed = np.sum((0.5 * m) ** 2)
    assert not selection.residual_at_noise_level([m])
    assert not selection.residual_at_noise_level([m], fall=0.9 * needed)
    lowered = 0.5 * (1.0 - 1e-9) * m
    assert selection.residual_at_noise_level([lowered]) and selection.residual_at_noise_level([m], fall=1.0001 * needed)


def test_a_share_of_the_run_counts_as_before():
    """Of 6 s of 20 s at 1.2 times the noise the whole may still be at 1.08 times: (0.3 1.2^2 + 0.7)^0.5 = 1.06; at 1.4 it may not."""
    for size, possible in ((1.2, True), (1.4, False)):
        m = size * noise() / np.sqrt(np.mean(noise() ** 2, axis=1, keepdims=True))
        assert selection.residual_at_noise_level([m], share=0.3) == possible
        assert not selection.residual_at_noise_level([m])


@pytest.fixture(scope="module")
def opening() -> SimulatedProblem:
    """Four seconds of a bench that leaks."""
    log = readers.read_log(readers.log_files(DATA, "fit")).head(4.0)
    return SimulatedProblem(logs=(log,), noise=channels.noise_of(load_machine(DATA), [log]))


def hypothesis(name: str, problem: SimulatedProblem):
    machine = load_machine(DATA)
    return least_squares.with_effects(
        least_squares.start_fit(machine, parameters.priors(machine), problem), [parameters.named(name)], 0.5, problem
    )


def worth(fit, promise: float) -> bool:
    return hypotheses.may_come_near(fit, rules.NEAR * promise, 1.0)


@pytest.mark.slow  # test_what_is_needed_stays_and_what_is_not_goes reaches it too
def test_a_fit_that_reaches_the_noise_is_the_same_with_the_rule(opening):
    """The leak that is there, begun at half its typical size: at the noise, its number within half a standard error."""
    begun = hypothesis("leakage_supply_to_chamber", opening)
    whole, ended = (
        least_squares.refine(begun, opening, stated=True),
        least_squares.refine(begun, opening, fresh=True, worth=worth),
    )
    assert selection.residual_at_noise_level(whole.misfit)
    key = "conductance_m3_s_Pa"
    assert ended.values[0][key] == pytest.approx(whole.values[0][key], abs=0.5 * whole.standard_errors()[0][key])


def counted(monkeypatch) -> list[int]:
    """How many residuals are simulated from here on, as the one number of a list."""
    counts, simulated = [0], SimulatedProblem.residual

    def residual(problem, machine, i):
        counts[0] += 1
        return simulated(problem, machine, i)

    monkeypatch.setattr(SimulatedProblem, "residual", residual)
    return counts


def test_known_columns_tell_that_a_hypothesis_is_hopeless(opening, monkeypatch):
    """A spring in the place of the leak, with the declared machine's columns at hand: none of its declared parameters is
    simulated again before it is refused. Without them all are."""
    begun = hypothesis("spring", opening)
    declared = least_squares.start_fit(begun.machine, begun.priors, opening)
    counts, known = counted(monkeypatch), least_squares.parameter_columns(declared, opening)
    made = []
    for near in (known, declared):
        counts[0] = 0
        assert hypotheses.simulated_fit(begun, opening, near) is None
        made.append(counts[0])
    assert made[0] <= 2 and made[1] > len(begun.priors)


def test_a_fit_that_cannot_ends_early_and_is_far(opening, monkeypatch):
    """A spring in its place: the whole fit stays far above the noise, and the rule ends it with less than half the simulations."""
    counts = counted(monkeypatch)
    begun = hypothesis("spring", opening)
    made = []
    for rule in (None, worth):
        counts[0] = 0
        fit = least_squares.refine(replace(begun), opening, fresh=True, worth=rule)
        made.append(counts[0])
        assert fit.reduced > rules.NEAR
    assert made[1] < 0.5 * made[0]


def test_columns_are_corrected_by_what_a_step_has_shown(opening):
    """Columns of a machine far off, corrected by a step: with the effect's own they say what that step did; those of numbers that
    it left alone stay. Where the effect's own is corrected too, they say so by themselves."""
    begun = hypothesis("leakage_supply_to_chamber", opening)
    fit = least_squares.parameter_columns(begun, opening)
    assert fit.columns is not None
    columns = list(zip(fit.columns, least_squares.effect_columns(fit, opening), strict=True))
    step = np.zeros(len(begun.priors) + 1)
    step[[0, 2, -1]] = 0.8, -0.6, 0.4
    after = least_squares.evaluate(least_squares.fit_at(fit, least_squares.coordinates_of(fit) + step), opening)
    scale = np.array([np.sum(own**2) for own in np.concatenate(columns[0])])
    [[found]] = least_squares.corrected(columns, step, scale, fit, after)
    own, weight = columns[0][0], scale * step / (step @ (scale * step))
    did = fit.misfit[0] - after.misfit[0]
    off = did - np.tensordot(step, np.concatenate(columns[0]), 1)
    assert np.std(off) > 0.1 * np.std(did)
    left = did - np.tensordot(step[:-1], found, 1) - step[-1] * (columns[0][1][0] + weight[-1] * off)
    assert np.std(left) < 1e-9 * np.std(did)
    assert np.array_equal(found[1], own[1]) and not np.array_equal(found[0], own[0])
    [both] = least_squares.corrected(columns, step, scale, fit, after, many=True)
    assert np.std(did - np.tensordot(step, np.concatenate(both), 1)) < 1e-9 * np.std(did)


def test_many_effects_are_fitted_with_corrected_columns(opening, monkeypatch):
    """A leak beside nuisance effects: with columns that are corrected the fit ends as near the noise, in half the simulations."""
    possible = parameters.candidates(load_machine(DATA))
    small = [own for own in rest_level.ordinary_effects(possible) if np.isfinite(own.effect.parameters[0].neutral)]
    begun = least_squares.with_effects(hypothesis("leakage_supply_to_chamber", opening), small, 0.0, opening)
    counts, made, left = counted(monkeypatch), [], []
    for many in (False, True):
        counts[0] = 0
        fit = least_squares.refine(replace(begun), opening, fresh=True, many=many)
        made.append(counts[0])
        left.append(fit.reduced)
    assert left[1] < 1.02 * left[0]
    assert made[1] < 0.5 * made[0]


def test_what_is_needed_stays_and_what_is_not_goes(opening):
    """Of a spring and the leak that is there the spring is superfluous; the refit without the leak ends early, and the leak stays."""
    leak, spring = parameters.named("leakage_supply_to_chamber"), parameters.named("spring")
    both = least_squares.with_effects(hypothesis("spring", opening), [leak], 0.5, opening)
    fit = least_squares.refine(both, opening, stated=True)
    assert fit.candidates == (spring, leak) and selection.residual_at_noise_level(fit.misfit)
    assert selection.pruned(fit, opening).candidates == (leak,)
