"""One machine as an environment of Gymnasium; each episode draws a machine and a motion anew."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.gym.task import N_SEEN, SEEN, Episodes, Task, options_of, task_of
from hexsim.plant import Plant
from hexsim.plant.mjcf import ModelKind
from hexsim.plant.plant import PlantError
from hexsim.plant.readout import leg_motion
from hexsim.scenarios import Scenario


class HexsimEnv(gymnasium.Env):
    """Observation (n_legs 8,), action (n_legs,) in [-1, 1], both float32; one step is a tick of the motion computer.

    machine: name or declaration, in place of the task's; other fields of the task by keyword. model: tendon or full legs.
    timestep [s]: constant; None: chosen. The episode ends at its duration (truncated) or where the machine leaves what is
    real (terminated). info: deviation_m_s2 (n_legs,) in the band; action_cut, whether
    an action beyond [-1, 1] was cut there; machine, the drawn one, at the start. Actions that are not finite raise HexsimError.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (Gymnasium's own form)

    def __init__(
        self,
        task: Task | None = None,
        *,
        machine: str | Machine | None = None,
        model: ModelKind = "tendon",
        timestep: float | None = None,
        **changes: Any,
    ) -> None:
        self.task, self.timestep = task_of(task, machine, **changes), timestep
        self.model: ModelKind = model
        self.episodes = Episodes(self.task, 1)
        n_legs = self.task.machine.n_legs
        self.observation_space = gymnasium.spaces.Box(-SEEN.largest, SEEN.largest, (n_legs * N_SEEN,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (n_legs,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """options: motion, a Scenario in place of a drawn one; machine, a Machine in place of a drawn one, with the legs and
        the control rate of the task's. Raises HexsimError for others."""
        given = options_of(options, self.task, motion=Scenario, machine=Machine)
        super().reset(seed=seed)
        drawn, motion = self.task.drawn_machine(self.np_random), self.task.drawn_motion(self.np_random)
        machine = given.get("machine", drawn)
        setpoints = self.task.setpoints(given.get("motion", motion))
        self.plant = Plant(machine, model=self.model, timestep=self.timestep)
        self.plant.prepare(1 / self.task.tick_s)
        which = np.array([0])
        self.episodes.begin(which, setpoints[:, :, None], *self._legs(), self._pressure())
        return self.episodes.observations(self._pressure())[0], {"machine": machine}

    def step(self, action):
        if not hasattr(self, "plant"):
            raise HexsimError("reset the environment before its first step")
        failed = False
        self.plant.tick(self.episodes.volts(np.asarray(action)[None])[0])
        try:
            self.plant.check()
        except PlantError:
            failed = True
        reward = self.episodes.advance(*self._legs())
        observation = np.nan_to_num(self.episodes.observations(self._pressure())[0])
        info = {"deviation_m_s2": self.episodes.deviation[0].copy(), "action_cut": bool(self.episodes.is_cut.any())}
        return observation, float(np.nan_to_num(reward[0])), failed, bool(self.episodes.is_over[0]), info

    def _legs(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities (1, n_legs)."""
        return legs_of(self.plant, self.plant.data.qpos[None], self.plant.data.qvel[None])

    def _pressure(self) -> np.ndarray:
        return self.plant.bottom_pressures()[None]


def legs_of(plant: Plant, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Piston positions and velocities (n, n_legs) of states (n, ...)."""
    position, velocity = leg_motion(plant, qpos, qvel)
    return np.array(position), np.array(velocity)
