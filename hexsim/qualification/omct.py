"""Objective motion cueing test: what becomes of a vehicle's motion on its way through washout and machine, by frequency.

Ten transfer functions from the vehicle's sine at the pilot's seat to what is felt in the platform, after ICAO 9625, each as
modulus and phase. A rotation's response is the platform's rate over the vehicle's; specific force's is that felt, gravity by
leaning included, over the vehicle's.

The washout is played sample by sample with its own rate limits, at the control rate. The machine is taken as linear, by its
describing function in the same axis; below the lowest frequency tested it is taken as 1, and a leaning's phase as that of the
axis leant about.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hexsim.cueing.washout import Cueing, Washout, g

Array = NDArray[np.float64]
# of the test, five a decade from 0.1 rad/s on, as printed there
FREQUENCIES_rad_s = tuple(round(10.0 ** (k / 5 - 1), 3) for k in range(12))
RATE_rad_s = np.radians(10.0)  # of the vehicle's sine
AXES = ("x", "y", "z", "roll", "pitch", "yaw")
SOURCE = (
    "[K] ICAO 9625 OMCT: frequencies and tests as commonly used, not held against the document; no published number"
)

# number and title; the vehicle's axis; what is felt: an axis
TESTS: tuple[tuple[str, str, str], ...] = (
    ("1 pitch from pitch", "pitch", "pitch"),
    ("2 surge force from pitch", "pitch", "x"),
    ("3 roll from roll", "roll", "roll"),
    ("4 sway force from roll", "roll", "y"),
    ("5 yaw from yaw", "yaw", "yaw"),
    ("6 surge from surge", "x", "x"),
    ("7 pitch from surge", "x", "pitch"),
    ("8 sway from sway", "y", "y"),
    ("9 roll from sway", "y", "roll"),
    ("10 heave from heave", "z", "z"),
)
Response = Callable[[str, float], complex]  # of the machine, by axis and frequency [rad/s]


@dataclass(frozen=True, kw_only=True)
class Point:
    """Modulus of felt over flown (of different quantities: m/s2 per rad/s, or rad/s per m/s2), and phase [deg]."""

    test: str
    frequency_rad_s: float
    modulus: float
    phase_deg: float


def amplitude_at(time_s: Array, values: Array, w: float) -> complex:
    """Complex amplitude of e^{jwt} in whole periods: 2/T int x e^{-jwt} dt, for x = Re(X e^{jwt})."""
    return complex(2.0 * np.mean(values * np.exp(-1j * w * time_s)))


def machine_response(curves: Mapping[str, Mapping[str, Sequence[float | None]]]) -> Response:
    """Gain and phase between those of a battery's describing function, linear in log frequency; beyond its ends: below,
    1 without phase at zero frequency; above, the last point."""

    def response(axis: str, w: float) -> complex:
        curve = curves[axis]
        known = [
            (2.0 * np.pi * f, gain, phase)
            for f, gain, phase in zip(curve["frequency_Hz"], curve["gain_dB"], curve["phase_deg"], strict=True)
            if f is not None and gain is not None and phase is not None
        ]
        frequency, gain, phase = (np.array(column, dtype=float) for column in zip(*known, strict=True))
        if w <= frequency[0]:  # a lag's phase is proportional to frequency, its loss of gain to the square
            share = w / frequency[0]
            return complex(10 ** (share**2 * gain[0] / 20.0) * np.exp(1j * np.radians(share * phase[0])))
        at = np.log(frequency)
        return complex(
            10 ** (np.interp(np.log(w), at, gain) / 20.0) * np.exp(1j * np.radians(np.interp(np.log(w), at, phase)))
        )

    return response


def felt_amplitudes(
    washout: Washout,
    axis: str,
    w: float,
    rate_Hz: float,
    machine: Response,
    *,
    settle_s: float = 20.0,  # of the washout, six times its slowest default constant
    n_periods: int = 2,  # whole ones
    force_m_s2: float = 1.0,  # of the vehicle's sine
) -> tuple[complex, NDArray[np.complex128]]:
    """The vehicle's complex amplitude [m/s2 or rad/s], and the felt ones (6,): specific force, rates."""
    cueing, period = Cueing(washout, rate_Hz), 2.0 * np.pi / w
    settle = np.ceil(settle_s / period) * period
    time = np.arange(round((settle + n_periods * period) * rate_Hz)) / rate_Hz
    place = AXES.index(axis)
    flown = np.zeros((len(time), 6))
    flown[:, place] = (force_m_s2 if place < 3 else RATE_rad_s) * np.sin(w * time)
    poses = np.array([cueing.step(row[:3], row[3:]) for row in flown])
    late = time >= settle
    given = amplitude_at(time[late], flown[late, place], w)
    x = np.array([amplitude_at(time[late], poses[late, k], w) * machine(AXES[k], w) for k in range(6)])
    force = -(w**2) * x[:3]
    force[0] -= g * x[4]  # f = R^T (a + g e_z): pitch is positive nose down,
    force[1] += g * x[3]  # roll left side up
    return given, np.concatenate((force, 1j * w * x[3:])).astype(np.complex128)


def omct(
    washout: Washout,
    rate_Hz: float,
    machine: Response,
    frequencies_rad_s: Sequence[float] = FREQUENCIES_rad_s,
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[Point]:
    """All ten tests at all frequencies."""
    axes = list(dict.fromkeys(axis for _, axis, _ in TESTS))
    points: list[Point] = []
    for n, axis in enumerate(axes):
        for k, w in enumerate(frequencies_rad_s):
            progress((n + k / len(frequencies_rad_s)) / len(axes))
            given, felt = felt_amplitudes(washout, axis, w, rate_Hz, machine)
            for title, flown, shown in TESTS:
                if flown == axis:
                    ratio = felt[AXES.index(shown)] / given
                    points.append(
                        Point(
                            test=title,
                            frequency_rad_s=w,
                            modulus=abs(ratio),
                            phase_deg=float(np.degrees(np.angle(ratio))),
                        )
                    )
    order = [title for title, _, _ in TESTS]
    return sorted(points, key=lambda point: (order.index(point.test), point.frequency_rad_s))
