"""The built-in signal generator of manual mode: a scenario's setpoints, computed block by block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.errors import HexsimError
from hexsim.plant import Plant
from hexsim.scenarios import Scenario
from hexsim.simulation.simulation import setpoints

Array = NDArray[np.float64]


class SignalGenerator:
    """Piston setpoints of `scenario` from the moment manual mode begins; after its duration the last one is held.

    DOF mode or actuator mode as in the scenario; the fade-in is the scenario's own.
    """

    def __init__(self, plant: Plant, scenario: Scenario, tick_s: float, preview: int) -> None:
        self._evaluate = lambda time: setpoints(plant.machine, scenario, plant.machine.mechanics, time)
        self.scenario, self.tick_s, self.preview = scenario, tick_s, preview
        if scenario.duration_s < tick_s:
            raise HexsimError(f"scenario {scenario.name} is shorter than one control tick of {tick_s:g} s")
        self._last = int(scenario.duration_s / tick_s)
        self._block, self._first = np.zeros((0, plant.n_legs)), 0
        self._tick = 0

    def restart(self) -> None:
        self._tick, self._block = 0, self._block[:0]

    def rows(
        self,
        *,
        block_ticks: int = 250,  # that are computed at once
    ) -> Array:
        """Setpoints (preview, n_legs) of the next tick and those after it."""
        tick = self._tick
        self._tick += 1
        if not self._first <= tick or tick + self.preview > self._first + len(self._block):
            ticks = np.minimum(np.arange(tick, tick + block_ticks + self.preview), self._last)
            self._block, self._first = self._evaluate(ticks * self.tick_s), tick
        start = tick - self._first
        return self._block[start : start + self.preview]
