"""Rows of the table of a qualification: figures of one motion, judged by limits whose source is named.

Sources: [S] read in a source, [K] commonly used and not confirmed from a source, none: reported without a limit.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hexsim.qualification import measures
from hexsim.qualification.rig import Motion
from hexsim.smoothness import half_hertz_noise, harmonic_deviation, parasitic, turn_around_check
from hexsim.smoothness.threshold import SOURCE, PERCEPTION_m_s2

ROTATIONS = ("roll", "pitch", "yaw")
NAMES = {"x": "surge x", "y": "sway y", "z": "heave z"}

# where each limit comes from
PART_60 = "[S] 14 CFR Part 60, app. A: within +-0.05 g"
APPLICANT = "[S] 14 CFR Part 60: tolerance is the applicant's; reported"
BENSON = f"[S] threshold of perception, {SOURCE} (3 s bell)"
COMMON_TURN = "[K] commonly used: +-0.05 g, 150 mm p-p at 0.5 Hz"
COMMON_BALANCE = "[K] commonly used: 1.5 deg"
AGARD = "figure after AGARD-AR-144 (formulas [K]); reported"
NO_LIMIT = "no limit known; reported"


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the table. limit None: reported only, and passed is None."""

    test: str
    axis: str
    figure: str
    value: float | None
    unit: str
    limit: float | None = None
    source: str = NO_LIMIT

    @property
    def passed(self) -> bool | None:
        if self.limit is None or self.value is None:
            return None
        return abs(self.value) <= self.limit


def row_of(
    test: str,
    axis: str,
    figure: str,
    value: float | None,
    unit: str,
    limit: float | None = None,
    *,
    source: str = NO_LIMIT,
) -> Row:
    return Row(test=test, axis=NAMES.get(axis, axis), figure=figure, value=value, unit=unit, limit=limit, source=source)


def half_hertz_rows(
    axis: str, motion: Motion, start: float, frequency_Hz: float = 0.5, bandwidth_Hz: float = 50.0
) -> Iterable[Row]:
    """Noise of a sine and parasitic motion in the axes of the same kind that the motion holds."""
    test, unit = "half-hertz noise", "rad/s²" if axis in ROTATIONS else "m/s²"
    noise = half_hertz_noise(motion.time_s, motion.acceleration[axis], frequency_Hz, bandwidth_Hz, start_s=start)
    limit = PERCEPTION_m_s2.get(axis)
    yield row_of(test, axis, "noise ratio r_n", noise.ratio_n, "1", source=AGARD)
    yield row_of(test, axis, "low harmonics r_lf", noise.ratio_lf, "1", source=AGARD)
    yield row_of(test, axis, "high harmonics r_hf", noise.ratio_hf, "1", source=AGARD)
    peak = f"peak, {bandwidth_Hz:g} Hz band"
    yield row_of(test, axis, peak, noise.peak_band, unit, limit, source=BENSON if limit else AGARD)
    like = [other for other in motion.acceleration if other != axis and (other in ROTATIONS) == (axis in ROTATIONS)]
    side = {other: parasitic(motion.time_s, motion.acceleration[other], bandwidth_Hz, start_s=start) for other in like}
    if side:
        worst = max(side, key=side.__getitem__)
        yield row_of(test, axis, f"parasitic peak, in {NAMES.get(worst, worst)}", side[worst], unit, source=AGARD)


def half_hertz_curve(
    axis: str, motion: Motion, start: float, frequency_Hz: float = 0.5, bandwidth_Hz: float = 50.0
) -> dict[str, Any]:
    part = harmonic_deviation(motion.time_s, motion.acceleration[axis], frequency_Hz, bandwidth_Hz, start_s=start)
    return {"time_s": part.time_s, "acceleration": part.harmonic + part.band, "deviation": part.band}


def turn_around_row(
    axis: str, motion: Motion, start: float, frequency_Hz: float = 0.5, bandwidth_Hz: float = 50.0
) -> Row:
    check = turn_around_check(
        motion.time_s, motion.acceleration[axis], frequency_Hz, bandwidth_Hz=bandwidth_Hz, start_s=start
    )
    figure = f"largest deviation, {bandwidth_Hz:g} Hz band"
    return row_of("turn-around", axis, figure, check.peak_m_s2, "m/s²", check.limit_m_s2, source=COMMON_TURN)


def turn_around_curve(
    axis: str, motion: Motion, start: float, frequency_Hz: float = 0.5, bandwidth_Hz: float = 50.0
) -> dict[str, Any]:
    part = harmonic_deviation(motion.time_s, motion.acceleration[axis], frequency_Hz, bandwidth_Hz, start_s=start)
    limit = turn_around_row(axis, motion, start, frequency_Hz, bandwidth_Hz).limit
    return {
        "time_s": part.time_s,
        "harmonic": part.harmonic,
        "acceleration": part.harmonic + part.band,
        "limit": limit,
    }


def leg_balance_row(axis: str, motion: Motion, start: float, frequency_Hz: float = 0.5) -> tuple[Row, np.ndarray]:
    """And the phase of each leg [deg]."""
    spread, phases = measures.leg_balance(
        motion.time_s, motion.leg_setpoints, motion.leg_positions, frequency_Hz, start
    )
    return row_of("leg balance", axis, "largest difference of phase", spread, "deg", 1.5, source=COMMON_BALANCE), phases
