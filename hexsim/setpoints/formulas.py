"""Setpoint signals with a formula: constant, sine, block, triangle, multisine, sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from hexsim.declaration import between
from hexsim.setpoints.signal import Array, Duration, Frequency, Signal, Size


@dataclass(frozen=True, kw_only=True)
class Constant(Signal):
    """s = level. Zero by default: a coordinate that is not driven."""

    kind: ClassVar[str] = "constant"
    level: Size = 0.0

    def value(self, time_s: ArrayLike) -> Array:
        return np.full(np.shape(time_s), self.level)

    def velocity(self, time_s: ArrayLike) -> Array:
        return np.zeros(np.shape(time_s))

    def acceleration(self, time_s: ArrayLike) -> Array:
        return np.zeros(np.shape(time_s))


@dataclass(frozen=True, kw_only=True)
class Sine(Signal):
    """s = A sin(2 pi f t + phase)."""

    kind: ClassVar[str] = "sine"
    amplitude: Size
    frequency_Hz: Frequency
    phase_rad: Annotated[float, between(-1e3, 1e3, "[rad]")] = 0.0

    def _angle(self, time_s: ArrayLike) -> Array:
        return 2.0 * np.pi * self.frequency_Hz * np.asarray(time_s, dtype=float) + self.phase_rad

    def value(self, time_s: ArrayLike) -> Array:
        return self.amplitude * np.sin(self._angle(time_s))

    def velocity(self, time_s: ArrayLike) -> Array:
        return 2.0 * np.pi * self.frequency_Hz * self.amplitude * np.cos(self._angle(time_s))

    def acceleration(self, time_s: ArrayLike) -> Array:
        return -((2.0 * np.pi * self.frequency_Hz) ** 2) * self.value(time_s)

    @property
    def period_s(self) -> float:
        return 1.0 / self.frequency_Hz

    @property
    def fundamental_Hz(self) -> float:
        return self.frequency_Hz


@dataclass(frozen=True, kw_only=True)
class Block(Signal):
    """s = A in the first half of each period, -A in the second: the step response, again and again.

    transition_s: in which it goes over, along the quintic A (2 (10 r^3 - 15 r^4 + 6 r^5) - 1), at most half a period; with 0
    it jumps. Of a jump velocity and acceleration are given as 0.
    """

    kind: ClassVar[str] = "block"
    amplitude: Size
    frequency_Hz: Frequency
    transition_s: Annotated[float, between(0.0, 1e5, "[s]")] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.transition_s * self.frequency_Hz > 0.5:
            raise self.refuse("transition_s", f"at most half a period, {0.5 / self.frequency_Hz:g} s, is possible")

    def _place(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Sign of the half period, and the share of its transition that is over."""
        turn = np.mod(self.frequency_Hz * np.asarray(time_s, dtype=float), 1.0)
        half_s = np.mod(turn, 0.5) / self.frequency_Hz
        over = np.minimum(half_s / self.transition_s, 1.0) if self.transition_s else np.ones_like(half_s)
        return np.where(turn < 0.5, 1.0, -1.0), over

    def value(self, time_s: ArrayLike) -> Array:
        sign, r = self._place(time_s)
        return self.amplitude * sign * (2.0 * r**3 * (10.0 - 15.0 * r + 6.0 * r**2) - 1.0)

    def velocity(self, time_s: ArrayLike) -> Array:
        sign, r = self._place(time_s)
        return self.amplitude * sign * 60.0 * (r * (1.0 - r)) ** 2 / (self.transition_s or 1.0)

    def acceleration(self, time_s: ArrayLike) -> Array:
        sign, r = self._place(time_s)
        return self.amplitude * sign * 120.0 * r * (1.0 - r) * (1.0 - 2.0 * r) / (self.transition_s or 1.0) ** 2

    @property
    def period_s(self) -> float:
        return 1.0 / self.frequency_Hz


@dataclass(frozen=True, kw_only=True)
class Triangle(Signal):
    """From 0 up to A, down to -A and back to 0 at the constant speed 4 A f. Acceleration 0 (the corners have none)."""

    kind: ClassVar[str] = "triangle"
    amplitude: Size
    frequency_Hz: Frequency

    def _turn(self, time_s: ArrayLike) -> Array:
        """Where in the period, 0 at the bottom corner, 0.5 at the top corner."""
        return np.mod(self.frequency_Hz * np.asarray(time_s, dtype=float) + 0.25, 1.0)

    def value(self, time_s: ArrayLike) -> Array:
        return self.amplitude * (1.0 - 4.0 * np.abs(self._turn(time_s) - 0.5))

    def velocity(self, time_s: ArrayLike) -> Array:
        speed = 4.0 * self.amplitude * self.frequency_Hz
        return np.where(self._turn(time_s) < 0.5, speed, -speed)

    def acceleration(self, time_s: ArrayLike) -> Array:
        return np.zeros(np.shape(time_s))

    @property
    def period_s(self) -> float:
        return 1.0 / self.frequency_Hz


