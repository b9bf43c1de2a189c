"""Figures of the declared loop: stability margins at the valve's command, and what the closed loop does.

    crossover        |L| = 1; phase margin: least angle of L to -180 deg there (pressure feedback gives more than one)
    gain margin      1/|L| where L is real, negative and above -1
    closed loop      piston over setpoint: -3 dB, -90 deg, peak, delay = -phase/(360 f) at DELAY_AT_Hz

The worst loop counts: of every leg, mode of the load and direction (`loop_model`, which says what is left out).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.motion_computer.loop_model import Loop, loops
from hexsim.smoothness import frequency_below

Array = NDArray[np.float64]
DELAY_AT_Hz = 1.0  # where the phase of a loop of a few hertz is still a delay


@dataclass(frozen=True, kw_only=True)
class LoopFigures:
    """None where there is no such frequency. leg, mode from 1; mass_kg that the leg moves in that mode."""

    leg: int
    mode: int
    mass_kg: float
    extends: bool
    is_stable: bool
    gain_margin_dB: float | None
    phase_margin_deg: float | None
    crossover_Hz: float | None  # the highest
    bandwidth_Hz: float | None
    quarter_Hz: float | None
    peak_dB: float
    delay_s: float


def frequencies(
    rate_Hz: float,
    points: int,
    late_s: float,
    *,
    per_turn: int = 8,  # frequencies in a turn of a delay's angle: a crossing of the real axis is never passed over
) -> Array:
    """From 0.05 Hz to just below half of the rate; at least per_turn in each turn of a delay's angle."""
    low, high = 0.05, 0.499 * rate_Hz
    even = np.linspace(low, high, int(per_turn * late_s * high) + 2)
    return np.union1d(np.geomspace(low, high, points), even)


def figures_of(loop: Loop, points: int = 400) -> LoopFigures:
    """All figures of one loop. points: frequencies of its curves."""
    f = frequencies(1.0 / loop.tick_s, points, sum(loop.late_ticks) * loop.tick_s)
    opened, closed = loop.open_response(f), loop.closed_response(f)
    crossings = _where_zero(f, np.abs(opened) - 1.0, lambda at: np.abs(loop.open_response(at)) - 1.0)
    angles = np.degrees(np.angle(loop.open_response(crossings))) if len(crossings) else np.zeros(0)
    real = _where_zero(f, opened.imag, lambda at: loop.open_response(at).imag)
    at_real = loop.open_response(real).real if len(real) else np.zeros(0)
    inside = at_real[(at_real < 0.0) & (at_real > -1.0)]
    gain = 20 * np.log10(np.abs(closed))
    phase = np.degrees(np.unwrap(np.angle(closed)))
    return LoopFigures(
        leg=loop.leg,
        mode=loop.mode,
        mass_kg=loop.mass_kg,
        extends=loop.extends,
        is_stable=loop.is_stable,
        gain_margin_dB=float(-20 * np.log10(-inside.min())) if len(inside) else None,
        phase_margin_deg=float((180.0 - np.abs(angles)).min()) if len(angles) else None,
        crossover_Hz=float(crossings[-1]) if len(crossings) else None,
        bandwidth_Hz=first_below(f, gain, -3.0),
        quarter_Hz=first_below(f, phase, -90.0),
        peak_dB=float(gain.max()),
        delay_s=float(-np.interp(DELAY_AT_Hz, f, phase) / 360.0 / DELAY_AT_Hz),
    )


def _where_zero(
    f: Array,
    values: Array,
    of: Callable[[Array], Array],
    *,
    bisections: int = 12,  # to 1/4096 of the interval between two frequencies
) -> Array:
    """Where `of` changes its sign, from its `values` at f: bisection, for a resonance turns quickly."""
    k = np.flatnonzero(np.diff(np.sign(values)) != 0)
    low, high, sign = f[k], f[k + 1], np.sign(values[k])
    for _ in range(bisections if len(k) else 0):
        middle = np.sqrt(low * high)
        same = np.sign(of(middle)) == sign
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.sqrt(low * high)


def first_below(f: Array, values: Array, level: float) -> float | None:
    """The first frequency at which `values` fall below `level`: f[0] where they begin below it, None where they never do."""
    return float(f[0]) if values[0] < level else frequency_below(f, values, level)


def worst_figures(machine: Machine) -> LoopFigures:
    """The loop with the least phase margin, with the worst of every other figure among all loops."""
    found = [figures_of(loop) for loop in loops(machine)]
    first = min(found, key=lambda one: (one.is_stable, 180.0 if one.phase_margin_deg is None else one.phase_margin_deg))
    return replace(
        first,
        gain_margin_dB=_least(one.gain_margin_dB for one in found),
        bandwidth_Hz=_least(one.bandwidth_Hz for one in found),
        quarter_Hz=_least(one.quarter_Hz for one in found),
        peak_dB=max(one.peak_dB for one in found),
        delay_s=max(one.delay_s for one in found),
    )


def _least(values: Iterable[float | None]) -> float | None:
    return min((value for value in values if value is not None), default=None)


def stability_sentence(
    figures: LoopFigures,
    *,
    low_margin_deg: float = 30.0,  # below: a warning
) -> str:
    """A warning where the loop is unstable or has little phase margin; else empty."""
    where = f"leg {figures.leg}, {'extending' if figures.extends else 'retracting'}, moving {figures.mass_kg:.0f} kg"
    if not figures.is_stable:
        return f"the declared loop is unstable about neutral ({where}): lower its gains, see hexsim tune-loop"
    if figures.phase_margin_deg is not None and figures.phase_margin_deg < low_margin_deg:
        return (
            f"the declared loop has a phase margin of {figures.phase_margin_deg:.0f} deg, below "
            f"{low_margin_deg:g} deg ({where}): lower its gains, see hexsim tune-loop"
        )
    return ""
