"""What a person feels: thresholds of perception, ISO 2631-1 weighted vibration, jerk.

    translations   deviation of the acceleration from the command, 50 Hz, against the threshold of perception (`threshold`)
    rotations      deviation of the rate, likewise
    weighted rms   ISO 2631-1:1997, annex A: Wk in heave, Wd in surge and sway (seated), We for rotations
    MTVV           its 6.3.1: the largest rms of the weighted acceleration over a running second
    VDV            its 6.3.2: (integral of the weighted acceleration's fourth power over time)^(1/4)

The rms alone misses shocks: by 6.3.3 MTVV counts besides where it exceeds 1.5 times the weighted rms, VDV where it exceeds
1.75 times the weighted rms times T^(1/4).

The command is moved by the delay of the response, which is given apart.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.smoothness.band import band_limit, inner_span_s, sample_rate_Hz
from hexsim.smoothness.reversals import (
    REVERSAL_WINDOW_S,
    peaks_at_reversals,
    response_delay_s,
    reversals_of_velocity,
)
from hexsim.smoothness.threshold import PERCEPTION_m_s2, PERCEPTION_rad_s

WEIGHTING = {"x": "d", "y": "d", "z": "k", "leg": "k", "roll": "e", "pitch": "e", "yaw": "e"}
TRANSITION_Hz_Q = {"k": (12.5, 0.63), "d": (2.0, 0.63), "e": (1.0, 0.63)}  # f3 = f4, Q4
STEP_Hz_Q = {"k": (2.37, 0.91, 3.35, 0.91)}  # f5, Q5, f6, Q6


def weighting(kind: str, frequency_Hz: ArrayLike) -> NDArray[np.complex128]:
    """Complex gain of Wk, Wd or We at frequencies: band limits, acceleration-velocity transition, upward step."""
    s = 2j * math.pi * np.asarray(frequency_Hz, dtype=float)
    low, high = (2 * math.pi * f for f in (0.4, 100.0))  # f1, f2, Butterworth
    gain = s**2 / (s**2 + math.sqrt(2) * low * s + low**2) * high**2 / (s**2 + math.sqrt(2) * high * s + high**2)
    f3, q4 = TRANSITION_Hz_Q[kind]
    w3 = 2 * math.pi * f3
    gain = gain * (1 + s / w3) / (1 + s / (q4 * w3) + (s / w3) ** 2)
    if kind in STEP_Hz_Q:
        f5, q5, f6, q6 = STEP_Hz_Q[kind]
        w5, w6 = 2 * math.pi * f5, 2 * math.pi * f6
        gain = gain * (1 + s / (q5 * w5) + (s / w5) ** 2) / (1 + s / (q6 * w6) + (s / w6) ** 2) * (w5 / w6) ** 2
    return gain


def weighted(time_s: ArrayLike, acceleration: ArrayLike, kind: str) -> NDArray[np.float64]:
    """The frequency-weighted acceleration (n,) [its unit]; kind: k, d or e. By the spectrum, so the record counts as
    periodic: give whole periods, or more than 10 s."""
    values = np.asarray(acceleration, dtype=float)
    gain = weighting(kind, np.fft.rfftfreq(len(values), 1.0 / sample_rate_Hz(time_s)))
    return np.fft.irfft(np.fft.rfft(values - values.mean()) * gain, len(values))


def weighted_rms(time_s: ArrayLike, acceleration: ArrayLike, kind: str) -> float:
    """Root mean square of the frequency-weighted acceleration [its unit], see `weighted`."""
    return float(np.sqrt(np.mean(weighted(time_s, acceleration, kind) ** 2)))


def mtvv(
    time_s: ArrayLike,
    acceleration: ArrayLike,
    kind: str,
    *,
    running_s: float = 1.0,  # integration time of MTVV
) -> float:
    """Maximum transient vibration value [its unit]: the largest weighted rms over a running second, or over a shorter record."""
    square = weighted(time_s, acceleration, kind) ** 2
    width = min(max(round(running_s * sample_rate_Hz(time_s)), 1), len(square))
    sums = np.cumsum(np.r_[0.0, square])
    return float(np.sqrt(np.max(sums[width:] - sums[:-width]) / width))


def vibration_dose(time_s: ArrayLike, acceleration: ArrayLike, kind: str) -> float:
    """Fourth power vibration dose value, VDV [m/s^1.75, rad/s^1.75] of the record; it grows with its duration."""
    values = weighted(time_s, acceleration, kind)
    return float((np.sum(values**4) / sample_rate_Hz(time_s)) ** 0.25)


def felt_figures(
    time_s: ArrayLike,
    axis: str,
    acceleration: ArrayLike,
    command: ArrayLike,
    position: ArrayLike,
    asked: ArrayLike,
    *,
    start_s: float = 0.0,
) -> dict[str, float | None]:
    """Of one axis from `start_s` on: delay_ms of what is felt behind the command, time_felt and reversals_felt (shares
    above the threshold of perception), weighted_rms, mtvv, vdv (ISO 2631-1) and weighted_rms_unwanted (of the deviation), jerk_rms.

    acceleration, command: (n,), felt and asked for; position, asked: (n,) likewise.
    """
    time = np.asarray(time_s, dtype=float)
    begin, end = inner_span_s(time, 50.0)
    inside = (time >= max(start_s, begin)) & (time <= end)
    band, wanted = band_limit(time, acceleration), band_limit(time, command)
    delay = response_delay_s(time[inside], band[inside], wanted[inside]) if np.ptp(wanted[inside]) else 0.0
    late = lambda values: np.interp(time - delay, time, values)  # noqa: E731
    deviation = band - late(wanted)
    deviation = deviation - deviation[inside].mean()
    velocity = np.gradient(np.asarray(asked, dtype=float), time)
    judged, threshold = deviation, PERCEPTION_m_s2.get(axis)
    if threshold is None:
        rate = np.gradient(np.asarray(position, dtype=float), time)
        judged, threshold = band_limit(time, rate) - late(band_limit(time, velocity)), PERCEPTION_rad_s[axis]
    reversals = [one for one in reversals_of_velocity(time, velocity) if one.time_s >= start_s]
    peaks = peaks_at_reversals(time[inside] - delay, judged[inside], reversals, REVERSAL_WINDOW_S)
    kind, felt = WEIGHTING[axis], np.asarray(acceleration, dtype=float)[inside]
    return {
        "delay_ms": 1e3 * delay,
        "time_felt": float(np.mean(np.abs(judged[inside]) > threshold)),
        "reversals_felt": float(np.mean([peak.peak > threshold for peak in peaks])) if peaks else None,
        "weighted_rms": weighted_rms(time[inside], felt, kind),
        "mtvv": mtvv(time[inside], felt, kind),
        "vdv": vibration_dose(time[inside], felt, kind),
        "weighted_rms_unwanted": weighted_rms(time[inside], deviation[inside], kind),
        "jerk_rms": float(np.sqrt(np.mean(np.gradient(band, time)[inside] ** 2))),
    }
