"""On what does a residual depend: additive curves over one signal, judged by cross-validation in blocks.

Forms for a signal s, because a missing gain looks like a curve only after the flow is taken out:
    plain r = g(s)      direction r = g(s) for each sign of v      product r = v g(s)
    memory r = sign(v) g(|v| through a low-pass): what the speed was lately, for the velocity only
plain, direction and product also of s through a low-pass, whose time constant is found, where that predicts clearly better
    late, play: the residual follows what a delay or a backlash of the channel itself would do (columns of the caller)
    size |r| = g(s): where the residual is large, asked only when its sign follows nothing
g is piecewise linear between quantiles. R^2 is that of blocks that the fit has not seen. A line in the spectrum that
stands at one frequency in every run, whatever the motion, is an outside source.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from scipy.optimize import minimize_scalar

from hexsim.tracing import rules

Array = np.ndarray


class Curves(NamedTuple):
    """Constants of the curves of a residual over a signal."""

    knots: int = 14  # of a curve at most: half at quantiles, half evenly spaced
    unclear: float = 0.2  # below this R^2 the residual's size is asked
    # [s] time constants of a low-pass; that of a signal is sought a factor of 2.5 either way
    lags_s: tuple[float, ...] = (0.1, 0.4, 1.6, 6.4)


CURVE = Curves()

CURVES = ("plain", "direction", "product")
FORMS = (*CURVES, "memory", "late", "play")  # the plainest first


@dataclass(frozen=True, kw_only=True, eq=False)
class Dependence:
    """The strongest dependence of a residual, and R^2 of every signal.

    knots and curve: g at its knots, in the residual's unit; for "direction" the one of v > 0, `back` that of v <= 0; for "product"
    at the speed `speed_m_s`; empty for "late", "play" and "tone".
    r2_cv of "size" is that of |r|. memory_s: time constant of the low-pass, None without one.
    """

    signal: str
    form: str
    r2_cv: float
    frequency_Hz: float | None = None
    memory_s: float | None = None
    knots: Array
    curve: Array
    curve_sd: Array
    table: dict[str, float]  # signal -> best R^2 over forms
    back: Array | None = None
    speed_m_s: float = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Regressors:
    """One form of one signal over all runs: X (n, k); its knots (empty without a curve); time constant of a memory."""

    form: str
    X: Array
    knots: Array
    memory_s: float | None = None


def hats(x: Array, knots: Array) -> Array:
    """Piecewise-linear basis (n, n_knots), constant beyond the ends."""
    x = np.clip(x, knots[0], knots[-1])
    j = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    share = (x - knots[j]) / (knots[j + 1] - knots[j])
    basis = np.zeros((len(x), len(knots)))
    basis[np.arange(len(x)), j] = 1 - share
    basis[np.arange(len(x)), j + 1] = share
    return basis


def knots_of(x: Array) -> Array:
    """Knots half at quantiles, half evenly spaced, so that neither a rare range nor a busy one is coarse."""
    quantiles = np.quantile(x, np.linspace(0, 1, CURVE.knots // 2 + 1))
    even = np.linspace(quantiles[0], quantiles[-1], CURVE.knots // 2 + 1)
    return np.unique(np.concatenate([quantiles, even]))


def design(form: str, x: Array, v: Array, knots: Array) -> Array:
    """Regressors of one form."""
    basis = hats(x, knots)
    if form == "direction":
        return np.concatenate([basis * (v > 0)[:, None], basis * (v <= 0)[:, None]], axis=1)
    if form == "product":
        return basis * v[:, None] / typical_speed(v)
    return basis


def typical_speed(v: Array) -> float:
    return max(float(np.std(v)), 1e-12)


def ridge(X: Array, r: Array) -> tuple[Array, Array]:
    """Coefficients and the inverse of the normal matrix, weakly regularised."""
    return ridge_of(X.T @ X, X.T @ r)


def ridge_of(A: Array, b: Array) -> tuple[Array, Array]:
    """The same of normal equations A = X'X, b = X'r."""
    A = A + (1e-6 * np.trace(A) / len(A) + 1e-12) * np.eye(len(A))
    inverse = np.linalg.inv(A)
    return inverse @ b, inverse


def r2_of(X: Array, r: Array, blocks: Array) -> Any:
    """Cross-validated R^2 of r (n,), or of every column of r (n, m): (m,). Blocks go to folds in turn."""
    rest = 0.0
    folds = [(X[own], r[own]) for own in (blocks % rules.FOLDS == fold for fold in range(rules.FOLDS)) if own.any()]
    parts = [(x.T @ x, x.T @ y) for x, y in folds]
    A, b = sum(one for one, _ in parts), sum(one for _, one in parts)
    for (x, y), (own_A, own_b) in zip(folds, parts, strict=True):
        theta, _ = ridge_of(A - own_A, b - own_b)
        rest = rest + np.sum((y - x @ theta) ** 2, axis=0)
    return 1.0 - rest / np.maximum(np.sum((r - r.mean(axis=0)) ** 2, axis=0), 1e-300)


def block_numbers(lengths: Sequence[int], per_block: int) -> Array:
    """Number of the block of every sample over all runs."""
    numbers, first = [], 0
    for n in lengths:
        own = np.arange(n) // max(per_block, 1)
        numbers.append(first + own)
        first += int(own[-1]) + 1 if n else 0
    return np.concatenate(numbers)


def tone_of(residuals: Sequence[Array], rate: float) -> tuple[float, float]:
    """(frequency [Hz], least share of the residual over the runs) of the strongest line of the first run."""
    longest = max(residuals, key=len)
    window = np.hanning(len(longest))
    spectrum = np.abs(np.fft.rfft((longest - longest.mean()) * window, 4 * len(longest)))
    frequencies = np.fft.rfftfreq(4 * len(longest), 1 / rate)
    spectrum[frequencies < 0.5] = 0.0
    best = frequencies[int(np.argmax(spectrum))]
    width = rate / len(longest)

    def shares(f: float) -> list[float]:
        return [line_share(r, f, rate) for r in residuals]

    fine = best + np.linspace(-width, width, 41)
    frequency = float(max(fine, key=lambda f: sum(shares(float(f)))))
    return frequency, min(shares(frequency))


def line_share(residual: Array, frequency_Hz: float, rate: float) -> float:
    """Share of the variance of a residual (n,) that the line at a frequency takes."""
    t = np.arange(len(residual)) / rate
    X = np.stack([np.cos(2 * np.pi * frequency_Hz * t), np.sin(2 * np.pi * frequency_Hz * t), np.ones(len(t))], axis=1)
    left = residual - X @ np.linalg.lstsq(X, residual, rcond=None)[0]
    return 1 - float(np.sum(left**2)) / max(float(np.sum((residual - residual.mean()) ** 2)), 1e-300)


def low_passed(x: Array, time_constant_s: float, rate: float) -> Array:
    """First-order low-pass, in its steady state at the first sample."""
    pole = np.exp(-1.0 / (time_constant_s * rate))
    return scipy.signal.lfilter([1 - pole], [1, -pole], x, zi=[pole * x[0]])[0]


def behind_low_pass(words: str, memory_s: float | None) -> str:
    """The words for a signal that a residual follows behind a low-pass, or at once."""
    return f"{words} behind a low-pass of {memory_s:.2g} s" if memory_s else words


def memories(velocities: Sequence[Array], rate: float) -> list[Regressors]:
    """sign(v) g(low-passed |v|) for every time constant."""
    found, v = [], np.concatenate(velocities)
    for memory_s in CURVE.lags_s:
        lately = np.concatenate([low_passed(np.abs(own), memory_s, rate) for own in velocities])
        knots = knots_of(lately)
        found.append(
            Regressors(form="memory", X=hats(lately, knots) * np.sign(v)[:, None], knots=knots, memory_s=memory_s)
        )
    return found


def best_memory(
    names: Sequence[str], r: Array, blocks: Array, signals: Sequence[Mapping[str, Array]], v: Array, rate: float
) -> tuple[str, Regressors, float]:
    """The signal, form and time constant of a low-pass with the best R^2; the first of those that do nearly alike."""

    def scored(name: str, form: str, memory_s: float) -> tuple[Regressors, float]:
        lately = np.concatenate([low_passed(own[name], memory_s, rate) for own in signals])
        knots = knots_of(lately)
        one = Regressors(form=form, X=design(form, lately, v, knots), knots=knots, memory_s=memory_s)
        return one, r2_of(one.X, r, blocks)

    tried = [(n, f, m, scored(n, f, m)[1]) for f in CURVES for n in names for m in CURVE.lags_s]
    most = max(score for *_, score in tried) - rules.SLIGHT
    name, form, _, _ = next(one for one in tried if one[3] > most)
    near = max((one for one in tried if one[:2] == (name, form)), key=lambda one: one[3])[2]
    found = minimize_scalar(
        lambda x: -scored(name, form, float(np.exp(x)))[1], method="bounded", options={"xatol": 0.02},
        bounds=(np.log(near / 2.5), np.log(near * 2.5)),
    )  # fmt: skip
    return name, *scored(name, form, float(np.exp(found.x)))


def of_size(x: Array, size: Array, blocks: Array) -> tuple[Regressors, float]:
    """A curve over one signal for the residual's size, and its R^2."""
    knots = knots_of(x)
    one = Regressors(form="size", X=hats(x, knots), knots=knots)
    return one, r2_of(one.X, size, blocks)


