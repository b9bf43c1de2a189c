"""What was computed of a log, kept while the log lives: of neighbouring machines a fit asks for much that has not changed."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from hexsim.signals.log import Log

Array = np.ndarray
KEPT_SETTINGS = 8  # of sensors, for each log

_known: WeakKeyDictionary[Log, dict[Hashable, Any]] = WeakKeyDictionary()


def remembered(log: Log, key: Hashable, make: Callable[[], Any]) -> Any:
    """What `make` gives for this log and key, made once while the log lives: fits ask for the same again and again."""
    known = _known.setdefault(log, {})
    found = known.get(key)
    if found is None:
        found = make()
        if len(known) > KEPT_SETTINGS * log.n_legs:
            known.clear()
        known[key] = found
    return found


def latest(log: Log, place: Hashable, key: Hashable, make: Callable[[], Array]) -> Array:
    """`remembered` for the latest few keys of a place: of neighbouring machines a fit asks for much that has not changed."""
    known = remembered(log, ("latest", place), dict)
    found = known.get(key)
    if found is None:
        found = make()
        found.flags.writeable = False
        if len(known) >= KEPT_SETTINGS:
            known.clear()
        known[key] = found
    return found
