"""What is to be learned: a machine with its spread, a motion to follow, what the learner sees, does and is paid for.

    action a in [-1, 1] a leg (cut there; NaN and inf are refused):
                                 u = sat(Kp (r - y) + authority a)   compensator
                                 u = sat(voltage_max a)              controller
    observation a leg:  e/e0, v_r/v0 now and 10 and 20 ms ahead, a_r/a0, (y_k - y_(k-1))/(T v0), (P1 - P1 at rest)/Ps, last action
    reward:  -(d/d0)^2, mean of the legs, d = the leg's acceleration less the commanded one in the band of 4 to 50 Hz

d is what a run's smoothness figures look for, by a causal filter: second order at either end. Kp is the declared gain alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.errors import HexsimError, shortened
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import Scenario
from hexsim.setpoints.signal import faded
from hexsim.setpoints.signals import Sine

Array = NDArray[np.float64]
SECTIONS = ("valve", "friction", "load", "oil", "cylinder", "supply")


class Seen(NamedTuple):
    """Scales of what a policy sees and is rewarded for."""

    # of the velocities that are shown: now, and what a valve of 60 Hz takes to answer
    ahead_s: tuple[float, float, float] = (0.0, 0.01, 0.02)
    error_m: float = 1e-3  # what counts as 1
    velocity_m_s: float = 0.1  # likewise
    acceleration_m_s2: float = 0.5  # likewise
    deviation_m_s2: float = 0.2  # likewise
    band_Hz: tuple[float, float] = (4.0, 50.0)  # above the motions, whose lag is no jolt
    largest: float = 10.0  # of a number in an observation


SEEN = Seen()

N_SEEN = 5 + len(SEEN.ahead_s)  # numbers a leg in an observation: `Episodes.observations`


@dataclass(frozen=True, kw_only=True)
class Task:
    """machine: as declared. role: "compensator" adds to proportional control, "controller" has the valve alone.

    authority_V: largest volts of a compensator. effects: key of an effect -> (low, high), uniform, as
    "effects.null_offset.offset_V". spread: of [uncertainty] in the machine's file, 1 = as declared there, 0 = none.
    amplitude_m, frequency_Hz: ranges of the sine in heave or along the leg. duration_s: of an episode.
    Raises HexsimError for a range that is none.
    """

    machine: Machine = field(default_factory=lambda: load_machine("bench"))
    role: str = "compensator"
    authority_V: float = 1.0
    effects: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    spread: float = 1.0
    amplitude_m: tuple[float, float] = (0.02, 0.05)
    frequency_Hz: tuple[float, float] = (0.2, 0.6)
    duration_s: float = 6.0

    def __post_init__(self) -> None:
        if self.role not in ("compensator", "controller"):
            raise HexsimError(f"role {self.role!r}: compensator or controller")
        for name, (low, high) in {
            "amplitude_m": self.amplitude_m,
            "frequency_Hz": self.frequency_Hz,
            **self.effects,
        }.items():
            if not low <= high:
                raise HexsimError(f"{name} = ({low:g}, {high:g}): the first must not be above the second")

    @property
    def tick_s(self) -> float:
        return 1.0 / self.machine.controller.rate_Hz

    @property
    def ticks(self) -> int:
        return round(self.duration_s / self.tick_s)

    def drawn_machine(self, random: np.random.Generator) -> Machine:
        """The machine with its uncertain values and its effects drawn."""
        changes = {}
        for name, half_width in self.machine.uncertainty.items() if self.spread else ():
            key, value = uncertain_key(self.machine, name)
            changes[key] = value * (1.0 + self.spread * half_width * random.uniform(-1.0, 1.0))
        changes |= {key: random.uniform(low, high) for key, (low, high) in self.effects.items()}
        return changed(self.machine, changes, source="a drawn machine")

    def drawn_motion(
        self,
        random: np.random.Generator,
        *,
        fade_s: float = 1.0,  # from rest into the motion
    ) -> Scenario:
        """A sine of drawn size and frequency, up or down first."""
        size = random.uniform(*self.amplitude_m) * random.choice((-1.0, 1.0))
        wave = Sine(amplitude=size, frequency_Hz=random.uniform(*self.frequency_Hz))
        wave = faded(wave, fade_s, "smooth")  # without a kink, which nobody can follow
        return Scenario(name="task", mode="dof", signals={"z": wave}, duration_s=self.duration_s, fade_s=0.0)

    def setpoints(self, motion: Scenario) -> Array:
        """Piston setpoint, velocity and acceleration (3, ticks + preview, n_legs), SI."""
        mechanics, ahead = self.machine.mechanics, self.preview_ticks
        time = np.arange(self.ticks + ahead + 2) * self.tick_s
        position = mechanics.piston_positions(motion.evaluate(time)[0])
        velocity = np.gradient(position, self.tick_s, axis=0)
        return np.stack([position, velocity, np.gradient(velocity, self.tick_s, axis=0)])

    @property
    def preview_ticks(self) -> int:
        return round(SEEN.ahead_s[-1] / self.tick_s)


def uncertain_key(machine: Machine, name: str) -> tuple[str, float]:
    """Dotted key and value of a name in [uncertainty]: viscous_extend_N_s_m, supply_pressure_Pa."""
    for section in SECTIONS:
        for key in (name, name.removeprefix(f"{section}_")):
            value = getattr(getattr(machine, section), key, None)
            if isinstance(value, float):
                return f"{section}.{key}", value
    raise HexsimError(f"[uncertainty] {name} is no value of machine {machine.name}")


class Episodes:
    """The course of n episodes, (n, n_legs) a scipy.signal: what is seen, what reaches the valves, what is paid."""

    def __init__(self, task: Task, n: int) -> None:
        self.task, self.n, self.n_legs = task, n, task.machine.n_legs
        self.gain = np.array([leg.controller.gain_V_per_m for leg in task.machine.legs])
        self.limit = np.array([leg.valve.voltage_max_V for leg in task.machine.legs])
        ends: list[Any] = [
            scipy.signal.butter(2, corner, kind, fs=1 / task.tick_s, output="sos")
            for corner, kind in zip(SEEN.band_Hz, ("highpass", "lowpass"), strict=True)
        ]
        self.filter = np.vstack(ends)
        shape = (n, self.n_legs)
        self.references = np.zeros((3, task.ticks + task.preview_ticks + 2, *shape))
        self.step = np.zeros(n, dtype=np.int64)
        self.memory = np.zeros((len(self.filter), 2, *shape))
        self.position, self.before, self.velocity, self.action, self.rest = (np.zeros(shape) for _ in range(5))
        self.deviation = np.zeros(shape)
        self.is_cut = np.zeros(n, dtype=bool)

    def begin(
        self, which: NDArray[np.intp], setpoints: Array, position: Array, velocity: Array, pressure: Array
    ) -> None:
        """Start episodes `which` (k,): setpoints (3, ticks, k, n_legs), the rest (k, n_legs)."""
        self.references[:, :, which] = setpoints
        self.step[which], self.memory[:, :, which] = 0, 0.0
        self.position[which] = self.before[which] = position
        self.velocity[which], self.rest[which], self.action[which] = velocity, pressure, 0.0

    def reference(self, kind: int, ahead: int = 0) -> Array:
        return self.references[kind, self.step + ahead, np.arange(self.n)]

    def volts(self, actions: Array) -> Array:
        """Commanded volts (n, n_legs) of actions (n, n_legs). Finite ones beyond +-1, the action space, are cut there.

        Raises HexsimError for others, and for another shape.
        """
        try:
            given = np.asarray(actions, dtype=float)
        except (TypeError, ValueError):
            raise HexsimError(f"an action is {shortened(repr(actions))}: numbers in [-1, 1] are needed") from None
        if given.shape != (self.n, self.n_legs):
            raise HexsimError(f"actions have the shape {given.shape[1:]}: one number a leg is needed, ({self.n_legs},)")
        if not np.isfinite(given).all():
            where, leg = np.argwhere(~np.isfinite(given))[0]
            which = f"environment {where}, leg {leg + 1}" if self.n > 1 else f"leg {leg + 1}"
            raise HexsimError(f"the action of {which} is {given[where, leg]}: finite numbers are needed")
        self.is_cut = (np.abs(given) > 1.0).any(axis=1)
        self.action = np.clip(given, -1.0, 1.0)
        if self.task.role == "controller":
            return self.limit * self.action
        volts = self.gain * (self.reference(0) - self.position) + self.task.authority_V * self.action
        return np.clip(volts, -self.limit, self.limit)

    def advance(
        self,
        position: Array,
        velocity: Array,
        *,
        worst: float = 100.0,  # of a reward, negative
    ) -> Array:
        """After a tick: rewards (n,) of what the legs did in it."""
        acceleration = (velocity - self.velocity) / self.task.tick_s
        self.deviation = self._banded(acceleration - self.reference(2))
        self.before, self.position, self.velocity = self.position, position, velocity
        self.step += 1
        return -np.minimum(np.mean((self.deviation / SEEN.deviation_m_s2) ** 2, axis=1), worst)

    def _banded(self, values: Array) -> Array:
        """One sample through the filter's sections (direct form II transposed)."""
        for (b0, b1, b2, _, a1, a2), memory in zip(self.filter, self.memory, strict=True):
            out = b0 * values + memory[0]
            memory[0], memory[1] = b1 * values - a1 * out + memory[1], b2 * values - a2 * out
            values = out
        return values

    def observations(self, pressure: Array) -> NDArray[np.float32]:
        """(n, n_legs N_SEEN), float32, cut at +-largest."""
        ahead = [round(seconds / self.task.tick_s) for seconds in SEEN.ahead_s]
        seen = [
            (self.reference(0) - self.position) / SEEN.error_m,
            *(self.reference(1, ticks) / SEEN.velocity_m_s for ticks in ahead),
            self.reference(2) / SEEN.acceleration_m_s2,
            (self.position - self.before) / (self.task.tick_s * SEEN.velocity_m_s),
            (pressure - self.rest) / self.task.machine.supply.pressure_Pa,
            self.action,
        ]
        return np.clip(np.stack(seen, axis=-1).reshape(self.n, -1), -SEEN.largest, SEEN.largest).astype(np.float32)

    @property
    def is_over(self) -> NDArray[np.bool_]:
        return self.step >= self.task.ticks


