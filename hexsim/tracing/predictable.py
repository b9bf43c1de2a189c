"""Is what a model leaves predictable from any signal? By coherence, and by curves on unseen blocks, each against a null.

The rest of a machine that lacks nothing is noise, and noise follows no signal. The signals are the model's own answers:
they hold no noise, so that noise which the controller feeds back passes for no dependence. The null is the same rest
set against the same signals at another time, a run turned round in itself.

    coherent share     sum_f |<R* S>|^2 / <|S|^2>  over  sum_f <|R|^2>,   <> over segments of all runs
    share of a curve   1 - (what the curve leaves of blocks that its fit has not seen) / (mean square there)

Both look at means over 10 ms: above 50 Hz nothing is predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import stft

from hexsim.tracing import rules
from hexsim.tracing.dependence import CURVES, FOLDS, design, knots_of

Array = np.ndarray
MEAN_S = 0.01  # [s]
SEGMENT_S = 1.0  # [s] of the spectra, which overlap by half
TURNS = 16  # of the null


@dataclass(frozen=True, kw_only=True)
class Predicted:
    """The rest of a channel that follows a signal. form: "coherence" or that of a curve (`dependence`).

    share: of the rest's mean square below 50 Hz, beyond what the null has. above: how many deviations of the null.
    """

    channel: str
    signal: str
    form: str
    share: float
    above: float

    @property
    def sentence(self) -> str:
        """Which channel, which signal, how much of it."""
        way = "by coherence" if self.form == "coherence" else f"by a curve ({self.form})"
        return (
            f"what is left of {self.channel} follows {self.signal} {way}: {self.share:.0%} of its mean square below "
            f"50 Hz, {self.above:.0f} deviations of chance"
        )


def predicted(
    channels: Sequence[str],
    rests: Sequence[Array],
    signals: Sequence[dict[str, Array]],
    velocities: Sequence[dict[str, Array]],
    rate: float,
) -> list[Predicted]:
    """The strongest dependence of each channel's rest, whatever its size, the strongest first.

    rests: a run (n_channels, n). signals: a run, name -> (n,). velocities: name -> (n,) of the direction of a signal.
    """
    per = max(round(MEAN_S * rate), 1)
    rests = [means(rest, per) for rest in rests]
    signals = [{name: means(x, per) for name, x in run.items()} for run in signals]
    velocities = [{name: means(x, per) for name, x in run.items()} for run in velocities]
    names = [name for name in signals[0] if sum(float(np.ptp(run[name])) for run in signals) > 0.0]
    tried = [("coherence", names, coherent_shares(rests, signals, names, rate / per))]
    for form in CURVES:
        shares = np.stack([curve_shares(form, name, rests, signals, velocities, rate / per) for name in names], axis=1)
        tried.append((form, names, shares))
    found: dict[str, Predicted] = {}
    for form, _, shares in tried:
        null = shares[..., 1:]
        excess, spread = shares[..., 0] - null.mean(axis=-1), null.std(axis=-1) + 1e-9
        excess = np.minimum(excess, shares[..., 0] - null.max(axis=-1))
        for k, channel in enumerate(channels):
            j = int(np.argmax(excess[k]))
            own = Predicted(
                channel=channel, signal=names[j], form=form, share=float(excess[k, j]),
                above=float(excess[k, j] / spread[k, j]),
            )  # fmt: skip
            if channel not in found or own.share > found[channel].share + rules.PREDICTED_PLAINER:
                found[channel] = own
    return sorted(found.values(), key=lambda own: -own.share)


def means(x: Array, per: int) -> Array:
    """Means of so many samples (..., n // per)."""
    n = x.shape[-1] // per * per
    return x[..., :n].reshape(*x.shape[:-1], -1, per).mean(axis=-1)


def coherent_shares(
    rests: Sequence[Array], signals: Sequence[dict[str, Array]], names: Sequence[str], rate: float
) -> Array:
    """Share of each rest that is coherent with each signal, (n_channels, n_signals, 1 + TURNS): as it is, then turned."""
    length = round(SEGMENT_S * rate)
    crosses, powers, totals = [], [], []
    for rest, own in zip(rests, signals, strict=True):
        R, S = (
            stft(x, rate, nperseg=length, noverlap=length // 2, padded=False)[2][..., 1:-1]
            for x in (rest, np.stack([own[name] for name in names]))
        )
        k = S.shape[-1]
        turns = [0, *np.linspace(0.1 * k, 0.9 * k, TURNS).round().astype(int)]
        crosses.append([np.einsum("cfk,sfk->csf", R.conj(), np.roll(S, turn, axis=-1)) for turn in turns])
        powers.append(np.sum(np.abs(S) ** 2, axis=-1))
        totals.append(np.sum(np.abs(R) ** 2, axis=(1, 2)))
    cross, power = np.sum(crosses, axis=0), np.sum(powers, axis=0)
    least = 1e-12 * power.max(axis=-1, keepdims=True)  # lines at which a signal has nothing
    shares = np.sum(np.abs(cross) ** 2 / np.maximum(power, least + 1e-300), axis=-1)
    return np.moveaxis(shares, 0, -1) / np.maximum(np.sum(totals, axis=0), 1e-300)[:, None, None]


def curve_shares(
    form: str,
    name: str,
    rests: Sequence[Array],
    signals: Sequence[dict[str, Array]],
    velocities: Sequence[dict[str, Array]],
    rate: float,
) -> Array:
    """Share of each rest that a curve over one signal predicts of unseen blocks, (n_channels, 1 + TURNS)."""
    x = np.concatenate([own[name] for own in signals])
    v = np.concatenate([own[name] for own in velocities])
    X = design(form, x, v, knots_of(x))
    r = np.concatenate([turned(rest) for rest in rests], axis=-1)
    lengths = [rest.shape[-1] for rest in rests]
    block = np.concatenate(
        [np.arange(n) // max(round(rules.PARTLY_BLOCK_S * rate), 1) + 3 * i for i, n in enumerate(lengths)]
    )
    flat = (r - r.mean(axis=-1, keepdims=True)).reshape(-1, r.shape[-1])
    folds = [block % FOLDS == fold for fold in range(FOLDS)]
    A = np.stack([X[own].T @ X[own] for own in folds])
    b = np.stack([X[own].T @ flat[:, own].T for own in folds])
    whole, asked = A.sum(axis=0), b.sum(axis=0)
    gain = np.zeros(flat.shape[0])
    for own, pull in zip(A, b, strict=True):
        normal = whole - own
        normal[np.diag_indices_from(normal)] += 1e-6 * np.trace(normal) / len(normal) + 1e-12
        theta = np.linalg.solve(normal, asked - pull)
        gain += np.sum(theta * (2.0 * pull - own @ theta), axis=0)
    total = np.maximum(np.sum(flat**2, axis=1), 1e-300)
    return (gain / total).reshape(r.shape[:-1])


def turned(rest: Array) -> Array:
    """A rest (n_channels, n) as it is, then turned round in itself: (n_channels, 1 + TURNS, n)."""
    n = rest.shape[-1]
    turns = [0, *np.linspace(0.1 * n, 0.9 * n, TURNS).round().astype(int)]
    return np.stack([np.roll(rest, -turn, axis=-1) for turn in turns], axis=1)
