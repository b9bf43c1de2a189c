"""What is known of the coordinates of a fit at the level of the rest before any log."""

from __future__ import annotations

import numpy as np

from hexsim.hydraulics.effects import EffectParameter
from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit, coordinates_of
from hexsim.tracing.fitting.parameters import Candidate, coordinate_bounds, named, to_coordinate, to_value

Array = np.ndarray


def prior_precision(fit: Fit) -> Array:
    """Of every coordinate (k,): 3 over the square of its reach for declared parameters and nuisance effects, of half its
    range for a number that is bounded, else 0.

    Without it a nuisance effect that can do a little of what a large effect does takes that much of its number, and a
    polytropic exponent, which no log shows, goes to a bound and takes the gas volume with it.
    """
    precision = [3.0] * len(fit.priors)
    for candidate in fit.candidates:
        for number in candidate.free():
            low, high = coordinate_bounds(number)
            reach = 0.5 * (high - low) if is_bounded(number) else max(-low, high, 1e-9)
            precision.append(3.0 / reach**2 if is_held(candidate) or is_bounded(number) else 0.0)
    return np.array(precision)


def off_prior(fit: Fit) -> Array:
    """How far every coordinate is from where its prior is centred (k,): 0, or the middle of what is bounded."""
    middle = [0.0] * len(fit.priors)
    for candidate in fit.candidates:
        middle += [0.5 * sum(coordinate_bounds(n)) if is_bounded(n) else 0.0 for n in candidate.free()]
    return coordinates_of(fit) - np.array(middle)


def middle_of(number: EffectParameter) -> float:
    """Of a bounded number what is expected before any log."""
    return to_value(number, 0.5 * sum(coordinate_bounds(number)))


def is_bounded(number: EffectParameter) -> bool:
    """Does physics bound it within a factor of two, or does it say what the machine file means, one thing or another?"""
    low, high = number.bounds
    return number.of_the_file or 0.0 < low < high < 2.0 * low


def is_held(candidate: Candidate) -> bool:
    """Is it a nuisance effect, held to its ordinary size?"""
    return candidate.effect.name in rules.ORDINARY and candidate.effect != named(candidate.effect.name).effect


def effects_of(fit: Fit) -> list[Candidate]:
    """The effects of a hypothesis that are no nuisance effects."""
    return [candidate for candidate in fit.candidates if not is_held(candidate)]


def acts_late(candidate: Candidate) -> bool:
    """Is its size a delay or a time constant, or that of a lag that vanishes at infinity?"""
    number = candidate.effect.parameters[0]
    return number.unit in ("s", "Hz")


def least_remarkable(candidate: Candidate) -> float:
    """Coordinate from which a machine is remarkable for the effect."""
    ordinary = rules.ORDINARY.get(candidate.effect.name)
    size = candidate.effect.parameters[0]
    return abs(to_coordinate(size, ordinary)) * rules.REMARKABLE if ordinary else rules.REMARKABLE_SHARE
