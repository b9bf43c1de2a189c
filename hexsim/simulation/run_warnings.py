"""Warnings of a run: where oil turned to vapour, position loops that swing by themselves, and a constant time step that the machine is
too stiff for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.hydraulics.leg import chamber_capacity
from hexsim.hydraulics.steps import STEP
from hexsim.plant import Plant
from hexsim.plant.readout import voids

Array = NDArray[np.float64]
TENDON_ERROR = (
    "peaks of single axes within 0.7 % and waveforms within 1.6 % of full legs"  # shipped hexapods, plain control
)


def start_warnings(plant: Plant, fast: bool) -> list[str]:
    """What is known before the run: the error of the tendon model where `fast` chose it, and a time step too long."""
    tendon = [f"tendon model: {TENDON_ERROR}"] if fast and plant.is_tendon else []
    return tendon + time_step_warnings(plant)


def time_step_warnings(
    plant: Plant,
    *,
    stable_real: float = 2.78,  # h lambda up to which RK4 is stable
    stable_ring: float = 2.83,  # h omega up to which RK4 is stable
) -> list[str]:
    """A sentence where a constant step is beyond RK4's bound of stability in some state: friction at standstill, or the oil's
    springs at rest. Beyond it the run may diverge, or chatter within bounds."""
    if plant.timestep is None:
        return []
    rule, y = plant.step_rule(), plant.piston_positions()
    stiffest = max(1.0 / chamber_capacity(p, y[i], plant.bottom_pressures()[i]) for i, p in enumerate(plant.rows))
    longest = {
        "friction where a leg stands still": stable_real / (STEP.stiff * rule.standstill),
        "the oil's spring": stable_ring / np.sqrt(rule.springs * stiffest),
    }
    what = min(longest, key=lambda name: longest[name])
    if plant.timestep <= longest[what]:
        return []
    return [
        f"time step {1e3 * plant.timestep:g} ms: {what} is stable up to {1e3 * longest[what]:.2g} ms; figures of this run may be "
        "those of the step: make it shorter, or leave the choice to hexsim"
    ]


@dataclass(kw_only=True)
class Cavitation:
    """Voids of a volume of oil: how many, the first one's beginning, how long they were there, and the largest one.

    area_m2: of the piston that pulls it; 0 of a volume without one.
    """

    area_m2: float
    count: int
    first_s: float
    duration_s: float
    largest_m3: float
    largest_s: float

    def sentence(self, place: str) -> str:
        """What a run warns of."""
        often = "once" if self.count == 1 else f"{self.count} times, first"
        travel = f", {1e3 * self.largest_m3 / self.area_m2:.2g} mm of the piston" if self.area_m2 > 0.0 else ""
        return (
            f"{place} cavitated {often} at {self.first_s:.3f} s, {1e3 * self.duration_s:.3g} ms in all: largest void "
            f"{1e6 * self.largest_m3:.2g} cm3{travel} at {self.largest_s:.3f} s"
        )


def cavitation_warnings(plant: Plant, tick_s: float, positions: Array, act: Array) -> list[str]:
    """One sentence a volume of oil that cavitated: when, how long, how large the void. positions (m, n_legs), act
    (m, n_states): of every tick; a void that opens and closes between two ticks is not seen."""
    time = np.arange(len(act), dtype=float) * tick_s
    found = []
    for place, (void, area) in voids(plant, time, positions, act).items():
        there, largest = void > 0.0, int(np.argmax(void))
        begins = np.flatnonzero(there & ~np.concatenate([[False], there[:-1]]))
        seen = Cavitation(
            area_m2=area,
            count=len(begins),
            first_s=float(time[begins[0]]),
            duration_s=tick_s * float(there.sum()),
            largest_m3=float(void[largest]),
            largest_s=float(time[largest]),
        )
        found.append(seen.sentence(place))
    return found


def swing_warnings(
    machine: Machine,
    volts: Array,
    setpoints: Array,
    *,
    least_swing: float = 0.33,  # of the volts' rms, quicker than that: the edges' steps at a reversal have 0.02 to 0.07
    least_share: float = 0.02,  # of the whole run's volts: at rest a compensator may answer the noise of pressures by less
    least_ratio: float = 3.0,  # as often as the setpoint: a valve with overlap and friction turns as often
    reading_deviations: float = 10.0,  # standard deviations of what the position sensor's noise and counts make of volts
    window_s: float = 0.5,  # in which a swing is sought
    quick_s: float = 0.1,  # within which a loop that swings by itself turns; setpoints of platforms turn slower
) -> list[str]:
    """A sentence on the leg whose position loop swings most by itself. volts, setpoints (m, n_legs): of every control tick, to
    the valves, and of the pistons.

    Sought in windows of `window_s`: the volts' part quicker than `quick_s` is `least_swing` of their rms and turns
    `least_ratio` times as often as the setpoint's speed. A loop that swings (a limit cycle) keeps an error of the time step,
    which one that settles forgets; an oscillation that takes longer than `quick_s` is not seen.
    """
    tick_s = 1.0 / machine.controller.rate_Hz
    n, wide = round(window_s / tick_s), max(round(quick_s / tick_s), 1)
    if len(volts) < n + wide:
        return []
    noise = np.array([leg.controller.gain_V_per_m * leg.sensors.position_error_m for leg in machine.legs])
    quick, speed = volts - _moving_mean(volts, wide), np.diff(setpoints, axis=0)
    least, found = np.maximum(reading_deviations * noise, least_share * volts.std(axis=0)), []
    for first in range(wide, len(volts) - n - wide + 1, n // 2):
        part = slice(first, first + n)
        swing, whole = quick[part].std(axis=0), volts[part].std(axis=0)
        for k in np.flatnonzero((swing > least_swing * whole) & (swing > least)):
            turns = _side_changes(quick[part, k], 0.5 * swing[k])
            asked = _side_changes(speed[part, k], 0.5 * float(speed[part, k].std()))
            if turns >= max(least_ratio * asked, n * tick_s / quick_s):
                found.append((float(swing[k]), int(k) + 1, first * tick_s, turns / (2.0 * n * tick_s)))
    if not found:
        return []
    swing, leg, at, hertz = max(found)
    return [
        f"position loop of leg {leg}: swings by itself at {hertz:.0f} Hz, {swing:.2g} V rms from {at:.1f} s on, while its setpoint "
        "does not; figures of such a run depend on the time step beyond what step_error says: lower controller.gain_V_per_m "
        "(hexsim tune-loop)"
    ]


def _moving_mean(x: Array, wide: int) -> Array:
    """Mean over `wide` rows about each of x (m, n); towards the ends as if x were zero beyond."""
    return np.stack([np.convolve(one, np.full(wide, 1.0 / wide), "same") for one in x.T], axis=1)


def _side_changes(x: Array, width: float) -> int:
    """How often a signal passes from above its mean by `width` to below by it, and back."""
    x = x - x.mean()
    sides = np.sign(x[np.abs(x) > width])
    return int(np.count_nonzero(np.diff(sides)))
