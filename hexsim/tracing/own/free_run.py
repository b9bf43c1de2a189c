"""What a simulated machine of one's own lacks: candidates judged by free runs over motion that the fit has not used.

1. The declared numbers are fitted in simulation.
2. Every effect of the library, and of the file, is put in at once with amplitude 0; one simulation with its sensitivities says how much
   of the residual each could take beside the declared numbers.
3. The first few are fitted in full, on all motion and on parts of it; each part is simulated with numbers that have not seen it.
4. The one with the smallest held-out error is named if its gain is beyond chance, no part gets worse beyond chance, and its numbers are
   the same from part to part within their errors. Then again from 2.

Held-out losses are compared block by block (Diebold and Mariano 1995): d = before^2 - after^2, t = mean(d) / its error, with the
correlation of neighbouring blocks in the error. Gain in log likelihood: n/2 ln(before^2 / after^2), n = the number of samples that are as
good as independent, from the correlation of the residual.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import sympy

from hexsim.errors import HexsimError
from hexsim.own.compiled import RATES
from hexsim.own.declaration import Declaration
from hexsim.own.effects import Candidate, Sizes, joined, offered, place_of
from hexsim.own.fit import Fitted, Problem, fit
from hexsim.own.folder import OwnFolder
from hexsim.own.model import Resolver, model_of
from hexsim.own.run import simulated
from hexsim.own.simulate import Record, Simulator, record_of

Array = np.ndarray
Progress = Callable[[str, float], None]
MOST_EFFECTS = 3  # named, one after the other
TRIED = 3  # candidates that are fitted in full
MEMORIES = 1  # the best one with a memory is always tried: what a linear look foretells of it is least sure
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


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeTrace:
    """From the declared machine to what it lacks. errors: step -> run -> rms of each output, on runs of [runs] validate."""

    folder: OwnFolder
    base: Fitted
    steps: list[Judgment]
    refused: list[Judgment]
    errors: dict[str, dict[str, dict[str, float]]]
    verdict: str
    final: Fitted
    declaration: Declaration


def trace_free_run(folder: OwnFolder, tell: Progress = lambda step, share: None) -> FreeTrace:
    """Name what the folder's machine lacks. Raises HexsimError where it cannot be simulated."""
    declaration, where = folder.declaration, folder.where
    columns = set.intersection(*(set(log.columns) for log in (*folder.fit, *folder.validate)))
    tell("fitting the declared machine", 0.05)
    search = Search(folder, columns)
    base, held = search.fitted(declaration, None)
    errors = {"declared": search.errors(base)}
    steps: list[Judgment] = []
    refused: list[Judgment] = []
    current, now = base, held
    again: list[str] = []
    for k in range(MOST_EFFECTS):
        tell(f"looking for what is missing, {k + 1}", 0.1 + 0.8 * k / MOST_EFFECTS)
        judged = search.round(
            declaration, current, now, again, lambda what, k=k: tell(what, 0.1 + 0.8 * (k + 0.5) / MOST_EFFECTS)
        )
        best = next((one for one in judged if one.named), None)
        if best is None:
            refused = judged
            break
        steps.append(best)
        again = [one.candidate.title for one in judged if one is not best and one.verdict != "refused"]
        declaration, current, now = best.declaration, best.fitted, best.after
        errors[f"with {best.candidate.title}"] = search.errors(current)
    del where
    return FreeTrace(
        folder=folder, base=base, steps=steps, refused=refused, errors=errors, verdict=said(steps, refused, now),
        final=current, declaration=declaration,
    )  # fmt: skip


def said(steps: Sequence[Judgment], refused: Sequence[Judgment], now: HeldOut) -> str:
    """The verdict in a sentence."""
    names = " + ".join(
        step.candidate.title + (f" (tied with {', '.join(step.tied)})" if step.tied else "") for step in steps
    )
    rest = [one for one in refused if one.verdict == "likely"]
    open_ = f"; likely, not proven: {', '.join(one.candidate.title for one in rest[:2])}" if rest else ""
    if names:
        return f"named: {names}{open_}"
    if rest:
        return f"unexplained{open_}"
    return "nothing of the library makes held-out simulations better"


