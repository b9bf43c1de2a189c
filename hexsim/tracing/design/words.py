"""What a design says: the first line of its file, and what stays open after it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hexsim.tracing import rules
from hexsim.tracing.design.ceiling import Ceiling
from hexsim.tracing.design.information import KNOWING, Number, Promise
from hexsim.tracing.fitting.fitted_numbers import Total
from hexsim.tracing.state import NamedEffect, Trace

UNKNOWN = Ceiling(errors=(), declared=())
ALL_KNOWN = "to know all declared parameters better"
NOT_APART = "they are one term, that no log takes apart"


def purpose_of(
    tables: dict[str, Any],
    labels: Sequence[str],
    found: Promise,
    numbers: tuple[Number, ...],
    wanted: int | None,
    load_kg: float | None,
    ceiling: Ceiling = UNKNOWN,
    alike: bool = False,
) -> str:
    """The first line. load_kg: the load of the motion, or one that would separate what no motion does. alike: what stays
    together is alike in all motions that were tried, as a hose and a dead volume are."""
    mass = f"a load of {load_kg:.3g} kg" if load_kg else ""
    put_on = f", with {mass} on it" if "machine" in tables else ""
    might = "another sensor might" if put_on else "another load or another sensor might"
    would = f"; {mass} would" if mass and not put_on else f"; {might}"
    would = f"; {NOT_APART}: look at the machine" if alike else would
    stay = [other for _, other in found.tied]
    apart = [label for label in labels[1:] if label not in stay]
    if apart:
        said = f"to separate {', '.join([labels[0], *apart])}{put_on}"
        return said + (f"; no motion separates {', '.join([labels[0], *stay])}" if stay else "")
    if stay:
        return f"no motion separates {', '.join(labels)}{would}"
    if wanted is not None:
        number, expected = numbers[wanted], found.errors[wanted]
        what = f"{number.name} of {number.effect} better"
        now = f"{number.value:.3g} +- {number.standard_error:.2g} now"
        least = least_words(number, ceiling, wanted)
        if expected > rules.SHARPENED * number.standard_error and (
            least or number.relative_of(expected) > KNOWING.sharp
        ):
            return f"no motion tells {what}{least or ' in this time'}; {now}"
        return f"to know {what}{put_on}: {now}{least and '; no motion tells it better'}{least}"
    if numbers:
        return f"{ALL_KNOWN}{put_on}: nothing is left to be told apart"
    return f"{ALL_KNOWN}, and what any machine has a little of{put_on}: no hypothesis is left"


def beside_one_term(purpose: str, effects: Sequence[NamedEffect]) -> str:
    """The first line where a named effect is one term with another: that no log takes them apart, alone where nothing else
    is left to be told."""
    said = "; ".join(one_term_words(effect) for effect in effects if effect.readings)
    if not said:
        return purpose
    return f"{said}: look at the machine" if purpose.startswith(ALL_KNOWN) else f"{purpose}; {said}"


def one_term_words(effect: NamedEffect) -> str:
    """hose_compliance, dead_volume are one term ..."""
    labels = (effect.candidate.label, *(own.candidate.label for own in effect.readings))
    return f"no motion separates {', '.join(labels)}; {NOT_APART}"


def with_the_sums(purpose: str, totals: Sequence[Total]) -> str:
    """The first line where no motion tells a number that adds to declared parameters: the sums that the logs do know."""
    told = [f"{own.key} {own.value:.4g} +- {own.standard_error:.2g}" for own in totals if own.known_better]
    if not told or not purpose.startswith("no motion tells"):
        return purpose
    return f"{purpose}; with what is declared it is known: {' and '.join(told)} in all"


def least_words(number: Number, ceiling: Ceiling, place: int) -> str:
    """Why no motion makes a number sharp; empty where all motions that were tried together would."""
    share = number.relative_of(ceiling.errors[place])
    if not share > KNOWING.sharp:
        return ""
    why = ceiling.declared[place]
    return f" than {100 * share:.0f} %" + (f": {why}" if why else "")


def expected_words(number: Number, error: float, hangs_on: str) -> str:
    """A number's error now and after the motion. hangs_on: a nuisance effect that does nearly the same, or ""."""
    said = f"{number.effect} {number.name} = {number.value:.4g}: error {number.standard_error:.2g} now, {error:.2g} expected"
    if hangs_on and error < rules.SHARPENED * number.standard_error:
        return f"{said}, about as now where a little {hangs_on} that any machine may have stays beside it"
    return said


def cannot_tell(trace: Trace, found: Promise, numbers: tuple[Number, ...], ceiling: Ceiling) -> tuple[str, ...]:
    """What stays open after it."""
    said = [
        f"{one} from {other}: {found.separations[one, other]:.2g} of at least {found.needed:.2g} that are needed"
        for one, other in found.tied
    ]
    for place, (number, error) in enumerate(zip(numbers, found.errors, strict=True)):
        if number.relative_of(error) > KNOWING.sharp:
            least = least_words(number, ceiling, place)
            said.append(
                f"{number.name} of {number.effect} to better than {100 * number.relative_of(error):.0f} %"
                + (f", and no motion better{least}" if least else "")
            )
    for rest in trace.unexplained:
        said.append(f"what the rest of the {rest.balance} balance in {rest.violation.where} is: no hypothesis names it")
    return tuple(said)
