"""In words: one term under two names with its number under either, and what an effect makes with the declared parameters
that it adds to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hexsim.hydraulics.effects import effect_named
from hexsim.recording.quantity import plain, quantity, split_key, with_error


def numbers_of(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    """(words, value with its error or why it has none) of each number of an effect of report.json, or of another name of it."""
    units = {number.name: number.unit for number in effect_named(entry["name"]).parameters}
    errors = entry.get("standard_error", {})
    found = []
    for key, value in entry["parameters"].items():
        why = without_error(entry, key)
        told = f"{quantity(value, units[key])}, {why}" if why else with_error(value, errors.get(key), units[key])
        found.append((split_key(key)[0], told))
    return found


def without_error(entry: Mapping[str, Any], key: str) -> str:
    """Why a number of an effect of report.json has no error; empty where it has one."""
    if end := entry.get("at_bound", {}).get(key):
        return f"the {end} end of its range"
    return "nothing in these logs depends on it" if key in entry.get("unmoved", ()) else ""


def names_of(entry: Mapping[str, Any]) -> list[str]:
    """All names of an effect's term, its own first."""
    return [own["name"].replace("_", " ") for own in (entry, *entry.get("one_term_with", []))]


def one_term(entry: Mapping[str, Any]) -> set[str]:
    """The other names of an effect's term, as `tied_with` has them."""
    place = f" in {entry['where']}"
    names = {own["name"] for own in entry.get("one_term_with", [])}
    return names | {name + place for name in names}


def term_sentence(entry: Mapping[str, Any]) -> str:
    """What is known of a term that has more than one name; empty for an effect with a name of its own."""
    if not entry.get("one_term_with"):
        return ""
    read = [f"{own['name'].replace('_', ' ')} of {numbers_of(own)[0][1]}" for own in (entry, *entry["one_term_with"])]
    return (
        f"added {entry['term']}, known to {known_to(entry)}: a {' or a '.join(read)}. "
        "They do the same in every log, so that no run tells which it is: look at the machine"
    )


def total_sentence(entry: Mapping[str, Any]) -> str:
    """What a declared parameter and the effect make together, where that is known much better than the effect alone; else empty."""
    totals = [own for own in entry.get("in_all", []) if own["known_better"]]
    if not totals:
        return ""
    whole, declared = [], []
    for own in totals:
        words, unit = split_key(own["key"])
        whole.append(f"{words} {with_error(own['value'], own['standard_error'], unit)}")
        declared.append(f"{quantity(own['declared'], unit, 4)} to {plain(100 * own['half_width'], 2)} %")
    name = entry["name"].replace("_", " ")
    return (
        f"{' and '.join(whole)} in all: what is declared ({', '.join(declared)}) and the {name} together. "
        f"How much of it is the {name}, no run tells better than that is declared"
    )


def known_to(entry: Mapping[str, Any]) -> str:
    """Relative standard error of an effect's number, of its best name: the others have a declared parameter's error in theirs."""
    found = []
    for own in (entry, *entry.get("one_term_with", [])):
        ((key, value),) = own["parameters"].items()
        if value and own["standard_error"].get(key) and not without_error(own, key):
            found.append(own["standard_error"][key] / abs(value))
    return f"{plain(100 * min(found), 2)} %" if found else "an unknown share"
