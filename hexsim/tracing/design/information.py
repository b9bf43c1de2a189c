"""What a motion would tell: how far two hypotheses stay apart in it, and how well it would know their numbers.

Sensitivities of all channels to the declared parameters and to the numbers of the effects, X (a row a number), at the
noise or at the level of what the model leaves unexplained, whichever is larger. With A the normal matrix of the logs
that there are, prior included, and d the difference of two answers in a new motion

    separation   d'd - b'(A + X X')^-1 b,  b = X d      the part of d that no change of the numbers takes up (T-optimal)
    errors       diag (A + X X')^-1                                                                        (D-optimal)

Atkinson and Fedorov, Biometrika 1975. Linear in the numbers: far from the fitted values it is a guide only.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hexsim.hydraulics.effects.effect import Effect
from hexsim.machine.files import changed
from hexsim.signals.channels import kind_of
from hexsim.signals.log import Log
from hexsim.tracing import rules
from hexsim.tracing.balances.null import with_noise
from hexsim.tracing.design.believed import COARSE, calm_samples, enters_a_cushion, reproduced
from hexsim.tracing.fitting import rest_level
from hexsim.tracing.fitting.covariance import inverse
from hexsim.tracing.fitting.fit import Fit, all_columns, refine, start_fit_at
from hexsim.tracing.fitting.parameters import end_of_range
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.problems.simulated import SimulatedProblem

Array = np.ndarray
UNKNOWN = float(np.sqrt(np.finfo(float).eps))  # share of what is known after a motion below which nothing is


class Knowing(NamedTuple):
    """What a number is worth."""

    sharp: float = 0.1  # a number known to this share is sharp
    enough: float = 10.0  # times the needed separation: more is worth nothing
    credible: float = 2.0  # information a coordinate: errors smaller by e


KNOWING = Knowing()


@dataclass(frozen=True, kw_only=True)
class Number:
    """A number of an effect: its label, its value, the error reported now, its place among the coordinates."""

    effect: str
    name: str
    value: float
    standard_error: float
    place: int
    absolute: bool = False  # a phase: its error counts as it is
    nothing: bool = False  # the number says that there is nothing, see `says_nothing`

    @property
    def relative(self) -> float:
        return self.relative_of(self.standard_error)

    def relative_of(self, error: float) -> float:
        """An error as a share of the number; of nothing, nothing."""
        if self.nothing:
            return 0.0
        return error if self.absolute else error / abs(self.value) if self.value else float("inf")


def says_nothing(effect: Effect, name: str, value: float) -> bool:
    """0; of a number that vanishes at infinity its largest; of one beside the effect's size an end of its range: a spool of
    2 kHz beside the limit of its speed does not lag. And one that is of the machine file alone."""
    own = next(one for one in effect.parameters if one.name == name)
    if own.of_the_file:
        return True
    end = end_of_range(own, value)
    if own is effect.parameters[0]:
        return value == 0.0 or (end == "upper" and bool(np.isinf(own.neutral)))
    return value == 0.0 or bool(end)


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis:
    """A fitted machine that the logs do not rule out, with what they know of its coordinates: normal matrix (k, k).

    named: labels of the effects whose numbers are asked for; empty: all, {""}: none. Nuisance effects beside them are not.
    """

    label: str
    fit: Fit
    known: Array
    named: frozenset[str] = frozenset()

    @property
    def numbers(self) -> list[Number]:
        """The numbers of its effects."""
        errors, place, found = self.fit.standard_errors(), len(self.fit.priors), []
        for candidate, values, own in zip(self.fit.candidates, self.fit.values, errors, strict=True):
            if self.named and candidate.label not in self.named:
                place += len(candidate.free())
                continue
            for parameter in candidate.free():
                error = own.get(parameter.name, float("nan"))
                found.append(
                    Number(
                        effect=candidate.label,
                        name=parameter.name,
                        value=values[parameter.name],
                        standard_error=error,
                        place=place,
                        absolute=parameter.typical == 0.0,
                        nothing=says_nothing(candidate.effect, parameter.name, values[parameter.name]),
                    )
                )
                place += 1
        return found


def normal_matrix(columns: list[Array]) -> Array:
    """X X' over all logs and channels."""
    return np.sum([(flat := own.reshape(own.shape[0], -1)) @ flat.T for own in columns], axis=0)


