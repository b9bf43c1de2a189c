"""The battery of motion tests: plays them on a rig and measures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from hexsim.cueing.washout import g as g0
from hexsim.errors import HexsimError
from hexsim.qualification import measures
from hexsim.qualification.rig import Motion, Rig
from hexsim.qualification.rows import (
    APPLICANT,
    NO_LIMIT,
    PART_60,
    ROTATIONS,
    Row,
    half_hertz_curve,
    half_hertz_rows,
    leg_balance_row,
    row_of,
    turn_around_curve,
    turn_around_row,
)
from hexsim.scenarios import Scenario
from hexsim.setpoints.signals import Signal, Sine, Triangle
from hexsim.smoothness import band_limit, describing_function, frequency_below


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Amplitudes and lengths. The half-hertz amplitude counts for all 0.5 Hz tests but the turn-around check."""

    frequencies_Hz: tuple[float, ...] = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
    half_hertz_m: float = 0.05
    half_hertz_rad: float = math.radians(5.0)
    largest_m: float = 0.03  # of the describing function,
    largest_m_s: float = 0.25  # with no more than this speed: high frequencies must leave the valves' dead band
    largest_rad: float = math.radians(3.0)
    largest_rad_s: float = math.radians(25.0)
    linearity_m: tuple[float, ...] = (0.005, 0.01, 0.02, 0.05)
    hysteresis_m: float = 0.02  # long enough for the lag to settle between the corner and the middle
    hysteresis_m_s: float = 0.005  # and twice that
    threshold_m_s2: float = 0.2
    turn_around_m: float = 0.075
    periods: int = 6


QUICK = Plan(frequencies_Hz=(0.5, 1.0, 2.0, 5.0, 10.0), linearity_m=(0.01, 0.05), hysteresis_m_s=0.01, periods=3)


@dataclass(kw_only=True)
class Findings:
    """rows of the table; curves for the plots, by test."""

    rows: list[Row] = field(default_factory=list)
    curves: dict[str, Any] = field(default_factory=dict)


