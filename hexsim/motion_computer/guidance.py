"""Guidance: how the motion computer moves the legs on its own, along smooth paths that begin with the present motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hexsim.mechanics.mechanics import Mechanics
from hexsim.motion_computer.paths import Path, stop_and_move

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Guidance:
    """Speeds and times of the motion computer's own motions. Assumed values, for people on board."""

    neutral_velocity_m_s: float = 0.05  # to neutral
    neutral_acceleration_m_s2: float = 0.2
    settle_velocity_m_s: float = 0.04  # down to the stops
    settle_acceleration_m_s2: float = 0.1
    stop_acceleration_m_s2: float = 1.0  # braking of a leg that was moving
    fade_compensation_s: float = 0.3  # in which a fault fades the compensation out
    lowering_V: float = -0.2  # open loop, to a leg without position signal once the other legs are down
    lowering_V_s: float = 0.2  # rate at which `lowering_V` is reached
    lift_fade_s: float = 0.3  # in which extending volts fade out without pressure: an open valve would let the leg sink
    rest_s: float = 2.0  # after the path's end, then the pump stops
    start_timeout_s: float = 10.0  # for the supply pressure to come up


class GuidedSetpoints:
    """Setpoints of the legs (n_legs,) [m], and the path that they follow while the motion computer guides them.

    The last three setpoints give the velocity and acceleration with which a path begins.
    """

    def __init__(self, guidance: Guidance, mechanics: Mechanics, tick_s: float, at_neutral: bool) -> None:
        self.guidance, self.tick_s, self.stroke_m = guidance, tick_s, mechanics.stroke_m
        self.neutral = mechanics.neutral_positions
        self.setpoint = setpoint = self.neutral.copy() if at_neutral else np.zeros(mechanics.n_legs)
        self.path: Path | None = None
        self._before, self._older = setpoint.copy(), setpoint.copy()

    def store(self, setpoint: Array) -> None:
        """The setpoint of this tick."""
        self._older, self._before, self.setpoint = self._before, self.setpoint, setpoint.copy()

    def stand(self) -> None:
        """Take the present setpoint as one at rest."""
        self._before = self._older = self.setpoint

    def preview(self, time_s: float, count: int) -> Array:
        """Setpoints (count, n_legs) of this tick and the next ones: along the path, or held."""
        if self.path is None:
            return np.tile(self.setpoint, (count, 1))
        return np.stack([self.path.value(time_s + k * self.tick_s) for k in range(count)])

    def to_neutral(self, time_s: float) -> None:
        guidance = self.guidance
        self._start(time_s, self.neutral, guidance.neutral_velocity_m_s, guidance.neutral_acceleration_m_s2)

    def lower(self, time_s: float) -> None:
        """Down to the stops."""
        guidance = self.guidance
        down = np.zeros(len(self.neutral))
        self._start(time_s, down, guidance.settle_velocity_m_s, guidance.settle_acceleration_m_s2)

    def brake(self, time_s: float) -> None:
        """To rest, wherever that is."""
        self._start(time_s, None, 1.0, 1.0)

    def _start(self, time_s: float, target: Array | None, velocity: float, acceleration: float) -> None:
        """A path that continues the present motion. It begins one tick ago, where the last setpoint was."""
        now = (self.setpoint - self._before) / self.tick_s
        change = (now - (self._before - self._older) / self.tick_s) / self.tick_s
        self.path = stop_and_move(
            time_s - self.tick_s,
            self.setpoint,
            now,
            change,
            target,
            velocity_max=velocity,
            acceleration_max=acceleration,
            stop_acceleration_max=self.guidance.stop_acceleration_m_s2,
            bounds=(0.0, self.stroke_m),
        )
