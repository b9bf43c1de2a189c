"""The numbers of a fit in their units, each with its error; and what an effect and the declared parameter that it adds to make
together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hexsim.hydraulics.effects.effect import EffectParameter
from hexsim.recording.quantity import split_key
from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit
from hexsim.tracing.fitting.parameters import Candidate, to_coordinate

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Number:
    """A fitted number: what it is of, its key with the unit, value, standard error; place among the coordinates.

    slope: of the value over its coordinate.  named: is it of an effect that the trace names?
    """

    of: str
    key: str
    unit: str
    value: float
    standard_error: float
    slope: float
    place: int
    named: bool


@dataclass(frozen=True, kw_only=True)
class Total:
    """A parameter of the machine with an effect on top of it: what is declared, and the sum [SI] with its standard error.

    half_width: relative, of what is declared.  adds: standard error of the effect's number alone.
    """

    key: str
    declared: float
    half_width: float
    value: float
    standard_error: float
    adds: float

    @property
    def known_better(self) -> bool:
        """Is the sum known much better than the effect alone?"""
        return self.standard_error < rules.SHARPENED * self.adds


def numbers_of(fit: Fit, named: Sequence[str]) -> list[Number]:
    """Every fitted number with its error; none without a covariance. named: labels of the effects that are named."""
    if fit.covariance is None:
        return []
    sd = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    found = []
    for prior, deviation in zip(fit.priors, fit.deviations, strict=True):
        slope, k = prior.half_width * prior.declared, len(found)
        found.append(Number(of="declared", key=prior.key, unit=split_key(prior.key)[1],
                            value=float(prior.declared * (1.0 + deviation)), standard_error=float(abs(slope) * sd[k]),
                            slope=slope, place=k, named=False))  # fmt: skip
    for candidate, values in zip(fit.candidates, fit.values, strict=True):
        for number in candidate.free():
            k, value = len(found), values[number.name]
            slope = slope_of(number, value)
            found.append(Number(of=candidate.label, key=number.name, unit=number.unit, value=float(value),
                                standard_error=abs(slope) * float(sd[k]), slope=slope, place=k,
                                named=candidate.label in named))  # fmt: skip
    return found


def slope_of(number: EffectParameter, value: float) -> float:
    """Of a value over its coordinate; a size that vanishes at infinity falls as its coordinate grows."""
    here = to_coordinate(number, value)
    if math.isinf(number.neutral):
        return -number.typical / max(here, rules.LEAST_STEP) ** 2
    return (abs(number.typical) or 1.0) / number.power * max(abs(here), rules.LEAST_STEP) ** (1.0 / number.power - 1.0)


def totals_of(fit: Fit, candidate: Candidate) -> list[Total]:
    """Of an effect whose number adds to declared parameters that may be off: the sums, which the logs see.

    What is declared and what is added trade: each may be known badly, and the sum well. The fit's errors say how well.
    A leg that has a value of its own in the machine file, or a second effect of the same name, is left out.
    """
    covariance, sums = fit.covariance, candidate.effect.parameters[0].adds_to
    if covariance is None or not sums or fit.machine.leg:
        return []
    if sum(own.effect.name == candidate.effect.name for own in fit.candidates) != 1:
        return []
    numbers = numbers_of(fit, [])
    declared = {number.key: number for number in numbers if number.of == "declared"}
    effect = next(number for number in numbers if number.of == candidate.label)
    found = []
    for prior in fit.priors:
        if prior.key not in sums:
            continue
        own = declared[prior.key]
        places = [own.place, effect.place]
        slopes = np.array([own.slope, effect.slope])
        variance = slopes @ covariance[np.ix_(places, places)] @ slopes
        found.append(Total(key=prior.key, declared=prior.declared, half_width=prior.half_width, value=own.value + effect.value,
                           standard_error=float(np.sqrt(max(variance, 0.0))), adds=effect.standard_error))  # fmt: skip
    return found
