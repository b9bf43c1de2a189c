# pyright: reportAttributeAccessIssue=false, reportCallIssue=false
# (as `newton_euler`)
"""Many machines of one layout side by side, on threads: each platform by `newton_euler`, without Python in between.

A batch holds states; a thread has one mjData, into which it puts a machine's state, steps it, and takes it out again.
Compiled code runs without Python's lock, so that threads run at once.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import compiled
from hexsim.plant.newton_euler import What, native_platform
from hexsim.plant.stepping import call_native, copy
from hexsim.plant.structs import time_view

Array = NDArray[np.float64]
STATE = ("qpos", "qvel", "act", "ctrl", "time")


@compiled
def step_machines(native, models, data, room, states, steps, first, last):
    """Machines first..last - 1, each `steps` of its model's time steps on. room: views of the data's state, as `states` in rows."""
    for k in range(first, last):
        copy(room[0], states[0][k])
        copy(room[1], states[1][k])
        copy(room[2], states[2][k])
        copy(room[3], states[3][k])
        copy(room[4], states[4][k])
        for _ in range(steps):
            call_native(native, models[k], data, (What.EVALUATE,))
            call_native(native, models[k], data, (What.RUNGE_KUTTA,))
        copy(states[0][k], room[0])
        copy(states[1][k], room[1])
        copy(states[2][k], room[2])
        copy(states[4][k], room[4])


class PlatformBatch:
    """States of n machines, and their steps. models: each `is_one_body`, of one layout. threads: 0 = all processors.

    `bind(name)` gives the array (n, ...) of qpos, qvel, act, ctrl or time [s] that `step` works on.
    """

    def __init__(self, models: Sequence[Any], threads: int = 0) -> None:
        self.models = list(models)  # keeps them
        self._addresses = np.array([model._address for model in models], dtype=np.uintp)
        first, n = self.models[0], len(self.models)
        self._data = [mujoco.MjData(first) for _ in range(min(threads or os.cpu_count() or 1, n))]
        self._room = [(d.qpos, d.qvel, d.act, d.ctrl, time_view(d)) for d in self._data]
        self._states = tuple(np.zeros((n, len(values))) for values in self._room[0])
        self._ends = np.linspace(0, n, len(self._data) + 1).astype(int).tolist()  # of the threads' shares
        self._pool = ThreadPoolExecutor(len(self._data), thread_name_prefix="machines")

    def bind(self, name: str) -> Array:
        """The array of a state, (n, width); time (n,)."""
        values = self._states[STATE.index(name)]
        return values[:, 0] if name == "time" else values

    def step(self, nstep: int = 1) -> None:
        """`nstep` time steps of every machine."""
        native = native_platform().address
        made = [
            (native, self._addresses, data._address, room, self._states, nstep, first, last)
            for data, room, first, last in zip(self._data, self._room, self._ends[:-1], self._ends[1:], strict=True)
        ]
        if len(made) == 1:
            step_machines(*made[0])
        else:
            list(self._pool.map(lambda one: step_machines(*one), made))
