"""Tune a machine's controller: search over the linear model, then measure in the simulator.

    feed-forward    k_v, k_a: least squares of T = piston/setpoint against the setpoint filter's own response, all loops,
                    weight 1/(1 + (f/follow_to_Hz)^2)
    feedback        Kp, pressure gain, setpoint filter: the least mean |T - 1|^2 up to follow_to_Hz, valve gain off by
                    +-gain_off, kept from breaking phase margin, gain margin, peak and SHAKEN by a penalty (Nelder-Mead)

What the noise of the transducers shakes, in the mode that it shakes most, stays below the threshold of perception with
three standard deviations: a high gain follows the noise as it follows the setpoint.
Every mode of the load counts alike. Measured with a multisine in each degree of freedom.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.hydraulics.oil_spring import oil_stiffness
from hexsim.hydraulics.parameters import declared_rows
from hexsim.machine.files import changed
from hexsim.motion_computer.controller import Control
from hexsim.motion_computer.declared_control import control_of
from hexsim.motion_computer.loop_model import Loop, controller_matrices, loops, reduced
from hexsim.motion_computer.margins import LoopFigures, figures_of, first_below, worst_figures
from hexsim.scenarios import Scenario
from hexsim.setpoints.signals import Multisine
from hexsim.signals.table import pose_column
from hexsim.simulation import simulate
from hexsim.smoothness.threshold import PERCEPTION_m_s2

Array = NDArray[np.float64]
SHAKEN_m_s2 = min(PERCEPTION_m_s2.values()) / 3.0  # rms in the felt band, by noise of the transducers


class Judged(NamedTuple):
    """Frequencies at which the loop is judged."""

    follow_to_Hz: float = 10.0  # [Hz] no motion that people ride asks for more
    points: int = 100  # frequencies of a loop that is judged thousands of times
    # at which an axis is measured: closest where a loop of a few hertz turns
    frequencies_Hz: tuple[float, ...] = (0.5, 1.0, 1.5, 2.5, 4.0, 5.5, 7.0, 8.5, 10.5, 13.0, 16.0, 19.5)


JUDGED = Judged()


@dataclass(frozen=True, kw_only=True)
class AxisFigures:
    """What one degree of freedom does in the simulator. response: at frequencies_Hz, complex."""

    axis: str
    response: Array
    bandwidth_Hz: float | None
    quarter_Hz: float | None
    peak_dB: float
    delay_s: float


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """A machine before and after, with the figures of both."""

    machines: tuple[Machine, Machine]
    margins: tuple[LoopFigures, LoopFigures]
    axes: tuple[list[AxisFigures], list[AxisFigures]]


def tune(machine: Machine, progress: Callable[[float], None] = lambda fraction: None) -> Tuning:
    """Tune the controller of `machine` and measure before and after. Raises HexsimError where no loop is stable."""
    after = tuned(machine, lambda fraction: progress(0.4 * fraction))
    measured = []
    for k, one in enumerate((machine, after)):
        measured.append(measure(one, lambda fraction, k=k: progress(0.4 + 0.3 * (k + fraction))))
    return Tuning(
        machines=(machine, after),
        margins=(worst_figures(machine), worst_figures(after)),
        axes=(measured[0], measured[1]),
    )


def tuned(machine: Machine, progress: Callable[[float], None] = lambda fraction: None) -> Machine:
    """The machine with the controller that the search finds."""
    search = Search(machine, progress)
    found = scipy.optimize.minimize(
        search.cost, search.start(), method="Nelder-Mead", options={"maxfev": 90, "xatol": 0.02, "fatol": 1e-5}
    )
    best = search.with_feed_forward(found.x)
    figures = worst_figures(best)
    if not figures.is_stable:
        raise HexsimError(f"machine {machine.name}: no stable controller was found; look at its valve and oil volumes")
    return best


class Search:
    """Costs of controllers over the linear loops of a machine."""

    def __init__(
        self,
        machine: Machine,
        progress: Callable[[float], None],
        *,
        same_mass: float = 0.02,  # relative difference of modes that are one loop
    ) -> None:
        self.machine, self.progress, self.evaluations = machine, progress, 0
        self.f = np.geomspace(0.1, 0.45 * machine.controller.rate_Hz, JUDGED.points)
        self.loops: list[Loop] = []
        for loop in loops(machine):
            alike = (o for o in self.loops if (o.leg, o.extends) == (loop.leg, loop.extends))
            if all(abs(o.mass_kg / loop.mass_kg - 1) > same_mass for o in alike):
                self.loops.append(loop)
        self.stiffness = float(np.mean([oil_stiffness(p) for p in declared_rows(machine)]))
        self.lowest_Hz = np.sqrt(self.stiffness / max(loop.mass_kg for loop in self.loops)) / (2 * np.pi)
        slow = 0.2
        self.valve_gain = float(
            np.mean([np.abs(2 * np.pi * slow * self._sensed(loop, slow)) for loop in self.loops])
        )  # [m/s/V]

    @staticmethod
    def _sensed(loop: Loop, frequency_Hz: float) -> complex:
        """Position over volts of the leg alone."""
        A, B, read, _ = loop.plant
        z = np.exp(2j * np.pi * frequency_Hz * loop.tick_s)
        return complex((read[:1] @ np.linalg.solve(z * np.eye(len(A)) - A, B))[0, 0])

    def start(self) -> Array:
        """The best of a few: log of velocity gain [1/s], of pressure gain as damping [1/s], of the filter [Hz]."""
        omega = 2 * np.pi * self.lowest_Hz
        tries = [
            np.log([a * omega, b * omega, min(2.5 * self.lowest_Hz, 25.0)])
            for a in (0.15, 0.3)
            for b in (0.5, 1.0, 2.0)
        ]
        return min(tries, key=self.cost)

    def keys(
        self,
        x: Array,
        velocity: float,
        acceleration: float,
        *,
        low_share: float = 0.1,  # corner of the pressure's high pass over the lowest resonance
    ) -> dict[str, Any]:
        """The [controller] of a point. A pressure gain G [V/Pa] lets the oil spring out at rate K_v G k/A1."""
        speed, damping, smooth_Hz = (float(v) for v in np.exp(x))
        area = self.machine.cylinder.area_bottom_m2
        rate_Hz = self.machine.controller.rate_Hz
        return {
            "structure": "pid",
            "gain_V_per_m": speed / self.valve_gain,
            "velocity_feed_forward_V_s_per_m": max(float(velocity), 0.0),
            "acceleration_feed_forward_V_s2_per_m": float(acceleration),
            "load_feed_forward": True,
            "pressure_feedback_V_per_Pa": damping * area / (self.stiffness * self.valve_gain),
            "pressure_high_pass_Hz": min(low_share * self.lowest_Hz, 0.1 * rate_Hz),
            "setpoint_filter_Hz": min(smooth_Hz, 0.2 * rate_Hz),
        }

    def changed(self, x: Array, velocity: float, acceleration: float) -> Machine:
        keys = self.keys(x, velocity, acceleration)
        return changed(self.machine, {f"controller.{key}": value for key, value in keys.items()}, "tune-loop")

    def closed(self, x: Array, velocity: float, acceleration: float) -> list[Loop]:
        """The loops with that controller."""
        control, made = control_of(self.changed(x, velocity, acceleration)), []
        for loop in self.loops:
            own = Control(control.rows[loop.leg - 1 : loop.leg], control.inertia)
            made.append(dataclasses.replace(loop, controller=reduced(controller_matrices(own, loop.mass_kg))))
        return made

    def feed_forward(self, x: Array) -> Array:
        """k_v, k_a: the response is linear in them."""
        T = [
            np.concatenate([loop.closed_response(self.f) for loop in self.closed(x, *k)])
            for k in ((0, 0), (1, 0), (0, 1))
        ]
        ratio = 1j * self.f / np.exp(x[2])
        target = np.tile(1.0 / (1.0 + np.sqrt(2) * ratio + ratio**2), len(self.loops))
        columns = np.column_stack([T[1] - T[0], T[2] - T[0]])
        weight = np.tile(1.0 / (1.0 + (self.f / JUDGED.follow_to_Hz) ** 2), len(self.loops))
        left, right = columns * weight[:, None], (target - T[0]) * weight
        return np.linalg.lstsq(np.vstack([left.real, left.imag]), np.r_[right.real, right.imag], rcond=None)[0]

    def with_feed_forward(self, x: Array) -> Machine:
        return self.changed(x, *self.feed_forward(x))

    def shaken_m_s2(self, loop: Loop) -> float:
        """Rms acceleration of a loop's piston by the noise and the resolution of its transducers."""
        own = self.machine.legs[loop.leg - 1].sensors
        return loop.shaken_m_s2(own.position_error_m, own.pressure_error_Pa)

    def cost(
        self,
        x: Array,
        *,
        penalty: float = 0.02,  # a degree or decibel beyond its limit costs as much as |T - 1| = 0.02 sqrt(n)
        gain_off: float = 0.15,  # of the valve: load, oil, wear
        phase_margin_deg: float = 50.0,  # of the nominal loop and of one whose gain is off
        gain_margin_dB: float = 8.0,  # of the same
        peak_dB: float = 1.0,  # of |T|
    ) -> float:
        """Mean |T - 1|^2 with the valve's gain off either way, and the penalties."""
        self.evaluations += 1
        self.progress(min(self.evaluations / 100, 1.0))
        error, beyond = [], []
        below = self.f <= JUDGED.follow_to_Hz
        for loop in self.closed(x, *self.feed_forward(x)):
            for factor in (1 - gain_off, 1 + gain_off):
                A, B, read, through = loop.plant
                off = dataclasses.replace(loop, plant=(A, factor * B, read, through))
                figures = figures_of(off, JUDGED.points)
                error.append(np.mean(np.abs(off.closed_response(self.f[below]) - 1.0) ** 2))
                beyond += [
                    max(0.0, phase_margin_deg - (figures.phase_margin_deg or 180.0)) / 10.0,
                    max(0.0, gain_margin_dB - (figures.gain_margin_dB or 60.0)),
                    max(0.0, figures.peak_dB - peak_dB),
                    0.0 if figures.is_stable else 100.0,
                    max(0.0, 20.0 * np.log10(max(self.shaken_m_s2(off), 1e-9) / SHAKEN_m_s2)),
                ]
        return float(np.mean(error) + penalty * np.sum(np.square(beyond)))