@dataclass(frozen=True, kw_only=True)
class Multisine(Signal):
    """s = sum_k A_k sin(2 pi f_k t + phi_k), phi_k uniform on 0 to 2 pi from `seed`.

    Periodic if all frequencies are multiples of one (looked for on a grid of 1e-4 Hz and simple fractions).
    """

    kind: ClassVar[str] = "multisine"
    amplitudes: Annotated[tuple[Size, ...], Field(strict=False, min_length=1, max_length=1000)]
    frequencies_Hz: Annotated[tuple[Frequency, ...], Field(strict=False, min_length=1, max_length=1000)]
    seed: Annotated[int, Field(ge=0, description="of the phases")] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.amplitudes) != len(self.frequencies_Hz):
            raise self.refuse("amplitudes", f"give {len(self.frequencies_Hz)}, one for each of frequencies_Hz")

    @cached_property
    def phases_rad(self) -> Array:
        """phi_k (n,)."""
        return np.random.default_rng(self.seed).uniform(0.0, 2.0 * np.pi, len(self.frequencies_Hz))

    def _sum(self, order: int, time_s: ArrayLike) -> Array:
        time = np.asarray(time_s, dtype=float)
        total = np.zeros(time.shape)
        for amplitude, frequency, phase in zip(self.amplitudes, self.frequencies_Hz, self.phases_rad, strict=True):
            omega = 2.0 * np.pi * frequency
            total += amplitude * omega**order * np.sin(omega * time + phase + 0.5 * np.pi * order)
        return total

    def value(self, time_s: ArrayLike) -> Array:
        return self._sum(0, time_s)

    def velocity(self, time_s: ArrayLike) -> Array:
        return self._sum(1, time_s)

    def acceleration(self, time_s: ArrayLike) -> Array:
        return self._sum(2, time_s)

    @property
    def period_s(self) -> float | None:
        # a period is looked for among fractions of this fineness
        parts = [Fraction(f).limit_denominator(10_000) for f in self.frequencies_Hz]
        if any(abs(float(p) - f) > 1e-12 * f for p, f in zip(parts, self.frequencies_Hz, strict=True)):
            return None
        common = Fraction(math.gcd(*(p.numerator for p in parts)), math.lcm(*(p.denominator for p in parts)))
        return float(1 / common)

    @property
    def fundamental_Hz(self) -> float | None:
        return self.frequencies_Hz[0] if len(self.frequencies_Hz) == 1 else None


@dataclass(frozen=True, kw_only=True)
class Sweep(Signal):
    """s = A(t) sin(phi(t)), phi' = 2 pi f(t), f from start to end in `duration_s`; then it stays at the end frequency.

    law: "linear", f = f0 + (f1 - f0) t / T; "log", f = f0 (f1 / f0)^(t / T).
    hold: what stays constant: "position" (A), "velocity" (A ~ 1/f) or "acceleration" (A ~ 1/f^2).
    amplitude: A at t = 0.
    """

    kind: ClassVar[str] = "sweep"
    amplitude: Size
    start_Hz: Frequency
    end_Hz: Frequency
    duration_s: Duration
    law: Literal["linear", "log"] = "linear"
    hold: Literal["position", "velocity", "acceleration"] = "position"

    def _frequency(self, time_s: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """Turns phi / 2 pi, frequency f, and f', f''."""
        time = np.asarray(time_s, dtype=float)
        t = np.clip(time, None, self.duration_s)
        beyond, during = time - t, np.asarray(time < self.duration_s, dtype=np.float64)
        if self.law == "linear" or self.start_Hz == self.end_Hz:
            rate = (self.end_Hz - self.start_Hz) / self.duration_s
            turns, frequency = self.start_Hz * t + 0.5 * rate * t**2, self.start_Hz + rate * t
            return turns + self.end_Hz * beyond, frequency, rate * during, np.zeros_like(t)
        growth = math.log(self.end_Hz / self.start_Hz) / self.duration_s
        frequency: Array = self.start_Hz * np.exp(growth * t)
        turns = self.start_Hz * np.expm1(growth * t) / growth
        return turns + self.end_Hz * beyond, frequency, growth * frequency * during, growth**2 * frequency * during

    def _amplitude(self, f: Array, f1: Array, f2: Array) -> tuple[Array, Array, Array]:
        """A = A0 (f0 / f)^n and its derivatives."""
        n = ("position", "velocity", "acceleration").index(self.hold)
        a: Array = np.asarray(self.amplitude * (self.start_Hz / f) ** n, dtype=float)
        growth = f1 / f
        return a, -n * growth * a, np.asarray(a * (n * (n + 1) * growth**2 - n * f2 / f), dtype=np.float64)

    def value(self, time_s: ArrayLike) -> Array:
        turns, *f = self._frequency(time_s)
        return self._amplitude(*f)[0] * np.sin(2.0 * np.pi * turns)

    def velocity(self, time_s: ArrayLike) -> Array:
        turns, *f = self._frequency(time_s)
        a, a1, _ = self._amplitude(*f)
        phi, omega = 2.0 * np.pi * turns, 2.0 * np.pi * f[0]
        return a1 * np.sin(phi) + a * omega * np.cos(phi)

    def acceleration(self, time_s: ArrayLike) -> Array:
        turns, *f = self._frequency(time_s)
        a, a1, a2 = self._amplitude(*f)
        phi, omega, omega_rate = 2.0 * np.pi * turns, 2.0 * np.pi * f[0], 2.0 * np.pi * f[1]
        return (a2 - a * omega**2) * np.sin(phi) + (2.0 * a1 * omega + a * omega_rate) * np.cos(phi)
