"""What may be missing and cannot show in these logs, and what would have to be measured for it to show."""

from __future__ import annotations

from hexsim.recording.quantity import quantity, split_key
from hexsim.tracing import rules
from hexsim.tracing.fitting.limits import limits_of, reached
from hexsim.tracing.fitting.parameters import named
from hexsim.tracing.fitting.rest_hidden import Hidden
from hexsim.tracing.state import Trace


def would_show(result: Trace) -> list[str]:
    """A sentence for each effect that may have its typical size unseen, that beside a parameter at its limit first.

    Of a machine that no model fits; linear about its best hypothesis.
    """
    names = {effect.candidate.effect.name for effect in result.effects}
    covered = [(name, own) for name, own in result.hidden.items() if own.times > 1.0 and own.by and name not in names]
    shifts = dict(zip((prior.key for prior in result.final.priors), result.final.deviations, strict=True))
    at_limit = {prior.key for prior in result.final.priors if abs(shifts[prior.key]) > 0.999 * prior.half_width}
    physical = [pair for pair in covered if not named(pair[0]).effect.generic]
    first = sorted(physical, key=lambda pair: (pair[1].by not in at_limit, not pair[1].known_to, -pair[1].times))
    return [sentence(name, own, result) for name, own in first[: rules.FEW]]


def sentence(name: str, covered: Hidden, result: Trace) -> str:
    """How much of an effect may be there, what does the same, and how well that would have to be known."""
    effect = named(name).effect
    number, by = effect.parameters[0], split_key(covered.by)[0].replace("_", " ")
    size, typical = quantity(covered.size, number.unit), quantity(number.typical, number.unit)
    may = (
        f"{name.replace('_', ' ')} of less than" if number.neutral == 0.0 else f"{name.replace('_', ' ')} of more than"
    )
    said = f"{may} {size} may be there unseen"
    if covered.is_parameter:
        width = result.machine.uncertainty[covered.by]
        said += f": {by}, declared to {100 * width:.2g} %, does nearly the same"
        needed = f"known to {100 * width * covered.known_to:.2g} %"
        measurable = width * covered.known_to > rules.KNOWN
    else:
        ordinary = rules.ORDINARY.get(covered.by)
        unit = named(covered.by).effect.parameters[0].unit
        said += f": a {by} that any machine may have does nearly the same"
        needed = f"measured apart to {quantity((ordinary or 0.0) * covered.known_to, unit)}"
        measurable = ordinary is not None and covered.known_to > 0.0
    if measurable and covered.known_to < 1.0:
        return f"{said}. With that {needed}, {typical} would show"
    return f"{said}. Knowing that alone is not enough; {effect.shown_by or 'another load or another sensor might tell'}"


def reached_limits(result: Trace) -> dict[str, float]:
    """Effect -> the largest limit that the fit runs would show, beside what is named."""
    problem, fit = result.balance_problem, result.final
    if problem is None:
        return {}
    limits = limits_of([line.candidate for line in result.screening], fit)
    return {own.effect.name: reached(fit, own, problem, rules.alarm(result.screened)) for own in limits}
