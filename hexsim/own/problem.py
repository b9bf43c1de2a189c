"""A simulated machine of one's own as a problem of the inference: residual of a channel = free run less what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hexsim.errors import HexsimError
from hexsim.inference.contract import Number, Stretch
from hexsim.inference.likelihood import Fit, fit
from hexsim.own.model import START, Model
from hexsim.own.simulate import FreeRun, Record, Simulator, records_of
from hexsim.signals.log import Log

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Piece:
    """Samples of a record that are one stretch."""

    record: int
    samples: slice
    group: str


class OwnProblem:
    """See `hexsim.inference.contract.Problem`. theta: numbers of the machine, those of a run once for each run."""

    def __init__(self, simulator: Simulator, records: Sequence[Record]) -> None:
        self.simulator, self.records = simulator, list(records)
        model = simulator.model
        self.channels, self.noises = model.outputs, model.noises
        runs = list(dict.fromkeys(record.run for record in records))
        self.numbers: list[Number] = []
        places: dict[tuple[str, str], int] = {}
        for number in model.numbers:
            for run in runs if number.of_run else ("",):
                places[number.name, run] = len(self.numbers)
                self.numbers.append(replace(number, name=f"{number.name} of {run}") if number.of_run else number)
        self.columns = np.array(
            [
                [places[number.name, record.run if number.of_run else ""] for number in model.numbers]
                for record in records
            ],
            dtype=int,
        ).reshape(len(records), len(model.numbers))
        begins = {START + name for name in model.tables.memory}  # effects come and go, parts of the motion stay
        of_run = any(number.of_run and number.name not in begins for number in model.numbers)
        self.pieces = pieces_of(self.records, of_run)
        self.stretches = [
            Stretch(
                name=self.records[piece.record].name,
                group=piece.group,
                dt=self.records[piece.record].dt,
                weight=self.records[piece.record].weight[piece.samples],
            )
            for piece in self.pieces
        ]
        self._kept: dict[tuple[int, bool], tuple[bytes, FreeRun]] = {}

    def free_run(self, record: int, theta: Array, slopes: bool = False) -> FreeRun:
        """Of one record; the last one is kept."""
        p = theta[self.columns[record]]
        key = p.tobytes()
        for kind in (True,) if slopes else (True, False):
            if (record, kind) in self._kept and self._kept[record, kind][0] == key:
                return self._kept[record, kind][1]
        made = self.simulator.run(self.records[record], p, slopes)
        self._kept[record, slopes] = (key, made)
        return made

    def residuals(self, theta: Array, at: Sequence[int]) -> list[Array]:
        found = []
        for piece in (self.pieces[k] for k in at):
            record = self.records[piece.record]
            left = (self.free_run(piece.record, theta).outputs - record.measured)[piece.samples]
            found.append(np.where(record.weight[piece.samples] > 0, left, 0.0))
        return found

    def slopes(self, theta: Array, at: Sequence[int]) -> list[Array]:
        found = []
        for piece in (self.pieces[k] for k in at):
            own = self.free_run(piece.record, theta, slopes=True).slopes[piece.samples]
            whole = np.zeros((*own.shape[:2], len(self.numbers)))
            whole[:, :, self.columns[piece.record]] = np.nan_to_num(own)
            found.append(whole)
        return found


def pieces_of(
    records: Sequence[Record],
    of_run: bool,
    *,
    n_folds: int = 4,  # parts of the motion, each held out once
) -> list[Piece]:
    """Stretches and what is held out together: runs where there are two or more, else parts in time of the one run (and of every run
    where runs have numbers of their own)."""
    runs = list(dict.fromkeys(record.run for record in records))
    found = []
    for run in runs:
        own = [k for k, record in enumerate(records) if record.run == run]
        by_run = len(runs) > 1 and not of_run
        if by_run or len(own) >= n_folds:
            for j, k in enumerate(own):
                part = runs.index(run) % n_folds if by_run else j * n_folds // len(own)
                found.append(Piece(record=k, samples=slice(None), group=f"part {part + 1}"))
            continue
        for k in own:
            seen = np.flatnonzero(records[k].weight.any(axis=1))
            cuts = (
                np.linspace(seen[0], seen[-1] + 1, n_folds + 1).astype(int) if len(seen) else np.zeros(n_folds + 1, int)
            )
            found += [
                Piece(record=k, samples=slice(a, b), group=f"part {j + 1}")
                for j, (a, b) in enumerate(zip(cuts[:-1], cuts[1:], strict=True))
            ]
    return found


def problem_of(model: Model, logs: Sequence[Log], where: str) -> OwnProblem:
    """Raises HexsimError where no output is in the logs."""
    records = [record for log in logs for record in records_of(model, log, where)]
    if not any(record.weight.any() for record in records):
        raise HexsimError("no output of the model is in the logs: name an output as its column is named")
    return OwnProblem(Simulator(model), records)


def fit_own(
    problem: OwnProblem,
    seed: int = 0,
    *,
    drawn_share: float = 0.3,  # of a number's scale: spread of further starts of a search
) -> Fit:
    """The numbers of a model, from several starts where its file asks for them."""
    settings = problem.simulator.model.tables.simulation
    by_error = settings.fit_by == "error"
    best, rng = fit(problem, by_error=by_error), np.random.default_rng(seed)
    for _ in range(settings.starts - 1):
        start = np.array(
            [number.start + drawn_share * number.scale * rng.standard_normal() for number in problem.numbers]
        )
        made = fit(problem, begin=start, by_error=by_error)
        best = made if made.cost < best.cost else best
    return best