class Search:
    """Fits of one folder's runs. folds: weights of each run for the fit and for the score."""

    def __init__(self, folder: OwnFolder, columns: set[str]) -> None:
        self.folder, self.columns, self.simulators = folder, columns, {}
        self.noises: Array | None = None

    def fitted(
        self, declaration: Declaration, begin: dict[str, float] | None, most: int = 100
    ) -> tuple[Fitted, HeldOut]:
        """All motion, and each part without it."""
        model = model_of(declaration, self.folder.where, self.columns)
        simulator = Simulator(model)
        records = [record_of(model, log, self.folder.where) for log in self.folder.fit]
        start = None if begin is None else values_of(simulator, records, begin)
        whole = fit(simulator, records, begin=start, starts=None if begin is None else 1, most=most)
        return whole, held_out(simulator, records, whole)

    def errors(self, fitted: Fitted) -> dict[str, dict[str, float]]:
        """Rms on runs that are held out for good."""
        return {log.name: simulated(fitted, log, self.folder.where)[1] for log in self.folder.validate}

    def round(
        self, declaration: Declaration, now: Fitted, held: HeldOut, again: Sequence[str], tell: Callable[[str], None]
    ) -> list[Judgment]:
        """Candidates that were fitted in full, the best first. again: titles that are tried whatever they promise."""
        records = [record_of(now.simulator.model, log, self.folder.where) for log in self.folder.fit]
        sizes = sizes_of(declaration, now, records)
        found = offered(declaration, now.simulator.model.inputs, sizes)
        if not found:
            return []
        tell(f"{len(found)} candidates")
        ranked = self.screened(declaration, now, found)
        judged = []
        memories = [one for one in ranked if one.memory and not one.switch][:MEMORIES]
        tried = ranked[:TRIED] + [one for one in ranked[TRIED:] if one.title in again or one in memories]
        for candidate in tried:
            tell(f"trying {candidate.title}")
            made = joined(declaration, candidate)
            try:
                whole, after = self.fitted(made, begun(now, candidate), NUDGES * 2)
            except HexsimError:
                continue
            judged.append(judge(candidate, whole, made, held, after, len(ranked)))
        judged.sort(key=lambda one: (not one.named, one.after.rms))
        most = max((one.nats for one in judged if one.named), default=0.0)
        judged.sort(key=lambda one: (not one.named, len(one.candidate.numbers) if most - one.nats < TIE else math.inf))
        return [with_ties(one, judged) for one in judged]

    def screened(self, declaration: Declaration, now: Fitted, found: Sequence[Candidate]) -> list[Candidate]:
        """By what each could take of the residual beside the declared numbers; one try of each effect and place."""
        everything: Declaration = declaration
        kept = []
        for k, candidate in enumerate(found):
            one = distinct(candidate, k)
            everything = joined(everything, one, neutral=True)
            kept.append(one)
        model = model_of(everything, self.folder.where, self.columns)
        simulator = Simulator(model)
        records = [record_of(model, log, self.folder.where) for log in self.folder.fit]
        problem = Problem(simulator, records, noises=now.noises)
        theta = values_of(simulator, records, dict(zip(now.names, now.values, strict=True)))
        rest, slopes = problem.residuals(theta), problem.jacobian(theta)
        names = [number.name for number in problem.numbers]
        base = slopes[:, [names.index(name) for name in now.names]]
        scores: dict[tuple[str, str], tuple[float, Candidate]] = {}
        for candidate, one in zip(found, kept, strict=True):
            own = [one.switch] if one.switch else list(one.amplitude)
            gain = taken(rest, base, slopes[:, [names.index(name) for name in own]], one)
            if gain > scores.get((candidate.title, ""), (0.0, candidate))[0]:
                scores[candidate.title, ""] = (gain, candidate)
        return [candidate for _, candidate in sorted(scores.values(), key=lambda pair: -pair[0])]


def distinct(candidate: Candidate, k: int) -> Candidate:
    """The same with names that no other candidate has."""
    names = [*candidate.numbers, *([candidate.switch] if candidate.switch else []), *([candidate.memory[0]] if candidate.memory else []),
             *([candidate.curve[0]] if candidate.curve else [])]  # fmt: skip
    new = {name: f"{name}_c{k}" for name in names}
    swap = lambda text: swapped(text, new)  # noqa: E731
    memory = None
    if candidate.memory:
        table = candidate.memory[1]
        extra = {key: swap(str(value)) for key, value in (table.__pydantic_extra__ or {}).items()}
        memory = (
            new[candidate.memory[0]],
            type(table).model_validate({"kind": table.kind, "of": swap(table.of), **extra}),
        )
    return replace(
        candidate, formulas={key: swap(text) for key, text in candidate.formulas.items()},
        numbers={new[name]: table for name, table in candidate.numbers.items()},
        amplitude=tuple(new[name] for name in candidate.amplitude), memory=memory,
        switch=new[candidate.switch] if candidate.switch else None,
        curve=(new[candidate.curve[0]], swap(candidate.curve[1])) if candidate.curve else None,
    )  # fmt: skip


def swapped(text: str, new: dict[str, str]) -> str:
    return re.sub(r"[A-Za-z_][A-Za-z0-9_]*", lambda found: new.get(found.group(), found.group()), text)