class Battery:
    """All motion tests on one rig. progress(fraction, what) is called before each motion."""

    def __init__(
        self, rig: Rig, plan: Plan, progress: Callable[[float, str], None] = lambda fraction, what: None
    ) -> None:
        self.rig, self.plan, self.progress = rig, plan, progress
        self.found = Findings()
        self._heave: Motion | None = None
        others = [f for f in plan.frequencies_Hz if f != 0.5]
        self._total = len(rig.axes) * (1 + len(others)) + len(plan.linearity_m) - 1 + 5
        self._played = 0

    def run(self) -> Findings:
        """Raises HexsimError for a motion that the machine cannot do."""
        for axis in self.rig.axes:
            self._axis(axis)
        self._linearity()
        self._hysteresis()
        self._dynamic_threshold()
        self._turn_around()
        self._repeatability()
        return self.found

    # playing
    def _play(self, name: str, axis: str, signal: Signal, fade_s: float, duration_s: float, seed: int = 0) -> Motion:
        self.progress(self._played / self._total, name)
        self._played += 1
        scenario = Scenario(
            name=name, mode="dof", signals={axis: signal}, duration_s=duration_s, fade_s=fade_s, fade="smooth"
        )
        return self.rig.play(scenario, seed)

    def _sine(self, name: str, axis: str, amplitude: float, frequency: float, seed: int = 0) -> tuple[Motion, float]:
        """Faded in over two periods or half a second, one more to settle; returns where that ends [s] too."""
        period = 1.0 / frequency
        fade = max(period, 0.5) if frequency < 0.5 else max(2 * period, 0.5)
        start = math.ceil((fade + max(period, 0.4)) * frequency - 1e-9) * period
        periods = self.plan.periods if frequency >= 0.5 else 2
        duration = start + periods * period + 0.02
        return self._play(name, axis, Sine(amplitude=amplitude, frequency_Hz=frequency), fade, duration, seed), start

    def _add(self, *row: Any, source: str = NO_LIMIT) -> None:
        self.found.rows.append(row_of(*row, source=source))

    # the tests
    def _axis(
        self,
        axis: str,
        *,
        least_gain: float = 3e-3,  # below -50 dB the command stays in the dead band and has no phase
    ) -> None:
        """Half-hertz noise, parasitic motion and describing function of one axis."""
        plan, turns = self.plan, axis in ROTATIONS
        amplitude = plan.half_hertz_rad if turns else plan.half_hertz_m
        motion, start = self._sine(f"half-hertz {axis}", axis, amplitude, 0.5)
        if axis == "z":
            self._heave, self._heave_start = motion, start
        self._half_hertz(axis, motion, start)
        response = {0.5: describing_function(motion.time_s, motion.response[axis], motion.commanded[axis], 0.5, start)}
        largest, speed = (plan.largest_rad, plan.largest_rad_s) if turns else (plan.largest_m, plan.largest_m_s)
        for f in plan.frequencies_Hz:
            if f != 0.5:
                size = min(largest, speed / (2 * math.pi * f))
                motion, start = self._sine(f"{axis} at {f:g} Hz", axis, size, f)
                response[f] = describing_function(
                    motion.time_s, motion.response[axis], motion.commanded[axis], f, start
                )
        frequencies = sorted(response)
        gains_dB = [20 * math.log10(max(abs(response[f]), 1e-6)) for f in frequencies]
        phases = [measures.phase_deg(response[f]) if abs(response[f]) > least_gain else math.nan for f in frequencies]
        self.found.curves.setdefault("describing_function", {})[axis] = {
            "frequency_Hz": frequencies,
            "gain_dB": gains_dB,
            "phase_deg": [None if math.isnan(phase) else phase for phase in phases],
        }
        half_power, quarter = (
            frequency_below(frequencies, gains_dB, -3.0),
            frequency_below(frequencies, phases, -90.0),
        )
        self._add("describing function", axis, "gain falls below -3 dB at", half_power, "Hz", source=APPLICANT)
        self._add("describing function", axis, "phase passes -90 deg at", quarter, "Hz", source=APPLICANT)

    def _half_hertz(self, axis: str, motion: Motion, start: float) -> None:
        self.found.rows += half_hertz_rows(axis, motion, start)
        self.found.curves.setdefault("half_hertz", {})[axis] = half_hertz_curve(axis, motion, start)

    def _linearity(self) -> None:
        gains = []
        for size in self.plan.linearity_m[:-1]:
            motion, start = self._sine(f"linearity {1000 * size:g} mm", "z", size, 0.5)
            gains.append(
                abs(describing_function(motion.time_s, motion.response["z"], motion.commanded["z"], 0.5, start))
            )
        heave, start = self._half_hertz_heave()
        gains.append(abs(describing_function(heave.time_s, heave.response["z"], heave.commanded["z"], 0.5, start)))
        self.found.curves["linearity"] = {"amplitude_m": list(self.plan.linearity_m), "gain": gains}
        low, high = 1000 * self.plan.linearity_m[0], 1000 * self.plan.linearity_m[-1]
        self._add("linearity", "z", f"gain changes, {low:g} to {high:g} mm", 100 * measures.linearity(gains), "%")

    def _half_hertz_heave(self) -> tuple[Motion, float]:
        if self._heave is None:
            raise HexsimError("the battery needs an axis z")
        return self._heave, self._heave_start

    def _hysteresis(self) -> None:
        plan, widths, curves = self.plan, [], []
        for speed in (plan.hysteresis_m_s, 2 * plan.hysteresis_m_s):
            period = 4 * plan.hysteresis_m / speed
            signal = Triangle(amplitude=plan.hysteresis_m, frequency_Hz=1 / period)
            motion = self._play(f"hysteresis {1000 * speed:g} mm/s", "z", signal, 0.5 * period, 2.6 * period)
            widths.append(measures.loop_width(motion.time_s, motion.commanded["z"], motion.response["z"], 0.6 * period))
            late = motion.time_s >= 1.5 * period
            curves.append(
                {
                    "speed_m_s": speed,
                    "commanded_m": motion.commanded["z"][late],
                    "response_m": motion.response["z"][late],
                }
            )
        self.found.curves["hysteresis"] = curves
        self._add("hysteresis", "z", "width of the loop at rest", 1e3 * measures.hysteresis(*widths), "mm")

    def _dynamic_threshold(self) -> None:
        signal = measures.AccelerationSteps(acceleration_m_s2=self.plan.threshold_m_s2, period=2.0)
        motion = self._play("dynamic threshold", "z", signal, 2.0, 8.02)
        start = 3.0
        delay = measures.dynamic_threshold(
            motion.time_s, motion.commanded_acceleration["z"], motion.acceleration["z"], start
        )
        self._add(
            "dynamic threshold",
            "z",
            f"63 % of a step of {2 * self.plan.threshold_m_s2:g} m/s² after",
            1e3 * delay,
            "ms",
        )
        late = motion.time_s >= start
        self.found.curves["dynamic_threshold"] = {
            "time_s": motion.time_s[late],
            "commanded_m_s2": motion.commanded_acceleration["z"][late],
            "acceleration_m_s2": band_limit(motion.time_s, motion.acceleration["z"])[late],
        }

    def _turn_around(self) -> None:
        motion, start = self._sine("turn-around", "z", self.plan.turn_around_m, 0.5)
        self.found.rows.append(turn_around_row("z", motion, start))
        self.found.curves["turn_around"] = turn_around_curve("z", motion, start)

    def _repeatability(self) -> None:
        """The half-hertz heave once more, with other sensor noise; and the legs' phases in the first one."""
        first, start = self._half_hertz_heave()
        second, _ = self._sine("repeatability", "z", self.plan.half_hertz_m, 0.5, seed=1)
        largest = measures.repeatability(first.time_s, first.acceleration["z"], second.acceleration["z"], start)
        self._add(
            "repeatability",
            "z",
            "largest difference of two runs, 50 Hz band",
            largest,
            "m/s²",
            0.05 * g0,
            source=PART_60,
        )
        if first.leg_positions.shape[1] > 1:
            row, phases = leg_balance_row("z", first, start)
            self.found.rows.append(row)
            self.found.curves["leg_balance"] = {"phase_deg": list(phases)}
