"""The motion of a machine that runs without an end: a scenario that may be exchanged in flight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.scenarios import Scenario

Array = NDArray[np.float64]
FADE_OUT_S = 2.0  # of a motion that another one follows


class LiveMotion:
    """The scenario of now, and beneath it the one before it while that fades out.

    A scenario that repeats itself goes on for ever; one that does not begins anew after its duration.
    """

    def __init__(self, scenario: Scenario | None) -> None:
        self.scenario, self.start_s = scenario, 0.0
        self._before: tuple[Scenario, float] | None = None

    def exchange(self, scenario: Scenario | None, time_s: float) -> None:
        """From `time_s` on another scenario fades in, the present one out."""
        self._before = None if self.scenario is None else (self.scenario, self.start_s)
        self.scenario, self.start_s = scenario, time_s

    def restart(self) -> None:
        """Begin anew at time 0."""
        self._before, self.start_s = None, 0.0

    def steady_s(self) -> float:
        """From when on the scenario alone is there, at full size."""
        fade = 0.0 if self.scenario is None else self.scenario.fade_s
        return self.start_s + (fade if self._before is None else max(fade, FADE_OUT_S))

    def poses(self, time_s: Array) -> Array:
        """Poses (n, 6) relative to neutral, or legs in the columns of a scenario for legs."""
        poses = np.zeros((len(time_s), 6))
        if self.scenario is not None:
            poses += self.scenario.evaluate(self.scenario_time(self.scenario, time_s - self.start_s))[0]
        if self._before is not None and time_s[0] < self.start_s + FADE_OUT_S:
            scenario, start = self._before
            share = np.clip(1.0 - (time_s - self.start_s) / FADE_OUT_S, 0.0, 1.0)
            poses += share[:, None] * scenario.evaluate(self.scenario_time(scenario, time_s - start))[0]
        return poses

    @staticmethod
    def scenario_time(scenario: Scenario, time_s: Array) -> Array:
        """Time since a scenario's beginning as its own time [s]."""
        return time_s if scenario.period_s else time_s % scenario.duration_s
