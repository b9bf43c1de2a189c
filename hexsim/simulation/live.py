# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""The machine live: hydraulics and position loop in steps of the control period, setpoints from sliders or a scenario.

The sliders are actuators without force that are added to the model behind the valves, so MuJoCo's own viewer shows them
in its control panel. Setpoints follow them with limited velocity and acceleration, within the strokes of the legs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hexsim.errors import HexsimError
from hexsim.hydraulics.effects.valve_delay import EFFECT as VALVE_DELAY
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve
from hexsim.hydraulics.resolved import Resolved
from hexsim.machine import Machine
from hexsim.mechanics.workspace import excursions
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.plant import Plant
from hexsim.plant.plant import whole_ratio
from hexsim.plant.states import lay_out_states
from hexsim.scenarios import Scenario
from hexsim.simulation.cavitation_watch import CavitationWatch
from hexsim.simulation.live_motion import LiveMotion
from hexsim.simulation.live_sensors import LiveSensors
from hexsim.simulation.simulation import make_compensators
from hexsim.simulation.stream import Stream, tick_row

Array = NDArray[np.float64]

TOP_LEFT = mujoco.mjtGridPos.mjGRID_TOPLEFT  # of the viewer's texts
PUSH_N = 981.0  # a person of 100 kg steps on it for a second
SLIDERS = {"x": ("surge_mm", 1e-3), "y": ("sway_mm", 1e-3), "z": ("heave_mm", 1e-3)} | {
    name: (f"{name}_deg", np.pi / 180.0) for name in ("roll", "pitch", "yaw")
}


@dataclass(kw_only=True)
class Follower:
    """A setpoint that follows a slider: x'' = w^2 (s - x) - 2 w x', |x'| limited. Arrays (n,)."""

    position: Array
    velocity: Array

    def towards(
        self,
        target: Array,
        dt: float,
        *,
        stiffness_rad_s: float = 8.0,  # rad/s of the critically damped filter behind it
        velocity_m_s: float = 0.15,  # m/s or rad/s, how fast setpoints follow a slider
    ) -> Array:
        """The next position, `dt` later."""
        w = stiffness_rad_s
        self.velocity += dt * (w * w * (target - self.position) - 2.0 * w * self.velocity)
        np.clip(self.velocity, -velocity_m_s, velocity_m_s, out=self.velocity)
        return self.position + dt * self.velocity


def add_floor_and_light(spec: Any, machine: Machine) -> None:
    """Floor, sky and light for a machine of any size, without contact."""
    mechanics = machine.mechanics
    size = mechanics.radius_m
    spec.stat.extent = 1.6 * size
    spec.stat.center = [0.0, 0.0, 0.6 * mechanics.longest_leg_m]
    spec.visual.headlight.diffuse, spec.visual.headlight.ambient = [0.5] * 3, [0.35] * 3
    sky = {"rgb1": [0.85, 0.90, 0.96], "rgb2": [0.55, 0.63, 0.72]}
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        width=256,
        height=1536,
        **sky,
    )
    spec.worldbody.add_light(name="sun", pos=[2 * size, -2 * size, 6 * size], dir=[-0.25, 0.25, -1.0], castshadow=True)
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[8 * size, 8 * size, 0.05], rgba=[0.74, 0.75, 0.77, 1.0],
        pos=[0.0, 0.0, -0.16 * size if mechanics.has_platform else 0.0], contype=0, conaffinity=0,
    )  # fmt: skip


def slider_limits(
    machine: Machine,
    *,
    slider_share: float = 0.9,  # of the excursion a degree of freedom has alone
) -> list[float]:
    """How far each slider goes, m or rad."""
    return [slider_share * min(-e.minimum, e.maximum) for e in excursions(machine.mechanics)]


def add_sliders(spec: Any, machine: Machine) -> None:
    """One actuator without force a degree of freedom, behind those of the plant."""
    for dof, limit in zip(machine.mechanics.dofs, slider_limits(machine), strict=True):
        name, unit = SLIDERS[dof]
        spec.add_actuator(
            name=name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target="slide_1",
            gainprm=np.zeros(10),
            biasprm=np.zeros(10),
            ctrllimited=True,
            ctrlrange=[-limit / unit, limit / unit],
        )


