"""Generalised least squares with the spectrum of its own residual, and errors from its curvature and from the spread of its numbers.

    minimise  sum 2 w [log S(f) + |R(f; theta)|^2 / S(f)] + sum ((theta - mean) / sd)^2

in turn by theta (scipy's trust region) and by S. What is left can stand for what is missing, and the iteration then rests there: it
begins from a white spectrum and from a given one, and the likelier end counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from hexsim.errors import HexsimError
from hexsim.inference.contract import Number, Problem
from hexsim.inference.spectrum import Spectrum, spectrum_of, windows_of

Array = np.ndarray
FAR = 1e9  # coefficient, in standard deviations, where the model cannot be run
WHITE = np.array([-60.0, 60.0])  # log Hz


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """theta with covariance (curvature alone), spectra of the channels, cost = -2 log p. spread: of each number over bands and over
    stretches beyond its error, one standard deviation."""

    problem: Problem
    theta: Array
    covariance: Array
    spectra: list[Spectrum]
    cost: float
    spread: Array

    @property
    def names(self) -> list[str]:
        return [number.name for number in self.problem.numbers]

    @property
    def errors(self) -> Array:
        """Of each number: curvature, and in quadrature what it differs by from band to band and from stretch to stretch; infinite
        where nothing that was measured moves with it."""
        variance = np.diag(self.covariance)
        return np.where(variance > 0.0, np.hypot(np.sqrt(np.maximum(variance, 0.0)), self.spread), np.inf)

    def value(self, name: str) -> float:
        return float(self.theta[self.names.index(name)])

    def error(self, name: str) -> float:
        return float(self.errors[self.names.index(name)])


class Coefficients:
    """Stretches of a problem in the frequency domain, by channel."""

    def __init__(self, problem: Problem, at: Sequence[int], tapered: bool = True) -> None:
        self.problem, self.at = problem, list(at)
        count = len(problem.channels)
        self.windows = windows_of([problem.stretches[i] for i in self.at], count, tapered)
        self.places = [(k, c) for c in range(count) for k, row in enumerate(self.windows) if row[c] is not None]
        if not self.places:
            raise HexsimError(
                "no output of the model is in the logs long enough: name an output as its column is named"
            )
        self.log_f = [self.window(place).log_f for place in self.places]
        self.weight = [self.window(place).weight for place in self.places]
        self.of_channel = [[j for j, (_, c) in enumerate(self.places) if c == channel] for channel in range(count)]

    def window(self, place: tuple[int, int]):
        window = self.windows[place[0]][place[1]]
        assert window is not None
        return window

    def residuals(self, theta: Array) -> list[Array]:
        values = self.problem.residuals(theta, self.at)
        return [self.window((k, c)).of(values[k][:, c]) for k, c in self.places]

    def slopes(self, theta: Array) -> list[Array]:
        values = self.problem.slopes(theta, self.at)
        return [self.window((k, c)).of(values[k][:, c]) for k, c in self.places]

    def spectra(self, residuals: Sequence[Array], numbers: int) -> list[Spectrum]:
        """Of every channel; the channels share the numbers evenly."""
        found = []
        for places, noise in zip(self.of_channel, self.problem.noises, strict=True):
            if not places:
                found.append(Spectrum(log_f=WHITE, log_s=np.zeros(2), edges=np.zeros(0), counts=np.zeros(1)))
                continue
            power = np.concatenate([np.abs(residuals[j]) ** 2 for j in places])
            x, w = (np.concatenate([part[j] for j in places]) for part in (self.log_f, self.weight))
            own = spectrum_of(x, power, w, numbers / sum(map(bool, self.of_channel)))
            found.append(own if np.isnan(noise) else replace(own, log_s=np.maximum(own.log_s, 2.0 * np.log(noise))))
        return found

    def white(self, residuals: Sequence[Array]) -> list[Spectrum]:
        """Flat spectra with the residuals' mean powers."""
        level = []
        for places in self.of_channel:
            power = [np.abs(residuals[j]) ** 2 for j in places]
            weight = [self.weight[j] for j in places]
            level.append(float(np.average(np.concatenate(power), weights=np.concatenate(weight))) if places else 1.0)
        return [
            Spectrum(log_f=WHITE, log_s=np.full(2, np.log(one + 1e-300)), edges=np.zeros(0), counts=np.ones(1))
            for one in level
        ]

    def scales(self, spectra: Sequence[Spectrum]) -> list[Array]:
        """sqrt(2 w / S) of every coefficient."""
        return [np.sqrt(2.0 * self.weight[j] / spectra[c].at(self.log_f[j])) for j, (_, c) in enumerate(self.places)]

    def log_determinant(self, spectra: Sequence[Spectrum]) -> float:
        return float(
            sum(
                np.sum(2.0 * self.weight[j] * np.log(spectra[c].at(self.log_f[j])))
                for j, (_, c) in enumerate(self.places)
            )
        )


