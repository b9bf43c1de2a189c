"""What a compensator's fit of bristles is told by reversals of known bristles."""

from __future__ import annotations

import numpy as np
from designs import usual

from compensation.adaptive.layout import PRESLIDING, REACH
from compensation.adaptive.presliding import add_to_presliding, bristle, update_presliding
from compensation.arithmetic import push


def length_found_m(length_m: float, inertia: float, reversals: int, seed: int) -> float:
    """Length [m] found by reversals at 0.5 m/s2: 50 kPa of half step fed all at once, 4 kPa and 3 um of noise. inertia:
    pressure of an acceleration [Pa s2/m]."""
    rng, p, deviation = np.random.default_rng(seed), usual(PRESLIDING), np.zeros(2 * REACH + 1)
    for _ in range(reversals):
        s = -1.0
        for v in 0.5 * 0.002 * np.arange(-REACH, REACH + 1):
            sign, travel_m = float(np.sign(v)), float(abs(v)) * 0.002
            s = bristle(s, sign, travel_m, length_m)
            add_to_presliding(p, sign, travel_m, 0.0, 5e4 * sign)
            push(deviation, 5e4 * (s - sign) + 4e3 * float(rng.normal()))
        update_presliding(p, deviation, rng.normal(0, 3e-6, len(deviation)), inertia, 5e4, 0.002)
    return float(p.length_m)
