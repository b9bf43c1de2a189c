"""Missing samples: short gaps are filled, longer ones end a stretch."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from hexsim.readers.cleaning import Cleaning, held, runs
from hexsim.signals.log import hold_of

FILL = 10  # samples: shorter gaps are filled, longer ones end a stretch
SMOOTH = 2  # samples: up to here a cubic through four neighbours is as good as a sample, beyond it its slope is noise
SHORTEST_S = 0.5  # [s] shorter logs are refused


def short_gaps(values: np.ndarray) -> np.ndarray:
    """Samples (n,) bool of missing runs of at most FILL samples between samples that are there."""
    missing = np.isnan(values)
    starts, stops = runs(missing)
    short = np.zeros(len(values), dtype=bool)
    for start, stop in zip(starts, stops, strict=True):
        if stop - start <= FILL and start > 0 and stop < len(values):
            short[start:stop] = True
    return short


def held_values(x: np.ndarray) -> np.ndarray | None:
    """A signal (n,) that a computer holds between its ticks, with missing samples from the same tick; None for others.

    A tick whose samples are all missing lies on a cubic spline through the others.
    """
    there = np.isfinite(x)
    found = hold_of(x)
    if found is None:
        return None
    hold, phase = found
    tick = (np.arange(len(x)) - phase) // hold + 1
    known, first = np.unique(tick[there], return_index=True)
    value = make_interp_spline(known, x[there][first], k=3)(tick)
    value[np.isin(tick, known)] = x[there][first][np.searchsorted(known, tick[np.isin(tick, known)])]
    return value


def filled(name: str, x: np.ndarray, short: np.ndarray) -> tuple[np.ndarray, str]:
    """(the signal with its short gaps filled, how): cubic splines, straight lines; a held signal by what was held."""
    good = ~np.isnan(x)
    new = held_values(x) if held(name) else None
    how = "the values held"
    if new is None:
        at, there, values = np.arange(len(x)), np.flatnonzero(good), x[good]
        starts, stops = runs(short)
        how = "straight lines" if np.any(stops - starts > SMOOTH) else "cubic splines"
        new = np.interp(at, there, values)
        for start, stop in zip(starts, stops, strict=True):
            i = int(np.searchsorted(there, start))
            near = slice(max(i - 2, 0), i + 2)
            if stop - start <= SMOOTH and len(there[near]) == 4:
                new[start:stop] = np.polyval(np.polyfit(there[near] - start, values[near], 3), at[start:stop] - start)
    return np.where(short, new, x), how


def stretches(log: Cleaning, rate: float) -> list[slice]:
    """Slices without a missing value, longest first, after filling short gaps."""
    for name, values in log.signals.items():
        short = short_gaps(values)
        if short.any():
            log.signals[name], how = filled(name, values, short)
            log.repaired[name] = short
            log.losses.append(f"column {name}: {short.sum()} samples filled by {how} (gaps of at most {FILL} samples)")
    whole = np.ones(len(log.time), dtype=bool)
    for values in log.signals.values():
        whole &= np.isfinite(values)
    starts, stops = runs(whole)
    found = [slice(int(a), int(b)) for a, b in zip(starts, stops, strict=True) if b - a >= SHORTEST_S * rate]
    return sorted(found, key=lambda part: (part.start - part.stop, part.start))
