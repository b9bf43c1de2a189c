"""What is kept between runs: the numbers, and the factor of their information."""

from __future__ import annotations

from typing import Any

from ..compensator import Parameters
from ..compiled import compiled
from ..records import Record, record
from .estimator import LAST_STAGE
from .fit import N_COLUMNS, variances
from .leg import COULOMB_DN, COULOMB_UP, HOLD, N_NUMBERS, NAMES, STATIC_DN, STATIC_UP
from .prior import fill_prior, restore_prior

N_FACTOR = N_NUMBERS * (N_NUMBERS + 1) // 2  # of a triangle
f = "f8"
LEARNED = record(
    numbers=(f, (N_NUMBERS,)), scale=(f, (N_NUMBERS,)),  # sd of the fit's units
    factor=(f, (N_FACTOR,)), chi2=(f, (2,)), noise=(f, (2,)),  # lower factor of the information, row by row; misfits; m, Pa
)  # fmt: skip
SCALE, FACTOR, CHI2, NOISE = (LEARNED.fields[name][1] // 8 for name in ("scale", "factor", "chi2", "noise"))  # type: ignore[index]
MOST_SCALE = 1e6  # over the prior's: of a data sheet that says other volts and forces than this one by a thousand
MOST_FACTOR = 1e8  # in units of scale: beyond 1/sqrt(eps) the prior is lost beside its square
MOST_CHI2 = 1e16  # of a piston that is a stroke from where it is expected
PRIOR = record(  # what `fill_prior` fills of a fit, in another order: a layout that another begins with is the same to numba
    mass_over_hold=f, mean=(f, (N_NUMBERS,)), sd=(f, (N_NUMBERS,)), low=(f, (N_NUMBERS,)), high=(f, (N_NUMBERS,)),
    scale=(f, (N_COLUMNS,)), kind_mean=(f, (N_NUMBERS,)), kind_sd=(f, (N_NUMBERS,)),
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
    prior: a record PRIOR, space. Bounds come of a data sheet, and the twin that has learned may have another one: a number may lie
    beyond by its prior's standard deviation, and is taken as the bound."""
    any_scale = False
    for i in range(len(known)):
        if known[i] - known[i] != 0.0:
            return 1 + i
    for k in range(N_NUMBERS):
        any_scale = any_scale or known[SCALE + k] != 0.0
    if not any_scale:
        return 0
    force_N = settings.area_bottom_m2 * settings.supply_pressure_Pa
    fill_prior(prior, settings, known[HOLD])
    for k in (HOLD, COULOMB_UP, COULOMB_DN, STATIC_UP, STATIC_DN):
        prior.low[k], prior.high[k] = max(prior.low[k], -force_N), min(prior.high[k], force_N)
    if not prior.low[HOLD] <= known[HOLD] <= prior.high[HOLD]:
        return 1 + HOLD
    for k in range(N_NUMBERS):
        prior.low[k], prior.high[k] = prior.low[k] - prior.sd[k], prior.high[k] + prior.sd[k]
        if not prior.low[k] <= known[k] <= prior.high[k]:
            return 1 + k
        if not 0.0 < known[SCALE + k] <= MOST_SCALE * prior.sd[k]:
            return 1 + SCALE + k
    for place in range(FACTOR, CHI2):
        if not abs(known[place]) <= MOST_FACTOR:
            return 1 + place
    for k in range(N_NUMBERS):
        diagonal = FACTOR + k * (k + 3) // 2
        if not known[diagonal] > 0.0:
            return 1 + diagonal
    for i in range(2):
        if not 0.0 <= known[CHI2 + i] <= MOST_CHI2:
            return 1 + CHI2 + i
    if not 0.0 < known[NOISE] <= settings.stroke_m:
        return 1 + NOISE
    if not 0.0 < known[NOISE + 1] <= settings.supply_pressure_Pa:
        return 1 + NOISE + 1
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
        most = MOST_SCALE * prior.sd[place - SCALE]
        return f"scale.{NAMES[place - SCALE]} is {numbers[place]:g}; it must lie between 0 and {most:g}"
    name, first = next(
        (name, first) for name, first in (("noise", NOISE), ("chi2", CHI2), ("factor", FACTOR)) if place >= first
    )
    return (
        f"{name}[{place - first}] is {numbers[place]:g}; the factor's diagonal and both noises must be above zero, misfits not "
        "below, and none beyond what a machine can give"
    )


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
