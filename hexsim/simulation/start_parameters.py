"""Compensators that start with what was learned before: `compensator.json` of `hexsim tune` and `hexsim identify`."""

from __future__ import annotations

import json
from pathlib import Path

import compensation
from compensation import Compensator
from compensation.started import Started
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.hydraulics.resolve import resolve
from hexsim.motion_computer.data_sheet import compensator_context
from hexsim.motion_computer.leg_load import ExpectedLoad

SUFFIX = ".json"


def started(path: Path, machine: Machine) -> tuple[str, list[Compensator]]:
    """The algorithm's name, and one a leg that starts with its parameters; plain control where a leg's are null.

    Raises HexsimError where the file is none, is for another number of legs, or its numbers are not the algorithm's.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise HexsimError(
            f"cannot read start parameters {path}: {error}; make them with `hexsim tune MACHINE`"
        ) from None
    try:
        name, legs = found["compensator"], found["legs"]
        made: list[Compensator] = [
            compensation.create("none") if learned is None else Started(compensation.create(name), learned)
            for learned in legs
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise HexsimError(
            f"{path} holds no start parameters ({type(error).__name__}: {error}): make them with `hexsim tune MACHINE`"
        ) from None
    if len(made) != machine.n_legs:
        raise HexsimError(f"{path} is for {len(made)} legs; {machine.name} has {machine.n_legs}: tune that machine")
    load = ExpectedLoad.of(resolve(machine))
    for leg, one in enumerate(made, 1):
        try:
            one.start(compensator_context(machine, None, leg, load))
        except (ValueError, TypeError, LookupError, ArithmeticError) as error:
            raise HexsimError(f"{path}, leg {leg}: {error}") from None
    return name, made