def hypothesis(label: str, fit: Fit, problem: SimulatedProblem, named: frozenset[str] = frozenset()) -> Hypothesis:
    """With what the logs of the problem know of it, the declared uncertainty of its parameters, and the ordinary size of
    nuisance effects."""
    known = normal_matrix(all_columns(start_fit_at(fit, problem), problem)) + np.diag(rest_level.prior_precision(fit))
    return Hypothesis(label=label, fit=fit, known=known, named=named)


@dataclass(frozen=True, kw_only=True, eq=False)
class Promise:
    """What a motion would give. separations: pair of labels -> chi2, or the measure of `rest`; errors: of each number of
    the first hypothesis."""

    separations: dict[tuple[str, str], float]
    errors: tuple[float, ...]
    information: float  # log of the ratio of the determinants, after to before, a coordinate; of a rest see `rest`
    needed: float = 4 * rules.SIGNIFICANT  # least separation that separates
    measure: str = "chi2"
    told: Array | None = None  # normal matrix of the motion
    hangs_on: tuple[str, ...] = ()  # of each error, see `believed.hangs_on`

    def worth(self, wanted: int | None) -> float:
        """What a design makes as large as it can. wanted: the number to be sharpened, where nothing is to be separated.

        A separation counts with the information on all numbers, an average of them (Atkinson's DT-optimality, 2008): a
        motion that only tells two hypotheses apart shows little of a third. A pair that no motion separates weighs alike
        in all. Information counts up to credible: small steps and slow strokes promise any amount, because near a standstill
        differences grow, and a real machine keeps little of it.
        """
        if self.separations:
            sizes = np.clip(list(self.separations.values()), rules.SLIGHT * self.needed, KNOWING.enough * self.needed)
            return float(np.mean(np.log(sizes))) + min(self.information, KNOWING.credible)
        error = 0.0 if wanted is None else self.errors[wanted]
        return min(self.information, KNOWING.credible) - (float(np.log(error)) if 0.0 < error < np.inf else 0.0)

    @property
    def tied(self) -> list[tuple[str, str]]:
        """Pairs that stay together."""
        return [pair for pair, size in self.separations.items() if size < self.needed]

    def words(self, size: float) -> str:
        """A separation for a reader."""
        if self.measure == "chi2":
            return f"chi2 {size:.3g}"
        return f"the second leaves {100 * (np.exp(size) - 1.0):.0f} % more mean square than the rest"


def promise(hypotheses: list[Hypothesis], log: Log, noise: dict[str, float]) -> Promise:
    """What a motion, given as a log of its setpoints, would tell of the hypotheses.

    Where what drives the machine spreads its answer far beyond the noise, nothing counts: there a real machine is elsewhere.
    A motion with much of that, slow or small, promises nothing: no trace reaches the noise in it.
    """
    first = hypotheses[0]
    problem = SimulatedProblem(logs=(log,), noise=noise).with_input_uncertainty(first.fit.fitted_machine())
    settle = problem.settle(0)
    answers = in_parallel(lambda one: problem.answer(one.fit.fitted_machine(), 0)[:, settle:], hypotheses)
    sigma = problem.sigma(0)[:, settle:]
    calm = calm_samples(problem)
    positions = answers[0][[kind_of(name) == "position" for name in problem.channels(0)]]
    if enters_a_cushion(first.fit.fitted_machine(), positions) or not all(np.isfinite(own).all() for own in answers):
        return Promise(separations={}, errors=tuple(np.inf for _ in first.numbers), information=-np.inf)
    pairs = [(i, k) for i in range(len(hypotheses)) for k in range(i + 1, len(hypotheses))]
    labels = {(i, k): (hypotheses[i].label, hypotheses[k].label) for i, k in pairs}
    if np.mean(calm) < rules.MAIN:
        return nothing_told(first, labels.values())
    there = start_fit_at(first.fit, problem)
    fine, coarse = (all_columns(there, problem, share)[0] for share in (1.0, COARSE))
    inverse_before = inverse(first.known)
    calm &= reproduced(fine, coarse, np.sqrt(np.diag(inverse_before)), log.rate)
    if np.mean(calm) < rules.MAIN:
        return nothing_told(first, labels.values())
    flat = (fine * calm).reshape(len(fine), -1)
    after = first.known + (new := flat @ flat.T)
    inverse_after = inverse(after)
    separations = {}
    for i, k in pairs:
        d = ((answers[k] - answers[i]) / sigma * calm).ravel()
        b = flat @ d
        separations[labels[i, k]] = max(float(d @ d - b @ inverse_after @ b), 0.0)
    shrink = np.sqrt(np.maximum(np.diag(inverse_after), 0.0) / np.maximum(np.diag(inverse_before), 1e-300))
    return Promise(
        separations=separations, errors=shrunk(first, shrink), information=growth(first.known, after), told=new
    )


