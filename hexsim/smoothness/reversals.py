"""What happens where the motion turns round: the bump of acceleration at each zero crossing of the velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.smoothness.band import Array, BANDWIDTH_Hz, band_limit, inner_span_s, sample_rate_Hz

REVERSAL_WINDOW_S = 0.2  # either side of a reversal (TU Delft, "high-efficiency-bump-test", 2024)

End = Literal["top", "bottom"]


@dataclass(frozen=True, kw_only=True)
class Reversal:
    """Where a motion turns round: at the top the velocity goes from + to -, at the bottom from - to +."""

    time_s: float
    end: End


@dataclass(frozen=True, kw_only=True)
class ReversalPeak:
    """Largest |deviation| near one reversal, its sign kept in `signed`."""

    time_s: float
    end: End
    peak: float
    signed: float


@dataclass(frozen=True, kw_only=True)
class ReversalBump:
    """Bump at one reversal: d = a - a_commanded, bump_pp = max d - min d, peak = max |d|, in the window about it.

    time_s: of the reversal in the response, delay_s after the command's.
    """

    time_s: float
    delay_s: float
    end: End
    bump_pp: float
    peak: float
    commanded_acceleration: float


@dataclass(frozen=True, kw_only=True, eq=False)
class CommandDeviation:
    """Acceleration less the commanded one (moved by `delay_s`), less the mean: arrays (n,), raw and in the band.

    inner: the samples that are not at an end of the record.
    """

    delay_s: float
    time_s: Array
    raw: Array
    band: Array
    inner: slice


def reversals_of_velocity(
    time_s: ArrayLike,
    velocity: ArrayLike,
    *,
    longest_standstill_s: float = 0.02,  # a commanded velocity at 0 for longer is a rest, not a reversal
) -> tuple[Reversal, ...]:
    """Zero crossings of a (commanded) velocity, interpolated between samples.

    A velocity that stays 0 for more than 0.02 s between the signs is a rest and not counted. Meant for commanded
    velocity: a measured one crosses zero many times at each reversal.
    """
    time, v = np.asarray(time_s, dtype=float), np.asarray(velocity, dtype=float)
    moving = np.flatnonzero(np.abs(v) > 1e-12 * np.max(np.abs(v), initial=0.0))
    found = []
    turning = np.flatnonzero(v[moving[:-1]] * v[moving[1:]] <= 0.0)
    for before, after in zip(moving[turning], moving[turning + 1], strict=True):
        if time[after] - time[before] > longest_standstill_s + time[1] - time[0]:
            continue
        share = v[before] / (v[before] - v[after])
        at = time[before] + share * (time[after] - time[before])
        found.append(Reversal(time_s=float(at), end="top" if v[before] > 0.0 else "bottom"))
    return tuple(found)


def peaks_at_reversals(
    time_s: ArrayLike, deviation: ArrayLike, reversals: Sequence[Reversal], window_s: float = REVERSAL_WINDOW_S
) -> tuple[ReversalPeak, ...]:
    """Largest |deviation| within `window_s` of each reversal whose window lies in the record.

    `deviation`: from the fundamental or from the command, already in the band it is judged in.
    """
    time, d = np.asarray(time_s, dtype=float), np.asarray(deviation, dtype=float)
    peaks = []
    for reversal in reversals:
        near = _window(time, reversal.time_s, window_s)
        if near is not None:
            largest = float(d[near][np.argmax(np.abs(d[near]))])
            peaks.append(ReversalPeak(time_s=reversal.time_s, end=reversal.end, peak=abs(largest), signed=largest))
    return tuple(peaks)


def response_delay_s(
    time_s: ArrayLike,
    response: ArrayLike,
    command: ArrayLike,
    *,
    longest_s: float = 0.5,  # a response later than this is not looked for
    step_s: float = 0.002,  # of the grid on which a delay is looked for
) -> float:
    """How much later the response comes than the command [s], looked for within +-0.5 s.

    The delay whose shifted and scaled command leaves the least squares: the largest correlation coefficient at whole samples,
    2 ms apart, by one FFT, then the exact maximum beside it for a command that is linear between its samples. A
    periodic command has several alike (likeness within 0.01 of the best): of these the one nearest to 0, so it is known
    but for whole periods. 0 if either is constant. One delay for the whole record: a lag that depends on frequency is
    met only on average.
    """
    time = np.asarray(time_s, dtype=float)
    rate = sample_rate_Hz(time)
    a, c = np.asarray(response, dtype=float), np.asarray(command, dtype=float)
    if not np.ptp(a) or not np.ptp(c):
        return 0.0
    reach = int(min(longest_s, 0.25 * (time[-1] - time[0])) * rate)
    if reach < 1:
        return 0.0
    fit = _DelayFit(a, c, reach)
    every = max(1, round(step_s * rate))
    lags = every * np.arange(-(reach // every), reach // every + 1)
    likes = fit.likeness(lags)
    beside = np.concatenate([[-np.inf], likes, [-np.inf]])
    peaks = (likes >= beside[:-2]) & (likes >= beside[2:]) & (likes >= likes.max() - 0.01)
    coarse = lags[peaks][np.argmin(np.abs(lags[peaks]))]
    return float(fit.refined(np.arange(max(coarse - every, -reach), min(coarse + every, reach)))) / rate


class _DelayFit:
    """Correlation of a response (n,) with its command, moved by k samples, over the samples whose moved command is known.

    Of the command c_k moved by k, less its mean, and the response a less its mean: a.c_k by one FFT, |c_k|^2 and c_k.c_k+1 by
    sums of c up to each sample. Between k and k + 1 the moved command is c_k + f (c_k+1 - c_k).
    """

    def __init__(self, response: Array, command: Array, reach: int) -> None:
        n, self.reach = len(command) - 2 * reach, reach
        a, c = response[reach : reach + n], command - command.mean()
        a, size = a - a.mean(), 1 << (len(c) - 1).bit_length()
        spectrum = np.fft.rfft(c, size) * np.conj(np.fft.rfft(a, size))
        begins = reach - np.arange(-reach, reach + 1)  # first sample of the command that is moved by -reach ... reach

        def summed(values: Array, at: NDArray[np.int_]) -> Array:
            total = np.concatenate([[0.0], np.cumsum(values)])
            return total[at + n] - total[at]

        sums = summed(c, begins)
        self.own = float(np.sum(a**2))
        self.product = np.fft.irfft(spectrum, size)[begins]
        self.square = summed(c**2, begins) - sums**2 / n
        self.beside = summed(c[1:] * c[:-1], begins[1:]) - sums[1:] * sums[:-1] / n

    def likeness(self, lags: NDArray[np.int_]) -> Array:
        """Correlation coefficients with the command moved by whole samples; 0 where it is constant."""
        return self._like(self.product[lags + self.reach], self.square[lags + self.reach])

    def _like(self, product: Array, square: Array) -> Array:
        power = self.own * square
        return np.where(power > 0.0, product / np.sqrt(np.maximum(power, np.finfo(float).tiny)), 0.0)

    def refined(self, lags: NDArray[np.int_]) -> float:
        """Where between any of these lags and the next the likeness is largest [samples]: where its derivative by f is 0,
        or at an end."""
        i = lags + self.reach
        p0, p1 = self.product[i], self.product[i + 1] - self.product[i]
        q0, q1 = self.square[i], 2.0 * (self.beside[i] - self.square[i])
        q2 = self.square[i + 1] - 2.0 * self.beside[i] + self.square[i]
        over, under = p0 * q1 - 2.0 * p1 * q0, p1 * q1 - 2.0 * p0 * q2
        share = np.clip(np.divide(over, under, out=np.zeros_like(over), where=under != 0.0), 0.0, 1.0)
        share = np.stack([np.zeros_like(share), share, np.ones_like(share)])
        likes = self._like(p0 + share * p1, q0 + share * (q1 + share * q2))
        best = np.unravel_index(np.argmax(likes), likes.shape)
        return float(lags[best[1]] + share[best])


def deviation_from_command(
    time_s: ArrayLike,
    acceleration: ArrayLike,
    commanded_acceleration: ArrayLike,
    *,
    bandwidth_Hz: float | None = BANDWIDTH_Hz,
    delay_s: float | None = None,
    start_s: float | None = None,
) -> CommandDeviation:
    """d(t) = a(t) - a_commanded(t - delay) less its mean, from `start_s` on; the delay is estimated if not given.

    Both accelerations are limited to the band; before the record the command is taken as its first value. The ends of
    the record lean on padding in the band (see `band_limit`): `CommandDeviation.inner` is the
    rest, and the one to take figures from.
    """
    time, command = np.asarray(time_s, dtype=float), np.asarray(commanded_acceleration, dtype=float)
    late = slice(0 if start_s is None else int(np.searchsorted(time, start_s - 1e-9)), None)
    inner = slice(*np.searchsorted(time[late], inner_span_s(time, bandwidth_Hz)))
    raw, band = np.asarray(acceleration, dtype=float), band_limit(time, acceleration, bandwidth_Hz)
    if delay_s is None:
        delay_s = response_delay_s(time[late], band[late], command[late])
    reference = np.interp(time - delay_s, time, command)
    raw, band = (raw - reference)[late], (band - band_limit(time, reference, bandwidth_Hz))[late]
    raw, band = raw - raw.mean(), band - band.mean()
    return CommandDeviation(delay_s=delay_s, time_s=time[late], raw=raw, band=band, inner=inner)


def reversal_bumps(
    time_s: ArrayLike,
    acceleration: ArrayLike,
    commanded_velocity: ArrayLike,
    commanded_acceleration: ArrayLike,
    *,
    bandwidth_Hz: float | None = BANDWIDTH_Hz,
    window_s: float = REVERSAL_WINDOW_S,
    delay_s: float | None = None,
    start_s: float | None = None,
) -> tuple[ReversalBump, ...]:
    """The bump at every zero crossing of the commanded velocity whose window lies inside the record after `start_s`.

    Arrays (n,), in the units of the axis; bandwidth_Hz None: raw. Reversal and command are moved by the delay of the
    response (estimated if not given). Limits: a response smaller than the command leaves a rest of the command in d,
    for a sine (1 - gain) |a_cmd| (1 - cos(2 pi f window)) of bump; noise of the sensor counts as bump, some 4 to 5
    standard deviations in the band.
    """
    time = np.asarray(time_s, dtype=float)
    command = np.asarray(commanded_acceleration, dtype=float)
    deviation = deviation_from_command(
        time, acceleration, command, bandwidth_Hz=bandwidth_Hz, delay_s=delay_s, start_s=start_s
    )
    bumps = []
    for reversal in reversals_of_velocity(time, commanded_velocity):
        near = _window(deviation.time_s[deviation.inner], reversal.time_s + deviation.delay_s, window_s)
        if near is None:
            continue
        d = deviation.band[deviation.inner][near]
        bumps.append(
            ReversalBump(
                time_s=reversal.time_s + deviation.delay_s,
                delay_s=deviation.delay_s,
                end=reversal.end,
                bump_pp=float(d.max() - d.min()),
                peak=float(np.abs(d).max()),
                commanded_acceleration=float(np.interp(reversal.time_s, time, command)),
            )
        )
    return tuple(bumps)


def _window(time: Array, centre_s: float, window_s: float) -> slice | None:
    """Samples within `window_s` of `centre_s`; None if the window reaches out of the record."""
    if len(time) < 2:
        return None
    tolerance = 0.5 * (time[1] - time[0])
    if centre_s - window_s < time[0] - tolerance or centre_s + window_s > time[-1] + tolerance:
        return None
    first, last = np.searchsorted(time, [centre_s - window_s - 1e-9, centre_s + window_s + 1e-9])
    return slice(int(first), int(last))
