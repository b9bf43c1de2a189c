"""Values that are damage: infinite ones, spikes, frozen and saturated channels."""

from __future__ import annotations

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.clock_group import HOLE, ClockGroup, is_held, periods, runs
from hexsim.readers.clocks import STAMPS
from hexsim.readers.possible import Limits, impossible, marker
from hexsim.signals.table import places


def blank_bad_values(group: ClockGroup, possible: dict[str, Limits], markers: dict[str, list[float]]) -> None:
    """What is no measurement becomes missing; a channel that is dead is left out.

    That is: infinite values, a logger's markers, what the machine cannot have, spikes of one sample, frozen stretches.
    Signals of a foreign machine (kind "own") may jump and stand still; only what is no number is blanked.
    """
    for name in list(group.signals):
        x = group.signals[name]
        blank(group, name, np.abs(x) > STAMPS.largest, "values beyond any measure")
        blank(group, name, np.isin(x, markers.get(name, [])), "markers of the mapping")
        say_missing(group, name)
        own = group.own_samples(name)
        if not group.foreign and not is_held(name) and len(own) > STAMPS.least:
            blank(group, name, marks(x, own, marker(x[own])), "markers far from all other values")
            own = group.own_samples(name)
        limits = possible.get(places()[name][0].stem) if name in places() else None
        if limits is not None and not group.foreign and len(own):
            blank(group, name, marks(x, own, impossible(x[own], limits)), "values that the machine cannot have")
            own = group.own_samples(name)
        reason = why_dead(group, name, own, limits)
        if reason:
            leave_out(group, name, reason)
        elif not group.foreign:
            blank(group, name, marks(x, own, spikes(x[own])), "spikes of a single sample")
            blank(group, name, marks(x, own, frozen(group, name, own, limits)), "rows of a frozen value")


