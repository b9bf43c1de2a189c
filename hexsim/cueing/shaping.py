"""What is done to a vehicle's motion before the washout, by axis: a dead band, a lag, a gain.

    y = gain lag(dead band(x))      dead band: x less the band, towards 0;  lag: T y' = x - y

The numbers may be changed while the platform moves. They go over to the new ones by a lag of `follow_s`, so that a slider
is no jolt: at 3 m/s2 a step of the gain by 0.1 comes in at 0.6 m/s3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.errors import HexsimError

Array = NDArray[np.float64]
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")


@dataclass(frozen=True, kw_only=True)
class AxisShape:
    """gain: of one axis, 0 switches it off, below 0 turns it about. smoothing_s: time constant of the lag. dead_band: what
    is not shown, m/s2 or rad/s."""

    gain: float = 1.0
    smoothing_s: float = 0.0
    dead_band: float = 0.0

    def __post_init__(self) -> None:
        for name, least, largest in (
            ("gain", -5.0, 5.0),
            ("smoothing_s", 0.0, 2.0),
            ("dead_band", 0.0, 10.0),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and least <= value <= largest):
                raise HexsimError(f"axis: {name} is {value}; give a number from {least:g} to {largest:g}")


class Shaping:
    """Of six axes, at `rate_Hz`; as given by the vehicle until `ask` says otherwise."""

    def __init__(self, rate_Hz: float) -> None:
        self._tick_s = 1.0 / rate_Hz
        self._wanted = np.tile(astuple(AxisShape()), (len(AXES), 1))
        self._now = self._wanted.copy()  # gain, lag and dead band of each axis
        self._lagged = np.zeros(len(AXES))

    def ask(self, shapes: Mapping[str, AxisShape]) -> None:
        """Go over to these. shapes: by axis; one that is not named stays. Raises HexsimError for an unknown axis."""
        wanted = self._wanted.copy()
        for axis, shape in shapes.items():
            if axis not in AXES:
                raise HexsimError(f"axis {axis!r} is unknown: give any of {', '.join(AXES)}")
            wanted[AXES.index(axis)] = astuple(shape)
        self._wanted = wanted  # whole at once: another thread reads it

    def step(
        self,
        acceleration: ArrayLike,
        rates: ArrayLike,
        *,
        follow_s: float = 0.5,  # lag by which changed numbers come in
    ) -> Array:
        """The shaped motion (6,) [m/s2, rad/s] for accelerations (3,) and rates (3,)."""
        given = np.concatenate((np.asarray(acceleration, dtype=float), np.asarray(rates, dtype=float)))
        self._now += (self._wanted - self._now) * (self._tick_s / (follow_s + self._tick_s))
        gain, lag_s, band = self._now.T
        beyond = given - np.minimum(np.maximum(given, -band), band)
        self._lagged += (beyond - self._lagged) * (self._tick_s / (lag_s + self._tick_s))
        return gain * self._lagged
