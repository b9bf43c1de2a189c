"""Missing samples: short gaps are filled, longer ones end a stretch."""

from __future__ import annotations

import numpy as np

from hexsim.readers.cleaning import Cleaning, held, runs

FILL = 10  # samples: shorter gaps are filled, longer ones end a stretch
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

    A tick whose samples are all missing lies on the straight line between its neighbours.
    """
    there = np.isfinite(x)
    changes = np.flatnonzero((np.diff(x) != 0) & there[1:] & there[:-1]) + 1
    hold = int(np.median(np.diff(changes))) if len(changes) > 50 else 1
    if hold < 2:
        return None
    phase = int(np.bincount(changes % hold).argmax())
    if np.mean(changes % hold == phase) < 0.98:
        return None
    tick = (np.arange(len(x)) - phase) // hold + 1
    known, first = np.unique(tick[there], return_index=True)
    return np.interp(tick, known, x[there][first])


def filled(name: str, x: np.ndarray, short: np.ndarray) -> tuple[np.ndarray, str]:
    """(the signal with its short gaps filled, how): straight lines; a held signal by what was held."""
    good = ~np.isnan(x)
    new = held_values(x) if held(name) else None
    how = "straight lines" if new is None else "the values held"
    if new is None:
        new = np.interp(np.arange(len(x)), np.flatnonzero(good), x[good])
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
