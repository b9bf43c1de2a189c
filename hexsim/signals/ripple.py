"""Cyclic error of a scale: shown = y + A sin(2 pi y/L + phase), amplitude A and pitch L [m], |2 pi A/L| < 1."""

from __future__ import annotations

import numpy as np

from hexsim.compiled import allocating


@allocating
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


def wave_along(
    places: np.ndarray,
    values: np.ndarray,
    *,
    pitches_m: tuple[float, float] = (2e-4, 1e-2),  # of a scale
    cell_m: float = 2e-5,
    n: int = 2**17,  # cells in which a ripple is summed: 0.4 lines a metre between two pitches
) -> tuple[float, float, float]:
    """Pitch [m] and phase of the sine over the places (n,) [m] that takes most of values (n,); how far it stands out.

    Sums over the places have one Fourier transform for all pitches. What stands out: the amplitude over the rms of all pitches'.
    """
    lines = np.fft.rfftfreq(n, cell_m)
    among = (lines > 1.0 / pitches_m[1]) & (lines < 1.0 / pitches_m[0])
    cells = np.clip(np.rint(places / cell_m), 0, n - 1).astype(int)
    wave = np.fft.rfft(np.bincount(cells, weights=values, minlength=n))[among]
    power = np.abs(wave)
    j = int(np.argmax(power))
    level = float(power[j] / max(np.sqrt(np.mean(power**2)), 1e-300))
    return float(1.0 / lines[among][j]), float(np.angle(1j * wave[j])), level  # of A sin: -i A/2 exp(i phase)