def real(parts: Sequence[Array], scales: Sequence[Array]) -> Array:
    """Complex coefficients, scaled, as one real array (2 m, ...)."""
    scaled = [part * scale.reshape(-1, *[1] * (part.ndim - 1)) for part, scale in zip(parts, scales, strict=True)]
    whole: Any = np.concatenate(scaled)
    return np.concatenate([whole.real, whole.imag])


def prior_of(numbers: Sequence[Number]) -> tuple[Array, Array]:
    """Means (0 where there is none) and precisions."""
    sd = np.array([number.sd for number in numbers])
    known = np.isfinite(sd)
    return np.where(known, [number.mean for number in numbers], 0.0), np.where(
        known, 1.0 / np.where(known, sd, 1.0), 0.0
    )


def fit(
    problem: Problem,
    at: Sequence[int] | None = None,
    begin: Array | None = None,
    spectra: Sequence[Spectrum] | None = None,
    evaluations: int = 40,
    with_spread: bool = True,
    white: bool = True,
    keep_local: bool = False,
    by_error: bool = False,
) -> Fit:
    """The numbers of a problem from these stretches (default all). begin: theta. spectra: a second start; white: is the first one used?
    keep_local: local numbers stay as they begin. by_error: least squares with a flat spectrum, for what a long simulation is to leave
    least of; errors are those of such a fit beside the residual's own spectrum.

    Raises HexsimError where the model cannot be run from any start.
    """
    data = Coefficients(problem, range(len(problem.stretches)) if at is None else at)
    begin = np.array([number.start for number in problem.numbers]) if begin is None else begin
    if by_error:
        return fit_by_error(data, begin, evaluations)
    starts = ([None] if white or spectra is None else []) + ([list(spectra)] if spectra is not None else [])
    free = np.array([not (keep_local and number.local) for number in problem.numbers], dtype=bool)
    ends = [iterated(data, begin, start, evaluations, free) for start in starts]
    theta, found, cost = min(ends, key=lambda end: end[2])
    check_finite(data, theta)
    covariance, spread = curvature(data, theta, found, with_spread)
    return Fit(problem=problem, theta=theta, covariance=covariance, spectra=found, cost=cost, spread=spread)


def fit_by_error(data: Coefficients, begin: Array, evaluations: int) -> Fit:
    """Ordinary least squares; covariance A^-1 B A^-1, A: its curvature, B: the scores' variance with the spectrum of what is left."""
    numbers = data.problem.numbers
    even = Coefficients(data.problem, data.at, tapered=False)
    theta = least(
        even, begin, even.white(finite(even.residuals(begin))), evaluations, np.ones(len(numbers), dtype=bool)
    )
    check_finite(data, theta)
    left = finite(data.residuals(theta))
    flat, found = data.white(left), data.spectra(left, len(numbers))
    scale = np.array([number.scale for number in numbers])
    x = whitened(data, theta, flat)[1] * scale
    ratio = np.concatenate(
        [np.square(a / b) for a, b in zip(data.scales(flat), data.scales(found), strict=True)] or [np.zeros(0)]
    )
    inverse = np.linalg.pinv(x.T @ x + np.diag((prior_of(numbers)[1] * scale) ** 2), hermitian=True, rcond=1e-13)
    middle = x.T @ (x * np.concatenate([ratio, ratio])[:, None]) + np.diag((prior_of(numbers)[1] * scale) ** 2)
    covariance = inverse @ middle @ inverse * np.outer(scale, scale)
    spread = curvature(data, theta, found, True)[1]
    cost = cost_of(data, theta, left, flat)
    return Fit(problem=data.problem, theta=theta, covariance=covariance, spectra=found, cost=cost, spread=spread)


