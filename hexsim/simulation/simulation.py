"""Run a scenario on a machine: motion computer, plant and sensors tick by tick, then the log and the figures."""

from __future__ import annotations

import ctypes
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

import compensation
from compensation import Compensator
from hexsim.compiled import seconds_compiled
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.mechanics.mechanics import Mechanics
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.plant import Plant
from hexsim.plant.callbacks import without_timers
from hexsim.plant.plant import InterventionError, PlantError, whole_ratio
from hexsim.plant.step_check import StepCheck
from hexsim.plant.stepping import mean_acceleration
from hexsim.scenarios import Scenario
from hexsim.scenarios.bench_motion import bench_motion
from hexsim.scenarios.resources import check_resources, tick_rate_Hz
from hexsim.scenarios.settings import loaded, machine_in
from hexsim.sensors.bank import SensorBank
from hexsim.simulation.hosted import Host, hosted_setpoints
from hexsim.simulation.plain_loop import CONTROL, PlainLoop, Transducer, run_ticks
from hexsim.simulation.run_log import Recorded, figures_log, run_log, run_summary
from hexsim.simulation.run_warnings import cavitation_warnings, start_warnings, swing_warnings
from hexsim.simulation.start_parameters import SUFFIX, started

if TYPE_CHECKING:
    from hexsim.motion_computer.computer import MotionComputer
    from hexsim.simulation.fault_run import FaultRun

Array = NDArray[np.float64]


@dataclass(kw_only=True)
class Run:
    """A finished or interrupted run. `log` has the columns of a measured log and the truth behind them."""

    machine: Machine
    scenario: Scenario
    compensator: str
    seed: int
    model: str
    timestep: float | None  # [s] constant; None: chosen
    log: pl.DataFrame
    summary: dict[str, Any]
    warnings: list[str] = field(default_factory=list)
    messages: list[tuple[float, int, str]] = field(default_factory=list)
    complete: bool = True
    interrupted: bool = False  # by the user
    reason: str = ""  # why it is not complete
    realtime_factor: float = 0.0
    compensator_parameters: list[dict[str, Any]] = field(default_factory=list)

    def whole(self, failed: str) -> Run:
        """This run to its end. KeyboardInterrupt where the user ended it, HexsimError(f"{failed}: reason") where it failed."""
        if self.interrupted:
            raise KeyboardInterrupt
        if not self.complete:
            raise HexsimError(f"{failed}: {self.reason}")
        return self


def make_compensators(which: str | Compensator, machine: Machine) -> tuple[str, list[Compensator]]:
    """The compensator's name and one instance a leg; none for "none". A name that ends in .json: start parameters."""
    if isinstance(which, str) and which.endswith(SUFFIX):
        return started(Path(which), machine)
    try:
        made = compensation.create(which) if isinstance(which, str) else which
    except (ValueError, TypeError) as error:
        raise HexsimError(str(error)) from None
    return made.name, [] if made.name == "none" else [made] * machine.n_legs


def setpoints(machine: Machine, scenario: Scenario, kinematics: Mechanics, time: Array) -> Array:
    """Piston setpoints (m, n_legs) [m]; refuses what leaves the workspace, naming time, leg and length."""
    if scenario.mode == "dof" and kinematics.has_platform:
        values, _, _ = scenario.evaluate(time)
        kinematics.check_trajectory(time, values)
        return kinematics.piston_positions(values)
    if kinematics.has_platform:
        legs = scenario.evaluate(time)[0]
    else:
        missing = [axis for axis in scenario.signals if scenario.mode == "actuator" and axis != "leg_1"]
        if missing:
            raise HexsimError(
                f"scenario {scenario.name} drives {missing[0]}, which bench {machine.name} has not: give leg_1 alone"
            )
        legs = bench_motion(scenario, time)[0][:, None]
    positions, strokes = kinematics.neutral_positions + legs, np.asarray(kinematics.stroke_m)
    outside = (positions < 0) | (positions > strokes)
    if outside.any():
        row, leg = np.argwhere(outside)[0]
        raise HexsimError(
            f"scenario {scenario.name}: at t = {time[row]:.3f} s leg {leg + 1} has the setpoint {positions[row, leg]:.4f} m, "
            f"outside 0..{strokes[leg]:g} m: lower the amplitude"
        )
    return positions


