"""The state of a trace on disk: everything that a step may ask for, so that a trace goes on where it stopped.

One file, a zip of numpy arrays (`.npz`) and a JSON text of the rest that refers to them; no pickle, and nothing in it names
code: objects are of the classes in CLASSES, effects and balances are looked up by their names. Logs are not in it: they are
read again, and refused where their content is another one.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hexsim import __version__
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.files.atomic import written_whole
from hexsim.hydraulics.effects import Effect, effect_named
from hexsim.machine.files import find_machine_file
from hexsim.readers import log_files
from hexsim.signals.log import Log
from hexsim.tracing.balances import Balance, library
from hexsim.tracing.balances.continuity import FastContinuity
from hexsim.tracing.checks.finding import Finding
from hexsim.tracing.dependence import Dependence
from hexsim.tracing.fitting.fit import Fit
from hexsim.tracing.fitting.parameters import Candidate, Prior
from hexsim.tracing.fitting.rest_hidden import Hidden
from hexsim.tracing.fitting.rest_level import RestFit
from hexsim.tracing.fitting.screening import Screened
from hexsim.tracing.fitting.selection import Search, Stage
from hexsim.tracing.predictable import Predicted
from hexsim.tracing.problems.balance import BalanceProblem, BalanceRows
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import NamedEffect, Reading, StepRecord, Trace, UnexplainedResidual, Violation

FILE = "trace_state.npz"
TEXT = "state"  # the array that holds the JSON text
FORMAT = 2  # of the file: another one is not read
CLASSES = {
    cls.__name__: cls
    for cls in (
        BalanceProblem, BalanceRows, Candidate, Dependence, Finding, Fit, Hidden, NamedEffect, Predicted, Prior, Reading, RestFit,
        Screened, Search, SimulatedProblem, Stage, StepRecord, Trace, UnexplainedResidual, Violation,
    )
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What a trace was asked for. machine: its folder or file."""

    machine: str
    fit: tuple[str, ...]
    validate: tuple[str, ...]
    load_kg: float | None = None
    loaded: tuple[str, ...] = ()
    mapping: str | None = None

    @property
    def mapping_file(self) -> Path | None:
        """For foreign names and units of all logs; None: mapping.toml beside each."""
        return None if self.mapping is None else Path(self.mapping)

    @property
    def files(self) -> list[Path]:
        """All files that the result depends on: the machine's declaration, the mapping of its columns, the logs."""
        place = find_machine_file(self.machine)
        mapping = self.mapping_file or place.parent / "mapping.toml"
        found = [path for path in (place, mapping) if path.is_file()]
        for name in (*self.fit, *self.validate):
            log = log_files(place.parent, name)
            found += sorted(path for path in log.iterdir() if path.is_file()) if log.is_dir() else [log]
        return found

    def hashes(self) -> dict[str, str]:
        """Path -> SHA-256 of its content."""
        return {str(path.resolve()): hashlib.sha256(path.read_bytes()).hexdigest() for path in self.files}


def save(state: Trace, asked: Asked, hashes: dict[str, str], folder: Path) -> Path:
    """Write the state into a folder, whole or not at all."""
    writer = _Writer([*state.fit_problem.logs, *state.validate_problem.logs])
    told = {
        "format": FORMAT,
        "version": __version__,
        "asked": {**vars(asked)},
        "hashes": hashes,
        "state": writer.plain(state),
        "objects": writer.objects,
        "machines": writer.machines,
    }
    text = np.frombuffer(json.dumps(told).encode(), dtype=np.uint8)
    with written_whole(folder / FILE) as temporary, temporary.open("wb") as file:
        arrays: dict[str, Any] = {TEXT: text} | {f"a{k}": array for k, array in enumerate(writer.arrays)}
        np.savez(file, **arrays)
    return folder / FILE


