"""Events in the residual of a balance: stretches where it lies at another level, with their times and sizes.

A level change is where the means of a window before and behind differ by more than noise does; it is placed where the
difference is largest. What a fitted model leaves is quiet between events, so that their size is the mean between edges.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from scipy.signal import find_peaks

from hexsim.tracing import rules

Array = np.ndarray
MOST = 200  # events: more of them are no events


@dataclass(frozen=True, kw_only=True)
class Event:
    """From start_s to stop_s the residual lies `size` away from its usual level."""

    start_s: float
    stop_s: float
    size: float

    def to_json(self) -> dict[str, float]:
        return asdict(self)


def events(time: Array, residual: Array, half: int) -> list[Event]:
    """Events (in time order) of a residual (n,) under a window of half width `half` samples; none where it is quiet."""
    n = len(residual)
    if n < 20 * half:
        return []
    sums = np.append(0.0, np.cumsum(residual))
    means = (sums[2 * half :] - sums[: -2 * half]) / (2 * half)  # means[k]: samples k to k + 2 half
    change = np.zeros(n)
    change[3 * half : 3 * half + len(means) - 4 * half] = means[4 * half :] - means[: -4 * half]
    usual = 1.4826 * float(np.median(np.abs(change[np.nonzero(change)]))) if np.any(change) else 0.0
    peaks, _ = find_peaks(np.abs(change), height=max(8.0 * usual, 1e-300), distance=4 * half)
    if not 2 <= len(peaks) <= 2 * MOST:
        return []
    edges = [0, *peaks.tolist(), n]
    inner = [residual[a + 2 * half : b - 2 * half] for a, b in zip(edges[:-1], edges[1:], strict=True)]
    levels = np.array([np.median(x) if len(x) else np.nan for x in inner])
    base = base_level(levels, np.diff(edges))
    least = rules.MAIN * float(np.max(np.abs(change[peaks])))
    return [
        Event(start_s=float(time[edges[k]]), stop_s=float(time[min(edges[k + 1], n - 1)]), size=float(level - base))
        for k, level in enumerate(levels)
        if np.isfinite(level) and abs(level - base) > least
    ]


def base_level(levels: Array, lengths: Array) -> float:
    """The usual level: the median over time of the levels that are nearest to zero."""
    there = np.isfinite(levels)
    order = np.argsort(np.abs(levels[there]))
    share = np.cumsum(lengths[there][order]) / np.sum(lengths[there])
    near = order[: max(int(np.searchsorted(share, 0.4)) + 1, 1)]
    return float(np.median(levels[there][near]))


def said(found: list[Event], unit: str) -> str:
    """Events in a sentence."""
    if not found:
        return ""
    sizes = np.array([event.size for event in found])
    lasting = np.array([event.stop_s - event.start_s for event in found])
    between = np.diff([event.start_s for event in found])
    pulses = "1 pulse" if len(found) == 1 else f"{len(found)} pulses"
    text = f"{pulses} of {np.median(sizes):.4g} {unit} (spread {np.std(sizes):.2g}), {np.median(lasting):.3g} s each"
    text += f", the first at {found[0].start_s:.3f} s"
    if len(between) > 2 and np.std(between) < 0.05 * np.median(between):
        text += f", every {np.median(between):.4g} s"
    return text
