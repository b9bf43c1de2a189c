"""Algorithms whose state is one row of doubles and whose tick is compiled: what the report's algorithms share.

A row holds the configuration, what is estimated, and tables behind both; an `IntEnum` of each algorithm says where. Its tick is

    tick(row, control_V, valve_V, position_m, bottom_Pa) -> volts to add

and a native function of the same for all legs (`desk.TICK`), so that a run needs no Python at a control tick.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np

from .compensator import Compensator, Context, Sample
from .compiled import compiled, compiled_callback
from .desk import STEP, TICK, legs_on
from .legs import OneByOne


@dataclass(slots=True)
class RowState:
    """The row, and the data sheet that it was made from."""

    context: Context
    row: np.ndarray


class RowCompensator(Compensator):
    """A compensator with such a state. Subclasses say what their row is, and its compiled functions."""

    def new_row(self, context: Context) -> np.ndarray:
        """A row with nothing learned."""
        raise NotImplementedError

    def functions(self) -> tuple[Any, Any]:
        """The compiled tick, and whether a row's numbers are finite."""
        raise NotImplementedError

    def start(self, context: Context) -> RowState:
        return RowState(context, self.new_row(context))

    def step(self, state: RowState, sample: Sample) -> tuple[float, RowState]:
        tick, _ = self.functions()
        return tick(state.row, sample.control_V, sample.valve_V, sample.position_m, sample.pressure_bottom_Pa), state

    def finite(self, state: RowState) -> bool:
        _, is_sound = self.functions()
        return is_sound(state.row)

    def together(self, states: Sequence[RowState]) -> RowLegs:
        """What steps these legs."""
        return RowLegs(self, states)


class RowLegs(OneByOne):
    """The rows of all legs in one array, where a native tick finds them; each state has its part of it."""

    def __init__(self, algorithm: RowCompensator, states: Sequence[RowState]) -> None:
        super().__init__(algorithm, states)
        self.joined, self.functions = np.array([state.row for state in states]), algorithm.functions()
        for i, state in enumerate(states):
            self.renew(i, state)

    def renew(self, leg: int, state: RowState) -> None:
        """A leg goes on with another state."""
        self.states[leg], self.joined[leg] = state, state.row
        state.row = self.joined[leg]

    def native(self) -> Any:
        """The tick of all legs."""
        return native_tick(*self.functions)


@cache
def native_tick(tick: Any, is_sound: Any) -> Any:
    """A compiled tick, and whether numbers are finite, of all legs that act."""

    @compiled_callback(TICK)
    def step_legs(desk, what):
        if what != STEP:
            return
        states, acts, finite, added, control, valve, position, bottom = legs_on(desk)
        for i in range(len(acts)):
            if acts[i]:
                added[i] = tick(states[i], control[i], valve[i], position[i], bottom[i])
                finite[i] = is_sound(states[i])

    return step_legs


class V(IntEnum):
    """Places of a velocity estimate from where it begins in a row."""

    RATE = 0  # ticks a second
    SHARE = 1  # of a low pass, a tick; 1: none
    POSITION = 2  # the last one [m], NaN before the first
    CONTROL = 3  # the last control volts
    PASSES = 4  # velocity, valve's volts and control volts behind one low pass, and behind two
    FOUND = 10  # velocity [m/s], valve and control volts that belong together
    END = 13


def start_estimate(part: np.ndarray, rate_Hz: float, bandwidth_Hz: float | None) -> None:
    """Begin an estimate in its part of a row. bandwidth_Hz: of a first-order low pass, twice; None: none."""
    part[V.RATE], part[V.POSITION] = rate_Hz, math.nan
    part[V.SHARE] = 1.0 if bandwidth_Hz is None else 1.0 - math.exp(-2 * math.pi * bandwidth_Hz / rate_Hz)


@compiled
def estimate_velocity(part, position_m, valve_V, control_V):
    """Velocity [m/s], valve and control volts that belong together, into FOUND; whether there are: not at the first tick and at a lost
    sample.

    A difference of two positions is the mean velocity between two ticks, driven by the volts sent at the first of them: valve_V is
    what was sent at the previous tick, control_V that of this one, kept for the next. Where the velocity is filtered, the volts pass
    the same filter, so that a flow curve drawn of both keeps its phase (report 4.4).
    """
    velocity = (position_m - part[V.POSITION]) * part[V.RATE]
    control = part[V.CONTROL]
    part[V.POSITION], part[V.CONTROL] = position_m, control_V
    if not math.isfinite(velocity):
        return False
    part[V.FOUND], part[V.FOUND + 1], part[V.FOUND + 2] = velocity, valve_V, control
    share = part[V.SHARE]
    if share < 1.0:
        for i in range(3):
            part[V.PASSES + i] += share * (part[V.FOUND + i] - part[V.PASSES + i])
            part[V.PASSES + 3 + i] += share * (part[V.PASSES + i] - part[V.PASSES + 3 + i])
            part[V.FOUND + i] = part[V.PASSES + 3 + i]
    return True


@compiled
def all_are_finite(row, first, last):
    """Whether the numbers first .. last - 1 of a row are."""
    total = 0.0
    for i in range(first, last):
        total += row[i] - row[i]  # not 0 of one that is not finite
    return total == 0.0
