"""The faults of a scenario in a simulation: broken sensors, a broken plant, a silent host."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexsim.hydraulics.resolved import Resolved
from hexsim.motion_computer.computer import MotionComputer
from hexsim.motion_computer.errors import labels
from hexsim.plant import Plant
from hexsim.sensors.bank import SensorBank, Transducers
from hexsim.simulation.emergency_supply import EmergencySupply
from hexsim.simulation.faults import Fault, HostSilence, LegBlind, PositionSensor, Workbench
from hexsim.simulation.safety_manifold import SafetyManifold

Array = NDArray[np.float64]


class FaultySensors(SensorBank):
    """A sensor bank in which some transducers break or change: same noise as the sound one, from the same seed."""

    def __init__(self, resolved: Resolved, ticks: int, tick_s: float, seed: int, faults: Sequence[Fault]) -> None:
        super().__init__(resolved, ticks, tick_s, seed)
        self._faults = [fault for fault in faults if isinstance(fault, (PositionSensor, LegBlind))]
        self._held: dict[Fault, float] = {}
        self._run = ticks, tick_s, seed
        self._changes: list[tuple[int, SensorBank]] = []

    def change(self, time_s: float, resolved: Resolved) -> None:
        """From `time_s` on the sensors are those of `resolved`."""
        self._changes.append((self._first(time_s), SensorBank(resolved, *self._run)))

    def _first(self, time_s: float) -> int:
        """First tick from `time_s` on."""
        return math.ceil(time_s / self.tick_s - 1e-9)

    def __getitem__(self, stem: str) -> Transducers:
        """The transducers of a signal as they are at present."""
        return self._changes[-1][1][stem] if self._changes else super().__getitem__(stem)

    def position(self, tick: int, history: Array) -> Array:
        measured = super().position(tick, history)
        for fault in self._faults:
            if tick >= self._first(fault.time_s):
                held = self._held.setdefault(fault, float(measured[fault.leg - 1]))
                measured[fault.leg - 1] = fault.reading(float(measured[fault.leg - 1]), held)
        return measured

    def pressure(self, tick: int, history: Array) -> Array:
        measured = super().pressure(tick, history)
        for fault in self._faults:
            if isinstance(fault, LegBlind) and tick >= self._first(fault.time_s):
                measured[fault.leg - 1] = np.nan
        return measured

    def rows(self, stem: str, true: Array) -> Array:
        measured = SensorBank.__getitem__(self, stem).rows(true)
        for first, bank in self._changes:
            measured[first:] = bank.rows(stem, true)[first:]
        for fault in self._faults if stem == "position" else ():
            column = measured[self._first(fault.time_s) :, fault.leg - 1]
            if len(column):
                held = float(column[0])
                column[:] = [fault.reading(float(value), held) for value in column]
        for fault in self._faults if stem == "pressure_bottom" else ():
            if isinstance(fault, LegBlind):
                measured[self._first(fault.time_s) :, fault.leg - 1] = np.nan
        return measured


class FaultRun:
    """All faults of a scenario around one run: the intervention that `simulate` calls at each tick."""

    def __init__(self, faults: Sequence[Fault], plant: Plant, computer: MotionComputer, sensors: FaultySensors) -> None:
        self.faults = sorted(faults, key=lambda fault: fault.time_s)
        self.computer = computer
        self.supply = EmergencySupply(plant)
        self.bench = Workbench(
            plant=plant,
            computer=computer,
            supply=self.supply,
            manifold=SafetyManifold(plant),
            sensors=sensors,
            tick_s=sensors.tick_s,
        )
        self._silent_s = min((f.time_s for f in self.faults if isinstance(f, HostSilence)), default=math.inf)
        self.hosted = math.isfinite(self._silent_s)

    def begin(
        self,
        *,
        fastest_m_s: float = 0.08,  # down to the stops
    ) -> None:
        """From neutral into manual, or into normal where a host is to fall silent.

        With a manifold the legs on their valves are lowered as fast as those on their orifices, within reason.
        """
        if (speed := self.bench.manifold.settling_velocity_m_s()) > 0.0:
            guided = self.computer.guided
            guided.guidance = dataclasses.replace(guided.guidance, settle_velocity_m_s=min(speed, fastest_m_s))
        self.computer.command("run_normal" if self.hosted else "run_manual", 0.0)

    def host_setpoints(self, time_s: float, setpoints: Array) -> Array | None:
        """Setpoints that reach the motion computer: None once the host is silent."""
        if not self.hosted:
            return setpoints
        if time_s >= self._silent_s:
            return None
        self.computer.last_packet_s = time_s
        return setpoints

    def before_step(self, time_s: float, plant: Plant, volts: Array) -> Array:
        for fault in self.faults:
            if time_s >= fault.time_s - 1e-9:
                volts = fault.act(self.bench, time_s, volts)
        self.supply.tick(self.computer.pump_on, self.bench.tick_s)
        self.bench.manifold.tick(self.computer, self.bench.tick_s)
        self.computer.pump_running = self.supply.running
        self.computer.oil_temperature_degC = plant.oil_temperature_degC
        return volts

    def summary(self) -> dict[str, Any]:
        """What the motion computer saw and did: `motion_computer` of summary.json."""
        computer = self.computer
        return {
            "motion_computer": {
                "state": computer.state.name.lower(),
                "errors": labels(computer.errors),
                "events": [[round(t, 6), before, event, after] for t, before, event, after in computer.events],
                "found": [[round(t, 6), finding.leg, finding.text] for t, finding in computer.findings],
            }
        }
