"""What a simulated machine of one's own lacks: the general effects and those of its file, judged by the one inference."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hexsim.inference.formula import Formula, formula_of
from hexsim.inference.likelihood import Fit
from hexsim.inference.notebook import Notebook
from hexsim.inference.search import Found, search
from hexsim.inference.stated import stated
from hexsim.inference.verdict import Judgment, changing
from hexsim.own.declaration import Declaration
from hexsim.own.effects import Candidate, distinct, joined, offered, with_values
from hexsim.own.folder import OwnFolder
from hexsim.own.forms import Form, forms, loosened, memories
from hexsim.own.looks import Look, looks
from hexsim.own.model import model_of
from hexsim.own.problem import OwnProblem, problem_of
from hexsim.own.run import mean_squares, simulated
from hexsim.own.sizes import sizes_of

Array = np.ndarray
NOT_BETTER = "does not make the runs that no fit or choice has seen better"


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnTrace:
    """From the declared machine to what it lacks. formula: for what names leave. errors: step -> run -> rms of each output, on runs of
    [runs] validate. remarks: declared numbers that are not the same in all motion."""

    folder: OwnFolder
    found: Found
    errors: dict[str, dict[str, dict[str, float]]]
    verdict: str
    remarks: list[str]
    declaration: Declaration
    formula: Formula | None = None

    @property
    def steps(self) -> list[Judgment]:
        return self.found.steps

    @property
    def final(self) -> Fit:
        return self.found.final


def trace_own(
    folder: OwnFolder,
    tell: Callable[[str, float], None] = lambda step, share: None,
    notes: Notebook | None = None,
    keep: Callable[[OwnTrace], None] = lambda trace: None,
) -> OwnTrace:
    """Name what the folder's machine lacks. Raises HexsimError where it cannot be simulated. notes, keep: as in `search`."""
    machine = Simulated(folder)
    notes = notes or Notebook()
    found = search(machine, tell, notes=notes, keep=lambda known: keep(traced(folder, machine, known)))
    found = proven_untouched(folder, found)
    formula = formula_of(machine, found, notes, lambda what: tell(what, 0.9))
    if formula is not None and formula.proven:
        beside = found.base if formula.instead else found.final
        if not falls(mean_squares(folder, beside), mean_squares(folder, formula.best.fitted)):
            formula = replace(formula, why=f"{formula.best.title} {NOT_BETTER}")
    if formula is not None and formula.instead:
        why = f"{formula.best.title} alone is as likely as every name together, or likelier"
        found = without_names(found, found.steps, why)
    if formula is not None and formula.tied:
        [step] = found.steps
        found, formula = replace(found, steps=[replace(step, tied=[*step.tied, *formula.tied])]), None
    return traced(folder, machine, found, formula)


def without_names(found: Found, doubted: Sequence[Judgment], why: str) -> Found:
    """Steps that are no names after all."""
    titles = {one.title for one in doubted}
    steps = [step for step in found.steps if step.title not in titles]
    return replace(
        found, steps=steps, refused=[*(replace(one, verdict="likely", why=why) for one in doubted), *found.refused]
    )


def proven_untouched(folder: OwnFolder, found: Found) -> Found:
    """Without names that make the runs which no fit or choice has seen no better, each or all together: what was fitted may flatter a
    search."""
    if not found.steps:
        return found
    errors = [mean_squares(folder, one) for one in (found.base, *(step.fitted for step in found.steps), found.final)]
    together = falls(errors[0], errors[-1])
    beside = zip(found.steps, errors, errors[1:], strict=False)
    return without_names(found, [step for step, a, b in beside if not (together and falls(a, b))], f"it {NOT_BETTER}")


def falls(before: Array, after: Array) -> bool:
    """Do mean squares of outputs fall, each in units of its own? True where there are none."""
    return not len(before) or float(np.mean(after / np.maximum(before, 1e-300))) < 1.0


def traced(folder: OwnFolder, machine: Simulated, found: Found, formula: Formula | None = None) -> OwnTrace:
    """What is known, with the errors of free runs."""
    errors = {
        title: {log.name: simulated(made, log, folder.where)[1] for log in folder.validate}
        for title, made in found.fits
    }
    return OwnTrace(
        folder=folder,
        found=found,
        errors=errors,
        verdict=said(found, formula),
        remarks=changing(found.final),
        declaration=machine.declared(found.in_model),
        formula=formula,
    )


