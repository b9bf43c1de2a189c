"""What a setpoint signal is: one coordinate as a pure function of time, with its exact velocity and acceleration."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, ValidationError

from hexsim.declaration import between, section_of, values_of
from hexsim.errors import HexsimError, shortened
from hexsim.files.toml_files import validation_sentence

Array = NDArray[np.float64]
FadeShape = Literal["linear", "smooth"]

Size = Annotated[float, between(-100.0, 100.0, "[m or rad]")]
Frequency = Annotated[float, between(1e-6, 1e3, "[Hz]")]
Duration = Annotated[float, between(1e-3, 1e5, "[s]")]
Cycles = Annotated[int, Field(ge=1, le=1000)]


class Signal(ABC):
    """One setpoint coordinate, in m or rad, relative to neutral. Subclasses are frozen dataclasses: data, no state.

    `value`, `velocity` and `acceleration` take times of any shape [s] and return that shape. Where a derivative jumps
    they return one of its two sides; the impulse of a jump in the value itself (block) is not in the velocity.
    """

    kind: ClassVar[str]

    @abstractmethod
    def value(self, time_s: ArrayLike) -> Array:
        """Setpoint [m or rad]."""

    @abstractmethod
    def velocity(self, time_s: ArrayLike) -> Array:
        """Exact first derivative [m/s or rad/s]."""

    @abstractmethod
    def acceleration(self, time_s: ArrayLike) -> Array:
        """Exact second derivative [m/s2 or rad/s2]."""

    @property
    def period_s(self) -> float | None:
        """Time after which the signal repeats itself, None where it does not."""
        return None

    @property
    def fundamental_Hz(self) -> float | None:
        """Frequency of the fundamental if the signal is a single sine, else None (see `period_s`)."""
        return None

    def refuse(self, key: str, allowed: str) -> HexsimError:
        return HexsimError(f"signal '{self.kind}': {key} = {shortened(repr(getattr(self, key)))}: {allowed}")

    def __post_init__(self) -> None:
        """Check the fields against the bounds that they carry, and take them as the types that they are declared to be."""
        table = section_of(type(self))
        given = {name: getattr(self, name) for name in table.model_fields}
        try:
            checked = table.model_validate(given)
        except ValidationError as error:
            raise HexsimError(f"signal '{self.kind}': {validation_sentence(error, table)}") from None
        for name, value in values_of(checked).items():
            object.__setattr__(self, name, value)


@dataclass(frozen=True, kw_only=True)
class Faded(Signal):
    """g(t) s(t): a signal faded in over `duration_s`, so that the machine starts at neutral and at rest.

    "linear", as in the report (section 3.3): g = min(t / T, 1). A sine then starts without a jump in velocity,
    but with one in acceleration, 2 A w / T; at the end the velocity jumps by -s(T) / T, which is 0 where T is whole
    half periods, and the acceleration by -2 s'(T) / T.
    "smooth": g = 10 r^3 - 15 r^4 + 6 r^5, r = min(t / T, 1); no jump in velocity or acceleration at either end.
    Before t = 0 the value is 0.
    """

    kind: ClassVar[str] = "faded"
    signal: Signal
    duration_s: Annotated[float, between(1e-6, 1e5, "from nothing to full size [s]")]
    shape: FadeShape = "linear"

    def _gain(self, time_s: ArrayLike) -> tuple[Array, Array, Array]:
        """g and its two derivatives."""
        time = np.asarray(time_s, dtype=float)
        r = np.clip(time / self.duration_s, 0.0, 1.0)
        inside = (time >= 0.0) & (time < self.duration_s)
        if self.shape == "linear":
            return r, inside / self.duration_s, np.zeros_like(r)
        gain = r**3 * (10.0 - 15.0 * r + 6.0 * r**2)
        rate = 30.0 * r**2 * (1.0 - r) ** 2 / self.duration_s
        curvature = 60.0 * r * (1.0 - r) * (1.0 - 2.0 * r) / self.duration_s**2
        return gain, rate, curvature

    def value(self, time_s: ArrayLike) -> Array:
        return self._gain(time_s)[0] * self.signal.value(time_s)

    def velocity(self, time_s: ArrayLike) -> Array:
        gain, rate, _ = self._gain(time_s)
        return rate * self.signal.value(time_s) + gain * self.signal.velocity(time_s)

    def acceleration(self, time_s: ArrayLike) -> Array:
        gain, rate, curvature = self._gain(time_s)
        s, v, a = self.signal.value(time_s), self.signal.velocity(time_s), self.signal.acceleration(time_s)
        return curvature * s + 2.0 * rate * v + gain * a

    @property
    def period_s(self) -> float | None:
        """Of the signal, once faded in."""
        return self.signal.period_s

    @property
    def fundamental_Hz(self) -> float | None:
        """Of the signal, once faded in."""
        return self.signal.fundamental_Hz


def faded(signal: Signal, duration_s: float, shape: FadeShape = "linear") -> Signal:
    """The signal faded in, or the signal itself if `duration_s` is 0."""
    return signal if duration_s == 0.0 else Faded(signal=signal, duration_s=duration_s, shape=shape)


def evaluate(signals: Sequence[Signal], time_s: ArrayLike) -> tuple[Array, Array, Array]:
    """Values, velocities and accelerations of several signals at once, each of shape (..., n_signals)."""
    values = np.stack([signal.value(time_s) for signal in signals], axis=-1)
    velocities = np.stack([signal.velocity(time_s) for signal in signals], axis=-1)
    accelerations = np.stack([signal.acceleration(time_s) for signal in signals], axis=-1)
    return values, velocities, accelerations
