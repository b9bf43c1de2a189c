"""Is what a model leaves predictable from any signal? By curves (`dependence`) on unseen blocks, against a null.

The rest of a machine that lacks nothing is noise, and noise follows no signal. The signals are the model's own answers:
they hold no noise, so that noise which the controller feeds back passes for no dependence. The null is the same rest
set against the same signals at another time, a run turned round in itself.

    share of a curve   1 - (what the curve leaves of blocks that its fit has not seen) / (mean square there)

of means over 10 ms: above 50 Hz nothing is predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hexsim.signals.weak_form import HALF_WIDTH_S
from hexsim.tracing import rules
from hexsim.tracing.dependence import CURVES, block_numbers, design, knots_of, r2_of

Array = np.ndarray
TURNS = 16  # of the null


@dataclass(frozen=True, kw_only=True)
class Predicted:
    """The rest of a channel that follows a signal. form: that of the curve.

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
        return (
            f"what is left of {self.channel} follows {self.signal} by a curve ({self.form}): {self.share:.0%} of its mean square below "
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
    per = max(round(0.5 * HALF_WIDTH_S * rate), 1)  # above 50 Hz nothing is predicted
    rests = [means(rest, per) for rest in rests]
    signals = [{name: means(x, per) for name, x in run.items()} for run in signals]
    velocities = [{name: means(x, per) for name, x in run.items()} for run in velocities]
    names = [name for name in signals[0] if sum(float(np.ptp(run[name])) for run in signals) > 0.0]
    found: dict[str, Predicted] = {}
    for form in CURVES:
        shares = np.stack([curve_shares(form, name, rests, signals, velocities, rate / per) for name in names], axis=1)
        null = shares[..., 1:]
        excess, spread = shares[..., 0] - null.mean(axis=-1), null.std(axis=-1) + 1e-9
        excess = np.minimum(excess, shares[..., 0] - null.max(axis=-1))
        for k, channel in enumerate(channels):
            j = int(np.argmax(excess[k]))
            own = Predicted(
                channel=channel, signal=names[j], form=form, share=float(excess[k, j]),
                above=float(excess[k, j] / spread[k, j]),
            )  # fmt: skip
            if channel not in found or own.share > found[channel].share + rules.SLIGHT:
                found[channel] = own
    return sorted(found.values(), key=lambda own: -own.share)


def means(x: Array, per: int) -> Array:
    """Means of so many samples (..., n // per)."""
    n = x.shape[-1] // per * per
    return x[..., :n].reshape(*x.shape[:-1], -1, per).mean(axis=-1)


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
    block = block_numbers([rest.shape[-1] for rest in rests], round(rules.REST_BLOCK_S * rate))
    flat = r.reshape(-1, r.shape[-1])
    return r2_of(X, (flat - flat.mean(axis=1, keepdims=True)).T, block).reshape(r.shape[:-1])


def turned(rest: Array) -> Array:
    """A rest (n_channels, n) as it is, then turned round in itself: (n_channels, 1 + TURNS, n)."""
    n = rest.shape[-1]
    turns = [0, *np.linspace(0.1 * n, 0.9 * n, TURNS).round().astype(int)]
    return np.stack([np.roll(rest, -turn, axis=-1) for turn in turns], axis=1)
