"""The algorithm on all legs of a machine in one compiled call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiled import compiled
from ..legs import Legs
from ..prediction import prediction_table
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
def tick_legs(
    states, acts, table, preview, counts, loads, pose, mobility, forces, speeds, setpoint, position, control, valve, bottom, top, supply,
    forward, added_V, finite,
):  # fmt: skip
    """`tick_of` of those states (n,) that act (n,) into added_V and finite (n,). preview, loads
    (n, most) in rows, of which counts (n,) are the leg's; pose (n,), mobility (n, n) or (n, 0)."""
    for i in range(len(states)):
        if acts[i]:
            added_V[i] = tick_of(
                states[i], table, preview[i, : counts[i]], loads[i, : counts[i]], pose[i], mobility[i], forces, speeds,
                setpoint[i], position[i], control[i], valve[i], bottom[i], top[i], supply, forward[i],
            )  # fmt: skip
            finite[i] = is_finite(states[i])


@compiled
def share_legs(states, acted, alike):
    """Each leg that has just acted and `tells` says what it knows to those that are alike (n, n)."""
    for i in range(len(states)):
        if acted[i] and tells(states[i]):
            for j in range(len(states)):
                if j != i and alike[i, j]:
                    hear_leg(states[j], states[i])


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
        tick_legs(
            self.joined, acts, prediction_table(), legs.preview_m, legs.counts, legs.load_preview_m_s2, legs.load_of_pose_m_s2,
            legs.mobility, legs.forces_N, legs.speeds_m_s, legs.setpoint_m, legs.position_m, legs.control_V, legs.valve_V,
            legs.pressure_bottom_Pa, legs.pressure_top_Pa, legs.pressure_supply_Pa, legs.feed_forward_V, added, finite,
        )  # fmt: skip

    def share(self, acted: np.ndarray, alike: np.ndarray) -> None:
        """What legs know, to those that are alike (n_legs, n_legs)."""
        if not (self._ticks % SAY_TICKS).all():
            share_legs(self.joined, acted, alike)
