"""What the fit knows, in an engineer's quantities: each is a function of the leg's parameters, its error by its gradient."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..knowledge import Estimate, Knowledge
from ..records import Record
from .estimator import KNOWN_LEG
from .leg import (
    COULOMB_DN,
    COULOMB_UP,
    DEAD_DN,
    DEAD_UP,
    GAIN_DN,
    GAIN_UP,
    MASS,
    N_NUMBERS,
    PLAY,
    S_TICK,
    STATIC_DN,
    STATIC_UP,
    SUBSTEPS,
    valve_lag_s,
)
from .step import LEAST_SHARE

STEP = 1e-4  # of a standard error: a central difference
# The model's steps are of second order where the valve meets the oil; what is left of them is evenly likely within one. [steps]
STEP_ERROR = 1.0 / math.sqrt(12.0)
LAG = "valve lag"

QUANTITIES: tuple[tuple[str, str, Callable[[np.ndarray], float]], ...] = (
    ("edge, extending", "mV", lambda n: 1e3 * n[DEAD_UP]),
    ("edge, retracting", "mV", lambda n: 1e3 * n[DEAD_DN]),
    (LAG, "ms", lambda n: 1e3 * valve_lag_s(n)),
    ("hysteresis, half width", "mV", lambda n: 1e3 * n[PLAY]),
    ("gain, extending", "%", lambda n: 100.0 * n[GAIN_UP]),
    ("gain, retracting", "%", lambda n: 100.0 * n[GAIN_DN]),
    ("breakaway friction, extending", "N", lambda n: n[COULOMB_UP] + n[STATIC_UP]),
    ("breakaway friction, retracting", "N", lambda n: n[COULOMB_DN] + n[STATIC_DN]),
    ("moved mass", "kg", lambda n: n[MASS]),
)


def knowledge_of(s: Record) -> Knowledge | None:
    """None before the first fit."""
    known, e = s.known, s.expected
    if not known.valid:
        return None
    covariance = max(1.0, *map(float, known.chi2)) * covariance_of(known)
    numbers, found = np.array(known.numbers), []
    for name, unit, of in QUANTITIES:
        slope = gradient(of, numbers, np.sqrt(np.diag(covariance)))
        step = 1e3 * s.sheet[S_TICK] / SUBSTEPS if name == LAG else 0.0
        error = math.hypot(math.sqrt(max(slope @ covariance @ slope, 0.0)), STEP_ERROR * step)
        before = float(np.linalg.norm(slope * s.fit.sd))
        found.append(Estimate(name=name, unit=unit, value=float(of(numbers)), error=error, before=before))
    seen, kept_out = e.halves > 0, s.share == 0.0 and max(known.chi2) > KNOWN_LEG
    return Knowledge(
        estimates=tuple(found),
        expected_m_s2=math.sqrt(e.sigma2 + e.missed2) if seen else math.nan,
        plain_m_s2=math.sqrt(e.bump2) if seen else math.nan,
        engages_m_s2=(0.0 if kept_out else math.sqrt(e.bump2 * (1.0 / LEAST_SHARE - 1.0))) if seen else math.nan,
        share=float(s.share),
    )


def covariance_of(known: Record) -> np.ndarray:
    """(N_NUMBERS, N_NUMBERS) of the parameters, where the leg is one that the model knows."""
    return np.linalg.inv(known.factor @ known.factor.T) * np.outer(known.sd, known.sd)


def gradient(of: Callable[[np.ndarray], float], numbers: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """(N_NUMBERS,) by the parameters."""
    steps = STEP * np.diag(np.maximum(errors, 1e-30))
    return np.array([(of(numbers + steps[k]) - of(numbers - steps[k])) / (2.0 * steps[k, k]) for k in range(N_NUMBERS)])
