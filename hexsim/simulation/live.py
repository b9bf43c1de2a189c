# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""The machine live: hydraulics and position loop in steps of the control period, setpoints from sliders or a scenario.

The sliders are actuators without force that are added to the model behind the valves, so MuJoCo's own viewer shows them
in its control panel. Setpoints follow them with limited velocity and acceleration, within the strokes of the legs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hexsim.errors import HexsimError
from hexsim.machine import Machine
from hexsim.mechanics.workspace import excursions
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.plant import Plant
from hexsim.scenarios import Scenario
from hexsim.simulation.live_sensors import LiveSensors
from hexsim.simulation.simulation import make_compensators

Array = NDArray[np.float64]

TOP_LEFT = mujoco.mjtGridPos.mjGRID_TOPLEFT  # of the viewer's texts
SLIDER_SHARE = 0.9  # of the excursion a degree of freedom has alone
SLIDER_VELOCITY = 0.15  # m/s or rad/s, how fast setpoints follow a slider
SLIDER_STIFFNESS = 8.0  # rad/s of the critically damped filter behind it
PUSH_N, PUSH_S = 981.0, 1.0  # a person of 100 kg steps on it for a second
SLIDERS = {"x": ("surge_mm", 1e-3), "y": ("sway_mm", 1e-3), "z": ("heave_mm", 1e-3)} | {
    name: (f"{name}_deg", np.pi / 180.0) for name in ("roll", "pitch", "yaw")
}


@dataclass(kw_only=True)
class Follower:
    """A setpoint that follows a slider: x'' = w^2 (s - x) - 2 w x', |x'| limited. Arrays (n,)."""

    position: Array
    velocity: Array

    def towards(self, target: Array, dt: float) -> Array:
        """The next position, `dt` later."""
        w = SLIDER_STIFFNESS
        self.velocity += dt * (w * w * (target - self.position) - 2.0 * w * self.velocity)
        np.clip(self.velocity, -SLIDER_VELOCITY, SLIDER_VELOCITY, out=self.velocity)
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
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        width=256, height=1536, **sky,
    )  # fmt: skip
    spec.worldbody.add_light(name="sun", pos=[2 * size, -2 * size, 6 * size], dir=[-0.25, 0.25, -1.0], castshadow=True)
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[8 * size, 8 * size, 0.05], rgba=[0.74, 0.75, 0.77, 1.0],
        pos=[0.0, 0.0, -0.16 * size if mechanics.has_platform else 0.0], contype=0, conaffinity=0,
    )  # fmt: skip


def slider_limits(machine: Machine) -> list[float]:
    """How far each slider goes, m or rad."""
    return [SLIDER_SHARE * min(-e.minimum, e.maximum) for e in excursions(machine.mechanics)]


def add_sliders(spec: Any, machine: Machine) -> None:
    """One actuator without force a degree of freedom, behind those of the plant."""
    for dof, limit in zip(machine.mechanics.dofs, slider_limits(machine), strict=True):
        name, unit = SLIDERS[dof]
        spec.add_actuator(
            name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target="slide_1",
            gainprm=np.zeros(10), biasprm=np.zeros(10), ctrllimited=True, ctrlrange=[-limit / unit, limit / unit],
        )  # fmt: skip


class LiveMachine:
    """A plant with its position loop, advanced tick by tick.

    scenario: motion that the sliders add to; None for the sliders alone.
    """

    def __init__(
        self, machine: Machine, scenario: Scenario | None = None, compensator: str = "none", seed: int = 0
    ) -> None:
        if scenario is not None and scenario.mode != "dof":
            raise HexsimError(f"scenario {scenario.name} drives single actuators: live takes scenarios in mode 'dof'")
        self.machine, self.scenario = machine, scenario
        self.kinematics = machine.mechanics
        self.dofs = self.kinematics.dofs

        def add_scene(spec: Any) -> None:
            add_floor_and_light(spec, machine)
            add_sliders(spec, machine)

        self.plant = Plant(machine, model="full", furnish=add_scene)
        self.sliders = slice(self.plant.model.nu - len(self.dofs), self.plant.model.nu)
        self.name, compensators = make_compensators(compensator, machine)
        self.messages: list[tuple[float, int, str]] = []
        self.loop = PositionLoop(
            machine,
            compensators,
            scenario.period_s if scenario else None,
            lambda *message: self.messages.append(message),
        )
        self.tick_s = 1.0 / machine.controller.rate_Hz
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
        self.sensors.restart()
        self.follower = Follower(position=np.zeros(len(self.dofs)), velocity=np.zeros(len(self.dofs)))
        self.tick, self._push_until_s = 0, -1.0

    def push(self) -> None:
        """Put 100 kg on the platform for a second."""
        self._push_until_s = self.time_s + PUSH_S

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
        if self.scenario is not None:
            times = self.time_s + self.tick_s * np.arange(count)
            poses += self.scenario.evaluate(times % self.scenario.duration_s)[0]
        return poses

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
        volts = self.loop.tick(self.time_s, setpoints, *self.sensors.read(self.tick))
        applied = self.data.xfrc_applied[self.body]
        applied[:] = self.disturbance
        applied[2] -= PUSH_N if self.time_s < self._push_until_s else 0.0
        self.plant.tick(volts)
        self.tick += 1
