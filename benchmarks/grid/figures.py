"""What a run is judged by: the true acceleration in the 50 Hz band at every commanded reversal.

Bump of a reversal: the largest deviation of the acceleration (50 Hz, zero phase) from the linear answer to the setpoint, from 0.1 s
before the reversal to 0.5 s after it. The linear answer is the least-squares fit of the setpoint's acceleration, late by LATE_S, to
the second half of the run: of a sine the fundamental. Worst late bump: the largest of the second half.
Worse: beyond plain control's bump by 5 % and by 0.03 m/s2, of a reversal after the first volts, be they a probe or of a compensation
that leaves again. While it comes in, the motion goes from plain control's linear answer to the compensated one: a reversal is judged
against the mean of both that fits it best. Where it comes in late, the compensated answer is of the time after it, COMES_IN_S later.
Plain control follows late: its bump is looked for LAG_S longer, so that both have the same reversals in their windows.
Beyond chance: beyond that of plain control with two noises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.signal import butter, sosfiltfilt

from benchmarks.grid.loop import Run
from benchmarks.grid.motions import Motion

OUT_HZ, EVERY = 1e4, 10
BEFORE_S, AFTER_S = 0.1, 0.5
LATE_S = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8)
LAG_S = 0.3  # of plain control, at the smallest loop gain of the draws
COMES_IN_S = 5.0  # until the volts and the linear answer have come in
LEAST_S = 6.0  # of motion that tells a linear answer
MIXTURES = np.linspace(0.0, 1.0, 21)
WORSE_RATIO, WORSE_m_s2 = 1.05, 0.03
LOW_PASS = butter(4, 50.0, fs=OUT_HZ, output="sos")


@lru_cache(maxsize=4)
def asked(motion: Motion) -> np.ndarray:
    """(n, 11): every ms the setpoint's acceleration, late by each of LATE_S, and 1."""
    t, h = np.arange(round(motion.duration_s * OUT_HZ / EVERY)) * EVERY / OUT_HZ, 5e-3
    early = np.arange(-1000, len(t)) * EVERY / OUT_HZ
    path = [motion.path(np.maximum(early + shift, 0.0)) for shift in (-h, 0.0, h)]
    acceleration = (path[0] - 2.0 * path[1] + path[2]) / h**2
    late = [acceleration[1000 - round(1e3 * x) : 1000 - round(1e3 * x) + len(t)] for x in LATE_S]
    return np.stack([*late, np.ones(len(t))]).T


def answer(acceleration: np.ndarray, motion: Motion, since_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration [m/s2] in the 50 Hz band and its linear answer, every ms. since_s: from then on, or of the second half."""
    low, basis = sosfiltfilt(LOW_PASS, acceleration)[::EVERY], asked(motion)
    told = slice(max(len(low) // 2, round(since_s * OUT_HZ / EVERY)), None)
    return low, basis @ np.linalg.lstsq(basis[told], low[told], rcond=1e-6)[0]


def largest(off: np.ndarray, motion: Motion, after_s: float = AFTER_S) -> np.ndarray:
    """(n,) largest |off| about each of the motion's reversals, off every ms."""
    rate, off = OUT_HZ / EVERY, np.abs(off)
    return np.array([off[round((t - BEFORE_S) * rate) : round((t + after_s) * rate)].max() for t in motion.reversals()])


def bumps(run: Run) -> np.ndarray:
    """(n,) bump [m/s2] of each of the motion's reversals."""
    low, linear = answer(run.acceleration_m_s2, run.motion)
    return largest(low - linear, run.motion)


def late(found: np.ndarray, motion: Motion) -> float:
    """Worst bump of the second half."""
    return float(found[motion.reversals() > motion.duration_s / 2].max())


def is_worse(plain: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(n,) whether a bump is beyond plain control's by both margins."""
    return (other > WORSE_RATIO * plain) & (other > plain + WORSE_m_s2)


@dataclass(frozen=True)
class Figures:
    """Of one draw and motion. plain, left: worst late bump without and with compensation [m/s2]."""

    plain: float
    left: float
    reversals: int
    worse: int  # than plain control with the same noise
    beyond: int  # than plain control with either noise
    chance: int  # of plain control with the other noise, worse than with the same
    growth: float  # largest, over plain control with either noise [m/s2]
    engaged_s: float | None

    @property
    def share(self) -> float:
        return self.left / self.plain


def figures(run: Run, plain: Run, again: Run) -> Figures:
    """Compensated, plain with the same noise, plain with another one."""
    return figures_of([each.acceleration_m_s2 for each in (run, plain, again)], run.motion, run.engaged_s, run.acts_s)


def figures_of(accelerations: Sequence[np.ndarray], motion: Motion, engaged_s: float | None, acts_s: float) -> Figures:
    """The same of their accelerations, every 1e-4 s. acts_s: of the first volts."""
    in_s = min((engaged_s or 0.0) + COMES_IN_S, motion.duration_s - LEAST_S)
    low, own = answer(accelerations[0], motion, in_s)
    (first_low, first_linear), (again_low, again_linear) = (answer(one, motion) for one in accelerations[1:])
    made = np.min([largest(low - x * own - (1.0 - x) * first_linear, motion) for x in MIXTURES], axis=0)
    left = np.where(motion.reversals() > in_s, largest(low - own, motion), made)
    off, off_again = first_low - first_linear, again_low - again_linear
    plain, again = largest(off, motion), largest(off_again, motion)
    first, second = (largest(one, motion, AFTER_S + LAG_S) for one in (off, off_again))
    either = np.maximum(first, second)
    acts = motion.reversals() > acts_s
    growth = (made - either)[acts]
    return Figures(
        late(plain, motion), late(left, motion), len(made), int((acts & is_worse(first, made)).sum()),
        int((acts & is_worse(either, made)).sum()), int(is_worse(plain, again).sum()), float(growth.max(initial=0.0)), engaged_s,
    )  # fmt: skip
