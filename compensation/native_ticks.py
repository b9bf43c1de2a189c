"""`desk.TICK` of the algorithms, by what steps their legs together."""

from __future__ import annotations

from .adaptive.legs import AdaptiveLegs, adaptive_tick
from .desk import Desk
from .legs import Together
from .prediction import prediction_table


def put_on(desk: Desk, legs: Together) -> int:
    """Put the states of legs on a desk. Returns the address of their tick; 0: they are stepped from Python alone."""
    native = adaptive_tick if type(legs) is AdaptiveLegs else getattr(legs, "native", None)
    if native is None:
        return 0
    if isinstance(legs, AdaptiveLegs):
        desk.place(legs.joined, prediction_table(), getattr(legs, "rows", None))
        desk.record["inner"] = adaptive_tick().address
    else:
        desk.place(legs.joined)  # type: ignore[attr-defined]
    return int(native().address)
