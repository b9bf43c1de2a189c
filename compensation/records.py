"""States as flat arrays of 8-byte numbers, doubles and integers, named.

A layout is the type of a numpy record; its fields lie one after the other without gaps, as in a C struct of `double` and `int64_t` in
the same order, so that compiled functions read and write them in place and allocate nothing. Truth values are integers, 0 or 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Record = Any  # a numpy record of a layout, which compiled functions read and write in place


def record(**fields: Any) -> np.dtype:
    """A layout: names with "f8", "i8" or another layout, or a pair of it and the shape."""
    return np.dtype((np.record, [(k, *v) if isinstance(v, tuple) else (k, v) for k, v in fields.items()]))


def kinds(layout: np.dtype) -> list[str]:
    """ "f8" or "i8" of each number of a layout, in its order."""
    base, shape = layout.base, layout.shape
    if base.names:
        one = [kind for name in base.names for kind in kinds(base[name])]
    else:
        one = [base.str[1:]]
    return one * int(np.prod(shape, dtype=int))


def empty(layout: np.dtype) -> Record:
    """A record of a layout, all zero."""
    return np.zeros(1, layout)[0]
