"""Cyclic error of a scale: shown = y + A sin(2 pi y/L + phase), amplitude A and pitch L [m], |2 pi A/L| < 1."""

from __future__ import annotations

import numpy as np

from hexsim.compiled import compiled

NEWTON_STEPS = 6  # of the inverse: 1e-12 m at 2 pi A/L = 0.5


@compiled
def rippled(y, amplitude, pitch, phase):
    """What a scale with this ripple shows at y [m], an array or a number."""
    return y + amplitude * np.sin(2.0 * np.pi * y / pitch + phase)


@compiled
def unrippled(shown, amplitude, pitch, phase):
    """Where a scale stands that shows this [m], an array or a number: Newton's steps from what it shows."""
    y, k = shown, 2.0 * np.pi / pitch
    for _ in range(NEWTON_STEPS):
        slope = 1.0 + amplitude * k * np.cos(k * y + phase)
        y = y - (rippled(y, amplitude, pitch, phase) - shown) / np.maximum(slope, 0.1)
    return y
