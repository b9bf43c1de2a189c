"""Scores of `next_measurement.py`: what a trace named against what was put in; its docstring has the words."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

ONE_TERM = "right and sharp, one term"
SHARP_SCORES = ("right and sharp", ONE_TERM)
SPOOL_m_s_V = 3000.0 * 1.1e-4  # of the second plant's spool, first order, after a step of the volts
LARGEST_FLOW_m3_s = 0.3 * np.pi / 4 * 0.03**2  # at 0.3 m/s: the rod side stands at the supply
SAME_SIZE = {  # effects whose number the library has too: its value for one of the plant's
    **dict.fromkeys(("leakage_supply_to_chamber", "leakage_chamber_to_tank", "null_offset", "null_drift"), 1.0),
    **dict.fromkeys(
        ("overlap", "coulomb_friction", "viscous_friction", "incline", "spring", "accelerometer_gain"), 1.0
    ),
    **dict.fromkeys(
        ("accelerometer_offset", "pressure_gain", "pressure_offset", "position_gain", "seal_friction"), 1.0
    ),
    **dict.fromkeys(("entrained_air", "hose_compliance", "dead_volume", "supply_pressure_gain", "return_line"), 1.0),
    **dict.fromkeys(("valve_hysteresis", "leakage_clearance"), 1.0),
    **dict.fromkeys(("valve_delay", "accelerometer_delay", "pressure_delay", "position_delay"), 1e-3),
    "underlap": -1.0,
    "mass": 40.0,
}


def score(line: dict[str, Any], named: list[list[Any]], never: bool = False) -> str:
    """right and sharp, of one name or as one term; right, tied, not sharp or number off; another that is there; nothing named;
    wrong. never: no log of the trace takes the limit that was put in."""
    from hexsim.hydraulics.effects import effect_named
    from hexsim.tracing.design.information import says_nothing

    right = right_names(line, never)
    there = names_there(line["effects"])
    if not named:
        return "nothing named"
    named, terms = (list(own) for own in zip(*(as_put_in(row, right) for row in named), strict=True))
    found = [row for row in named if row[0] in right]
    if any(row[0] not in right | there for row in named):
        tied = [row for row in named if any(label.split(" in ")[0] in right for label in row[3])]
        return "wrong" if not (tied or found) else "right, tied" if tied else "right among others"
    if not found:
        return "another that is there"
    alone = terms[named.index(found[0])]
    _, values, errors, tied = found[0]
    if tied and not alone:
        return "right, tied"
    if not all(
        says_nothing(effect_named(found[0][0]), key, value) or (errors.get(key) or np.inf) <= 0.1 * scale_of(key, value)
        for key, value in values.items()
    ):
        return "right, not sharp"
    factor = SAME_SIZE.get(line["effect"])
    if factor and len(values) == 1:
        put_in = line["effects"][line["effect"]]
        if line["effect"] == "valve_delay":  # the second plant delays by whole milliseconds
            put_in = int(put_in)
        value, size = next(iter(values.values())), factor * put_in
        if abs(value / size - 1.0) > 0.15:
            return "right, number off"
    return ONE_TERM if alone else "right and sharp"


def known_in_all(line: dict[str, Any], own: dict[str, Any]) -> bool:
    """The right name alone with a number that is not sharp, or off, and every sum of it and what is declared known to 10 % and
    within 15 % of the truth."""
    if own["score"] not in ("right, not sharp", "right, number off") or not own.get("in_all"):
        return False
    return all(
        error <= 0.1 * abs(value) and abs(value / line["true"][key] - 1.0) <= 0.15
        for key, (value, error) in own["in_all"].items()
    )


def as_put_in(row: list[Any], right: set[str]) -> tuple[list[Any], bool]:
    """A row of `named` under the right one of its term's names, and whether it is tied with nothing but these."""
    read = row[4] if len(row) > 4 else []
    labels = {name for name, _, _ in read}
    alone = bool(read) and all(label.split(" in ")[0] in labels for label in row[3])
    own = next((one for one in read if one[0] in right), None)
    return ([*own, row[3]] if own and row[0] not in right else row[:4]), alone


def never_taken(line: dict[str, Any], logs: Iterable[Path]) -> bool:
    """Does no log take the limit of the spool's speed that was put in? Then its spool is one of first order, 3000 1/s.

    Between two samples the volts are held, and a step has decayed by the next: the largest one asks for the largest speed.
    """
    import polars as pl

    if line["effect"] != "spool_rate_limit":
        return False
    steps = [pl.read_csv(log)["valve_V"].diff().abs().max() for log in logs]
    return SPOOL_m_s_V * float(np.max(steps)) < line["effects"]["spool_rate_limit"]


def right_names(line: dict[str, Any], never: bool = False) -> set[str]:
    """Names of the library for what was put in. never: see `score`; of a pump the limit says it."""
    from tracing_evaluation import RIGHT

    if line["effect"] == "pump_limit" and line["effects"]["pump_limit"] > LARGEST_FLOW_m3_s:
        return RIGHT["supply_droop"]
    return RIGHT["spool_lag" if never else line["effect"]]


def names_there(effects: dict[str, float]) -> set[str]:
    """Names of the library for all that a machine has."""
    from other_effects import LIBRARY_NAMES
    from tracing_rough import SAME_AS

    own = [name.removeprefix("small_") for name in effects]
    return {LIBRARY_NAMES.get(name, SAME_AS.get(name, name)) for name in own}


def scale_of(key: str, value: float) -> float:
    """What 10 % of a number are of: a phase counts as it is, and 0 is sharp when nothing is."""
    return 1.0 if key == "phase_rad" else abs(value) or np.inf