def measure(
    machine: Machine,
    progress: Callable[[float], None] = lambda fraction: None,
    *,
    speed_m_s: float = 0.04,  # of each sine at most; rotations: over turn_m
    acceleration_m_s2: float = 0.4,  # of each sine at most; rotations: over turn_m
    n_periods: int = 2,  # of a sine, after it has settled
    turn_m: float = 0.6,  # from the axis, where a turn moves as far as a shift
    settle_s: float = 2.0,  # before the sine is judged
) -> list[AxisFigures]:
    """Every degree of freedom in the simulator, one multisine each. Raises HexsimError where a run does not end."""
    measured, axes = [], machine.mechanics.dofs
    frequencies = np.array(JUDGED.frequencies_Hz)
    for k, axis in enumerate(axes):
        omega = 2 * np.pi * frequencies
        size = np.minimum(speed_m_s / omega, acceleration_m_s2 / omega**2) / (
            turn_m if axis in ("roll", "pitch", "yaw") else 1.0
        )
        signal = Multisine(amplitudes=tuple(size), frequencies_Hz=tuple(JUDGED.frequencies_Hz), seed=1)
        period = 2.0  # of all frequencies
        scenario = Scenario(
            name=f"tune-loop {axis}",
            mode="dof",
            signals={axis: signal},
            duration_s=settle_s + n_periods * period,
            fade_s=1.0,
            fade="smooth",
        )
        run = simulate(machine, scenario, fast=True).whole(f"machine {machine.name}, {axis}")
        time = run.log["time_s"].to_numpy()
        late = time >= settle_s - 1e-9
        played = signal.value(time[late])
        if machine.is_hexapod:
            answer = run.log[pose_column("platform", axis)].to_numpy()[late]
        else:
            answer = run.log["true_position_m"].to_numpy()[late] - 0.5 * machine.cylinder.stroke_m
        turn = np.exp(-1j * np.outer(omega, time[late]))
        measured.append(axis_figures(axis, (turn @ answer) / (turn @ played)))
        progress((k + 1) / len(axes))
    return measured


def axis_figures(axis: str, response: Array) -> AxisFigures:
    """Figures from the response at frequencies_Hz."""
    f, gain = np.array(JUDGED.frequencies_Hz), 20 * np.log10(np.abs(response))
    phase = np.degrees(np.unwrap(np.angle(response)))
    phase -= 360.0 * np.ceil((phase[0] - 90.0) / 360.0)
    return AxisFigures(
        axis=axis,
        response=response,
        bandwidth_Hz=first_below(f, gain, -3.0),
        quarter_Hz=first_below(f, phase, -90.0),
        peak_dB=float(gain.max()),
        delay_s=float(-np.interp(1.0, f, phase) / 360.0),
    )
