"""Cyclic error of a scale: shown = y + A sin(2 pi y/L + phase), amplitude A and pitch L [m], |2 pi A/L| < 1."""

from __future__ import annotations

import numpy as np

from hexsim.compiled import compiled


@compiled
def rippled(y, amplitude, pitch, phase):
    """What a scale with this ripple shows at y [m], an array or a number."""
    return y + amplitude * np.sin(2.0 * np.pi * y / pitch + phase)


def unrippled(
    shown: np.ndarray,
    amplitude: float,
    pitch: float,
    phase: float,
    *,
    near_m: float = 1e-9,  # Newton's step below which the next one is none
    most_steps: int = 8,  # Newton's: each squares the error
) -> np.ndarray:
    """Where a scale stands that shows this (n,) [m]: Newton's steps from what it shows."""
    y, k = shown, 2.0 * np.pi / pitch
    for _ in range(most_steps):
        angle = k * y + phase
        step = (shown - y - amplitude * np.sin(angle)) / np.maximum(1.0 + amplitude * k * np.cos(angle), 0.1)
        y = y + step
        if np.max(np.abs(step)) < near_m:
            break
    return y
