"""What a reading may be off by, in each estimator's own quantity: declared noise, and what the law leaves of a sound leg.

    sigma^2 = noise^2 + resolution^2/12                    of a reading; a count is uniform over its width
    z = y + c P:  sigma_z^2 = sigma_y^2 + (c sigma_P)^2    oil displacement, c = V / (E A1) at mid-stroke

An estimator's error is hypot(its share of these, its model's). The model's errors were measured on legs of 3 um and 4 kPa of
noise: what windows, passages and reversals leave there beyond the noise. They do not grow with it.
"""

from __future__ import annotations

from math import hypot, sqrt

from ..compiled import compiled
from .chambers import compliance_m_Pa

WINDOW_MODEL_M = 2.3e-6  # of the oil that a window or a passage moves, two readings: 5 um with 3 um of noise
LEAK_MODEL_M = 5.4e-6  # of a passage over an overlap by edges that are just identified: 7 um
OIL_MODEL_M = 1.0e-6  # of an oil displacement within a reversal: 3.3 um
LOAD_MODEL_PA = 1.7e3  # of a window's mean load: 2 kPa


@compiled
def position_error_m(settings):
    """Standard deviation of a position."""
    return hypot(settings.position_noise_m, settings.position_resolution_m / sqrt(12.0))


@compiled
def pressure_error_Pa(settings):
    """Standard deviation of a pressure."""
    return hypot(settings.pressure_noise_Pa, settings.pressure_resolution_Pa / sqrt(12.0))


@compiled
def set_noises(s, window):
    """Noise of each estimator but the monitor's, from the settings; window: ticks."""
    settings = s.settings
    position_m, pressure_Pa = position_error_m(settings), pressure_error_Pa(settings)
    oil_m = hypot(position_m, compliance_m_Pa(settings, 0.5 * settings.stroke_m) * pressure_Pa)
    window_m = hypot(sqrt(2.0) * oil_m, WINDOW_MODEL_M)
    for i in range(2):
        s.valve.edges[i].noise_m = window_m
    s.rounding.noise_m, s.leak.noise_m = window_m, hypot(sqrt(2.0) * oil_m, LEAK_MODEL_M)
    s.delay.noise_m = s.friction.presliding.noise_m = hypot(oil_m, OIL_MODEL_M)
    s.friction.stribeck.noise_m = position_m
    s.friction.presliding.noise_Pa = s.friction.stribeck.noise_Pa = s.trust.noise_Pa = pressure_Pa
    load_Pa = pressure_Pa * hypot(1.0, settings.area_ratio) / sqrt(window + 1.0)
    s.friction.noise_MPa = 1e-6 * hypot(load_Pa, LOAD_MODEL_PA)
