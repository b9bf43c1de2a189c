"""What the motion tests measure, as pure functions of records: time, command and response of one coordinate.

Response and command are positions unless said otherwise. Each function has a linear or idealised system whose answer is
known; tests/test_qualify.py holds them to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.errors import HexsimError
from hexsim.setpoints.signal import Signal
from hexsim.smoothness import band_limit, describing_function

Array = NDArray[np.float64]
STEP_SHARE = 0.63  # of an acceleration step, where the dynamic threshold counts


@dataclass(frozen=True, kw_only=True)
class AccelerationSteps(Signal):
    """Parabolic arcs, up and down in turn: the acceleration is a square wave of +-`acceleration`, of `period_s`.

    x = +-(a/2) t (H - t) in each half period H: steps of 2 a at the greatest speed a H/2, arcs of height a H^2/8.
    """

    kind: ClassVar[str] = "acceleration_steps"
    acceleration_m_s2: float
    period: float

    @property
    def period_s(self) -> float:
        return self.period

    def _arc(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Time in the half period [s], and +1 or -1."""
        half = 0.5 * self.period
        count = np.floor(np.asarray(time_s, dtype=float) / half)
        return np.asarray(time_s, dtype=float) - count * half, np.where(count % 2 == 0, 1.0, -1.0)

    def value(self, time_s: ArrayLike) -> Array:
        t, sign = self._arc(time_s)
        return sign * 0.5 * self.acceleration_m_s2 * t * (0.5 * self.period - t)

    def velocity(self, time_s: ArrayLike) -> Array:
        t, sign = self._arc(time_s)
        return sign * self.acceleration_m_s2 * (0.25 * self.period - t)

    def acceleration(self, time_s: ArrayLike) -> Array:
        return -self._arc(time_s)[1] * self.acceleration_m_s2


def phase_deg(response: complex) -> float:
    """Phase in (-360, 0]: a response comes after its command."""
    angle = float(np.degrees(np.angle(response)))
    return angle - 360.0 if angle > 1e-9 else angle


def linearity(gains: ArrayLike) -> float:
    """Largest relative deviation of the gains at several amplitudes from that at the last, largest one. 0 for a linear
    system."""
    gains = np.abs(np.asarray(gains))
    return float(np.max(np.abs(gains / gains[-1] - 1.0)))


def loop_width(time_s: ArrayLike, commanded: ArrayLike, response: ArrayLike, start_s: float) -> float:
    """Response where the command passes zero upwards, less that where it passes downwards, means from start_s on.

    Constant speed v, first-order lag tau: -2 v tau. Backlash of full width b: -b whatever the speed.
    """
    time, command, answer = (np.asarray(values, dtype=float) for values in (time_s, commanded, response))
    late = time >= start_s
    time, command, answer = time[late], command[late], answer[late]
    sides: dict[bool, list[float]] = {True: [], False: []}
    for k in np.flatnonzero(np.diff(np.sign(command)) != 0):
        rise = command[k + 1] - command[k]
        share = -command[k] / rise
        sides[bool(rise > 0)].append(answer[k] + share * (answer[k + 1] - answer[k]))
    if not (sides[True] and sides[False]):
        raise HexsimError("hysteresis: the command does not pass zero in both directions in the record; run longer")
    return float(np.mean(sides[True]) - np.mean(sides[False]))


def hysteresis(width_slow: float, width_fast: float) -> float:
    """Width of the loop at speed zero [m], from the widths at a speed and at twice that: |2 w(v) - w(2 v)|.

    The lag of a linear system is proportional to speed and drops out.
    """
    return abs(2.0 * width_slow - width_fast)


def dynamic_threshold(
    time_s: ArrayLike,
    commanded_acceleration: ArrayLike,
    acceleration: ArrayLike,
    start_s: float,
    bandwidth_Hz: float | None = 50.0,
) -> float:
    """Mean time [s] from a commanded step of acceleration until the response has covered 63 % of the step.

    The response is band-limited. A first-order lag tau gives tau, a pure delay gives the delay.
    Raises HexsimError where the record has no step from start_s on, or the response does not get there.
    """
    time, command = np.asarray(time_s, dtype=float), np.asarray(commanded_acceleration, dtype=float)
    answer = band_limit(time, acceleration, bandwidth_Hz)
    jumps = np.abs(np.diff(command))
    steps = [k for k in np.flatnonzero(jumps > 0.5 * jumps.max()) if time[k] >= start_s]
    delays = []
    for k, following in zip(steps, [*steps[1:], len(time) - 1], strict=True):
        before, after = command[k], command[k + 1]
        level = before + STEP_SHARE * (after - before)
        sign = np.sign(after - before)
        reached = np.flatnonzero(sign * (answer[k : following + 1] - level) >= 0)
        # where it was already beyond the level at the step, the last step's answer had not come yet
        reached = reached[reached > 0] if len(reached) and reached[0] == 0 else reached
        if len(reached):
            j = k + int(reached[0])
            share = (level - answer[j - 1]) / (answer[j] - answer[j - 1]) if answer[j] != answer[j - 1] else 1.0
            delays.append(time[j - 1] + share * (time[j] - time[j - 1]) - 0.5 * (time[k] + time[k + 1]))
    if not delays:
        raise HexsimError(
            "dynamic threshold: the response does not reach 63 % of any step; take larger or longer steps"
        )
    return float(np.mean(delays))


def leg_balance(
    time_s: ArrayLike, setpoints: ArrayLike, positions: ArrayLike, frequency_Hz: float, start_s: float
) -> tuple[float, Array]:
    """(largest difference of phase between any two legs [deg], phases (n_legs,) [deg]); setpoints, positions (m, n)."""
    setpoints, positions = np.asarray(setpoints), np.asarray(positions)
    phases = np.array(
        [
            np.degrees(np.angle(describing_function(time_s, positions[:, i], setpoints[:, i], frequency_Hz, start_s)))
            for i in range(positions.shape[1])
        ]
    )
    return float(phases.max() - phases.min()), phases


def repeatability(
    time_s: ArrayLike, first: ArrayLike, second: ArrayLike, start_s: float, bandwidth_Hz: float | None = 50.0
) -> float:
    """Largest difference [m/s2] of two runs of the same motion, in the band, from start_s on."""
    late = np.asarray(time_s, dtype=float) >= start_s
    difference = band_limit(time_s, np.asarray(first) - np.asarray(second), bandwidth_Hz)
    return float(np.max(np.abs(difference[late])))
