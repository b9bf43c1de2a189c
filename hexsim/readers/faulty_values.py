"""Values that are damage: infinite ones, spikes, frozen and saturated channels."""

from __future__ import annotations

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.cleaning import Cleaning, held, runs

RESTING_s = 0.25  # a quantised signal may stand still for longer when nothing moves
DWELLS = 0.1  # of the usual step between samples: a signal that comes slower to its limit stops there
LARGEST = 1e30  # in any SI unit: beyond it a number is damage


def blank_bad_values(log: Cleaning) -> None:
    """Infinite values, spikes of one sample and frozen stretches become missing; a channel that is dead is left out.

    Signals of a foreign machine (kind "own") may jump and stand still; only what is no number is blanked.
    """
    for name, values in list(log.signals.items()):
        x = values.copy()
        blank(log, name, x, np.abs(x) > LARGEST, "values beyond any measure")
        blank(log, name, x, np.isnan(x), "missing values")
        reason = why_dead(log, name, x)
        if reason:
            leave_out(log, name, reason)
            continue
        if not log.foreign:
            blank(log, name, x, spikes(x), "spikes of a single sample")
            blank(log, name, x, frozen(log, name, x), "rows of a frozen value")
        log.signals[name] = x


def blank(log: Cleaning, name: str, x: np.ndarray, bad: np.ndarray, what: str) -> None:
    """Mark samples as missing, with a stated loss."""
    if bad.any():
        log.losses.append(f"column {name}: {bad.sum()} {what}, the first in row {log.first(bad)}")
        x[bad] = np.nan


def why_dead(log: Cleaning, name: str, x: np.ndarray) -> str | None:
    """Why a whole channel cannot be used: missing, cut off, or standing still; None when it can."""
    missing = int(np.isnan(x).sum())
    if missing > 0.5 * len(x):
        return f"{missing} of {len(x)} values are missing"
    if log.foreign or held(name):
        return None
    clipped = saturated(x)
    if clipped is not None:
        limit, at = clipped
        return f"it is saturated at {limit:.6g} in {at.sum()} rows from row {log.first(at)}"
    still = longest_run(np.diff(x) == 0) + 1
    if still == len(x) and name != "pressure_supply_Pa":  # an ideal supply may be constant
        return "it never changes"
    return f"it stands still in {still} of {len(x)} rows" if 0.9 * len(x) < still < len(x) else None


def leave_out(log: Cleaning, name: str, why: str) -> None:
    if name.startswith("position") and not log.foreign:
        raise HexsimError(f"{log.path}: column {name} cannot be used, {why}; nothing can be traced without it")
    log.losses.append(f"column {name} is left out: {why}")
    del log.signals[name]


def spikes(x: np.ndarray) -> np.ndarray:
    """Single samples further from their neighbours than half of what the signal otherwise spans.

    The two samples on either side must lie together (within a tenth of the spike): a jump that rings is no spike.
    """
    filled = np.where(np.isnan(x), np.nanmedian(x), x)
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


def cut_off(x: np.ndarray, at: np.ndarray) -> bool:
    """Does the signal run into its limit at speed? One that comes to rest there dwells, at an end stop for example."""
    starts, stops = runs(at)
    usual = np.nanmedian(np.abs(np.diff(x))[~at[1:] & ~at[:-1]])
    into = [abs(x[start] - x[max(start - 3, 0)]) / 3 for start in starts if start > 0]
    out_of = [abs(x[min(stop + 2, len(x) - 1)] - x[stop - 1]) / 3 for stop in stops if stop < len(x)]
    steps = np.array([step for step in (*into, *out_of) if np.isfinite(step)])
    return bool(len(steps) == 0 or np.median(steps) > DWELLS * max(float(usual), 1e-300))


def longest_run(mask: np.ndarray) -> int:
    starts, stops = runs(mask)
    return int(np.max(stops - starts, initial=0))


def frozen(log: Cleaning, name: str, x: np.ndarray) -> np.ndarray:
    """Stretches of one value that are longer than chance allows, in a noisy signal: a sensor that has stopped.

    With a share p of samples equal to the one before, a run of k has n p^k chances; k is where that is 1e-9. p is taken
    three times as large as seen, without the two longest runs. A run longer than RESTING_s counts only while another
    signal moves: a quantised sensor of a machine at rest stands still by right, as do held setpoints, noise-free logs.
    """
    none = np.zeros(len(x), dtype=bool)
    if held(name) or len(x) < 50 or not noisy(x):
        return none
    same = np.diff(x) == 0
    starts, stops = runs(same)
    length = stops - starts
    chance = 3.0 * (np.sort(length)[:-2].sum() + 1) / len(x)
    if chance > 0.7:
        return none
    least = max(5, int(np.ceil(np.log(1e-9 / len(x)) / np.log(chance))))
    for start, stop in zip(starts[length >= least], stops[length >= least], strict=True):
        if log.time[stop] - log.time[start] < RESTING_s or others_move(log, name, start, stop):
            none[start + 1 : stop + 1] = True
    return none


def others_move(log: Cleaning, name: str, start: int, stop: int) -> bool:
    """Does another signal change by a twentieth of its span between two samples?"""
    for other, values in log.signals.items():
        span = np.ptp(values[np.isfinite(values)]) if other != name else 0.0
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