def simulate(
    machine: Machine | str | Path,
    scenario: Scenario | str | Path,
    *,
    compensator: str | Compensator = "none",
    fast: bool = False,
    model: str | None = None,
    seed: int = 0,
    timestep: float | None = None,
    progress: Callable[[float], None] | None = None,
    interventions: Sequence[Any] = (),
    host: Host | None = None,
    figures_only: bool = False,
) -> Run:
    """Run `scenario` on `machine`, each an object, a name or a file.

    fast: tendon model, else full legs. timestep [s]: constant; None: chosen (`hydraulics.steps`). seed: of all sensor
    noise. progress(fraction).
    interventions: objects with `before_step(time_s, plant, volts)`, which may change the plant or the volts (faults).
    host: its packets drive the machine, and no future is known (`hosted`). figures_only: `Run.log` holds setpoints and
    true positions alone.
    Raises HexsimError before the run for what cannot be done; an interrupted or diverged run comes back with
    complete = False and its log so far.
    """
    machine, scenario = loaded(machine, scenario)
    machine = machine_in(scenario, machine)
    check_resources(machine, scenario.duration_s)
    name, compensators = make_compensators(compensator, machine)
    kind = model or ("tendon" if fast else "full")
    messages: list[tuple[float, int, str]] = []
    control, later, shifts = PositionLoop, [], False
    if scenario.faults:
        from hexsim.motion_computer.computer import MotionComputer as control
        from hexsim.simulation.faults import PayloadShift, later_effects, read_faults

        faults = read_faults(scenario.faults, machine, f"scenario {scenario.name}")
        later, shifts = later_effects(faults, machine), any(isinstance(fault, PayloadShift) for fault in faults)
    plant = Plant(machine, model=kind, timestep=timestep, later=later, load_moves=shifts)  # type: ignore[arg-type]
    warnings = start_warnings(plant, fast)
    loop = control(machine, compensators, scenario.period_s, lambda *message: messages.append(message))
    run = TickLoop(plant, loop, scenario, seed, host)
    if scenario.faults:
        from hexsim.simulation.fault_run import FaultRun, FaultySensors

        run.sensors = FaultySensors(plant.resolved, run.ticks, run.tick_s, seed, faults)
        run.faults = FaultRun(faults, plant, loop, run.sensors)  # type: ignore[arg-type]
        interventions = [*interventions, run.faults]
        run.faults.begin()
    started = clock.perf_counter() - seconds_compiled()
    reason = run.go(progress or (lambda fraction: None), interventions)
    wall = clock.perf_counter() - seconds_compiled() - started  # compiling (once) is no part of the speed
    recorded = run.recorded()
    if not len(recorded.time):  # it ended in its first tick: there is no log to keep
        if run.interrupted:
            raise KeyboardInterrupt
        raise HexsimError(reason)
    step_error = run.check.error(run.done)
    log = figures_log(plant, recorded) if figures_only else run_log(plant, scenario, recorded, run.sensors)
    realtime = float(recorded.time[-1] / wall) if len(recorded.time) > 1 else 0.0
    warnings += ([reason] if reason else []) + cavitation_warnings(plant, run.tick_s, recorded.positions, recorded.act)
    warnings += step_warnings(step_error)
    each = slice(None, None, run.control_every)
    warnings += swing_warnings(machine, recorded.volts[each], recorded.setpoints[each])
    summary = run_summary(plant, scenario, name, log, recorded, realtime, warnings)
    summary["step_error"] = step_error
    summary |= {"compensation": loop.engagement()} if compensators else {}
    summary |= run.faults.summary() if run.faults else {}
    return Run(
        machine=machine,
        scenario=scenario,
        compensator=name,
        seed=seed,
        model=plant.model_kind,
        timestep=timestep,
        log=log,
        summary=summary,
        warnings=warnings,
        messages=messages,
        complete=not reason,
        interrupted=run.interrupted,
        reason=reason,
        realtime_factor=realtime,
        compensator_parameters=loop.learned(),
    )


def step_warnings(error: float | None, largest: float = 1.0e-3) -> list[str]:
    """What a run says of its time steps' error above the largest, relative to the peak in the 50 Hz band."""
    if error is None or error <= largest:
        return []
    return [
        f"time step: the acceleration in the 50 Hz band is off by about {100 * error:.2g} % of its peak, above "
        f"{100 * largest:g} %: compare with a smaller constant step (--timestep)"
    ]


def _address(function: Any) -> int:
    """Of a ctypes callback."""
    return ctypes.cast(function, ctypes.c_void_p).value or 0


