"""What a simulated machine of one's own lacks: candidates judged by free runs over motion that the fit has not used.

1. The declared numbers are fitted in simulation.
2. Every effect of the library, and of the file, is put in at once with amplitude 0; one simulation with its sensitivities says how much
   of the residual each could take beside the declared numbers.
3. The first few are fitted in full, on all motion and on parts of it; each part is simulated with numbers that have not seen it.
4. The one with the smallest held-out error is named if its gain is beyond chance, no part gets worse beyond chance, and its numbers are
   the same from part to part within their errors. Then again from 2.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hexsim.errors import HexsimError
from hexsim.own.declaration import Declaration
from hexsim.own.effects import Candidate, joined, offered
from hexsim.own.fit import Fitted, Problem, fit
from hexsim.own.folder import OwnFolder
from hexsim.own.model import model_of
from hexsim.own.run import simulated
from hexsim.own.simulate import Simulator, record_of
from hexsim.own.sizes import sizes_of
from hexsim.tracing.own.free_run_evidence import NUDGES, TIE, HeldOut, Judgment, held_out, judge, values_of, with_ties

Array = np.ndarray
Progress = Callable[[str, float], None]
MOST_EFFECTS = 3  # named, one after the other
TRIED = 3  # candidates that are fitted in full
MEMORIES = 1  # the best one with a memory is always tried: what a linear look foretells of it is least sure


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
    declaration = folder.declaration
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


def begun(now: Fitted, candidate: Candidate) -> dict[str, float]:
    """Where the search with a candidate begins: the numbers there are, amplitudes a little off 0 on their side."""
    known = dict(zip(now.names, (float(value) for value in now.values), strict=True))
    for name in candidate.amplitude:
        table = candidate.numbers[name]
        known[name] = 0.1 * (table.scale or 1.0) * (table.sign or 1)
    return known
