# pyright: reportPrivateImportUsage=false, reportCallIssue=false
# (numba does not list its own functions, and intrinsics are called without their typing context)
"""`desk.TICK` of the algorithms, by what steps their legs together."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import carray

from .adaptive.layout import STATE
from .adaptive.legs import AdaptiveLegs, share_legs, tick_legs
from .compiled import compiled_callback
from .desk import LEGS, SHARE, TICK, Desk, doubles, integers, pointer, rows, truths
from .legs import Together
from .prediction import MAX_LOOK, PAST, PREDICTORS, PREVIEW_TICKS, prediction_table


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


@cache
def adaptive_tick() -> Any:
    """`tick_legs`, `share_legs`."""

    @compiled_callback(TICK)
    def step_legs(desk, what):
        d = carray(desk, (1,), LEGS)[0]
        n, states, acts = d.n, carray(pointer(d.states), (d.n,), STATE), truths(d.acts, d.n)
        if what == SHARE:
            share_legs(states, acts, carray(pointer(d.alike), (n, n), np.bool_))
            return
        table = carray(pointer(d.table), (MAX_LOOK - PREVIEW_TICKS + 1, PAST, 3 * PREDICTORS), np.float64)
        tick_legs(
            states, acts, table, rows(d.preview_m, n, d.most), integers(d.counts, n), rows(d.loads_m_s2, n, d.loads),
            doubles(d.pose_m_s2, n), rows(d.mobility, n, d.mobilities), doubles(d.forces_N, d.feels), doubles(d.speeds_m_s, d.feels),
            doubles(d.setpoint_m, n), doubles(d.position_m, n), doubles(d.control_V, n), doubles(d.valve_V, n), doubles(d.bottom_Pa, n),
            doubles(d.top_Pa, n), d.supply_Pa, doubles(d.forward_V, n), doubles(d.added_V, n), truths(d.finite, n),
        )  # fmt: skip

    return step_legs
