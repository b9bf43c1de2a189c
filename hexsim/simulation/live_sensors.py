"""Sensors of a machine that runs without an end: the noise repeats, the recent past is kept for delays."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from hexsim.plant import Plant
from hexsim.sensors.bank import SensorBank

Array = NDArray[np.float64]
NOISE_S = 10.0  # noise is drawn for this long and then repeats


class LiveSensors:
    """A sensor bank at the control rate. Delays are linear between control ticks, as in `Transducers.at`."""

    def __init__(self, plant: Plant, tick_s: float, seed: int) -> None:
        self.plant, self.noise_ticks = plant, round(NOISE_S / tick_s)
        self.bank = SensorBank(plant.resolved, self.noise_ticks, tick_s, seed)
        self._delay = np.concatenate([self.bank["position"].delay, self.bank["pressure_bottom"].delay]) / tick_s
        self._older = np.ceil(self._delay).astype(int)  # ticks back to the sample before the delayed time
        self._past: deque[Array] = deque(maxlen=int(self._older.max()) + 1)

    def restart(self) -> None:
        """Forget the past."""
        self._past.clear()

    def read(self, tick: int) -> tuple[Array, Array, float]:
        """Measured positions (n_legs,) [m], bottom pressures (n_legs,) [Pa] and supply pressure [Pa] of the plant."""
        bank, k, n = self.bank, tick % self.noise_ticks, self.plant.n_legs
        true = np.concatenate([self.plant.piston_positions(), self.plant.bottom_pressures()])
        self._past.appendleft(true)
        if self._delay.any():
            past, columns, first = np.array(self._past), np.arange(2 * n), len(self._past) - 1
            share = self._older - self._delay
            before = past[np.minimum(self._older, first), columns]
            after = past[np.clip(self._older - 1, 0, first), columns]
            true = (1.0 - share) * before + share * after
        position, pressure = bank["position"].read(true[:n], k), bank["pressure_bottom"].read(true[n:], k)
        return position, pressure, bank.supply(k, self.plant.supply_pressure())
