# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""Many machines at once on threads: each has its own numbers in `actuator_user`, masses and states.

Hexapods of the tendon model run in `plant.batch`, others on MuJoCo's thread pool, whose callbacks the compiled hydraulics
are; either way without Python. Steps are constant here, so the shortest one that any machine asks for near standstill counts.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from mujoco.batch import Batch

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.gym.environment import legs_of
from hexsim.gym.task import N_SEEN, SEEN, Episodes, Task, options_of, task_of
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.steps import STEP
from hexsim.hydraulics.valve import delay_in_ticks
from hexsim.plant import Plant
from hexsim.plant.batch import PlatformBatch
from hexsim.plant.callbacks import pressures_of
from hexsim.plant.mjcf import ModelKind


class HexsimVectorEnv(gymnasium.vector.VectorEnv):
    """`HexsimEnv` n times. Machines are drawn once, at the first reset; motions at each reset.

    threads: 0 = all processors. timestep [s]: constant; None: that of the sharpest machine. An episode
    that ends is begun anew in the same step (autoreset mode SAME_STEP).
    """

    metadata = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}  # noqa: RUF012 (Gymnasium's own form)

    def __init__(
        self,
        num_envs: int,
        task: Task | None = None,
        *,
        machine: str | Machine | None = None,
        threads: int = 0,
        model: ModelKind = "tendon",
        timestep: float | None = None,
        **changes: Any,
    ) -> None:
        self.num_envs, self.task = num_envs, task_of(task, machine, **changes)
        self.threads, self.timestep = threads, timestep
        self.model: ModelKind = model
        self.episodes = Episodes(self.task, num_envs)
        box, n_legs = gymnasium.spaces.Box, self.task.machine.n_legs
        self.single_observation_space = box(-SEEN.largest, SEEN.largest, (n_legs * N_SEEN,), np.float32)
        self.single_action_space = box(-1.0, 1.0, (n_legs,), np.float32)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self.machines: list[Machine] = []

    def _build(self) -> None:
        """Draw the machines and put them side by side."""
        self.machines = [self.task.drawn_machine(self.np_random) for _ in range(self.num_envs)]
        first = Plant(self.machines[0], model=self.model)
        plants = [first, *(Plant(machine, model=self.model) for machine in self.machines[1:])]
        sharpest = max(max(plant.step_rule().standstill, plant.step_rule().steady) for plant in plants)
        if not sharpest * STEP.shortest_s < 1.0:
            raise HexsimError("one of the drawn machines asks for steps below 10 us: narrow the ranges")
        step = self.timestep or self.task.tick_s / np.ceil(sharpest * self.task.tick_s)
        self.substeps = round(self.task.tick_s / step)
        if any(not np.array_equal(plant.layout, first.layout) for plant in plants):
            raise HexsimError("the drawn machines have other states each: leave out effects that add states at 0")
        for plant in plants:
            plant.model.opt.timestep = self.task.tick_s / self.substeps
        self.plant, self.models = first, [plant.model for plant in plants]
        self.starts = {
            name: np.stack([getattr(plant.data, name) for plant in plants]) for name in ("qpos", "qvel", "act", "ctrl")
        }
        self.hysteresis, spread = (
            np.stack([plant.rows[:, p] for plant in plants]) for p in (P.HYSTERESIS, P.HYSTERESIS_SPREAD)
        )
        self.threshold = np.maximum(self.hysteresis - spread, 0.0)
        delays = [delay_in_ticks(plant.rows[:, P.VALVE_DELAY], self.task.tick_s) for plant in plants]
        self.delay = np.stack([whole for whole, _ in delays])
        self.part = np.stack([rest for _, rest in delays]) / self.task.tick_s  # of a tick
        self.past = np.zeros((int(self.delay.max()) + 2, self.num_envs, first.n_legs))
        self.spool_volts, self.apart = np.zeros((2, self.num_envs, first.n_legs))
        if first.is_one_body:
            self.batch: Any = PlatformBatch(self.models, self.threads)
        else:
            self.batch = Batch(first.model, self.num_envs, self.threads)
            self.batch.set_models(self.models)
        self.state = {name: self.batch.bind(name) for name in ("qpos", "qvel", "act", "ctrl", "time")}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        options_of(options, self.task)
        super().reset(seed=seed)
        if seed is not None:
            self._np_random = np.random.default_rng(seed)
        if not self.machines or seed is not None:
            self._build()
        self._begin(np.arange(self.num_envs))
        return self.episodes.observations(self._pressure()), {}

    def _begin(self, which: np.ndarray) -> None:
        """Episodes `which` from rest, with motions drawn anew."""
        for name, values in self.starts.items():
            self.state[name][which] = values[which]
        self.state["time"][which] = 0.0
        self.spool_volts[which], self.apart[which], self.past[:, which] = 0.0, 0.0, 0.0
        setpoints = np.stack([self.task.setpoints(self.task.drawn_motion(self.np_random)) for _ in which], axis=2)
        position, velocity = self._legs()
        pressure = self._pressure()[which]
        self.episodes.begin(which, setpoints, position[which], velocity[which], pressure)

    def step(self, actions):
        """Next observations, rewards, terminations, truncations (n, ...), and infos."""
        episodes, n_legs = self.episodes, self.plant.n_legs
        command = self._delayed(episodes.volts(actions))
        narrow, wide = self.threshold, 2.0 * self.hysteresis - self.threshold  # as `valve.hysteresis`
        quick = np.clip(self.spool_volts - 0.5 * self.apart, command - narrow, command + narrow)
        slow = np.clip(self.spool_volts + 0.5 * self.apart, command - wide, command + wide)
        self.spool_volts, self.apart = 0.5 * (quick + slow), slow - quick
        self.state["ctrl"][:, :n_legs] = self.spool_volts
        self.batch.step(nstep=self.substeps)
        rewards = episodes.advance(*self._legs())
        failed = ~np.isfinite(self.state["act"]).all(axis=1) | ~np.isfinite(rewards)
        seen = episodes.observations(self._pressure())
        if failed.any():  # of others every number is finite
            seen, rewards = np.nan_to_num(seen), np.nan_to_num(rewards)
        infos: dict[str, Any] = {"deviation_m_s2": episodes.deviation.copy(), "action_cut": episodes.is_cut.copy()}
        over = episodes.is_over
        if (ended := over | failed).any():
            infos |= {"final_obs": seen.copy(), "_final_obs": ended.copy()}
            self._begin(np.flatnonzero(ended))
            seen[ended] = episodes.observations(self._pressure())[ended]
        return seen, rewards, failed, over, infos

    def _delayed(self, volts: np.ndarray) -> np.ndarray:
        """Volts of so many ticks ago as each valve is late; before the first tick those of the first.

        MuJoCo steps a batch with constant controls: of a delay that ends within a tick, the tick's mean.
        """
        step, size = self.episodes.step, len(self.past)
        every = np.arange(self.num_envs)
        fresh = step == 0
        self.past[:, fresh] = volts[fresh]
        self.past[step % size, every] = volts
        legs, now = np.arange(volts.shape[1]), step[:, None] - self.delay
        late, later = (self.past[k % size, every[:, None], legs] for k in (now, now - 1))
        return late + self.part * (later - late)

    def _legs(self) -> tuple[np.ndarray, np.ndarray]:
        return legs_of(self.plant, self.state["qpos"], self.state["qvel"])

    def _pressure(self) -> np.ndarray:
        return pressures_of(self.state["act"][:, self.plant.pressure_places])