def marks(x: np.ndarray, own: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """Marks of a signal's own samples as marks of the rows."""
    found = np.zeros(len(x), dtype=bool)
    found[own] = bad
    return found


def blank(group: ClockGroup, name: str, bad: np.ndarray, what: str) -> None:
    """Mark samples as missing, with a note."""
    if bad.any():
        group.note(f"{bad.sum()} {what}, the first in row {group.first(bad)}", name)
        group.signals[name][bad] = np.nan


def say_missing(group: ClockGroup, name: str) -> None:
    """Cells without a sample, of a signal that has one in most rows; others are slower."""
    missing = np.isnan(group.signals[name])
    if missing.any() and missing.mean() < 0.5:
        group.note(f"{missing.sum()} missing values, the first in row {group.first(missing)}", name)


def why_dead(group: ClockGroup, name: str, own: np.ndarray, limits: Limits | None) -> str | None:
    """Why a whole channel cannot be used: missing, cut off, or standing still; None when it can."""
    x, time = group.signals[name][own], group.time[own]
    if len(own) < STAMPS.least:
        return f"{len(group.time) - len(own)} of {len(group.time)} values are missing"
    there, whole = covered(time), covered(group.time)  # a pause of the logger is nobody's
    if there < 0.5 * whole and name not in group.steady:
        return f"it is there for {there:.3g} of {whole:.3g} s"
    if group.foreign or is_held(name) or name in group.held:
        return None
    clipped = saturated(x)
    if clipped is not None and not (name.startswith("position") and at_an_end(clipped[0], x, limits)):
        limit, at = clipped
        return f"it is saturated at {limit:.6g} in {at.sum()} rows from row {group.row(int(own[np.argmax(at)]))}"
    still = longest_run(np.diff(x) == 0) + 1
    if still == len(x) and name != "pressure_supply_Pa":  # an ideal supply may be constant
        return "it never changes"
    return f"it stands still in {still} of {len(x)} rows" if 0.9 * len(x) < still < len(x) else None


def covered(time: np.ndarray) -> float:
    """Time [s] between samples, without holes."""
    steps = np.diff(time)
    return float(np.sum(steps[steps <= HOLE * periods(time)]))


def at_an_end(limit: float, x: np.ndarray, limits: Limits | None) -> bool:
    """Is this where the cylinder ends? Without a machine only the retracted end is known: 0."""
    near = 0.02 * (limits.high - limits.low) if limits is not None else 0.02 * float(np.ptp(x))
    return abs(limit) < near or (limits is not None and abs(limit - limits.high) < near)


def leave_out(group: ClockGroup, name: str, why: str) -> None:
    if name.startswith("position") and not group.foreign:
        raise HexsimError(f"{group.path}: column {name} cannot be used, {why}; nothing can be traced without it")
    group.note(f"left out: {why}", name)
    del group.signals[name]


def spikes(x: np.ndarray) -> np.ndarray:
    """Single samples further from their neighbours than half of what the signal otherwise spans.

    The two samples on either side must lie together (within a tenth of the spike): a jump that rings is no spike.
    """
    if len(x) < 5:
        return np.zeros(len(x), dtype=bool)
    filled = x
    low, high = np.quantile(filled, [0.002, 0.998])
    around = np.stack([filled[:-4], filled[1:-3], filled[3:-1], filled[4:]])
    away = np.abs(filled[2:-2] - around.mean(axis=0))
    alone = np.ptp(around, axis=0) < 0.1 * away
    found = np.zeros(len(x), dtype=bool)
    far = (away > 0.5 * max(float(high - low), 1e-300)) & (away > 40 * np.median(away))
    found[2:-2] = alone & far & ~np.isnan(x[2:-2])
    return found if found.sum() <= max(3, 1e-3 * len(x)) else np.zeros(len(x), dtype=bool)


def saturated(x: np.ndarray) -> tuple[float, np.ndarray] | None:
    """(limit, where) of a signal cut off at an end: more samples at the limit than in 1 % of the span next to it."""
    low, high = np.nanmin(x), np.nanmax(x)
    if not high > low:
        return None
    for limit in (high, low):
        at = x == limit
        near = (np.abs(x - limit) < 0.01 * (high - low)) & ~at
        if at.sum() > max(near.sum(), 20) and longest_run(at) >= 10 and len(np.unique(x[~at])) > 50 and cut_off(x, at):
            return float(limit), at
    return None


def cut_off(
    x: np.ndarray,
    at: np.ndarray,
    *,
    dwells: float = 0.1,  # of the usual step between samples: a signal that comes slower to its limit stops there
) -> bool:
    """Does the signal run into its limit at speed? One that comes to rest there dwells, at an end stop for example."""
    starts, stops = runs(at)
    usual = np.nanmedian(np.abs(np.diff(x))[~at[1:] & ~at[:-1]])
    into = [abs(x[start] - x[max(start - 3, 0)]) / 3 for start in starts if start > 0]
    out_of = [abs(x[min(stop + 2, len(x) - 1)] - x[stop - 1]) / 3 for stop in stops if stop < len(x)]
    steps = np.array([step for step in (*into, *out_of) if np.isfinite(step)])
    return bool(len(steps) == 0 or np.median(steps) > dwells * max(float(usual), 1e-300))


def longest_run(mask: np.ndarray) -> int:
    starts, stops = runs(mask)
    return int(np.max(stops - starts, initial=0))


def frozen(
    group: ClockGroup,
    name: str,
    own: np.ndarray,
    limits: Limits | None,
    *,
    resting_s: float = 0.25,  # a quantised signal may stand still for longer when nothing moves
) -> np.ndarray:
    """Stretches of one value that are longer than chance allows, in a noisy signal: a sensor that has stopped.

    With a share p of samples equal to the one before, a run of k has n p^k chances; k is where that is 1e-9. p is taken
    three times as large as seen, without the two longest runs. A run longer than resting_s counts only while another
    signal moves: a quantised sensor of a machine at rest stands still by right, as do held setpoints, noise-free logs.
    """
    x, time = group.signals[name][own], group.time[own]
    none = np.zeros(len(x), dtype=bool)
    if is_held(name) or name in group.held or len(x) < 50 or not noisy(x):
        return none
    same = np.diff(x) == 0
    starts, stops = runs(same)
    length = stops - starts
    chance = 3.0 * (np.sort(length)[:-2].sum() + 1) / len(x)
    if chance > 0.7:
        return none
    least = max(5, int(np.ceil(np.log(1e-9 / len(x)) / np.log(chance))))
    for start, stop in zip(starts[length >= least].tolist(), stops[length >= least].tolist(), strict=True):
        if name.startswith("position") and at_an_end(float(x[start]), x, limits):
            continue
        if time[stop] - time[start] < resting_s or others_move(group, name, int(own[start]), int(own[stop])):
            none[start + 1 : stop + 1] = True
    return none


def others_move(group: ClockGroup, name: str, start: int, stop: int) -> bool:
    """Does another signal change by a twentieth of its span between two samples?"""
    for other, values in group.signals.items():
        span = np.ptp(values[np.isfinite(values)]) if other != name and np.isfinite(values).any() else 0.0
        inside = values[start : stop + 1]
        inside = inside[np.isfinite(inside)]
        if span > 0 and len(inside) and np.ptp(inside) > 0.05 * span:
            return True
    return False


def noisy(x: np.ndarray) -> bool:
    """White noise under the signal: sixth differences larger than a smooth signal's (1e-6 of the span)."""
    differences = np.diff(x[np.isfinite(x)], 6)
    moving = np.abs(differences[differences != 0])
    return len(moving) > 20 and float(np.median(moving)) / 30.0 > 1e-6 * float(np.nanmax(x) - np.nanmin(x))