def check_finite(data: Coefficients, theta: Array) -> None:
    """Raises HexsimError where the model cannot be run."""
    if not all(np.isfinite(part).all() for part in data.residuals(theta)):
        raise HexsimError(
            "the simulation leaves the finite numbers with every number that was tried: check signs and starts, or give smaller steps"
        )


def iterated(
    data: Coefficients,
    theta: Array,
    spectra: list[Spectrum] | None,
    evaluations: int,
    free: Array,
    *,
    most_rounds: int = 6,  # of numbers and spectrum in turn, at most
    settled_nats: float = 0.2,  # nats: an end of the rounds
) -> tuple[Array, list[Spectrum], float]:
    """Numbers and spectrum in turn: (theta, spectra, cost)."""
    numbers, cost = data.problem.numbers, np.inf
    if spectra is None:
        spectra = data.white(finite(data.residuals(theta)))
    for _ in range(most_rounds):
        new = least(data, theta, spectra, evaluations, free)
        left = finite(data.residuals(new))
        estimated = data.spectra(left, len(numbers))
        now = cost_of(data, new, left, estimated)
        if now > cost - 2.0 * settled_nats:
            return (theta, spectra, cost) if cost < now else (new, estimated, now)
        theta, spectra, cost = new, estimated, now
    return theta, spectra, cost


def cost_of(data: Coefficients, theta: Array, left: Sequence[Array], spectra: Sequence[Spectrum]) -> float:
    mean, precision = prior_of(data.problem.numbers)
    q = float(np.sum(real(left, data.scales(spectra)) ** 2)) + float(np.sum(((theta - mean) * precision) ** 2))
    return q + data.log_determinant(spectra)


def finite(parts: Sequence[Array]) -> list[Array]:
    return [np.where(np.isfinite(part), part, FAR) for part in parts]


def least(data: Coefficients, theta: Array, spectra: Sequence[Spectrum], evaluations: int, free: Array) -> Array:
    """Numbers with this spectrum, inside their bounds. free: those that are searched."""
    numbers = data.problem.numbers
    if not free.any():
        return theta
    scales, (mean, precision) = data.scales(spectra), prior_of(numbers)
    low, high = np.array([number.low for number in numbers]), np.array([number.high for number in numbers])
    scale = np.array([number.scale for number in numbers])
    room = np.minimum(1e-6 * scale, 0.25 * (high - low))

    begin = np.clip(theta, low + room, high - room)
    begin[~free] = theta[~free]

    def whole(x: Array) -> Array:
        made = begin.copy()
        made[free] = x
        return made

    def residuals(x: Array) -> Array:
        new = whole(x)
        return np.concatenate([np.clip(real(finite(data.residuals(new)), scales), -FAR, FAR), (new - mean) * precision])

    def jacobian(x: Array) -> Array:
        return np.concatenate([bounded(real(data.slopes(whole(x)), scales)), np.diag(precision)])[:, free]

    with np.errstate(divide="ignore", invalid="ignore"):  # scipy divides by the slope of a number that does nothing
        found = least_squares(
            residuals,
            begin[free],
            jac=jacobian,  # pyright: ignore[reportArgumentType]
            bounds=(low[free], high[free]),
            x_scale=scale[free],
            max_nfev=evaluations,
            xtol=1e-10,
            ftol=1e-8,
            gtol=1e-12,
        )
    return whole(found.x)


