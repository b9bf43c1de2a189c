"""A machine that a search proposes may be one that cannot be built: joints out of a leg's reach, a number out of range."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from hexsim.errors import HexsimError

T = TypeVar("T")

# What building and simulating a machine raises: the sentence of a check, a refused declaration (pydantic) and a matrix that
# has no inverse (both are ValueErrors), an overflow or a division by zero. Anything else is a bug and keeps its traceback.
CANNOT_BE_BUILT = (HexsimError, ArithmeticError, ValueError)


def attempted(make: Callable[[], T]) -> T | None:
    """What `make` gives; None where the machine cannot be built. Of the declared machine call `make`: its user is told why."""
    try:
        return make()
    except CANNOT_BE_BUILT:
        return None
