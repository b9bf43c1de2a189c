"""Acceleration of one axis for plots: its reference, the deviation from it raw and in the band, and the peaks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hexsim.errors import HexsimError
from hexsim.smoothness import (
    BANDWIDTH_Hz,
    HarmonicDeviation,
    Reversal,
    ReversalPeak,
    band_limit,
    deviation_from_command,
    harmonic_deviation,
    peaks_at_reversals,
    reversals_of_velocity,
)
from hexsim.smoothness.reversals import REVERSAL_WINDOW_S

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Peak:
    """Largest deviation in the band near one reversal, its sign kept, and when it is."""

    time_s: float
    value: float
    end: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Deviation:
    """From the end of the fade-in to the end of the log, arrays (n,).

    reference: fundamental of the last whole periods, drawn back to the fade-in; or the command (see `reference_is`)
    where the motion is no single sine (0 at rest). raw, band: acceleration - reference, as recorded and in the band.
    """

    time_s: Array
    reference: Array
    reference_is: str
    raw: Array
    band: Array
    peaks: tuple[Peak, ...]
    bandwidth_Hz: float = BANDWIDTH_Hz


def axis_deviation(
    time_s: Array,
    acceleration: Array,
    commanded_acceleration: Array | None,
    commanded_position: Array | None,
    frequency_Hz: float | None,
    figures_from_s: float,
    shown_from_s: float,
) -> Deviation:
    """Deviation from the fundamental where there is one, else from the command.

    commanded_position: of the driven axis, whose reversals are meant.
    """
    late = slice(min(int(np.searchsorted(time_s, shown_from_s - 1e-9)), len(time_s) - 2), None)
    time = time_s[late]
    fit = _fit(time_s, acceleration, frequency_Hz, figures_from_s)
    if fit is not None:
        reference = fit.mean + fit.amplitude * np.sin(2.0 * np.pi * fit.frequency_Hz * time_s + fit.phase_rad)
        raw, reference_is = acceleration - reference, "fundamental"
        band = band_limit(time_s, raw)
        peaks = replace(fit, time_s=time, band=band[late]).peaks()
    else:
        command = np.zeros_like(acceleration) if commanded_acceleration is None else commanded_acceleration
        part = deviation_from_command(time_s, acceleration, command)
        reference, raw, band, reference_is = acceleration - part.raw, part.raw, part.band, "command"
        peaks = peaks_at_reversals(time, band[late], _reversals(time_s, commanded_position, part.delay_s))
    return Deviation(
        time_s=time,
        reference=reference[late],
        reference_is=reference_is,
        raw=raw[late],
        band=band[late],
        peaks=tuple(_placed(time, band[late], peak) for peak in peaks),
    )


def given_deviation(time_s: Array, acceleration: Array, reference: Array) -> Deviation:
    """Deviation from an acceleration that is given, such as a measured one; no delay is taken out."""
    raw = acceleration - reference
    band = band_limit(time_s, raw)
    return Deviation(time_s=time_s, reference=reference, reference_is="given", raw=raw, band=band, peaks=())


def _fit(time_s: Array, acceleration: Array, frequency_Hz: float | None, start_s: float) -> HarmonicDeviation | None:
    """The last whole periods; None where the motion has no period, or not one whole period follows the start."""
    if frequency_Hz is None:
        return None
    try:
        return harmonic_deviation(time_s, acceleration, frequency_Hz, start_s=start_s)
    except HexsimError:
        return None


def _reversals(time_s: Array, commanded_position: Array | None, delay_s: float) -> list[Reversal]:
    """Reversals of the command, moved by the delay of the response."""
    if commanded_position is None or not np.ptp(commanded_position) > 0.0:
        return []
    band_Hz = 20.0  # smooths the steps of a setpoint that is held between control ticks
    velocity = np.gradient(band_limit(time_s, commanded_position, band_Hz), time_s)
    return [replace(found, time_s=found.time_s + delay_s) for found in reversals_of_velocity(time_s, velocity)]


def _placed(time_s: Array, band: Array, peak: ReversalPeak) -> Peak:
    """The peak with the time at which it stands."""
    near = np.flatnonzero(np.abs(time_s - peak.time_s) <= REVERSAL_WINDOW_S + 1e-9)
    at = near[np.argmin(np.abs(band[near] - peak.signed))]
    return Peak(time_s=float(time_s[at]), value=peak.signed, end=peak.end)
