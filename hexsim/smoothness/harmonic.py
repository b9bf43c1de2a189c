"""A sine test taken apart: fundamental, the deviation from it, and the figures of half-hertz noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.errors import HexsimError
from hexsim.smoothness.band import PADDING_PERIODS, Array, BANDWIDTH_Hz, band_limit, sample_rate_Hz
from hexsim.smoothness.reversals import Reversal, ReversalPeak, peaks_at_reversals


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicDeviation:
    """The last whole periods of a record, taken apart: acceleration = mean + fundamental + deviation.

    amplitude, phase_rad: fundamental = amplitude sin(2 pi f t + phase), t as in time_s.
    Arrays (n,): time_s, harmonic, raw (deviation as recorded), band (deviation in `bandwidth_Hz`).
    """

    frequency_Hz: float
    bandwidth_Hz: float | None
    periods: int
    mean: float
    amplitude: float
    phase_rad: float
    time_s: Array
    harmonic: Array
    raw: Array
    band: Array

    def reversals(self) -> tuple[Reversal, ...]:
        """Where the motion of the fundamental turns round: top where its acceleration is smallest."""
        turns = self.frequency_Hz * self.time_s[[0, -1]] + self.phase_rad / (2.0 * np.pi)
        quarters = np.arange(np.ceil(2.0 * turns[0] - 0.5), np.floor(2.0 * turns[1] - 0.5) + 1.0)  # at 1/4 + k/2 turns
        found = []
        for quarter in quarters:
            at = (0.5 * quarter + 0.25 - self.phase_rad / (2.0 * np.pi)) / self.frequency_Hz
            found.append(Reversal(time_s=float(at), end="bottom" if quarter % 2 == 0 else "top"))
        return tuple(found)

    def peaks(self) -> tuple[ReversalPeak, ...]:
        """Largest deviation in the band within 0.2 s of each reversal."""
        return peaks_at_reversals(self.time_s, self.band, self.reversals())


@dataclass(frozen=True, kw_only=True)
class HalfHertzNoise:
    """Figures of the half-hertz noise test; sigma and ratios in the band, peaks raw and in the band.

    fundamental = |A1|; sigma_f = |A1| / sqrt 2; sigma_n = rms(a - mean - a_f);
    sigma_lf = sqrt((|A2|^2 + |A3|^2) / 2); sigma_hf = sqrt(sum_{k >= 4} |A_k|^2 / 2);
    sigma_s = sqrt(sigma_n^2 - sigma_lf^2 - sigma_hf^2), what is not periodic; ratio = sigma / sigma_f;
    peak = max |a - mean - a_f|.
    Ratios are None where there is no fundamental.
    """

    frequency_Hz: float
    bandwidth_Hz: float | None
    periods: int
    fundamental: float
    peak_raw: float
    peak_band: float
    sigma_f: float
    sigma_n: float
    sigma_lf: float
    sigma_hf: float
    sigma_s: float
    ratio_n: float | None
    ratio_lf: float | None
    ratio_hf: float | None


def whole_periods(time: Array, frequency_Hz: float, start_s: float | None) -> tuple[slice, int]:
    """The last whole periods of the record at or after `start_s`, and how many they are (may be 0)."""
    rate = sample_rate_Hz(time)
    first = 0 if start_s is None else int(np.searchsorted(time, start_s - 0.01 / rate))
    available = len(time) - first
    periods = int(np.floor((available + 0.01) * frequency_Hz / rate))
    samples = round(periods * rate / frequency_Hz)
    return slice(len(time) - samples, len(time)), periods


def _amplitudes(
    time: Array, signal: Array, frequency_Hz: float, harmonics: int
) -> tuple[float, NDArray[np.complex128]]:
    """Mean, and complex A_k, k = 1 .. harmonics, of sum Im(A_k exp(j k w t)), by least squares."""
    angle = 2.0 * np.pi * frequency_Hz * time[:, None] * np.arange(1, harmonics + 1)
    columns = np.hstack([np.ones((len(time), 1)), np.sin(angle), np.cos(angle)])
    solution = np.linalg.lstsq(columns, signal, rcond=None)[0]
    return float(solution[0]), solution[1 : harmonics + 1] + 1j * solution[harmonics + 1 :]


def harmonic_deviation(
    time_s: ArrayLike,
    acceleration: ArrayLike,
    frequency_Hz: float,
    bandwidth_Hz: float | None = BANDWIDTH_Hz,
    start_s: float | None = None,
) -> HarmonicDeviation:
    """The last whole periods of `frequency_Hz` at or after `start_s`, as mean, fundamental and deviation.

    The fundamental is fitted by least squares to the raw record (the band does not touch it). The deviation is
    band-limited as a periodic motion: after the end of the record it is continued by what came one period earlier,
    before its beginning by what came one period later, so no end effect is in the figures as long as the motion
    repeats itself (`band_limit` alone would be off by a third of any ringing at the last sample).
    Raises HexsimError where not one whole period is there.
    """
    time, raw = np.asarray(time_s, dtype=float), np.asarray(acceleration, dtype=float)
    if not frequency_Hz > 0.0:
        raise HexsimError(f"frequency_Hz is {frequency_Hz}; it must be greater than 0.")
    part, periods = whole_periods(time, frequency_Hz, start_s)
    if periods < 1:
        length = time[-1] - (time[0] if start_s is None else start_s)
        raise HexsimError(
            f"{max(length, 0.0):.3f} s of record hold no whole period of {frequency_Hz:g} Hz "
            f"({1.0 / frequency_Hz:g} s); run longer or start the analysis earlier."
        )
    mean, amplitudes = _amplitudes(time[part], raw[part], frequency_Hz, 3)
    first = complex(amplitudes[0])
    harmonic = np.imag(first * np.exp(2j * np.pi * frequency_Hz * time))
    deviation = raw - mean - harmonic
    return HarmonicDeviation(
        frequency_Hz=frequency_Hz,
        bandwidth_Hz=bandwidth_Hz,
        periods=periods,
        mean=mean,
        amplitude=abs(first),
        phase_rad=float(np.angle(first)),
        time_s=time[part],
        harmonic=harmonic[part],
        raw=deviation[part],
        band=_periodic_band_limit(time, deviation, part, bandwidth_Hz),
    )


def _periodic_band_limit(time: Array, deviation: Array, part: slice, bandwidth_Hz: float | None) -> Array:
    """The whole periods `part` of a deviation, band-limited with one period's worth of its own on either side.

    Before `part` stands the record itself where it reaches back as far, else the last of the periods.
    """
    whole = deviation[part]
    if bandwidth_Hz is None:
        return whole.copy()
    extra = min(int(np.ceil(2.0 * PADDING_PERIODS * sample_rate_Hz(time) / bandwidth_Hz)), len(whole))
    earlier = deviation[part.start - extra : part.start] if part.start >= extra else whole[-extra:]
    extended = np.concatenate([earlier, whole, whole[:extra]])
    step = (time[-1] - time[0]) / (len(time) - 1)
    return band_limit(step * np.arange(len(extended)), extended, bandwidth_Hz)[extra : extra + len(whole)]


def half_hertz_noise(
    time_s: ArrayLike,
    acceleration: ArrayLike,
    frequency_Hz: float,
    bandwidth_Hz: float | None = BANDWIDTH_Hz,
    start_s: float | None = None,
) -> HalfHertzNoise:
    """Noise figures of a sine test over whole periods; formulas in `HalfHertzNoise`, cutting in `harmonic_deviation`.

    Limits: with one period everything is a harmonic and sigma_s is 0; where the sample rate is no multiple of the
    frequency, whole periods are whole to half a sample, and the harmonics leak by as much into sigma_s.
    """
    part = harmonic_deviation(time_s, acceleration, frequency_Hz, bandwidth_Hz, start_s)
    spectrum = 2.0 / len(part.band) * np.abs(np.fft.rfft(part.band))
    harmonics = spectrum[part.periods :: part.periods]  # k = 1, 2, ...
    sigma_f = float(part.amplitude / np.sqrt(2.0))
    sigma_n = float(np.sqrt(np.mean(part.band**2)))
    sigma_lf = float(np.sqrt(0.5 * np.sum(harmonics[1:3] ** 2)))
    sigma_hf = float(np.sqrt(0.5 * np.sum(harmonics[3:] ** 2)))
    sigma_s = float(np.sqrt(max(sigma_n**2 - sigma_lf**2 - sigma_hf**2, 0.0)))
    peak_raw, peak_band = float(np.max(np.abs(part.raw))), float(np.max(np.abs(part.band)))

    def per(value: float, reference: float) -> float | None:
        return value / reference if reference > 1e-12 else None

    return HalfHertzNoise(
        frequency_Hz=frequency_Hz,
        bandwidth_Hz=bandwidth_Hz,
        periods=part.periods,
        fundamental=part.amplitude,
        peak_raw=peak_raw,
        peak_band=peak_band,
        sigma_f=sigma_f,
        sigma_n=sigma_n,
        sigma_lf=sigma_lf,
        sigma_hf=sigma_hf,
        sigma_s=sigma_s,
        ratio_n=per(sigma_n, sigma_f),
        ratio_lf=per(sigma_lf, sigma_f),
        ratio_hf=per(sigma_hf, sigma_f),
    )


def describing_function(
    time_s: ArrayLike, response: ArrayLike, commanded: ArrayLike, frequency_Hz: float, start_s: float | None = None
) -> complex:
    """H(j w) = A1 / A1 commanded, over whole periods: gain abs(H), phase np.angle(H) (negative: later).

    Response and command in the same quantity (both positions, or both accelerations).
    """
    answer = harmonic_deviation(time_s, response, frequency_Hz, None, start_s)
    reference = harmonic_deviation(time_s, commanded, frequency_Hz, None, start_s)
    if not reference.amplitude > 0.0:
        raise HexsimError(f"The command has no part at {frequency_Hz:g} Hz; the describing function is not defined.")
    return answer.amplitude / reference.amplitude * complex(np.exp(1j * (answer.phase_rad - reference.phase_rad)))


def frequency_below(frequency_Hz: ArrayLike, values: ArrayLike, level: float) -> float | None:
    """First frequency at which `values` (gain or phase) fall below `level`, linear in log frequency; None where they do not."""
    f, y = np.asarray(frequency_Hz, dtype=float), np.asarray(values, dtype=float)
    falls = np.flatnonzero((y[:-1] >= level) & (y[1:] < level))
    if not len(falls):
        return None
    k = falls[0]
    return float(f[k] * (f[k + 1] / f[k]) ** ((y[k] - level) / (y[k] - y[k + 1])))
