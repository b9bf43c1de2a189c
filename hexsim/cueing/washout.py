"""Washout: what a vehicle does, made to fit into the excursions of a platform, tick by tick.

    translation   x'' = HP3(s a),  HP3 = s^3 / ((s^2 + 2 w s + w^2)(s + w_b))     quick part, returns to the middle
    tilt          angle = low-passed(rate limit(LP2(s a) / g))                    slow part: gravity stands in for it
    rotation      rate -> HP1 -> angle                                            quick part of turning
    specific force  f = R^T (a + g e_z)                                           what is felt

Classical washout (Reid and Nahon, UTIAS 307, 1985). Nose up to speed up, left side up to turn left. Filters by the
bilinear rule, from rest. Adaptive washout scales what is quick down as the platform nears its excursion:
s_k = s / (1 + (x_k / (share L_k))^2)^2, so that large manoeuvres keep their shape longer and small ones their size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from hexsim.cueing.shaping import Shaping
from hexsim.errors import HexsimError
from hexsim.files.toml_files import read_toml

Array = NDArray[np.float64]
g = 9.81  # m/s2
SMOOTHING_S = 0.025  # of each of two lags behind the rate limit: one alone leaves steps of angular acceleration


@dataclass(frozen=True, kw_only=True)
class Washout:
    """scale: of accelerations and rates. high_pass_rad_s: w of surge, sway, heave: higher, shorter strokes and less of
    what is felt. back_rad_s: w_b, how fast the platform returns. low_pass_rad_s: below it leaning takes over; about the
    high pass of surge. tilt_rate_rad_s: bound of leaning, 3 deg/s is not felt. turn_rad_s: high pass of rotations.

    adaptive: quick parts give way near `excursion_m`.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")
    scale: float = 0.3
    high_pass_rad_s: tuple[float, float, float] = (2.5, 1.2, 4.0)
    back_rad_s: float = 0.3
    low_pass_rad_s: float = 2.5
    tilt_rate_rad_s: float = math.radians(3.0)
    turn_rad_s: float = 1.0
    adaptive: bool = False
    excursion_m: tuple[float, float, float] = (0.08, 0.08, 0.06)

    def __post_init__(self) -> None:
        numbers = (self.scale, *self.high_pass_rad_s, self.back_rad_s, self.low_pass_rad_s, self.tilt_rate_rad_s)
        if not all(math.isfinite(x) and x > 0 for x in (*numbers, self.turn_rad_s, *self.excursion_m)):
            raise HexsimError("washout: scale, corner frequencies, tilt rate and excursions must be numbers above zero")


def washout_of(name: str) -> Washout:
    """A washout by its name, classical or adaptive, or by a TOML file with some of its parameters.

    Raises HexsimError for an unknown name, key or value.
    """
    if name in ("classical", "adaptive"):
        return Washout(adaptive=name == "adaptive")
    if not name.endswith(".toml"):
        raise HexsimError(f"washout {name!r} is unknown: give classical, adaptive, or a TOML file of its parameters")
    tables = read_toml(Path(name))
    try:
        return TypeAdapter(Washout).validate_python(tables)
    except ValidationError as error:
        first, keys = error.errors(include_url=False)[0], ", ".join(field.name for field in fields(Washout))
        raise HexsimError(f"{name}: {first['loc'][0]}: {first['msg'].lower()}; the keys are {keys}") from None
    except HexsimError as error:
        raise HexsimError(f"{name}: {error}") from None


class _Filter:
    """A continuous filter of n channels by the bilinear rule, direct form II transposed, from rest."""

    def __init__(self, over: ArrayLike, under: ArrayLike, rate_Hz: float) -> None:
        b, a = (np.asarray(row) for row in scipy.signal.bilinear(np.atleast_1d(over), np.atleast_1d(under), rate_Hz))
        self.a = a.tolist()  # numbers of Python, as they are used one by one; a[0] is 1
        self.b = [*[0.0] * (len(a) - len(b)), *b.tolist()]
        self.memory = [0.0] * len(a)

    def step(self, value: float) -> float:
        out = self.b[0] * value + self.memory[0]
        for k in range(1, len(self.a)):
            self.memory[k - 1] = self.b[k] * value - self.a[k] * out + self.memory[k]
        return out


class Cueing:
    """A washout at work, at `rate_Hz`. `step` takes a vehicle's motion and gives a pose.

    shaping: what is done to the motion before. asked: its last output times the washout's scale (6,) [m/s2, rad/s].
    """

    def __init__(self, washout: Washout, rate_Hz: float = 500.0) -> None:
        w, self.washout, self.tick_s = washout, washout, 1.0 / rate_Hz
        self.shaping, self.asked = Shaping(rate_Hz), np.zeros(6)
        self._quick = [
            _Filter([1.0, 0.0], np.polymul([1.0, 2.0 * k, k * k], [1.0, w.back_rad_s]), rate_Hz)
            for k in w.high_pass_rad_s
        ]
        low = w.low_pass_rad_s
        self._lean = [_Filter([low**2], [1.0, 2.0 * low, low**2], rate_Hz) for _ in range(2)]
        self._smooth = [_Filter([1.0], np.polymul([SMOOTHING_S, 1.0], [SMOOTHING_S, 1.0]), rate_Hz) for _ in range(2)]
        turn = np.polymul([1.0, w.turn_rad_s], [1.0, w.back_rad_s])
        self._turn = [_Filter([1.0, 0.0], turn, rate_Hz) for _ in range(3)]
        self._tilt, self._place = np.zeros(2), np.zeros(3)

    def step(self, acceleration: ArrayLike, rates: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """Pose (6,) [m, rad] for the vehicle's acceleration (3,) [m/s2] forward, left, up, without gravity, and its rates
        of roll, pitch, yaw (3,) [rad/s]."""
        w, pose = self.washout, np.zeros(6)
        self.asked = w.scale * self.shaping.step(acceleration, rates)
        scaled, turning = self.asked[:3], self.asked[3:]
        for k in range(3):
            share = 1.0 / (1.0 + (self._place[k] / w.excursion_m[k]) ** 2) ** 2 if w.adaptive else 1.0
            pose[k] = self._place[k] = self._quick[k].step(share * float(scaled[k]))
            pose[3 + k] = self._turn[k].step(float(turning[k]))
        most = w.tilt_rate_rad_s * self.tick_s
        for k, (source, axis, sign) in enumerate(((1, 3, 1.0), (0, 4, -1.0))):
            asked = sign * self._lean[k].step(float(scaled[source])) / g
            self._tilt[k] += min(max(asked - self._tilt[k], -most), most)
            pose[axis] += self._smooth[k].step(float(self._tilt[k]))
        return pose


def poses(washout: Washout, accelerations: Array, rates: Array | None = None, rate_Hz: float = 500.0) -> Array:
    """Poses (n, 6) of a whole motion (n, 3)."""
    cueing = Cueing(washout, rate_Hz)
    turning = np.zeros_like(accelerations) if rates is None else rates
    return np.array([cueing.step(*both) for both in zip(accelerations, turning, strict=True)])


def specific_force(rotations: Array, acceleration: Array) -> Array:
    """f = a + R^T g e_z (n, 3), with the acceleration (n, 3) in the platform's frame and its rotations (n, 3, 3)."""
    return acceleration + g * rotations[:, 2, :]
