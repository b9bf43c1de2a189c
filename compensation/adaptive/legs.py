"""The adaptive algorithm on all legs of a machine in one compiled call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiled import compiled
from ..guard import TELLS
from ..legs import Legs, tell
from ..prediction import prediction_table
from .layout import STATE
from .start import finite_from
from .step import DESIGN_WANTED, expect, tick_of
from .taps import design


@compiled
def tick_legs(
    states, numbers, acts, table, preview, counts, loads_m_s2, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa,
    supply_Pa, extra_V, added_V, told, finite,
):  # fmt: skip
    """`tick` of those states (n,) that act (n,), into added_V, told, finite (n,). numbers (n, doubles): the states' memory. preview,
    loads (n, most) in rows, of which counts (n,) are the leg's. Returns what any of them tells."""
    any_told = 0
    for i in range(len(states)):
        if acts[i]:
            expect(states[i], loads_m_s2[i, : counts[i]])
            added_V[i], told[i] = tick_of(
                states[i], table, preview[i, : counts[i]], setpoint_m[i], position_m[i], control_V[i], valve_V[i], bottom_Pa[i],
                top_Pa[i], supply_Pa, extra_V[i],
            )  # fmt: skip
            finite[i] = finite_from(numbers[i], 0)
            any_told |= told[i]
    return any_told


class AdaptiveLegs:
    """The states of all legs in one array; each `AdaptiveState` has its part of it. algorithm: `Adaptive`, or derived from it;
    has_extra: which then adds volts of its own."""

    def __init__(self, algorithm: Any, states: Sequence[Any], has_extra: bool) -> None:
        self.algorithm, self.states, self._has_extra = algorithm, list(states), has_extra
        self.joined = np.zeros(len(states), STATE)
        self.numbers = self.joined.view(np.float64).reshape(len(states), -1)
        self.may_speak = True
        self._told, self._any = np.zeros(len(states), np.int64), 0
        self._was: list[int] = []
        for i, state in enumerate(states):
            self.renew(i, state)

    def renew(self, leg: int, state: Any) -> None:
        """A leg goes on with another state."""
        self.states[leg], self.joined[leg] = state, state.states[0]
        state.states = self.joined[leg : leg + 1]
        state.flat = self.numbers[leg]
        self._told[leg], self._was = state.told, []

    def step(self, legs: Legs, acts: np.ndarray, added: np.ndarray, finite: np.ndarray) -> None:
        """As `Adaptive.step` and `Adaptive.finite`."""
        made, states = self.algorithm, self.states
        extra = 0.0 - legs.feed_forward_V  # not -0.0, as `Adaptive.step`
        if self._has_extra:
            for i, sample in enumerate(legs.samples()):
                if acts[i]:
                    extra[i] = made.extra(states[i], sample) - sample.feed_forward_V
        self._any = tick_legs(
            self.joined, self.numbers, acts, prediction_table(), legs.preview_m, legs.counts, legs.load_preview_m_s2,
            legs.setpoint_m, legs.position_m, legs.control_V, legs.valve_V, legs.pressure_bottom_Pa, legs.pressure_top_Pa,
            legs.pressure_supply_Pa, extra, added, self._told, finite,
        )  # fmt: skip
        told = self._told.tolist()
        self.may_speak = told != self._was
        if self.may_speak:
            self._was = told
            for state, its in zip(states, told, strict=True):
                state.told = its
        if self._any & DESIGN_WANTED:
            for i, state in enumerate(states):
                if acts[i] and state.told & DESIGN_WANTED:
                    design(state.numbers)
        if self._has_extra:
            for i, state in enumerate(states):
                finite[i] = finite[i] and made.has_sound_extra(state)

    def share(self, acted: np.ndarray, alike: np.ndarray) -> None:
        """What legs have just learned, to those that are alike (n_legs, n_legs)."""
        if self._any & TELLS:
            tell([self.algorithm] * len(self.states), self.states, acted, alike)