def whitened(data: Coefficients, theta: Array, spectra: Sequence[Spectrum]) -> tuple[Array, Array]:
    """Residual (2 m,) and slopes (2 m, k) with unit variance."""
    scales = data.scales(spectra)
    slopes = bounded(real(data.slopes(theta), scales))  # first: their simulation gives the residual, too
    return real(finite(data.residuals(theta)), scales), slopes


def bounded(slopes: Array) -> Array:
    """Those of a motion that runs away, too."""
    return np.clip(np.nan_to_num(slopes), -(FAR**2), FAR**2)


def curvature(data: Coefficients, theta: Array, spectra: Sequence[Spectrum], with_spread: bool) -> tuple[Array, Array]:
    """Covariance from the curvature, and the spread of each number over bands and over stretches."""
    numbers = data.problem.numbers
    if not numbers:
        return np.zeros((0, 0)), np.zeros(0)
    rest, slopes = whitened(data, theta, spectra)
    _, precision = prior_of(numbers)
    scale = np.array([number.scale for number in numbers])
    x = slopes * scale
    inner = x.T @ x + np.diag((precision * scale) ** 2)
    covariance = np.linalg.pinv(inner, hermitian=True, rcond=1e-13) * np.outer(scale, scale)
    spread = np.zeros(len(numbers))
    if with_spread:
        f = np.concatenate([*data.log_f, *data.log_f])
        stretch = np.concatenate(
            [np.full(len(self_f), k) for self_f, (k, _) in zip(data.log_f, data.places, strict=True)] * 2
        )
        for i in range(len(numbers)):
            if numbers[i].local:
                continue
            apart = [spread_of(x, rest, inner, i, labels) for labels in (bands(x, inner, i, f), stretch)]
            spread[i] = scale[i] * float(np.hypot(apart[0], apart[1]))
    return covariance, spread


def bands(
    x: Array,
    inner: Array,
    i: int,
    f: Array,
    *,
    n_bands: int = 4,  # of equal information, over which a number must be the same
) -> Array:
    """A label for every coefficient: bands of equal information about number i beside the others."""
    own = beside(x, inner, i) ** 2
    order = np.argsort(f, kind="stable")
    share = np.cumsum(own[order]) / max(float(own.sum()), 1e-300)
    edges = f[order][np.minimum(np.searchsorted(share, np.arange(1, n_bands) / n_bands), len(f) - 1)]
    return np.searchsorted(edges, f, side="left")


def beside(x: Array, inner: Array, i: int) -> Array:
    """Column i without what the others can do for it."""
    others = [j for j in range(x.shape[1]) if j != i]
    if not others:
        return x[:, i]
    share = np.linalg.lstsq(inner[np.ix_(others, others)], inner[others, i], rcond=1e-12)[0]
    return x[:, i] - x[:, others] @ share


def spread_of(
    x: Array,
    rest: Array,
    inner: Array,
    i: int,
    labels: Array,
    *,
    nothing_share: float = 1e-8,  # of a number's information, left beside the others: none
    clear_spreads: float = 3.0,  # standard deviations of chi2 that a spread must have: moments of four values scatter
) -> float:
    """Standard deviation of a number between labels beyond its errors there, by moments (DerSimonian and Laird 1986).

    To first order about the fit; the other numbers stay as they are.
    """
    own = beside(x, inner, i)
    if float(own @ own) < nothing_share * inner[i, i]:
        return 0.0  # it trades with others altogether
    information = np.bincount(labels, own * own)
    kept = information > 1e-3 * information.sum()
    if kept.sum() < 2:
        return 0.0
    information = information[kept]
    step = -np.bincount(labels, own * rest)[kept] / information
    mean = float(np.average(step, weights=information))
    freedom = len(step) - 1
    excess = float(np.sum(information * (step - mean) ** 2)) - freedom
    if excess < clear_spreads * np.sqrt(2.0 * freedom):
        return 0.0
    return float(np.sqrt(excess / (information.sum() - np.sum(information**2) / information.sum())))
