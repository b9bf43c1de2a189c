"""What is kept between runs: the numbers, and the factor of their information."""

from __future__ import annotations

from typing import Any

from ..compensator import Parameters
from ..compiled import compiled
from ..records import Record, record
from .estimator import HEATS
from .fit import N_COLUMNS, variances
from .leg import HOLD, N_NUMBERS, NAMES
from .prior import fill_prior, restore_prior

N_FACTOR = N_NUMBERS * (N_NUMBERS + 1) // 2
LAST_STAGE = len(HEATS) - 1
f = "f8"
LEARNED = record(
    numbers=(f, (N_NUMBERS,)), scale=(f, (N_NUMBERS,)),  # sd of the fit's units
    factor=(f, (N_FACTOR,)), chi2=(f, (2,)), noise=(f, (2,)),  # lower factor of the information, row by row; misfits; m, Pa
)  # fmt: skip
SCALE, FACTOR, NOISE = (LEARNED.fields[name][1] // 8 for name in ("scale", "factor", "noise"))  # type: ignore[index]
PRIOR = record(  # what `fill_prior` fills of a fit, in another order: a layout that another begins with is the same to numba
    mass_over_hold=f, mean=(f, (N_NUMBERS,)), sd=(f, (N_NUMBERS,)), low=(f, (N_NUMBERS,)), high=(f, (N_NUMBERS,)),
    scale=(f, (N_COLUMNS,)),
)  # fmt: skip


@compiled
def keep(s, learned):
    """Into a record LEARNED."""
    known, place = s.known, 0
    for k in range(N_NUMBERS):
        learned.numbers[k], learned.scale[k] = known.numbers[k], known.sd[k]
        for j in range(k + 1):
            learned.factor[place] = known.factor[k, j]
            place += 1
    learned.chi2[0], learned.chi2[1] = known.chi2[0], known.chi2[1]
    learned.noise[0], learned.noise[1] = s.past.noise_m, s.past.noise_Pa


@compiled
def restore(s, learned):
    """Into a state that was just started: the numbers and their covariance; what is uncertain moves, what is known stays."""
    known, fit, place, any_scale = s.known, s.fit, 0, False
    for k in range(N_NUMBERS):
        any_scale = any_scale or learned.scale[k] != 0.0
    if not any_scale:
        return
    for k in range(N_NUMBERS):
        known.numbers[k], known.sd[k] = learned.numbers[k], learned.scale[k]
        for j in range(k + 1):
            known.factor[k, j] = learned.factor[place]
            place += 1
    known.chi2[0], known.chi2[1] = learned.chi2[0], learned.chi2[1]
    known.valid = 1
    s.past.noise_m, s.past.noise_Pa = learned.noise[0], learned.noise[1]
    variances(known.factor, 1.0, fit.held, fit.a)
    for k in range(N_NUMBERS):
        fit.held[k] = known.sd[k] * fit.held[k] ** 0.5
    restore_prior(fit, s.settings, known.numbers, fit.held)
    for k in range(N_NUMBERS):
        fit.a[k] = fit.held[k] = 0.0
    fit.stage = LAST_STAGE


@compiled
def refused_number(known, settings, prior):
    """0, or 1 + the place of the first number that cannot be this machine's. known (n,): doubles of LEARNED; settings: a record SETTINGS;
    prior: a record PRIOR, space."""
    any_scale = False
    for i in range(len(known)):
        if known[i] - known[i] != 0.0:
            return 1 + i
    for k in range(N_NUMBERS):
        any_scale = any_scale or known[SCALE + k] != 0.0
    if not any_scale:
        return 0
    fill_prior(prior, settings, known[HOLD])
    for k in range(N_NUMBERS):
        if not prior.low[k] <= known[k] <= prior.high[k]:
            return 1 + k
        if not known[SCALE + k] > 0.0:
            return 1 + SCALE + k
    for k in range(N_NUMBERS):
        diagonal = FACTOR + k * (k + 3) // 2
        if not known[diagonal] > 0.0:
            return 1 + diagonal
    for i in range(2):
        if not known[NOISE + i] > 0.0:
            return 1 + NOISE + i
    return 0


def refusal(known: Any, settings: Record, prior: Record) -> str:
    """The same in words; empty where nothing is refused. known: a record LEARNED."""
    numbers = known.reshape(1).view(f)
    place = refused_number(numbers, settings, prior) - 1
    if place < 0:
        return ""
    if place < SCALE:
        low, high = prior.low[place], prior.high[place]
        return f"numbers.{NAMES[place]} is {numbers[place]:g}; it must lie between {low:g} and {high:g}"
    if place < FACTOR:
        return f"scale.{NAMES[place - SCALE]} is {numbers[place]}; it must be above zero"
    return "the factor's diagonal and both noises must be above zero"


def as_dict(learned: Record) -> Parameters:
    """A record LEARNED by name."""
    return {
        name: dict(zip(NAMES, learned[name].tolist(), strict=True)) if name in ("numbers", "scale") else learned[name].tolist()
        for name in LEARNED.names or ()
    }  # fmt: skip


def fill(learned: Record, parameters: Parameters) -> None:
    """The inverse of `as_dict`; ValueError names what is missing."""
    if problem := missing(parameters):
        raise ValueError(problem)
    for name in LEARNED.names or ():
        given = parameters[name]
        learned[name] = [float(given[k]) for k in NAMES] if name in ("numbers", "scale") else list(map(float, given))


def missing(parameters: Parameters) -> str:
    """Empty, or what start parameters lack."""
    for table in ("numbers", "scale"):
        for name in NAMES:
            if name not in parameters.get(table, {}):
                return f"{table}.{name} is missing"
    for name, count in (("factor", N_FACTOR), ("chi2", 2), ("noise", 2)):
        if len(parameters.get(name, [])) != count:
            return f"{name} must be a list of {count} numbers"
    return ""
