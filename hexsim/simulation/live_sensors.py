"""Sensors of a machine that runs without an end: the noise repeats, the recent past is kept for delays."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from hexsim.plant import Plant
from hexsim.sensors.bank import SensorBank

Array = NDArray[np.float64]
Readings = tuple[
    Array, Array, float, Array | None
]  # positions, bottom pressures, supply pressure, rod sides on a valve


class LiveSensors:
    """A sensor bank at the control rate. Delays are linear between control ticks, as in `Transducers.at`."""

    def __init__(
        self,
        plant: Plant,
        tick_s: float,
        seed: int,
        *,
        noise_s: float = 10.0,  # noise is drawn for this long and then repeats
    ) -> None:
        self.plant, self.noise_ticks = plant, round(noise_s / tick_s)
        self.bank = SensorBank(plant.resolved, self.noise_ticks, tick_s, seed)
        self._stems = ["position", "pressure_bottom"]
        if plant.machine.cylinder.rod_side == "valve":
            self._stems.append("pressure_top")
        self._delay = np.concatenate([self.bank[stem].delay for stem in self._stems]) / tick_s
        self._older = np.ceil(self._delay).astype(int)  # ticks back to the sample before the delayed time
        self._past: deque[Array] = deque(maxlen=int(self._older.max()) + 1)

    def restart(self) -> None:
        """Forget the past."""
        self._past.clear()
        for stem in self._stems:
            self.bank[stem].restart()

    def read(self, tick: int) -> Readings:
        """Measured positions (n_legs,) [m], bottom pressures (n_legs,) [Pa], supply pressure [Pa], and pressures of the
        rod sides (n_legs,) [Pa] that are on a valve."""
        bank, plant, k = self.bank, self.plant, tick % self.noise_ticks
        chambers = [plant.bottom_pressures(), plant.rod_side_pressures()][: len(self._stems) - 1]
        true = np.concatenate([plant.piston_positions(), *chambers])
        self._past.appendleft(true)
        if self._delay.any():
            past, columns, first = np.array(self._past), np.arange(len(true)), len(self._past) - 1
            share = self._older - self._delay
            before = past[np.minimum(self._older, first), columns]
            after = past[np.clip(self._older - 1, 0, first), columns]
            true = (1.0 - share) * before + share * after
        read = [
            bank[stem].next(values, k)
            for stem, values in zip(self._stems, true.reshape(len(self._stems), -1), strict=True)
        ]
        return read[0], read[1], bank.supply(k, plant.supply_pressure()), read[2] if len(read) > 2 else None
