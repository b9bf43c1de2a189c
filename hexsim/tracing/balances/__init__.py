"""Balances: what must be zero where the model holds, evaluated at the measured point, one file each.

A module of this folder that defines BALANCES, and every entry point `hexsim.balances` of another package, is traced and
reported with all that belongs to it; see `balance` for what a balance is.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from importlib.metadata import entry_points

from hexsim.declaration import Machine
from hexsim.tracing.balances.balance import Balance

HELPERS = ("balance", "bends", "memory", "null", "spool")  # modules of this folder that define no balance

__all__ = ["Balance", "balance_named", "caption_of", "family", "learned_term_of", "library"]


@cache
def library() -> tuple[Balance, ...]:
    """All balances in the order of tracing."""
    names = sorted(info.name for info in pkgutil.iter_modules(__path__) if info.name not in HELPERS)
    found = [balance for name in names for balance in importlib.import_module(f"{__name__}.{name}").BALANCES]
    found += [point.load() for point in entry_points(group="hexsim.balances")]
    return tuple(sorted(found, key=lambda balance: balance.order))


def balance_named(name: str, machine: Machine) -> Balance:
    """The balance of a violation of this machine, by its name or by one that it is reported under."""
    return next(b for b in library() if name in (b.name, *b.other_names) and b.needs(machine))


def family(name: str) -> str:
    """The name of the balance that is reported under this name: continuity and valve are one residual."""
    return next((b.name for b in library() if name in b.other_names), name)


def learned_term_of(name: str) -> str | None:
    """The balance that a learned curve of this residual may join, None where there is none."""
    return next((b.learned_as for b in library() if name in (b.name, *b.other_names)), None)


def caption_of(name: str) -> str:
    """What must be equal, for the report."""
    captions = {b.name: b.caption for b in reversed(library())}
    for b in library():
        captions |= b.other_names
    return captions.get(name, "")