def taken(rest: Array, base: Array, own: Array, candidate: Candidate) -> float:
    """Share of the residual's square that the amplitudes could take beside the base's numbers; 0 against their sign."""
    if not np.isfinite(own).all() or not own.any():
        return 0.0
    both = np.hstack([base, own])
    size = np.linalg.norm(both, axis=0)
    size[size == 0] = 1.0
    found = np.linalg.lstsq(both / size, -rest, rcond=1e-9)[0]
    alone = np.linalg.lstsq(base / size[: base.shape[1]], -rest, rcond=1e-9)[0]
    signs = [
        candidate.numbers[name].sign if name in candidate.numbers else 1 for name in (candidate.amplitude or ("",))
    ]
    if len(signs) == 1 and signs[0] and found[-1] * signs[0] <= 0:
        return 0.0
    left = np.sum((rest + (both / size) @ found) ** 2)
    before = np.sum((rest + (base / size[: base.shape[1]]) @ alone) ** 2)
    return float(1.0 - left / max(before, 1e-300)) if before > 0 else 0.0


def values_of(simulator: Simulator, records: Sequence[Record], known: dict[str, float]) -> Array:
    """theta with what is known put in."""
    problem = Problem(simulator, records, noises=np.ones(len(simulator.model.outputs)))
    return np.array([known.get(number.name, number.start) for number in problem.numbers])


def begun(now: Fitted, candidate: Candidate) -> dict[str, float]:
    """Where the search with a candidate begins: the numbers there are, amplitudes a little off 0 on their side."""
    known = dict(zip(now.names, (float(value) for value in now.values), strict=True))
    for name in candidate.amplitude:
        table = candidate.numbers[name]
        known[name] = 0.1 * (table.scale or 1.0) * (table.sign or 1)
    return known


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
        verdict, why = "refused", f"held-out error {'grows' if fall < 0 else 'falls'} by {100 * abs(fall):.1f} % only"
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


def sizes_of(declaration: Declaration, now: Fitted, records: Sequence[Record]) -> Callable[[str, str], Sizes]:
    """Typical sizes of signals, from the free runs of the model as it is."""
    problem = Problem(now.simulator, records, noises=now.noises)
    model, runs = now.simulator.model, problem.free_runs(now.values, False)
    states = np.concatenate([free.states for free in runs])
    spread = dict(zip(model.states, np.sqrt(np.nanmean(states**2, axis=0)), strict=True))
    middle = dict(zip(model.states, 0.5 * (np.nanmax(states, axis=0) + np.nanmin(states, axis=0)), strict=True))
    half = dict(zip(model.states, 0.5 * (np.nanmax(states, axis=0) - np.nanmin(states, axis=0)), strict=True))
    dt, duration = records[0].dt, float(np.mean([record.time[-1] for record in records]))

    def of(what: str, name: str) -> Sizes:
        common = {"T": dt, "D": duration}
        if what == "sum":
            at = place_of(name, declaration) or name
            sums = sum_size(declaration, now, runs, records, name)
            return Sizes(X=spread[name] or 1.0, S=sums or 1.0, P=half[at] or 1.0, M=middle[at], **common)
        if what == "input":
            k = model.inputs.index(name)
            values = np.concatenate([record.inputs[:, k] for record in records])
        else:
            k = model.outputs.index(name)
            values = np.concatenate([record.measured[record.weight[:, k] > 0, k] for record in records])
        return Sizes(Y=float(np.sqrt(np.mean(values**2))) or 1.0, P=0.5 * float(np.ptp(values)) or 1.0,
                     M=0.5 * float(values.max() + values.min()), **common)  # fmt: skip

    return of


def sum_size(declaration: Declaration, now: Fitted, runs, records: Sequence[Record], name: str) -> float:
    """Rms of storage times rate of a state along the runs, or of the storage times the range over a time where it is near balance."""
    model = now.simulator.model
    k, count = model.states.index(name), len(model.numbers)
    nx = len(model.states)
    out = np.zeros(nx + nx * nx + nx * count)
    problem = Problem(now.simulator, records, noises=now.noises)
    found = []
    del declaration
    for r, (record, free) in enumerate(zip(records, runs, strict=True)):
        p = np.ascontiguousarray(now.values[problem.columns[r]])
        inputs = now.simulator.inputs(record, p)
        for i in range(0, record.n, max(record.n // 400, 1)):
            u = np.array([*inputs[i], record.time[i], record.dt])
            now.simulator.equations(RATES, np.tile(free.states[i], 2), u, p, out)
            # the part of the rate that inputs give: what a missing term is compared with
            found.append(out[k])
    return float(np.sqrt(np.nanmean(np.square(found)))) * storage_of(now, name)


def storage_of(now: Fitted, name: str) -> float:
    """Value of a state's storage with the numbers there are (states in it: at their means)."""
    model = now.simulator.model
    table = model.tables.states[name]
    value = Resolver(model.tables, "storage", model.tables.states).of(table.storage, f"[states.{name}]")
    named = dict(zip(now.names, (float(one) for one in now.values), strict=True))
    value = value.xreplace(
        {symbol: sympy.Float(named[str(symbol)]) for symbol in value.free_symbols if str(symbol) in named}
    )
    return abs(float(value)) if value.is_number else 1.0