def said(found: Found, formula: Formula | None) -> str:
    """The verdict in a sentence."""
    stand_ins = {one.title for one in found.in_model} - {step.title for step in found.steps}
    likely = [
        one.title + (" (in the model, a stand-in)" if one.title in stand_ins else "")
        for one in found.refused
        if one.verdict == "likely"
    ]
    if found.steps:
        begin = f"named: {' + '.join(of_kinds(found.steps))}"
    else:
        begin = "unexplained" if likely or formula else "nothing of the library makes held-out motion more likely"
    parts = [begin]
    if formula is not None and formula.proven:
        parts.append(f"formula beyond the library: {formula.best.title} ({stated('formula')})")
    elif formula is not None:
        parts.append(f"no form: {formula.why}")
    if found.steps and found.left and not (formula is not None and formula.proven):
        parts.append(found.left)
    return "; ".join([*parts, *([f"likely, not proven: {', '.join(likely[:2])}"] if likely else [])])


def kind_of(step: Judgment) -> str:
    return "tie" if step.tied else "name"


def of_kinds(steps: Sequence[Judgment]) -> Iterator[str]:
    """Names alone, then ties, each kind with its stated chance of being wrong."""
    for kind in dict.fromkeys(map(kind_of, steps)):
        titles = [
            step.title + (f" (tied with {', '.join(step.tied)})" if step.tied else "")
            for step in steps
            if kind_of(step) == kind
        ]
        yield f"{' + '.join(titles)} ({stated(kind)})"


class Simulated:
    """The machine of a folder, as the search asks for it."""

    def __init__(self, folder: OwnFolder) -> None:
        self.folder = folder
        self.columns = set.intersection(*(set(log.columns) for log in (*folder.fit, *folder.validate)))

    def declared(self, chosen: Sequence[Candidate]) -> Declaration:
        declaration = self.folder.declaration
        for candidate in chosen:
            declaration = joined(declaration, candidate)
        return declaration

    def of(self, declaration: Declaration) -> OwnProblem:
        return problem_of(model_of(declaration, self.folder.where, self.columns), self.folder.fit, self.folder.where)

    def problem(self, chosen: Sequence[Candidate]) -> OwnProblem:
        return self.of(self.declared(chosen))

    def offers(self, chosen: Sequence[Candidate], now: Fit, rival: bool) -> list[Candidate]:
        declared = self.declared(chosen)
        assert isinstance(now.problem, OwnProblem)
        sizes = sizes_of(declared, now)
        every = offered(declared, now.problem.simulator.model.inputs, sizes)
        return [candidate for candidate in every if candidate.rival is rival]

    def free_forms(self, chosen: Sequence[Candidate], now: Fit) -> list[list[Candidate]]:
        """The most general laws over the signals of each place, and memories at the places of what is chosen."""
        declared, fitted = self.declared(chosen), dict(zip(now.names, map(float, now.theta), strict=True))
        sizes = sizes_of(declared, now)
        return [[form] for form in self.offers(chosen, now, True)] + [
            [distinct(one, k) for k, one in enumerate(tries)]
            for effect in chosen
            for tries in memories(declared, effect, fitted, sizes)
        ]

    def loosened(self, effect: Candidate, chosen: Sequence[Candidate], now: Fit) -> Candidate:
        """The effect with an error of its form."""
        declared = self.declared(chosen)
        return loosened(declared, effect, sizes_of(declared, now))

    def candidates(self, chosen: Sequence[Candidate], now: Fit) -> tuple[OwnProblem, list[tuple[Candidate, list[str]]]]:
        """All that the library and the file offer, in one model."""
        everything, found = self.declared(chosen), []
        for k, candidate in enumerate(self.offers(chosen, now, False)):
            one = distinct(candidate, k)
            everything = joined(everything, one, neutral=True)
            found.append((candidate, [one.switch] if one.switch else list(one.amplitude)))
        return self.of(everything), found

    def forms(self, chosen: Sequence[Candidate], now: Fit, named: Sequence[Candidate] = ()) -> list[Form]:
        """Every formula over the machine's signals but those that a chosen or named effect is."""
        assert isinstance(now.problem, OwnProblem)
        declared = self.declared(chosen)
        every = forms(declared, now.problem.simulator.model.inputs, sizes_of(declared, now))
        known = {written(one) for one in (*chosen, *named)}
        return [form for form in every if written(form.candidate) not in known]

    def looks(self, chosen: Sequence[Candidate], every: Sequence[Form], about: Fit) -> Iterator[Look]:
        """Models with some of the formulas at amplitude 0, and each with the names of its amplitudes there."""
        return looks(self.folder, self.columns, self.declared(chosen), every, about)


def written(candidate: Candidate) -> tuple[str, ...]:
    """Place and formulas, whatever their numbers are called and on which side they count."""
    numbers = dict.fromkeys(candidate.numbers, "#")
    texts = (re.sub(r"[\s()+-]", "", with_values(text, numbers)) for text in candidate.formulas.values())
    return (candidate.place, *texts)
