"""What of friction's reversal the valve cannot keep from the load: the oil of the pressure step takes time.

The load rides on the oil: resonance w, damping ratio zeta. Friction reverses by 2 F within `friction_s`, centred on t = 0.
The oil's force for it comes as a ramp over `delivery_s`, `late_s` after that. With S = 2 F/M and r = exp(-zeta w t) sin(w_d
t)/w_d, the integral of the acceleration's response to a step of force,

    a = S [ramp(t - late, delivery) - ramp(t, friction)],    ramp(t, T) = [r(t + T/2) - r(t - T/2)]/T

Linear: that the piston sticks for a moment is not in it. It makes the raw peak smaller than a's, not what is below 50 Hz.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.smoothness.band import band_limit

Array = NDArray[np.float64]


def delivery_s(tick_s: float, spool_Hz: float, travel_V: float, voltage_max_V: float) -> float:
    """Shortest time in which a second-order spool goes from rest to rest over `travel_V`.

    A hold needs two ticks of volts for it; the valve's range takes 2 sqrt(travel/(w^2 range)), full volts one way and back.
    """
    return max(2.0 * tick_s, 2.0 * math.sqrt(travel_V / voltage_max_V) / (2 * math.pi * spool_Hz))


def acceleration(
    time_s: ArrayLike,
    *,
    step_m_s2: float,
    resonance_Hz: float,
    damping_ratio: float,
    delivery_s: float,
    friction_s: float,
    late_s: float = 0.0,
) -> Array:
    """The load's acceleration (n,) beyond the one asked for; step_m_s2: S, of either sign."""
    w = 2 * math.pi * resonance_Hz
    t, w_d = np.asarray(time_s, dtype=float), w * math.sqrt(1.0 - damping_ratio**2)

    def ramp(since: Array, width_s: float) -> Array:
        begun, over = np.maximum(since + 0.5 * width_s, 0.0), np.maximum(since - 0.5 * width_s, 0.0)
        r = [np.exp(-damping_ratio * w * x) * np.sin(w_d * x) / w_d for x in (begun, over)]
        return (r[0] - r[1]) / width_s

    return step_m_s2 * (ramp(t - late_s, delivery_s) - ramp(t, friction_s))


def peak_in_band(**reversal: float) -> float:
    """Largest of `acceleration` below 50 Hz [m/s2], with these arguments."""
    step_s, span_s = 2e-5, 0.6  # of the record that the peak is taken from; a third of it lies before the reversal
    t = np.arange(round(span_s / step_s)) * step_s - span_s / 3
    return float(np.abs(band_limit(t, acceleration(t, **reversal))).max())  # type: ignore[arg-type]
