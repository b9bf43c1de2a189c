# pyright: reportPrivateImportUsage=false, reportCallIssue=false
# (numba does not list its own functions, and intrinsics are called without their typing context)
"""The algorithm on all legs of a machine in one compiled call.

All of it is compiled once, as the C function `adaptive_tick`; Python's ticks, too, are calls of it with the addresses of their arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numba import carray

from ..compiled import compiled, compiled_callback
from ..desk import LEGS, SHARE, STEP, TICK, address, call_tick, doubles, integers, pointer, rows, truths
from ..legs import Legs
from ..prediction import MAX_LOOK, PAST, PREDICTORS, PREVIEW_TICKS, prediction_table
from .layout import STATE
from .step import SAY_TICKS, hear_leg, tick_of


@compiled
def is_finite(s):
    """Whether the volts ahead and the model's state are."""
    total, inverse = 0.0, s.inverse
    for k in range(len(inverse.U)):
        total += inverse.U[k] - inverse.U[k]  # not 0 of one that is not finite
    for k in range(len(inverse.x)):
        total += inverse.x[k] - inverse.x[k]
    return total == 0.0


@compiled
def tells(s):
    """Whether a leg of a platform says what it knows: every SAY_TICKS ticks."""
    return s.platform != 0 and s.past.ticks % SAY_TICKS == 0


@compiled
def share_legs(states, acted, alike):
    """Each leg that has just acted and `tells` says what it knows to those that are alike (n, n)."""
    for i in range(len(states)):
        if acted[i] and tells(states[i]):
            for j in range(len(states)):
                if j != i and alike[i, j]:
                    hear_leg(states[j], states[i])


@cache
def adaptive_tick() -> Any:
    """`tick_of` of those legs on a desk that act, and `share_legs`."""

    @compiled_callback(TICK)
    def step_legs(desk, what):
        d = carray(desk, (1,), LEGS)[0]
        n, states, acts = d.n, carray(pointer(d.states), (d.n,), STATE), truths(d.acts, d.n)
        if what == SHARE:
            share_legs(states, acts, carray(pointer(d.alike), (n, n), np.bool_))
            return
        table = carray(pointer(d.table), (MAX_LOOK - PREVIEW_TICKS + 1, PAST, 3 * PREDICTORS), np.float64)
        preview, counts, loads = rows(d.preview_m, n, d.most), integers(d.counts, n), rows(d.loads_m_s2, n, d.loads)
        pose, mobility = doubles(d.pose_m_s2, n), rows(d.mobility, n, d.mobilities)
        forces, speeds = doubles(d.forces_N, d.feels), doubles(d.speeds_m_s, d.feels)
        setpoint, position, control = doubles(d.setpoint_m, n), doubles(d.position_m, n), doubles(d.control_V, n)
        valve, bottom, top = doubles(d.valve_V, n), doubles(d.bottom_Pa, n), doubles(d.top_Pa, n)
        forward, added, finite = doubles(d.forward_V, n), doubles(d.added_V, n), truths(d.finite, n)
        for i in range(n):
            if acts[i]:
                added[i] = tick_of(
                    states[i], table, preview[i, : counts[i]], loads[i, : counts[i]], pose[i], mobility[i], forces, speeds,
                    setpoint[i], position[i], control[i], valve[i], bottom[i], top[i], d.supply_Pa, forward[i],
                )  # fmt: skip
                finite[i] = is_finite(states[i])

    return step_legs


@compiled
def _tick(
    legs, tick, states, acts, table, counts, preview, loads, pose, mobility, forces, speeds, setpoint, position, control, valve, bottom,
    top, forward, supply, added_V, finite,
):  # fmt: skip
    d = legs[0]
    d.n, d.feels, d.supply_Pa = len(states), len(forces), supply
    d.most, d.loads, d.mobilities = preview.shape[1], loads.shape[1], mobility.shape[1]
    d.states, d.acts, d.table, d.counts = address(states), address(acts), address(table), address(counts)
    d.preview_m, d.loads_m_s2, d.pose_m_s2 = address(preview), address(loads), address(pose)
    d.mobility, d.forces_N, d.speeds_m_s = address(mobility), address(forces), address(speeds)
    d.setpoint_m, d.position_m, d.control_V = address(setpoint), address(position), address(control)
    d.valve_V, d.bottom_Pa, d.top_Pa = address(valve), address(bottom), address(top)
    d.forward_V, d.added_V, d.finite = address(forward), address(added_V), address(finite)
    call_tick(tick, pointer(address(legs)), STEP)


@compiled
def _share(legs, tick, states, acted, alike):
    d = legs[0]
    d.n, d.states, d.acts, d.alike = len(states), address(states), address(acted), address(alike)
    call_tick(tick, pointer(address(legs)), SHARE)


def tick_legs(
    states: np.ndarray, acts: np.ndarray, counts: np.ndarray, given: Sequence[np.ndarray], supply_Pa: float, added_V: np.ndarray,
    finite: np.ndarray,
) -> None:  # fmt: skip
    """`tick_of` of those states (n,) that act (n,), into added_V and finite (n,). given: preview, loads (n, most) in rows, of which
    counts (n,) are the leg's; pose (n,), mobility (n, n) or (n, 0), forces, speeds (n,) or (0,), setpoint, position, control volts,
    valve's volts, bottom and top pressure, feed-forward (n,)."""
    rows = (np.ascontiguousarray(one, float) for one in given)
    tick, table = adaptive_tick().address, prediction_table()
    _tick(np.zeros(1, LEGS), tick, states, acts, table, counts, *rows, float(supply_Pa), added_V, finite)


class AdaptiveLegs:
    """The states of all legs in one array; each `AdaptiveState` has its part of it."""

    may_speak = False

    def __init__(self, states: Sequence[Any]) -> None:
        self.joined, self.states = np.zeros(len(states), STATE), list(states)
        for i, state in enumerate(states):
            self.renew(i, state)
        self._ticks = self.joined["past"]["ticks"]

    def renew(self, leg: int, state: Any) -> None:
        """A leg goes on with another state."""
        self.states[leg], self.joined[leg] = state, state.states[0]
        state.states = self.joined[leg : leg + 1]

    def step(self, legs: Legs, acts: np.ndarray, added: np.ndarray, finite: np.ndarray) -> None:
        """As `Adaptive.step` and `Adaptive.finite`."""
        given = (
            legs.preview_m, legs.load_preview_m_s2, legs.load_of_pose_m_s2, legs.mobility, legs.forces_N, legs.speeds_m_s,
            legs.setpoint_m, legs.position_m, legs.control_V, legs.valve_V, legs.pressure_bottom_Pa, legs.pressure_top_Pa,
            legs.feed_forward_V,
        )  # fmt: skip
        tick_legs(self.joined, acts, legs.counts, given, legs.pressure_supply_Pa, added, finite)

    def share(self, acted: np.ndarray, alike: np.ndarray) -> None:
        """What legs know, to those that are alike (n_legs, n_legs)."""
        if not (self._ticks % SAY_TICKS).all():
            _share(np.zeros(1, LEGS), adaptive_tick().address, self.joined, acted, alike)
