"""A machine of one's own as a folder: model.toml (or balances.toml), mapping.toml, logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import ValidationError

from hexsim.errors import HexsimError
from hexsim.files.toml_files import read_toml, validation_sentence
from hexsim.own.declaration import Declaration
from hexsim.own.files import FILES, model_file
from hexsim.own.model import Model, model_of
from hexsim.readers import load_mapping, log_files, read_stretches
from hexsim.readers.files import log_name, logs_of_folder
from hexsim.readers.mapping import Channel, Mapping
from hexsim.signals.log import Log


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnFolder:
    """A machine that is simulated, with its runs."""

    name: str
    where: str
    declaration: Declaration
    model: Model
    fit: tuple[Log, ...]
    validate: tuple[Log, ...]


def declared(folder: Path) -> Declaration:
    """What the folder's file says. Raises HexsimError for what cannot be used."""
    where = model_file(folder)
    if where is None:
        raise HexsimError(f"there is no {' and no '.join(FILES)} in {folder}")
    try:
        found = Declaration.model_validate(read_toml(where))
    except ValidationError as error:
        raise HexsimError(f"{where}: {validation_sentence(error, Declaration)}") from None
    if not found.simulated and not found.balances:
        raise HexsimError(
            f"{where}: it has no [states], no [outputs] and no [[balances]]: nothing to simulate or to trace"
        )
    return found


def is_simulated(folder: Path) -> bool:
    """Has the folder a machine of one's own that can be simulated?"""
    return folder.is_dir() and model_file(folder) is not None and declared(folder).simulated


def load_simulated(folder: Path, fit: Sequence[str] = (), validate: Sequence[str] = ()) -> OwnFolder:
    """The machine of a folder with its runs. Raises HexsimError for what cannot be used."""
    asked, where = declared(folder), str(model_file(folder))
    data = folder / asked.runs.folder
    named = model_of(asked, where)
    wanted = dict.fromkeys((*named.inputs, *named.outputs, *(column for _, column in named.firsts)))
    read = logs_of(data, folder, fit or asked.runs.fit, validate or asked.runs.validate_on, list(wanted))
    logs, held_out = ([averaged(log, asked.simulation.average_s) for log in part] for part in read)
    columns = set.intersection(*(set(log.columns) for log in (*logs, *held_out)))
    return OwnFolder(
        name=asked.name or folder.resolve().name,
        where=where,
        declaration=asked,
        model=model_of(asked, where, columns),
        fit=tuple(logs),
        validate=tuple(held_out),
    )


def averaged(log: Log, over_s: float | None) -> Log:
    """Means over so long as samples; the rest of a run that is no whole mean is left out. Raises HexsimError where none is left."""
    count = 1 if over_s is None else max(round(over_s * log.rate), 1)
    if count == 1:
        return log
    n = log.n // count
    if n < 2:
        raise HexsimError(
            f"log {log.name} has {log.n} samples, fewer than two means over {over_s:g} s: lower average_s"
        )
    mean = lambda values: values[: n * count].reshape(n, count).mean(axis=1)  # noqa: E731
    return replace(
        log,
        time=mean(log.time),
        rate=log.rate / count,
        columns={name: mean(values) for name, values in log.columns.items()},
        repaired={name: mean(values) > 0.0 for name, values in log.repaired.items()},
        sampled={},
    )


def logs_of(
    data: Path, folder: Path, fit: Sequence[str], validate: Sequence[str], wanted: Sequence[str] = ()
) -> tuple[list[Log], list[Log]]:
    """Runs to fit and held out, every stretch between gaps one of them. wanted: columns, where no mapping.toml names them."""
    held_out = [log_files(data, name) for name in validate]
    paths = [log_files(data, name) for name in fit]
    mapping = folder / "mapping.toml"
    chosen = load_mapping(mapping if mapping.is_file() else None)
    if wanted and not mapping.is_file():
        chosen = Mapping(kind="own", columns={name: Channel() for name in wanted})
    if not paths:
        paths = [path for path in logs_of_folder(data, chosen.file) if path not in held_out]
    both = {path.resolve() for path in paths} & {path.resolve() for path in held_out}
    if both:
        name = log_name(min(both))
        raise HexsimError(f"log {name} is given to fit and to validate: judge on another run that no fit has seen")
    if not paths:
        raise HexsimError(f"there is no log in {data}: name its folder under [runs] of {model_file(folder)}")
    read = []
    for path in (*paths, *held_out):
        parts = read_stretches(path, chosen)
        read.append(parts[:1])  # the longest: alignment needs all of its parts
    logs = [part for parts in read[: len(paths)] for part in parts]
    return logs, [part for parts in read[len(paths) :] for part in parts]
