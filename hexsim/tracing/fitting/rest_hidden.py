"""What a rest hides of an effect, and what would have to be known better for it to show.

With A the normal matrix of J beside the effect's column and C its inverse, a size has the variance C_ss. Knowing coordinate
j to a variance v instead of C_jj leaves

    C_ss - C_sj^2 (C_jj - v) / C_jj^2

An effect shows from sqrt(least fall of J) standard errors on. Linear about the fit: what bends is off by some tens of a percent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit
from hexsim.tracing.fitting.parameters import Candidate, to_value
from hexsim.tracing.fitting.rest_priors import least_remarkable, prior_precision

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """size: of the effect's first number, below which it would not be named.  times: that over its typical size.

    by: what hides most of it, a declared parameter's key or a nuisance effect, "" where nothing alone does.
    known_to: the share of its half width or ordinary size to which that must be known for the typical size to show; 0 where
    knowing it alone is not enough.
    """

    size: float
    times: float
    by: str = ""
    is_parameter: bool = False
    known_to: float = 0.0


def hidden_of(bare: Fit, A: Array, candidate: Candidate, least: float) -> Hidden | None:
    """What the rest hides of an effect; None where the logs do not see it.

    A: normal matrix of J, the effect's size last.
    least: the fall of J from which it would be named, by the least remarkable size at the least.
    """
    C = np.linalg.pinv(A, rcond=1e-12, hermitian=True)
    number = candidate.effect.parameters[0]
    if C[-1, -1] <= 0.0:
        return None
    error = float(np.sqrt(C[-1, -1]))
    shown = max(error * math.sqrt(least), least_remarkable(candidate))
    size = abs(to_value(number, shown))
    if shown <= 1.0:
        return Hidden(size=size, times=shown)
    known = np.maximum(np.diag(C)[:-1], 1e-300)
    takes = C[-1, :-1] ** 2 / known  # of the variance, by each coordinate
    place = int(np.argmax(takes))
    if takes[place] < (1.0 - rules.SHARPENED**2) * C[-1, -1]:
        return Hidden(size=size, times=shown)
    keys = [prior.key for prior in bare.priors] + [c.label for c in bare.candidates for _ in c.free()]
    spare = takes[place] - (C[-1, -1] - 1.0 / least)  # variance of it that may stay, in shares of what it takes
    known_to = math.sqrt(prior_precision(bare)[place] * known[place] * max(spare, 0.0) / takes[place])
    is_parameter = place < len(bare.priors)
    return Hidden(size=size, times=shown, by=keys[place], is_parameter=is_parameter, known_to=known_to)
