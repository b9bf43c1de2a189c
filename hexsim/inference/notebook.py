"""The fits of a search in the order they were made, so that one that was broken off goes on without making them again.

A search asks for the same fits in the same order whenever its machine and its logs are the same. So what was fitted is given back as
long as it is what is asked for; from the first that is not, everything is computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from hexsim.errors import HexsimError
from hexsim.inference.contract import Problem
from hexsim.inference.held_out import HeldOut, held_out, predicted
from hexsim.inference.likelihood import Fit
from hexsim.inference.spectrum import Spectrum

Array = np.ndarray
SPECTRUM = ("log_f", "log_s", "edges", "counts")


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """asked: titles of the effects. fits: to everything, then without each group. refused: a sentence instead of fits."""

    asked: list[str]
    fits: list[dict[str, Any]]
    refused: str = ""

    def to_json(self) -> dict[str, Any]:
        return {"asked": self.asked, "fits": [written(own) for own in self.fits], "refused": self.refused}

    @classmethod
    def of_json(cls, data: Any) -> Entry:
        """Raises ValueError, TypeError or KeyError for what is none."""
        if not isinstance(data["refused"], str) or not all(isinstance(title, str) for title in data["asked"]):
            raise TypeError("a text is something else")
        fits = [read(own) for own in data["fits"]]
        if not fits and not data["refused"]:
            raise ValueError("an entry without fits")
        return cls(asked=list(data["asked"]), fits=fits, refused=data["refused"])


class Machine(Protocol):
    def problem(self, chosen: Sequence[Any]) -> Problem: ...


class Notebook:
    """entries: of an earlier search. keep: called with all of them after each new one."""

    def __init__(
        self, entries: Iterable[Entry] = (), keep: Callable[[list[Entry]], None] = lambda entries: None
    ) -> None:
        self.entries, self.keep, self._place = list(entries), keep, 0

    def attempt(self, machine: Machine, chosen: Sequence[Any], make: Callable[[Problem], Fit]) -> tuple[Fit, HeldOut]:
        """The model with these effects fitted and held out. Raises HexsimError where it cannot be, as it did the first time."""
        asked = [f"{one.title} {getattr(one, 'shape', '')}".strip() for one in chosen]
        known = self.entries[self._place] if self._place < len(self.entries) else None
        if known is not None and known.asked == asked and known.refused:
            self._place += 1
            raise HexsimError(known.refused)
        try:
            problem = machine.problem(chosen)
            if known is not None and known.asked == asked and fits_in(known, problem):
                self._place += 1
                whole, *parts = (made(own, problem) for own in known.fits)
                return whole, predicted(problem, parts)
            fitted = make(problem)
            held = held_out(fitted)
        except HexsimError as error:
            if asked:
                self._add(Entry(asked=asked, fits=[], refused=str(error)))
            raise
        self._add(Entry(asked=asked, fits=[numbers_of(own) for own in (fitted, *held.fits)]))
        return fitted, held

    def _add(self, entry: Entry) -> None:
        self.entries[self._place :] = [entry]
        self._place += 1
        self.keep(self.entries)


def fits_in(entry: Entry, problem: Problem) -> bool:
    """Are the fits of this problem?"""
    groups = len({stretch.group for stretch in problem.stretches})
    shapes = {(len(own["theta"]), len(own["spectra"])) for own in entry.fits}
    return len(entry.fits) == groups + 1 and shapes == {(len(problem.numbers), len(problem.channels))}


def numbers_of(own: Fit) -> dict[str, Any]:
    """A fit without its problem."""
    return {name: value for name, value in vars(own).items() if name != "problem"}


def made(own: dict[str, Any], problem: Problem) -> Fit:
    return Fit(problem=problem, **own)


def written(own: dict[str, Any]) -> dict[str, Any]:
    """As strict JSON."""
    return {
        "theta": listed(own["theta"]),
        "covariance": listed(own["covariance"]),
        "spread": listed(own["spread"]),
        "cost": listed(np.array(own["cost"])),
        "spectra": [{name: listed(getattr(one, name)) for name in SPECTRUM} for one in own["spectra"]],
    }


def read(data: Any) -> dict[str, Any]:
    """The inverse. Raises ValueError, TypeError or KeyError for what is no fit."""
    theta = array(data["theta"], 1)
    n = len(theta)
    spectra = [Spectrum(**{name: array(one[name], 1) for name in SPECTRUM}) for one in data["spectra"]]
    if any(len(one.log_f) != len(one.log_s) or len(one.edges) + 1 != len(one.counts) for one in spectra):
        raise ValueError("a spectrum of uneven length")
    covariance, spread = array(data["covariance"], 2).reshape(n, n), array(data["spread"], 1).reshape(n)
    return {
        "theta": theta,
        "covariance": covariance,
        "spread": spread,
        "spectra": spectra,
        "cost": float(array([data["cost"]], 1)[0]),
    }


def listed(values: Array) -> Any:
    """Numbers as JSON has them; what is not finite as a text."""
    if np.ndim(values):
        return [listed(one) for one in values]
    return float(values) if np.isfinite(values) else str(float(values))


def array(data: Any, ndim: int) -> Array:
    """The inverse: numbers to the last bit."""
    found = np.array(data, dtype=np.float64)
    if found.ndim != ndim and found.size:
        raise ValueError(f"an array of {found.ndim} dimensions, not {ndim}")
    return found
