"""Evidence for an effect: motion that the numbers have not seen, losses of its blocks, and the judgment of a candidate.

Losses are compared block by block (Diebold and Mariano 1995): d = before^2 - after^2, t = mean(d) / its error, with the correlation of
neighbouring blocks in the error. Gain in log likelihood: n/2 ln(before^2 / after^2), n = the number of samples that are as good as
independent, from the correlation of the residual.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hexsim.own.declaration import Declaration
from hexsim.own.effects import Candidate
from hexsim.own.fit import Fitted, Problem, fit
from hexsim.own.simulate import Record, Simulator

Array = np.ndarray
BLOCKS = 16  # of a part, whose losses are compared
CHANCE = 0.02  # that a name comes by chance: the gain in log likelihood must be above ln(candidates / CHANCE)
LEAST_T = 1.0  # errors of the mean gain over blocks: one occasion alone names nothing
TIE = math.log(20.0)  # log odds below which two candidates are tied
LEAST_FALL = 0.03  # of the held-out rms: less is not worth a name
APART = 3.0  # errors, beyond which numbers of two parts differ
SAME = 0.3  # of a number: parts that differ by less are the same
NUDGES = 30  # evaluations of a fit that begins at another's numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOut:
    """A model on parts that its numbers have not seen. rests: per fold (n, ny) weighted by noise; numbers: per fold."""

    rests: list[list[Array]]
    fits: list[Fitted]

    def losses(self) -> Array:
        """Mean square of every block of every part and run, [noise^2]."""
        return np.array([
            np.mean(block**2) for parts in self.rests for rest in parts
            for block in np.array_split(rest, min(BLOCKS, max(len(rest) // 8, 1))) if block.size
        ])  # fmt: skip

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.losses())))

    def fold_rms(self) -> list[float]:
        return [float(np.sqrt(np.mean(np.concatenate([rest**2 for rest in parts])))) for parts in self.rests]


@dataclass(frozen=True, kw_only=True, eq=False)
class Judgment:
    """A candidate against the model without it."""

    candidate: Candidate
    fitted: Fitted
    declaration: Declaration
    before: HeldOut
    after: HeldOut
    t: float
    nats: float
    verdict: str
    why: str
    tied: list[str] = field(default_factory=list)

    @property
    def named(self) -> bool:
        return self.verdict == "named"


def halves(records: Sequence[Record], of_run: bool) -> list[tuple[list[Record], list[Record]]]:
    """(to fit, to score) twice: every second run, or the halves in time of the one run (or of each, where runs have own numbers)."""
    found = []
    for k in range(2):
        fits, scores = [], []
        for r, record in enumerate(records):
            mask = np.zeros_like(record.weight)
            if len(records) == 1 or of_run:
                seen = np.flatnonzero(record.weight.any(axis=1))
                middle = int(seen[len(seen) // 2]) if len(seen) else record.n // 2
                mask[slice(0, middle) if k == 0 else slice(middle, None)] = 1.0
            elif r % 2 == k:
                mask[:] = 1.0
            fits.append(replace(record, weight=record.weight * mask))
            scores.append(replace(record, weight=record.weight * (1.0 - mask)))
        found.append((fits, scores))
    return found


def held_out(simulator: Simulator, records: Sequence[Record], whole: Fitted) -> HeldOut:
    """Numbers from one half, residuals of the other, both ways."""
    of_run = any(number.of_run for number in simulator.model.numbers)
    rests, fits = [], []
    for fitted_on, scored in halves(records, of_run):
        used = [record for record in fitted_on if record.weight.any()] if not of_run else fitted_on
        own = fit(simulator, used, begin=whole.values, starts=1, most=NUDGES)
        fits.append(own)
        problem = Problem(simulator, scored, noises=whole.noises)
        theta = values_of(simulator, scored, dict(zip(own.names, own.values, strict=True)))
        parts = []
        for record, free in zip(scored, problem.free_runs(theta, False), strict=True):
            rest = np.nan_to_num((free.outputs - record.measured) / whole.noises, nan=1e6)
            rows = record.weight > 0
            if rows.any():
                parts.append(np.concatenate([rest[rows[:, k], k] for k in range(rest.shape[1])]))
        rests.append(parts)
    return HeldOut(rests=rests, fits=fits)


def values_of(simulator: Simulator, records: Sequence[Record], known: dict[str, float]) -> Array:
    """theta with what is known put in."""
    problem = Problem(simulator, records, noises=np.ones(len(simulator.model.outputs)))
    return np.array([known.get(number.name, number.start) for number in problem.numbers])


def judge(
    candidate: Candidate, whole: Fitted, made: Declaration, before: HeldOut, after: HeldOut, count: int
) -> Judgment:
    """Named, likely or refused, and why."""
    difference = before.losses() - after.losses()
    t = mean_over_error(difference)
    nats = 0.5 * independent(after) * math.log(max(before.rms, 1e-300) ** 2 / max(after.rms, 1e-300) ** 2)
    fall = 1.0 - after.rms / before.rms if before.rms > 0 else 0.0
    worse = [
        k
        for k, (a, b) in enumerate(zip(after.fold_rms(), before.fold_rms(), strict=True))
        if a > b * (1.0 + LEAST_FALL)
    ]
    changed = changing(candidate, after, whole)
    needed = math.log(max(count, 1) / CHANCE)
    verdict, why = "named", f"held-out error falls by {100 * fall:.0f} %"
    if fall < LEAST_FALL:
        verdict = "refused"
        why = (
            f"held-out error grows by {-100 * fall:.1f} %"
            if fall < 0
            else f"held-out error falls by {100 * fall:.1f} % only"
        )
    elif nats < needed or t < LEAST_T:
        verdict = "likely"
        why = (
            f"gain of {nats:.1f} nats, {needed:.1f} are needed"
            if nats < needed
            else f"the gain over blocks is {t:.1f} of its errors"
        )
    elif worse:
        verdict, why = "likely", "one part of the motion gets worse with it"
    elif changed:
        verdict, why = "likely", f"{changed}: a stand-in for something else"
    return Judgment(candidate=candidate, fitted=whole, declaration=made, before=before, after=after, t=t, nats=nats,
                    verdict=verdict, why=why)  # fmt: skip


def mean_over_error(d: Array) -> float:
    """t of a mean whose neighbours are correlated (Newey and West 1987, three lags)."""
    n, e = len(d), d - d.mean()
    variance = float(np.mean(e * e))
    for lag in range(1, min(4, n)):
        variance += 2.0 * (1.0 - lag / 4.0) * float(np.sum(e[lag:] * e[:-lag])) / n
    return float(d.mean() / math.sqrt(max(variance, 1e-30 * float(np.mean(d * d)) + 1e-300) / n))


def independent(held: HeldOut) -> float:
    """Samples that are as good as independent: n / (1 + 2 sum of the correlation up to its first zero)."""
    total = 0.0
    for parts in held.rests:
        for rest in parts:
            e = rest - rest.mean()
            spectrum = np.abs(np.fft.rfft(e, 2 * len(e))) ** 2
            correlation = np.fft.irfft(spectrum)[: len(e)]
            if correlation[0] <= 0:
                continue
            correlation = correlation / correlation[0]
            stop = int(np.argmax(correlation < 0)) or len(e)
            total += len(e) / (1.0 + 2.0 * float(np.sum(correlation[1:stop])))
    return total


def changing(candidate: Candidate, after: HeldOut, whole: Fitted) -> str:
    """The amplitude that differs between the parts beyond its error and by more than SAME, in words."""
    del whole
    for name in candidate.amplitude if len(candidate.amplitude) == 1 else ():
        values = [one.value(name) for one in after.fits]
        errors = [one.errors[one.names.index(name)] for one in after.fits]
        if values[0] * values[1] < 0 and all(abs(v) > e for v, e in zip(values, errors, strict=True)):
            return f"{name} is {values[0]:.3g} on one part and {values[1]:.3g} on the other"
        apart = abs(values[0] - values[1])
        if apart > APART * math.hypot(*errors) and apart > SAME * max(map(abs, values)):
            return f"{name} is {values[0]:.3g} on one part and {values[1]:.3g} on the other"
    return ""


def with_ties(one: Judgment, judged: Sequence[Judgment]) -> Judgment:
    """Others that are named as well, at odds below TIE."""
    tied = [
        f"{other.candidate.title}, odds 1 to {math.exp(min(max(one.nats - other.nats, 0.0), TIE)):.1f}" for other in judged
        if other is not one and other.named and one.named and one.nats - other.nats < TIE
    ]  # fmt: skip
    return replace(one, tied=tied)
