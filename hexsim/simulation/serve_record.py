"""What a served machine leaves: its states from the start on, made into a run like any other."""

from __future__ import annotations

from typing import Any

import numpy as np

from hexsim.plant.stepping import mean_acceleration
from hexsim.scenarios import Scenario
from hexsim.sensors.bank import SensorBank
from hexsim.simulation.run_log import Recorded, run_log, run_summary
from hexsim.simulation.run_warnings import cavitation_warnings
from hexsim.simulation.simulation import Run


class ServeRecord:
    """The first `seconds` of a server's plant, tick by tick, at the rate that it steps with.

    The measured columns of the log carry sensor noise of the same size as the motion computer's, not the same draws.
    """

    def __init__(self, server: Any, seconds: float, rate_Hz: float, seed: int) -> None:
        self.server, self.tick_s, self.seed, self.done = server, 1.0 / rate_Hz, seed, 0
        self.room, self.rate_Hz = max(1, round(seconds * rate_Hz)), rate_Hz
        n = server.machine.n_legs
        self.setpoints, self.compensation = np.zeros((self.room, n)), np.zeros((self.room, n))
        server.plant.prepare(rate_Hz, self.room)
        self.record = server.plant.record

    def before_tick(self) -> None:
        """Write down what a tick of the plant begins with; once the room is used up, nothing more."""
        if self.done == self.room:
            self.server.plant.prepare(self.rate_Hz)
            self.done += 1
        if self.done > self.room:
            return
        self.server.plant.sense()
        self.setpoints[self.done] = self.server.computer.setpoint
        self.compensation[self.done] = self.server.computer.compensation
        self.done += 1

    def run(self) -> Run:
        """The run so far, with its log and figures."""
        server, record, rows = self.server, self.record, slice(0, min(self.done, self.room))
        done = rows.stop
        recorded = Recorded(
            time=np.arange(done, dtype=float) * self.tick_s,
            setpoints=self.setpoints[rows],
            positions=record.positions[rows],
            qpos=record.qpos[rows],
            qvel=record.qvel[rows],
            qacc=record.qacc[rows],
            mean_acceleration=mean_acceleration(record, done, self.tick_s),
            act=record.act[rows],
            timestep=self.tick_s / record.steps[rows],
            volts=record.volts[rows],
            spool_volts=record.spool_volts[rows],
            compensation=self.compensation[rows],
        )
        scenario = Scenario(
            name="serve",
            mode="actuator",
            signals={},
            duration_s=max(done * self.tick_s, self.tick_s),
            description="what a host or the manual mode asked for",
        )
        log = run_log(server.plant, scenario, recorded, SensorBank(server.plant.resolved, done, self.tick_s, self.seed))
        margin, engagement = server.margin, server.computer.engagement()
        warnings = cavitation_warnings(server.plant, self.tick_s, recorded.positions, recorded.act)
        summary = run_summary(server.plant, scenario, server.compensator, log, recorded, margin, warnings)
        return Run(
            machine=server.machine,
            scenario=scenario,
            compensator=server.compensator,
            seed=self.seed,
            model=server.plant.model_kind,
            timestep=server.plant.timestep,
            log=log,
            summary=summary | ({"compensation": engagement} if engagement else {}),
            warnings=warnings,
            messages=list(server.messages),
            realtime_factor=margin,
            compensator_parameters=server.computer.learned(),
        )
