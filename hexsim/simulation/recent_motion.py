"""What a machine that runs without an end has just done: its last seconds, their figures, and its last reversals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hexsim.scenarios import Scenario
from hexsim.simulation.run_log import RecordedMotion, axis_motions, motion_log
from hexsim.smoothness import (
    AxisMotion,
    deviation_from_command,
    harmonic_deviation,
    reversals_of_velocity,
    summary_axes,
)
from hexsim.smoothness.reversals import REVERSAL_WINDOW_S, Reversal
from hexsim.smoothness.threshold import times_threshold

if TYPE_CHECKING:
    from hexsim.simulation.live import LiveMachine

Array = NDArray[np.float64]
LONGEST_S = 25.0  # that is kept
OTHER_SPAN_S = 4.0  # and of another motion


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionFigures:
    """axes: as in a run's summary. times_threshold: the largest translation's peak in the band over the threshold of
    perception along it, and that axis. driven: the axis whose reversals are in `curves`, top and bottom: deviation (n,)
    in the band at the times `curve_time_s` (n,) about the reversal."""

    axes: dict[str, dict[str, float | None]]
    times_threshold: float
    felt_axis: str
    driven: str
    unit: str
    curve_time_s: Array
    curves: dict[str, Array]

    @property
    def peak(self) -> float:
        """Peak of the driven axis in the band, m/s2 or rad/s2."""
        return self.axes[self.driven][f"peak_band_{self.unit}"] or 0.0


class RecentMotion:
    """A ring of the last seconds of a machine's motion; `note` is its observer."""

    def __init__(self) -> None:
        self._rows: Array | None = None
        self._next, self._count, self._step_s = 0, 0, 0.0
        self._parts: list[slice] = []

    def note(self, live: LiveMachine) -> None:
        """Write down the present state."""
        values = (np.array([live.time_s]), live.loop.setpoint, live.data.qpos, live.data.qvel)
        if self._rows is None:
            ends = np.cumsum([len(value) for value in values])
            self._parts = [slice(int(end) - len(value), int(end)) for end, value in zip(ends, values, strict=True)]
            self._step_s = live.tick_s / live.steps_a_tick
            self._rows = np.zeros((round(LONGEST_S / self._step_s), int(ends[-1])))
        row = self._rows[self._next]
        for part, value in zip(self._parts, values, strict=True):
            row[part] = value
        self._next = (self._next + 1) % len(self._rows)
        self._count = min(self._count + 1, len(self._rows))

    def forget(self) -> None:
        """Begin anew: the machine has."""
        self._rows, self._next, self._count = None, 0, 0

    def log(
        self,
        live: LiveMachine,
        since_s: float,
        *,
        n_periods: int = 2,  # of a sine that the figures are taken from
        shortest_s: float = 0.5,  # that figures can be taken from
    ) -> pl.DataFrame | None:
        """Log of the last periods since `since_s`, in the time of the scenario; None before there is one period.

        The mean acceleration over a step, (v_(k+1) - v_k)/T, belongs to the step's middle; so do time and command here.
        """
        scenario = live.motion.scenario
        if self._rows is None or scenario is None or not scenario.signals:
            return None
        period, step = scenario.period_s or OTHER_SPAN_S, self._step_s
        periods = min(int((live.time_s - since_s) / period), n_periods, int(0.9 * LONGEST_S / period))
        count = min(round(periods * period / step) + 2, self._count)
        if periods < 1 or count * step < shortest_s:
            return None
        rows = self._rows[(self._next - count + np.arange(count)) % len(self._rows)]
        time, setpoints, qpos, qvel = (rows[:, part] for part in self._parts)
        middle = time[0, 0] + step * (np.arange(count - 1) + 0.5)
        recorded = RecordedMotion(
            time=live.motion.scenario_time(scenario, middle - live.motion.start_s),
            setpoints=setpoints[:-1],
            qpos=qpos[:-1],
            qvel=qvel[:-1],
            mean_acceleration=np.diff(qvel, axis=0) / step,
        )
        if np.any(np.diff(recorded.time) <= 0.0):  # the scenario has begun anew within
            return None
        return motion_log(live.plant, scenario, recorded)


def motion_figures(scenario: Scenario, axis_names: tuple[str, ...], log: pl.DataFrame) -> MotionFigures:
    """Figures of a log of `RecentMotion`, as `hexsim run` gives them."""
    time, motions = log["time_s"].to_numpy(), axis_motions(log, scenario, axis_names)
    axes = summary_axes(time, motions, start_s=float(time[0]))
    driven = next(name for name, motion in motions.items() if motion.driven)
    felt = {
        name: times
        for name, figures in axes.items()
        if (times := times_threshold(name, figures.get("peak_band_m_s2") or 0.0)) is not None
    }
    axis = max(felt, key=lambda name: felt[name])
    grid, curves = reversal_curves(time, motions[driven], scenario.period_s)
    return MotionFigures(
        axes=axes,
        times_threshold=felt[axis],
        felt_axis=axis,
        driven=driven,
        curve_time_s=grid,
        curves=curves,
        unit="m_s2" if "peak_band_m_s2" in axes[driven] else "rad_s2",
    )


def reversal_curves(
    time: Array,
    motion: AxisMotion,
    period_s: float | None,
    *,
    step_s: float = 0.002,  # of the curves: a control tick
) -> tuple[Array, dict[str, Array]]:
    """Deviation in the band about the last reversal at the top and at the bottom: its times about it, end -> values."""
    if motion.frequency_Hz is not None:
        part = harmonic_deviation(time, motion.acceleration, motion.frequency_Hz)
        at, band, reversals = part.time_s, part.band, part.reversals()
    else:
        command, velocity = motion.commanded_acceleration, motion.commanded_velocity
        assert command is not None and velocity is not None  # the axis is driven
        other = deviation_from_command(time, motion.acceleration, command)
        at, band = other.time_s[other.inner], other.band[other.inner]
        reversals = tuple(
            Reversal(time_s=found.time_s + other.delay_s, end=found.end)
            for found in reversals_of_velocity(time, velocity)
        )
    window = min(REVERSAL_WINDOW_S, 0.25 * (period_s or OTHER_SPAN_S))
    grid = np.arange(-window, window + 0.5 * step_s, step_s)
    curves = {}
    for reversal in reversals:
        if at[0] <= reversal.time_s - window and reversal.time_s + window <= at[-1]:
            curves[reversal.end] = np.interp(reversal.time_s + grid, at, band)
    return grid, curves
