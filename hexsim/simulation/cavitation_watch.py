# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""Cavitation of a machine that runs without an end: each event in the sentence of a run's warnings, once it is over."""

from __future__ import annotations

from collections import deque

import numpy as np

from hexsim.hydraulics.chamber import VAPOUR
from hexsim.hydraulics.supply import POWER_UNIT, S, U
from hexsim.plant import Plant
from hexsim.plant.callbacks import MPa
from hexsim.plant.readout import voids
from hexsim.plant.states import A
from hexsim.simulation.run_warnings import Cavitation


class CavitationWatch:
    """Watches the chambers of a plant. `told` has the last sentences, `count` says how many there were."""

    def __init__(
        self,
        plant: Plant,
        *,
        n_kept: int = 100,  # sentences, the last ones
    ) -> None:
        self.plant, self.count, self._said = plant, 0, 0
        self.told: deque[str] = deque(maxlen=n_kept)
        self._chambers = chambers(plant)
        self._open: dict[str, tuple[Cavitation, float]] = {}  # and when a void was last seen

    def note(self, tick_s: float) -> None:
        """After every tick of the plant, of `tick_s`. A void that opens and closes between two ticks is not seen."""
        act = self.plant.data.act
        if act[self._chambers].min() < VAPOUR / MPa:
            self._add(tick_s)
        if self._open:
            self._close(float(self.plant.data.time))

    def since(self, count: int) -> list[str]:
        """Sentences after the first `count` ones, those that are still kept."""
        new = min(self.count - count, len(self.told))
        return list(self.told)[len(self.told) - new :]

    def unsaid(self) -> list[str]:
        """Sentences since the last call."""
        found, self._said = self.since(self._said), self.count
        return found

    def _add(self, tick_s: float) -> None:
        plant, now = self.plant, float(self.plant.data.time)
        found = voids(plant, np.array([now]), plant.piston_positions()[None], plant.data.act[None])
        for place, (void, area) in found.items():
            volume = float(void[0])
            seen, last_s = self._open.get(place, (None, now))
            if seen is None:
                seen = Cavitation(area_m2=area, count=0, first_s=now, duration_s=0.0, largest_m3=volume, largest_s=now)
            seen.count += seen.count == 0 or now - last_s > 1.5 * tick_s
            seen.duration_s += tick_s
            if volume > seen.largest_m3:
                seen.largest_m3, seen.largest_s = volume, now
            self._open[place] = seen, now

    def end(self) -> None:
        """The machine stops, or begins anew at time 0: say what is still open."""
        self._close(np.inf)

    def _close(
        self,
        now: float,
        *,
        apart_s: float = 1.0,  # voids that are farther apart are two events
        longest_s: float = 10.0,  # of an event; one that goes on is said, and begins anew
    ) -> None:
        for place, (seen, last_s) in list(self._open.items()):
            if now - last_s > apart_s or now - seen.first_s > longest_s:
                self.told.append(seen.sentence(place))
                self.count += 1
                del self._open[place]


def chambers(plant: Plant) -> np.ndarray:
    """Places of all volumes of oil in the plant's states."""
    tops, supply = plant.rod_side_places, plant.layout[-1]
    found = [*plant.pressure_places, *tops[tops >= 0]]
    if plant.has_supply_states:
        found.append(supply[A.PRESSURE])
        if plant.resolved.supply[S.MODEL] == POWER_UNIT:
            found.append(supply[A.SUPPLY] + U.PUMP_PRESSURE)
    return np.array(found, dtype=np.int64)
