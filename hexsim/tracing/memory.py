"""What was computed of a log, kept while the log lives: of neighbouring machines a fit asks for much that has not changed."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from hexsim.signals.log import Log

Array = np.ndarray
KEPT_SETTINGS = 8  # of sensors, for each log
KEPT_SAMPLES = 1_200_000  # of a signal: fewer settings of a log of minutes, but the base and a neighbour a thread

_known: WeakKeyDictionary[Log, dict[Hashable, Any]] = WeakKeyDictionary()


def remembered(log: Log, key: Hashable, make: Callable[[], Any]) -> Any:
    """What `make` gives for this log and key, made once while the log lives: fits ask for the same again and again."""
    return _kept(_known.setdefault(log, {}), key, make, KEPT_SETTINGS * log.n_legs + 1)


def latest(log: Log, place: Hashable, key: Hashable, make: Callable[[], Array], most: int | None = None) -> Array:
    """`remembered` for the latest `most` keys of a place: of neighbouring machines a fit asks for much that has not changed."""

    def read_only() -> Array:
        made = make()
        made.flags.writeable = False
        return made

    return latest_of(log, place, key, read_only, most)


def latest_of(log: Log, place: Hashable, key: Hashable, make: Callable[[], Any], most: int | None = None) -> Any:
    """The same of what is no array."""
    most = max(min(KEPT_SETTINGS, KEPT_SAMPLES // log.n), 3) if most is None else most
    return _kept(remembered(log, ("latest", place), dict), key, make, most)


def _kept(known: dict[Hashable, Any], key: Hashable, make: Callable[[], Any], most: int) -> Any:
    """What is known under the key, or made; beyond `most` what was not asked for longest is forgotten."""
    found = known.get(key)
    if found is None:
        found = make()
        while len(known) >= most:
            known.pop(next(iter(list(known))), None)
    else:
        known.pop(key, None)
    known[key] = found
    return found
