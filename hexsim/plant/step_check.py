# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""The error of a run's time steps, measured: its worst tenths of a second are done again in steps half as long.

A run is marked every CHECK_EVERY_S or so. `stepping.last_error` says which spans were the worst; those are started from
their marks again, under the volts that reached the spools, with twice the steps and an eighth of the tolerance. What the
platform's acceleration differs by in the 50 Hz band, over its peak in that band during the run, is the error. It holds
for given volts: a reading of a sensor that falls on the other side of a count because of it, and what a controller makes
of that, is not in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hexsim.plant import stepping
from hexsim.smoothness.band import band_limit

Array = NDArray[np.float64]
STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@dataclass
class Mark:
    """Where a span begins, and what it needs to be done again."""

    first: int  # tick
    state: Array  # of MuJoCo
    ctrl: Array
    rows: Array  # actuator_user
    centres: Array  # body_ipos
    masses: Array
    context: Any
    arrays: list[Array]  # of the context, as they were
    versions: int  # of the plant's rows
    last: int = 0
    error: float = 0.0


class StepCheck:
    """Marks of a run on `plant`, which records it."""

    def __init__(self, plant: Any, kept: int = 8) -> None:
        """kept: marks of the worst spans."""
        self.plant, self.kept, self.marks, self.spans = plant, kept, [], 0
        self.repeat: Callable[[Any, Any, Array], object] = _repeat  # or what a run has compiled already
        self.open: Mark | None = None

    def begin(self, tick: int) -> None:
        """A span begins at a tick, before it."""
        self.open = self._mark(tick)
        self.plant.context.error[0] = 0.0

    def end(self, tick: int) -> None:
        """It ends before a tick. One in which the machine changed is not done again."""
        mark, model = self.open, self.plant.model
        if mark is None or tick <= mark.first + 1:
            return
        mark.last, mark.error = tick, float(self.plant.context.error[0])
        self.spans += 1
        same = np.array_equal(mark.rows, model.actuator_user) and np.array_equal(mark.centres, model.body_ipos)
        if same and mark.versions == len(self.plant.history) and np.isfinite(mark.error):
            self.marks = sorted([*self.marks, mark], key=lambda m: (-m.error, m.first))[: self.kept]

    def error(
        self,
        ticks: int,
        *,
        spans_a_check: int = 60,  # one span in so many is done again, one at least
        still_m_s2: float = 1.0e-6,  # a machine that does not move has no peak to judge by
    ) -> float | None:
        """Error over the peak, for a run of `ticks`; None where no span can be judged."""
        plant, context = self.plant, self.plant.context
        record, tick_s = plant.record, context.tick_s
        acceleration = stepping.mean_acceleration(record, ticks, tick_s) * context.reach
        if not self.marks or ticks < 2 or not np.isfinite(acceleration).all():
            return None
        peak = np.abs(self._banded(acceleration)).max()
        if not peak > still_m_s2:
            return 0.0
        present, worst = self._mark(ticks), 0.0
        for mark in self.marks[: max(1, min(self.kept, self.spans // spans_a_check))]:
            middle = self._again(mark)
            gap = (middle - record.middle[mark.first : mark.last]) * context.reach
            differs = np.diff(gap, axis=0, prepend=0.0) / tick_s
            worst = max(worst, float(np.abs(self._banded(differs)).max()))
        self._go_to(present)
        return worst / float(peak)

    def _banded(self, acceleration: Array) -> Array:
        return band_limit(np.arange(len(acceleration)) * self.plant.context.tick_s, acceleration)

    def _mark(self, tick: int) -> Mark:
        plant, model = self.plant, self.plant.model
        state = np.empty(mujoco.mj_stateSize(model, STATE))
        mujoco.mj_getState(model, plant.data, state, STATE)
        context = plant.context
        return Mark(
            tick,
            state,
            plant.data.ctrl.copy(),
            model.actuator_user.copy(),
            model.body_ipos.copy(),
            model.body_mass.copy(),
            context,
            [values.copy() for values in _changing(context)],
            len(plant.history),
        )

    def _go_to(self, mark: Mark) -> None:
        plant, model = self.plant, self.plant.model
        mujoco.mj_setState(model, plant.data, mark.state, STATE)
        plant.data.ctrl[:] = mark.ctrl
        model.actuator_user[:], model.body_ipos[:], model.body_mass[:] = mark.rows, mark.centres, mark.masses
        for values, kept in zip(_changing(mark.context), mark.arrays, strict=True):
            values[:] = kept

    def _again(self, mark: Mark) -> Array:
        """Velocities (ticks, nv) in the middle of the ticks of a span, in steps half as long."""
        self._go_to(mark)
        ticks, volts = mark.last - mark.first, self.plant.record.reached
        record = stepping.new_record(self.plant, ticks + 1)  # row 0 is that of no tick
        context = mark.context._replace(is_recorded=True, refined=2, count=np.ones(1, np.int64))
        self.repeat(context, record, volts[mark.first : mark.last])
        return record.middle[1 : ticks + 1]


def _repeat(context: Any, record: Any, volts: Array) -> None:
    """Ticks with volts (ticks, n_legs) at the spools."""
    for of_tick in volts:
        context.spool_volts[:] = of_tick
        stepping.for_python(context, record, context.spool_volts, False, False, True)


def _changing(context: Any) -> list[Array]:
    """Arrays of a context that steps change."""
    return [
        context.next_step,
        context.level,
        context.slow,
        context.velocity_before,
        context.spool_volts,
        context.apart,
        context.timestep,
        context.error,
        *context.bends,
    ]