class LiveMachine:
    """A plant with its position loop, advanced tick by tick.

    scenario: motion that the sliders add to; None for the sliders alone. observe: called after every step of the log's
    rate, as in a run, for those who write down what the plant does. stream: takes the signals of every control tick.
    """

    def __init__(
        self,
        machine: Machine,
        scenario: Scenario | None = None,
        compensator: str = "none",
        seed: int = 0,
        observe: Callable[[LiveMachine], None] | None = None,
        stream: Stream | None = None,
        *,
        longest_delay_s: float = 0.02,  # of the valve, that can be set in flight
        n_kept: int = 1000,  # messages, the last ones
    ) -> None:
        self.machine, self.motion, self.observe = machine, LiveMotion(checked(scenario)), observe
        self.stream = stream
        self.kinematics = machine.mechanics
        self.dofs = self.kinematics.dofs

        def add_scene(spec: Any) -> None:
            add_floor_and_light(spec, machine)
            add_sliders(spec, machine)

        longest = (VALVE_DELAY, tuple(range(machine.n_legs)), {"delay_s": longest_delay_s})
        self.plant = Plant(machine, model="full", furnish=add_scene, later=[longest])
        self.sliders = slice(self.plant.model.nu - len(self.dofs), self.plant.model.nu)
        self.messages: deque[tuple[float, int, str]] = deque(maxlen=n_kept)
        self.use_compensator(compensator)
        self.tick_s = 1.0 / machine.controller.rate_Hz
        rate = max(machine.sensors.log_rate_Hz, machine.controller.rate_Hz)
        self.steps_a_tick = whole_ratio(rate, machine.controller.rate_Hz, "log rate and control rate")
        self.plant.prepare(rate)
        self.cavitation = CavitationWatch(self.plant)
        self.sensors = LiveSensors(self.plant, self.tick_s, seed)
        margin = machine.of_legs("cylinder", "cushion_length_m")
        self.reach = margin, machine.of_legs("cylinder", "stroke_m") - margin
        self.disturbance = np.zeros(6)  # force and torque on the platform, from the mouse
        self.body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, self.kinematics.moving_body)
        self.paused, self.out_of_reach = False, False
        self.tick = 0
        self._push_until_s = -1.0
        self.reset()

    @property
    def model(self) -> Any:
        return self.plant.model

    @property
    def data(self) -> Any:
        return self.plant.data

    @property
    def time_s(self) -> float:
        return float(self.data.time)

    def reset(self) -> None:
        """Neutral, at rest, sliders in the middle."""
        self.plant.reset()
        self.cavitation.end()
        self.sensors.restart()
        self.follower = Follower(position=np.zeros(len(self.dofs)), velocity=np.zeros(len(self.dofs)))
        self.tick, self._push_until_s = 0, -1.0
        self.motion.restart()
        self.loop.restart()

    def use_compensator(self, name: str) -> None:
        """Another compensator, which begins to learn; the same one forgets what it has learned."""
        self.compensator, compensators = make_compensators(name, self.machine)
        scenario = self.motion.scenario
        self.loop = PositionLoop(
            self.machine,
            compensators,
            scenario.period_s if scenario else None,
            lambda *message: self.messages.append(message),
        )

    def use_scenario(self, scenario: Scenario | None) -> None:
        """Another motion, from now on; a compensator that was told the period begins anew with another one."""
        period = self.motion.scenario.period_s if self.motion.scenario else None
        self.motion.exchange(checked(scenario), self.time_s)
        if self.loop.compensators and (scenario.period_s if scenario else None) != period:
            self.use_compensator(self.compensator)

    def become(self, machine: Machine) -> bool:
        """Take over another machine's valves, friction and effects in flight; False, and nothing done, where more differs."""
        plant, wanted, present = self.plant, resolve(machine), resolve(self.machine)
        if not (same_beside_hydraulics(machine, self.machine) and same_beside_rows(wanted, present)):
            return False
        if wanted.rows[:, P.VALVE_DELAY].max() > plant.longest_delay_s:
            return False
        for leg, place in np.argwhere(wanted.rows != present.rows):
            plant.change_row(int(leg), int(place), float(wanted.rows[leg, place]))
        plant.context.hysteresis[:] = plant.rows[:, P.HYSTERESIS]
        plant.context.spread[:] = plant.rows[:, P.HYSTERESIS_SPREAD]
        plant.follow_delay()
        self.machine = machine
        return True

    def push(
        self,
        *,
        push_s: float = 1.0,  # as long as a person takes to step on it
    ) -> None:
        """Put 100 kg on the platform for a second."""
        self._push_until_s = self.time_s + push_s

    def pull(self, perturb: Any) -> None:
        """Take the force of the mouse on the platform from the viewer; none where the mouse pulls at another body."""
        self.disturbance[:] = 0.0
        if perturb.active and perturb.select == self.body:
            before = self.data.xfrc_applied.copy()
            mujoco.mjv_applyPerturbForce(self.model, self.data, perturb)
            self.disturbance[:] = self.data.xfrc_applied[self.body]
            self.data.xfrc_applied[:] = before

    def slider_values(self) -> Array:
        """Setpoints of the sliders, m and rad (n_dofs,)."""
        units = np.array([SLIDERS[dof][1] for dof in self.dofs])
        return self.data.ctrl[self.sliders] * units

    def poses(self, count: int) -> Array:
        """Reference poses (count, 6) of this tick and the next ones: the scenario's plus the sliders'."""
        poses = np.zeros((count, 6))
        poses[:, self.kinematics.dof_places] = self.follower.position
        return poses + self.motion.poses(self.tick_s * (self.tick + np.arange(count, dtype=float)))

    def setpoints(self, poses: Array) -> Array:
        """Piston setpoints (count, n_legs) [m]; outside the strokes where a pose is out of reach."""
        return self.kinematics.piston_positions(poses)

    def advance(self, duration_s: float) -> None:
        """Whole control ticks worth `duration_s`; nothing while paused. Raises HexsimError where the plant diverges."""
        if self.paused:
            return
        for _ in range(max(1, round(duration_s / self.tick_s))):
            self._tick()
        self.plant.check()
        self.plant.follow_oil_temperature()

    def _tick(self) -> None:
        before = self.follower.position.copy()
        self.follower.position = self.follower.towards(self.slider_values(), self.tick_s)
        setpoints = self.setpoints(self.poses(self.loop.preview))
        low, high = self.reach
        self.out_of_reach = bool(np.any((setpoints < low) | (setpoints > high)))
        if self.out_of_reach:  # stop at the limit
            self.follower.position, self.follower.velocity = before, np.zeros_like(before)
            setpoints = np.clip(self.setpoints(self.poses(self.loop.preview)), low, high)
        readings = self.sensors.read(self.tick)
        volts = self.loop.tick(self.time_s, setpoints, *readings)
        applied = self.data.xfrc_applied[self.body]
        applied[:] = self.disturbance
        applied[2] -= PUSH_N if self.time_s < self._push_until_s else 0.0
        for _ in range(self.steps_a_tick):
            self.plant.tick(volts)
            self.cavitation.note(self.tick_s / self.steps_a_tick)
            if self.observe is not None:
                self.observe(self)
        if self.stream:
            self.stream.row(self.time_s, tick_row(self.plant, self.loop, volts, readings))
        self.tick += 1