def regressors_of(
    name: str,
    x: Array,
    velocities: Sequence[Array],
    rate: float,
    columns: Mapping[tuple[str, str], Sequence[Array]],
) -> list[Regressors]:
    """The forms in which a residual may depend on one signal x (n,) of all runs; the arguments of `dependence_of`."""
    is_speed, knots, v = name.startswith("velocity"), knots_of(x), np.concatenate(velocities)
    found = [Regressors(form=f, X=design(f, x, v, knots), knots=knots) for f in (CURVES[:1] if is_speed else CURVES)]
    found += memories(velocities, rate) if is_speed else []
    for (channel, form), runs in columns.items():
        if channel == name:
            X = np.concatenate(runs)
            found.append(Regressors(form=form, X=X / max(float(np.std(X)), 1e-300), knots=np.zeros(0)))
    return found


def dependence_of(
    residuals: Sequence[Array],
    signals: Sequence[dict[str, Array]],
    velocities: Sequence[Array],
    rate: float,
    order: Sequence[str],
    columns: Mapping[tuple[str, str], Sequence[Array]] | None = None,
) -> Dependence:
    """The strongest dependence of the residual of all runs together.

    residuals: a run (n,); signals: name -> (n,), the same names in every run; velocities (n,) split the directions.
    order: which signal speaks for itself when another follows it closely; one that is not in it is not considered.
    columns: (signal, "late" or "play") -> a run (n, k), how the residual would change if that channel were so.
    """
    r = np.concatenate(residuals)
    blocks = block_numbers([len(x) for x in residuals], int(rules.BLOCK_S * rate))
    moving = {name: np.concatenate([s[name] for s in signals]) for name in signals[0]}
    moving = {name: x for name, x in moving.items() if np.ptp(x) > 0}
    table: dict[str, float] = {}
    found: dict[str, tuple[Regressors, float]] = {}
    for name, x in moving.items():
        tried = regressors_of(name, x, velocities, rate, columns or {})
        scored = [(one, r2_of(one.X, r, blocks)) for one in tried]
        table[name] = max(score for _, score in scored)
        good = [(one, score) for one, score in scored if score > table[name] - rules.SLIGHT]
        found[name] = min(good, key=lambda pair: (FORMS.index(pair[0].form), -pair[1]))
    frequency, share = tone_of(residuals, rate)
    if share > rules.MAIN and share > max((score for _, score in found.values()), default=0.0):
        empty = np.zeros(0)
        return Dependence(
            signal="time", form="tone", r2_cv=share, frequency_Hz=frequency, knots=empty, curve=empty, curve_sd=empty,
            table=table | {"tone": share},
        )  # fmt: skip
    target = r
    if max(table[name] for name in table if name in order) < CURVE.unclear:
        size = np.minimum(np.abs(r), np.quantile(np.abs(r), 1.0 - rules.TAIL))
        sized = {name: of_size(x, size, blocks) for name, x in moving.items()}
        if max(sized[name][1] for name in sized if name in order) > CURVE.unclear:
            target, found = size, sized
    best = max(found[name][1] for name in found if name in order)
    signal = next(name for name in order if name in found and found[name][1] > best - rules.TELLABLE)
    chosen, score = found[signal]
    others = [name for name in order if name in moving and name != "time_s"]
    if target is r and others and best < 1.0 - rules.TELLABLE:
        name, one, later = best_memory(others, r, blocks, signals, np.concatenate(velocities), rate)
        if later > best + rules.TELLABLE:
            signal, chosen, score = name, one, later
            table[name] = later
    theta, inverse = ridge(chosen.X, target)
    spread = float(np.sqrt(np.mean((target - chosen.X @ theta) ** 2)))
    k = len(chosen.knots)
    return Dependence(
        signal=signal,
        form=chosen.form,
        r2_cv=score,
        memory_s=chosen.memory_s,
        knots=chosen.knots,
        curve=theta[:k],
        curve_sd=spread * np.sqrt(np.diag(inverse))[:k],
        table=table,
        back=theta[k:] if chosen.form == "direction" else None,
        speed_m_s=typical_speed(np.concatenate(velocities)) if chosen.form == "product" else 1.0,
    )