class Stored:
    """What a folder holds of an unfinished trace. HexsimError where it holds none, or one that cannot go on."""

    def __init__(self, folder: Path) -> None:
        self.place = folder / FILE
        if not self.place.is_file():
            raise HexsimError(
                f"{folder} holds no unfinished trace ({FILE} is not there): give the folder of a trace that was interrupted"
            )
        try:
            with self.place.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                self._told = json.loads(bytes(arrays[TEXT]))
                self._arrays = [arrays[f"a{k}"] for k in range(len(arrays.files) - 1)]
            asked: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in self._told["asked"].items()}
            self.asked = Asked(**asked)
            self.hashes = dict(self._told["hashes"])
            made_by = (self._told["format"], self._told["version"])
        except (
            OSError,
            ValueError,
            KeyError,
            TypeError,
            AttributeError,
            zipfile.BadZipFile,
            EOFError,
            MemoryError,
        ) as error:
            raise self._damaged(error) from None
        if made_by != (FORMAT, __version__):
            raise HexsimError(
                f"{self.place} was written by hexsim {made_by[1]}, this is {__version__}: start the trace anew"
            )

    def check_same_files(self) -> None:
        """Refuse files whose content is another one than when the trace began."""
        now = self.asked.hashes()
        other = [path for path in {*now, *self.hashes} if now.get(path) != self.hashes.get(path)]
        if other:
            raise HexsimError(
                f"{min(other)} has changed since the trace in {self.place.parent} began: start the trace anew"
            )

    def state(self, logs: Sequence[Log]) -> Trace:
        """The state. logs: those of the fit, then the held-out ones, as `steps.logs.begin` reads them."""
        try:
            reader = _Reader(self._told, self._arrays, logs)
            state = reader.made(self._told["state"])
        except (ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
            raise self._damaged(error) from None
        if not isinstance(state, Trace):
            raise self._damaged(TypeError("it is no trace"))
        return state

    def _damaged(self, error: Exception) -> HexsimError:
        return HexsimError(f"{self.place} cannot be read ({type(error).__name__}: {error}): start the trace anew")


class _Writer:
    """Objects as JSON that refers to arrays, machines and logs; what is the same object is written once."""

    def __init__(self, logs: Sequence[Log]) -> None:
        self.arrays: list[np.ndarray] = []
        self.machines: list[dict[str, Any]] = []
        self.objects: list[dict[str, Any]] = []
        self._logs = {id(log): k for k, log in enumerate(logs)}
        self._seen: dict[int, tuple[Any, Any]] = {}  # id -> (the object, which keeps its id, and how it is written)

    def plain(self, value: Any) -> Any:
        if value is None or (isinstance(value, (bool, int, float, str)) and not isinstance(value, np.generic)):
            return value
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, (list, tuple)):
            return {"list" if isinstance(value, list) else "tuple": [self.plain(one) for one in value]}
        if isinstance(value, dict):
            return {"dict": [[self.plain(key), self.plain(one)] for key, one in value.items()]}
        if isinstance(value, Log):
            return {"log": self._logs[id(value)]}
        if id(value) not in self._seen:
            self._seen[id(value)] = (value, self._written(value))
        return self._seen[id(value)][1]

    def _written(self, value: Any) -> dict[str, Any]:
        if isinstance(value, np.ndarray):
            self.arrays.append(value)
            return {"array": len(self.arrays) - 1}
        if isinstance(value, Machine):
            self.machines.append(value.model_dump(mode="json", exclude_none=True))
            return {"machine": len(self.machines) - 1}
        if isinstance(value, Effect):
            return {"effect": value.name, "bounds": [[own.name, *own.bounds] for own in value.parameters]}
        if isinstance(value, Balance):
            return {"balance": type(value).__name__, "given": {key: float(own) for key, own in vars(value).items()}}
        if is_dataclass(value) and type(value).__name__ in CLASSES:
            own = {f.name: self.plain(getattr(value, f.name)) for f in fields(value) if f.init}
            self.objects.append({"class": type(value).__name__, "fields": own})
            return {"object": len(self.objects) - 1}
        raise TypeError(f"the state of a trace holds a {type(value).__name__}: add it to hexsim.tracing.store")


class _Reader:
    """The inverse."""

    def __init__(self, told: dict[str, Any], arrays: Sequence[np.ndarray], logs: Sequence[Log]) -> None:
        self._arrays, self._logs = arrays, logs
        self._machines = [Machine.model_validate(own) for own in told["machines"]]
        self._balances = {type(own).__name__: own for own in library()}
        self._effects: dict[str, Effect] = {}
        self._objects: list[Any] = []
        for own in told["objects"]:  # each refers to those before it
            self._objects.append(
                CLASSES[own["class"]](**{key: self.made(value) for key, value in own["fields"].items()})
            )

    def made(self, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        kind, own = next(iter(value.items()))
        match kind:
            case "list":
                return [self.made(one) for one in own]
            case "tuple":
                return tuple(self.made(one) for one in own)
            case "dict":
                return {self.made(key): self.made(one) for key, one in own}
            case "log":
                return self._logs[own]
            case "array":
                return self._arrays[own]
            case "machine":
                return self._machines[own]
            case "object":
                return self._objects[own]
            case "effect":
                return self._effect(own, value["bounds"])
            case "balance":
                return FastContinuity(**value["given"]) if own == FastContinuity.__name__ else self._balances[own]
        raise ValueError(f"unknown entry {kind}")

    def _effect(self, name: str, bounds: Sequence[Sequence[Any]]) -> Effect:
        effect = effect_named(name)
        known = {own.name: own for own in effect.parameters}
        parameters = tuple(replace(known[name], bounds=(low, high)) for name, low, high in bounds)
        return effect if parameters == effect.parameters else replace(effect, parameters=parameters)
