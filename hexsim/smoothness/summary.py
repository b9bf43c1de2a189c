"""The figures of a run that need its command: turn-around check, parasitic motion, and the `axes` of its summary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hexsim.smoothness.band import Array, BANDWIDTH_Hz, band_limit, inner_span_s
from hexsim.smoothness.harmonic import half_hertz_noise, harmonic_deviation, whole_periods
from hexsim.smoothness.reversals import ReversalBump, deviation_from_command, reversal_bumps

ROTATIONS = ("roll", "pitch", "yaw")


@dataclass(frozen=True, kw_only=True)
class TurnAround:
    """Largest deviation from the desired sine in the band, against the limit [m/s2]."""

    peak_m_s2: float
    limit_m_s2: float
    passed: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisMotion:
    """One axis of a run: acceleration (n,), and its command; None, None for an axis that is not driven.

    frequency_Hz: of the commanded motion if that is a single sine, else None. delay_s: of the response, by `summary_axes`.
    """

    acceleration: ArrayLike
    commanded_velocity: ArrayLike | None = None
    commanded_acceleration: ArrayLike | None = None
    frequency_Hz: float | None = None
    delay_s: float = 0.0

    @property
    def driven(self) -> bool:
        return self.commanded_acceleration is not None and self.commanded_velocity is not None


def turn_around_check(
    time_s: ArrayLike,
    acceleration: ArrayLike,
    frequency_Hz: float,
    commanded_amplitude_m_s2: float | None = None,
    limit_m_s2: float = 0.49,  # +-0.05 g; commonly used, the rule leaves the tolerance to the applicant
    bandwidth_Hz: float | None = BANDWIDTH_Hz,
    start_s: float | None = None,
) -> TurnAround:
    """Largest deviation from the desired sine, against a limit (default +-0.05 g, commonly used).

    Desired: the sine of `commanded_amplitude_m_s2` in phase with the response (None: the fundamental of the response
    itself, so an error of amplitude does not count). Compare only runs of 150 mm peak to peak at 0.5 Hz with others'.
    """
    part = harmonic_deviation(time_s, acceleration, frequency_Hz, bandwidth_Hz, start_s)
    missing = 0.0
    if commanded_amplitude_m_s2 is not None and part.amplitude > 0.0:
        missing = 1.0 - commanded_amplitude_m_s2 / part.amplitude
    peak = float(np.max(np.abs(part.band + missing * part.harmonic)))
    return TurnAround(peak_m_s2=peak, limit_m_s2=limit_m_s2, passed=peak <= limit_m_s2)


def parasitic(
    time_s: ArrayLike,
    acceleration: ArrayLike,
    bandwidth_Hz: float | None = BANDWIDTH_Hz,
    start_s: float | None = None,
) -> float:
    """Peak of an axis that is not driven, about its mean, from `start_s` on; bandwidth_Hz None: raw.

    All of it counts, also what is at the driven frequency and the sensor's noise. In the band the ends of the record are
    left out (see `band_limit`).
    """
    time = np.asarray(time_s, dtype=float)
    begin, end = inner_span_s(time, bandwidth_Hz)
    start = time[0] if start_s is None else start_s
    part = band_limit(time, acceleration, bandwidth_Hz)[(time >= max(start, begin)) & (time <= end)]
    return _peak(part - part.mean())


def _peak(deviation: Array) -> float:
    """Largest absolute value; 0 of nothing."""
    return float(np.max(np.abs(deviation), initial=0.0))


def _rms(deviation: Array) -> float:
    """Root mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(deviation**2))) if len(deviation) else 0.0


def summary_axes(
    time_s: ArrayLike,
    axes: Mapping[str, AxisMotion],
    start_s: float = 0.0,
    bandwidth_Hz: float | None = BANDWIDTH_Hz,
) -> dict[str, dict[str, float | None]]:
    """The `axes` of a run's summary: {axis: {figure: value}}, axes "x" ... "yaw" or "leg", from `start_s` on.

    Figures: fundamental, peak_raw, peak_band, noise_rms, bump_pp (suffix _m_s2, or _rad_s2 for rotations), ratio_n,
    ratio_lf, ratio_hf. An axis driven by a single sine is judged against its fundamental; an axis that is not
    driven against that of the first driven sine, and has no ratios (see also `parasitic`). In any other motion, or
    where not one whole period is there, peaks and noise are against the commanded acceleration (moved by the delay of
    the response; none commanded: 0), and fundamental and ratios are None. bump_pp is the largest bump in the band at
    the reversals of the axis, or of the first driven one; None where there is none.
    """
    time = np.asarray(time_s, dtype=float)
    axes = {name: replace(motion, delay_s=_delay(time, motion, bandwidth_Hz, start_s)) for name, motion in axes.items()}
    lead = next((motion for motion in axes.values() if motion.driven), None)
    return {name: _axis_figures(time, name, motion, lead, start_s, bandwidth_Hz) for name, motion in axes.items()}


def _axis_figures(
    time: Array, name: str, motion: AxisMotion, lead: AxisMotion | None, start_s: float, bandwidth_Hz: float | None
) -> dict[str, float | None]:
    unit = "rad_s2" if name in ROTATIONS else "m_s2"
    reference = motion if motion.driven or lead is None else lead
    frequency = reference.frequency_Hz
    acceleration = np.asarray(motion.acceleration, dtype=float)
    command = np.zeros(len(time)) if not motion.driven else np.asarray(motion.commanded_acceleration, dtype=float)
    delay = reference.delay_s
    noise = None
    if frequency is not None and whole_periods(time, frequency, start_s)[1] >= 1:
        noise = half_hertz_noise(time, acceleration, frequency, bandwidth_Hz, start_s)
        peak_raw, peak_band, rms = noise.peak_raw, noise.peak_band, noise.sigma_n
    else:
        part = deviation_from_command(
            time, acceleration, command, bandwidth_Hz=bandwidth_Hz, delay_s=delay, start_s=start_s
        )
        peak_raw, peak_band, rms = _peak(part.raw), _peak(part.band[part.inner]), _rms(part.band[part.inner])
    bumps: tuple[ReversalBump, ...] = ()
    if reference.driven:
        velocity = np.asarray(reference.commanded_velocity, dtype=float)
        bumps = reversal_bumps(
            time, acceleration, velocity, command, bandwidth_Hz=bandwidth_Hz, delay_s=delay, start_s=start_s
        )
    ratios = noise if motion.driven else None
    return {
        f"fundamental_{unit}": None if noise is None else noise.fundamental,
        f"peak_raw_{unit}": peak_raw,
        f"peak_band_{unit}": peak_band,
        f"noise_rms_{unit}": rms,
        "ratio_n": None if ratios is None else ratios.ratio_n,
        "ratio_lf": None if ratios is None else ratios.ratio_lf,
        "ratio_hf": None if ratios is None else ratios.ratio_hf,
        f"bump_pp_{unit}": max((bump.bump_pp for bump in bumps), default=None),
    }


def _delay(time: Array, motion: AxisMotion, bandwidth_Hz: float | None, start_s: float) -> float:
    """Delay of a driven axis behind its command [s]; 0 for one that is not driven."""
    if not motion.driven:
        return 0.0
    command = np.asarray(motion.commanded_acceleration, dtype=float)
    part = deviation_from_command(time, motion.acceleration, command, bandwidth_Hz=bandwidth_Hz, start_s=start_s)
    return part.delay_s
