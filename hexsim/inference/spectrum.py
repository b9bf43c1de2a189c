"""Residuals as Fourier coefficients, and the spectrum of what is left.

The coefficients R(f) of a stationary residual are nearly independent with E|R|^2 = S(f) (Whittle 1953). So a large slow residual weighs
little, and errors are honest without blocks or correction factors. S comes from the residual itself, in bins that are even in log f.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from hexsim.inference.contract import Stretch

Array = np.ndarray
LEAST = 10.0  # coefficients of a bin: S is known to 1/sqrt(10) there
MOST_FREEDOM = (
    16.0  # degrees of freedom of a bin's variance at most: another run's spectrum is known to sqrt(2/16) = 35 %
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Window:
    """Of one stretch and channel: taper (n,), log f (m,) [log Hz], weight of every coefficient (m,)."""

    taper: Array
    log_f: Array
    weight: Array

    def of(self, values: Array) -> Array:
        """Coefficients (m, ...) of values (n, ...)."""
        taper = self.taper.reshape(-1, *[1] * (values.ndim - 1))
        return np.fft.rfft(values * taper, axis=0)[: len(self.log_f)]


def window_of(
    stretch: Stretch,
    channel: int,
    tapered: bool,
    *,
    taper_share: float = 0.05,  # of a stretch at either end: leakage of drift falls with f^-3
) -> Window | None:
    """None where too few samples count."""
    mask = stretch.weight[:, channel] > 0
    seen = np.flatnonzero(mask)
    if len(seen) < 2 * LEAST:
        return None
    edge = np.minimum(np.arange(len(mask)) - seen[0], seen[-1] - np.arange(len(mask))) + 0.5
    ramp = np.clip(edge / max(taper_share * (seen[-1] - seen[0]), 1.0), 0.0, 1.0) if tapered else np.ones(len(mask))
    taper = np.where(mask, np.sin(0.5 * np.pi * ramp) ** 2, 0.0)
    f = np.fft.rfftfreq(len(mask), stretch.dt)
    f = f[: max(int(np.searchsorted(f, stretch.top_Hz)), 4)]
    share = float(np.sum(taper**2)) / len(mask)
    weight = np.full(len(f), share)
    weight[0] *= 0.5
    return Window(taper=taper / np.sqrt(np.sum(taper**2)), log_f=np.log(np.maximum(f, 0.5 * f[1])), weight=weight)


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """Of one channel. log_f, log_s: of the bins' middles. edges: inner edges of bins in log f. counts: coefficients of each bin."""

    log_f: Array
    log_s: Array
    edges: Array
    counts: Array

    def at(self, log_f: Array) -> Array:
        return np.exp(np.interp(log_f, self.log_f, self.log_s))

    @property
    def top_Hz(self) -> float:
        """Upper end of the band that stands two errors above the floor, which is noise; 0 where there is nothing else."""
        floor = int(np.argmin(self.log_s))
        clear = self.log_s - self.log_s[floor] > 2.0 * np.sqrt(1.0 / self.counts + 1.0 / self.counts[floor])
        edges = np.append(self.edges, self.log_f[-1])
        return float(np.exp(edges[np.flatnonzero(clear)[-1]])) if clear.any() else 0.0

    def log_density(self, log_f: Array, power: Array, weight: Array) -> float:
        """Of the coefficients of another stretch: each bin's variance is known by its count alone (Student t)."""
        where, s = np.searchsorted(self.edges, log_f), self.at(log_f)
        n = np.bincount(where, 2.0 * weight, len(self.counts))
        q = np.bincount(where, 2.0 * weight * power / s, len(self.counts))
        nu = np.minimum(2.0 * self.counts, MOST_FREEDOM)
        student = (
            gammaln(0.5 * (nu + n)) - gammaln(0.5 * nu) - 0.5 * n * np.log(0.5 * nu) - 0.5 * (nu + n) * np.log1p(q / nu)
        )
        return float(np.sum(student) - np.sum(weight * np.log(s)))


def spectrum_of(
    log_f: Array,
    power: Array,
    weight: Array,
    numbers: float,
    *,
    n_bins: int = 14,  # of a spectrum: two to three an octave would follow noise, fewer than two a decade would miss a resonance
    floor_share: float = 1e-12,  # of the mean power, below which a spectrum is rounding
) -> Spectrum:
    """From |R|^2 of all stretches. numbers: fitted ones, taken off the degrees of freedom."""
    order = np.argsort(log_f, kind="stable")
    x, p, w = log_f[order], power[order], weight[order]
    total = float(w.sum())
    p = p * total / max(total - 0.5 * numbers, 0.3 * total)
    cumulated, cuts = np.cumsum(w), [0]
    for i in np.searchsorted(x, np.linspace(x[0], x[-1], n_bins + 1)[1:-1]):
        if i and cumulated[i - 1] - (cumulated[cuts[-1] - 1] if cuts[-1] else 0.0) >= LEAST:
            cuts.append(int(i))
    if len(cuts) > 1 and total - cumulated[cuts[-1] - 1] < LEAST:
        cuts.pop()
    parts = [slice(a, b) for a, b in zip(cuts, [*cuts[1:], len(x)], strict=True)]
    floor = floor_share * float(np.average(p, weights=w)) + 1e-300
    return Spectrum(
        log_f=np.array([np.average(x[c], weights=w[c]) for c in parts]),
        log_s=np.log(np.array([np.average(p[c], weights=w[c]) for c in parts]) + floor),
        edges=np.array([0.5 * (x[i - 1] + x[i]) for i in cuts[1:]]),
        counts=np.array([w[c].sum() for c in parts]),
    )


def windows_of(stretches: Sequence[Stretch], channels: int, tapered: bool = True) -> list[list[Window | None]]:
    return [[window_of(stretch, c, tapered) for c in range(channels)] for stretch in stretches]