def checked(scenario: Scenario | None) -> Scenario | None:
    """HexsimError for a scenario that drives single actuators."""
    if scenario is not None and scenario.mode != "dof":
        raise HexsimError(f"scenario {scenario.name} drives single actuators: live takes scenarios in mode 'dof'")
    return scenario


def same_beside_hydraulics(wanted: Machine, present: Machine) -> bool:
    """Whether two machine files differ in valves, friction and effects alone; warm oil scales its rows as it runs."""
    apart = {"valve", "friction", "effects", "uncertainty"}
    return wanted.power_unit is None and wanted.model_dump(exclude=apart) == present.model_dump(exclude=apart)


def same_beside_rows(wanted: Resolved, present: Resolved) -> bool:
    """Whether effects differ in the legs' rows alone, and leave the states where they are."""

    def equal(name: str, a: Any, b: Any) -> bool:
        if name == "leg_sensors":
            return all(np.array_equal(a[key], b[key]) for key in a)
        if name == "mechanics":
            return all(np.array_equal(getattr(a, item.name), getattr(b, item.name)) for item in fields(a))
        return bool(np.all(a == b)) if isinstance(a, np.ndarray) else a == b

    names = [item.name for item in fields(Resolved) if item.name not in ("machine", "rows")]
    return all(equal(name, getattr(wanted, name), getattr(present, name)) for name in names) and np.array_equal(
        lay_out_states(wanted), lay_out_states(present)
    )