class TickLoop:
    """The tick-by-tick run: buffers, and one pass through time."""

    def __init__(
        self, plant: Plant, loop: PositionLoop | MotionComputer, scenario: Scenario, seed: int, host: Host | None = None
    ) -> None:
        machine = plant.machine
        self.plant, self.loop = plant, loop
        rate = tick_rate_Hz(machine)
        self.tick_s = 1.0 / rate
        slower, faster = sorted((machine.sensors.log_rate_Hz, machine.controller.rate_Hz))
        whole_ratio(faster, slower, "log rate and control rate")
        self.control_every = round(rate / machine.controller.rate_Hz)
        self.log_every = round(rate / machine.sensors.log_rate_Hz)
        self.ticks = round(scenario.duration_s * rate)
        if self.ticks < 1:
            raise HexsimError(
                f"duration {scenario.duration_s:g} s is shorter than one sample of {self.tick_s:g} s: make it longer"
            )
        ahead = (
            np.arange(0, self.ticks + self.control_every * loop.preview, self.control_every, dtype=float) * self.tick_s
        )
        self.setpoints = setpoints(machine, scenario, machine.mechanics, ahead)
        if host is not None:
            self.setpoints = hosted_setpoints(machine, scenario, host, len(ahead) - loop.preview, loop.preview)
        self.sensors = SensorBank(plant.resolved, self.ticks, self.tick_s, seed)
        plant.prepare(rate, self.ticks)
        self.record = plant.record
        self.pressures = np.zeros((self.ticks, machine.n_legs))
        self.rod_sides = np.zeros((self.ticks if machine.cylinder.rod_side == "valve" else 0, machine.n_legs))
        self.compensation = np.zeros((self.ticks, machine.n_legs))
        self.faults: FaultRun | None = None
        self.check = StepCheck(plant)
        self.volts = np.zeros(machine.n_legs)
        self.done, self.interrupted, self._raised = 0, False, None

    @without_timers()
    def go(
        self,
        progress: Callable[[float], None],
        interventions: Sequence[Any],
        *,
        check_every_s: float = 0.1,  # simulated time between checks of MuJoCo's warnings
    ) -> str:
        """Run to the end; returns "" or why it ended early."""
        loop = None if interventions or not isinstance(self.loop, PositionLoop) else self._compiled_loop()
        if loop is not None:
            self.check.repeat = lambda context, record, volts: run_ticks(
                context, record, loop._replace(given=volts), 0, len(volts)
            )
        chunk = max(1, round(check_every_s / self.tick_s))
        try:
            for first in range(0, self.ticks, chunk):
                last = min(first + chunk, self.ticks)
                self.check.begin(first)
                if loop is not None:
                    self.done = run_ticks(self.plant.context, self.record, loop, first, last)
                    if self._raised is not None:
                        raise self._raised
                else:
                    self._ticks(first, last, interventions)
                self.plant.check()
                self.check.end(last)
                self.plant.follow_oil_temperature()
                progress(last / self.ticks)
        except InterventionError as error:
            return f"{error} (at t = {self.done * self.tick_s:.3f} s)"
        except PlantError as error:
            return self._diverged(str(error))
        except KeyboardInterrupt:
            self.interrupted = True
            return f"interrupted by the user at t = {self.done * self.tick_s:.3f} s"
        return ""

    def _diverged(self, what: str) -> str:
        """Cut the record where it stops being finite; says when, and in which leg it began."""
        record = self.record
        states = np.hstack([record.act[: self.done], record.qacc[: self.done], record.qpos[: self.done]])
        real = (np.abs(states) < 1e9).all(axis=1)  # [MPa, m/s2, m] beyond any machine; false for NaN too
        self.done = int(np.argmin(real)) if not real.all() else self.done - 1
        bottom = record.act[self.done][self.plant.pressure_places]
        # the leg whose pressure is not real, or else the one farthest from rest
        leg = int(
            np.argmax(np.where(np.isfinite(bottom), np.abs(bottom - record.act[0][self.plant.pressure_places]), np.inf))
        )
        return (
            f"the simulation diverged at t = {self.done * self.tick_s:.4f} s in leg {leg + 1} (MuJoCo: {what}): use a smaller time step, "
            "or a machine whose volumes and masses are not near zero"
        )

    def _sensed(self) -> list[str]:
        """The transducers that the controllers read."""
        if not self.loop.feels_load:
            return ["position"]
        return ["position", "pressure_bottom", *(["pressure_top"] if len(self.rod_sides) else [])]

    def _compiled_loop(self) -> PlainLoop:
        def transducer(stem: str) -> Transducer:
            found = self.sensors[stem]
            return Transducer(found.noise, found.gain, found.offset, found.resolution)

        sensed, plant, none = self._sensed(), self.plant, np.zeros(0, np.int64)
        asks = bool(self.loop.compensators) or not all(self.sensors[stem].is_direct for stem in sensed)
        self._asked, self._followed = (
            CONTROL(self._ask),
            CONTROL(self._follow),
        )  # kept as long as their addresses are used
        address, self._native = _address(self._asked) if asks else 0, None
        if isinstance(self.loop, PositionLoop) and self.loop.compensators:
            from hexsim.simulation.compensated_loop import CompensatedLoop

            self._native = CompensatedLoop(self, self.loop, _address(self._followed))
            address = self._native.address or address
        return PlainLoop(
            setpoints=self.setpoints,
            every=self.control_every,
            control=self.loop.control,
            memory=self.loop.memory,
            position=transducer("position"),
            bottom=transducer("pressure_bottom"),
            top=transducer(sensed[-1]),
            bottom_places=plant.pressure_places,
            top_places=plant.rod_side_places if "pressure_top" in sensed else none,
            asks=address,
            needs=self._native.record.ctypes.data if self._native else 0,
            volts=self.volts,
            added=self.loop.compensation,
            pressures=self.pressures,
            rod_sides=self.rod_sides,
            rod_side_places=plant.rod_side_places,
            compensation=self.compensation,
            given=np.zeros((0, len(self.volts))),
        )

    def _ask(self, needs: int, tick: int) -> int:
        """One control tick, for compiled code; not 0 where the run must end, with `_raised` as the reason."""
        return self._guarded(partial(self._control, tick))

    def _follow(self, needs: int, tick: int) -> int:
        """The same of what Python does beside a compiled control tick."""
        assert isinstance(self.loop, PositionLoop)
        return self._guarded(partial(self.loop.follow, tick * self.tick_s))

    def _guarded(self, task: Callable[[], None]) -> int:
        try:
            task()
        except BaseException as problem:  # KeyboardInterrupt too: nothing may pass through compiled code
            self._raised = problem
            return 1
        return 0

    def _ticks(self, first: int, last: int, interventions: Sequence[Any]) -> None:
        """Ticks with the motion computer and the interventions in Python."""
        for tick in range(first, last):
            self.plant.sense()
            self.pressures[tick] = self.plant.bottom_pressures()
            if len(self.rod_sides):
                self.rod_sides[tick] = self.plant.rod_side_pressures()
            if tick % self.control_every == 0:
                self._control(tick)
            self.compensation[tick] = self.loop.compensation
            self.plant.tick(self.loop.valve, partial(self._intervene, interventions) if interventions else None)
            self.done = tick + 1

    def _intervene(self, interventions: Sequence[Any], volts: Array) -> Array:
        """Volts (n_legs,) at the spools after all interventions of this tick."""
        for intervention in interventions:
            volts = intervention.before_step(self.done * self.tick_s, self.plant, volts)
        return volts

    def _control(self, tick: int) -> None:
        sensors = self.sensors
        step = tick // self.control_every
        ahead = self.setpoints[step : step + self.loop.preview]
        self.loop.tick(
            tick * self.tick_s,
            ahead if self.faults is None else self.faults.host_setpoints(tick * self.tick_s, ahead),  # type: ignore[arg-type]
            sensors.position(tick, self.record.positions),
            sensors.pressure(tick, self.pressures),
            sensors.supply(tick, self.plant.supply_pressure()),
            sensors.pressure_top(tick, self.rod_sides),
        )
        self.volts[:] = self.loop.valve
        self.setpoints[step] = self.loop.setpoint  # a motion computer that guides the machine has its own

    def recorded(self) -> Recorded:
        """What was recorded, at every tick."""
        done, record = slice(0, self.done), self.record
        return Recorded(
            time=np.arange(self.done, dtype=float) * self.tick_s,
            every=self.log_every,
            setpoints=np.repeat(self.setpoints, self.control_every, axis=0)[done],
            positions=record.positions[done],
            qpos=record.qpos[done],
            qvel=record.qvel[done],
            qacc=record.qacc[done],
            mean_acceleration=mean_acceleration(record, self.done, self.tick_s),
            act=record.act[done],
            timestep=self.tick_s / record.steps[done],
            volts=record.volts[done],
            spool_volts=record.spool_volts[done],
            compensation=self.compensation[done],
        )