def options_of(options: Mapping[str, Any] | None, task: Task, **kinds: type) -> dict[str, Any]:
    """The options of a reset, checked: names and types as `kinds`, a machine that fits the task.

    Raises HexsimError for others.
    """
    given = dict(options or {})
    for name, value in given.items():
        if name not in kinds:
            known = f"there are {', '.join(kinds)}" if kinds else "it has none"
            raise HexsimError(f"reset has no option {shortened(repr(name))}: {known}")
        if not isinstance(value, kinds[name]):
            raise HexsimError(f"option {name} of reset is a {type(value).__name__}: give a {kinds[name].__name__}")
    machine = given.get("machine")
    for what, of in (("legs", lambda m: m.n_legs), ("Hz of control", lambda m: m.controller.rate_Hz)):
        if machine is not None and of(machine) != of(task.machine):
            raise HexsimError(
                f"option machine of reset: {machine.name} has {of(machine):g} {what}, the task's machine {of(task.machine):g}"
            )
    return given


def task_of(task: Task | None, machine: str | Machine | None, **changes: object) -> Task:
    """A task, with a machine by name or declaration and other fields changed."""
    made = task or Task()
    if machine is not None:
        made = replace(made, machine=load_machine(machine) if isinstance(machine, str) else machine)
    return replace(made, **changes)  # type: ignore[arg-type]