def nothing_told(first: Hypothesis, pairs: Iterable[tuple[str, str]]) -> Promise:
    """Of a motion in which too little can be believed."""
    now = tuple(number.standard_error for number in first.numbers)
    return Promise(separations=dict.fromkeys(pairs, 0.0), errors=now, information=-KNOWING.credible)


def growth(before: Array, after: Array) -> float:
    """Log of the ratio of the determinants a coordinate. A number at its bound, that no log shows, adds nothing."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(after), 1e-300))
    ridge = UNKNOWN * np.eye(len(after))
    sizes = [np.linalg.slogdet(matrix * scale[:, None] * scale + ridge)[1] for matrix in (before, after)]
    return float(sizes[1] - sizes[0]) / max(len(after), 1)


def shrunk(one: Hypothesis, share: Array) -> tuple[float, ...]:
    """Errors of its numbers where the error of every coordinate is this share of what it is now.

    In coordinates, because a reported error ends at the bounds of its number.
    """
    if one.fit.covariance is None:
        return tuple(float("nan") for _ in one.numbers)
    fit = replace(one.fit, covariance=one.fit.covariance * np.outer(share, share))
    return tuple(number.standard_error for number in replace(one, fit=fit).numbers)


def with_load(fit: Fit, load_kg: float) -> Fit:
    """A fit of the machine that people can put this on; exactly known."""
    return replace(fit, machine=changed(fit.machine, {"load.additional_mass_kg": load_kg}))


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenRefits:
    """Hypotheses refitted by simulation, the best first. problem: the logs that there are, at the noise or the rest."""

    hypotheses: tuple[Hypothesis, ...]
    problem: SimulatedProblem

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(one.label for one in self.hypotheses)

    @property
    def first(self) -> Hypothesis:
        return self.hypotheses[0]

    def promise(self, log: Log) -> Promise:
        """What a motion, given as a log of its setpoints, would tell; linear."""
        return promise(list(self.hypotheses), log, self.problem.noise)

    def checked(self, log: Log, found: Promise) -> Promise:
        """The promise as the trace will judge the motion: all hypotheses refitted to the logs and to it, with its noise."""
        whole = self.rehearsal(log)
        first, *others = in_parallel(
            lambda one: refine(start_fit_at(one.fit, whole), whole, stated=True), self.hypotheses
        )
        left = {
            (self.labels[0], label): max(other.chi2 - first.chi2, 0.0)
            for label, other in zip(self.labels[1:], others, strict=True)
        }
        separations = {pair: min(size, left.get(pair, size)) for pair, size in found.separations.items()}
        return replace(found, separations=separations)

    def rehearsal(self, log: Log) -> SimulatedProblem:
        """The logs that there are and the motion, as the first hypothesis would write it."""
        machine = self.first.fit.fitted_machine()
        alone = replace(self.problem, logs=(log,), input_uncertainty=())
        written = with_noise(
            alone.simulated(machine, 0),
            self.problem.noise,
            machine.sensors.position_resolution_m,
            np.random.default_rng(0),
        )
        whole = replace(self.problem, logs=(*self.problem.logs, written), input_uncertainty=())
        return whole.with_input_uncertainty(machine)

    def with_load(self, load_kg: float) -> OpenRefits:
        """About the machine that people can put this on."""
        own = tuple(replace(one, fit=with_load(one.fit, load_kg)) for one in self.hypotheses)
        return replace(self, hypotheses=own)
