"""What no motion tells: how sharp a number can become at all, and the declared parameters that it trades with.

With A the normal matrix of the logs that there are, prior included, and X_i that of every motion that was tried,

    floor      diag (A + sum X_i X_i')^-1      all of them measured, one after the other
    declared   the parameters whose error goes with the number's there, r^2 of a tenth at least
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.design.information import Hypothesis, shrunk
from hexsim.tracing.fitting.covariance import inverse

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Ceiling:
    """Of each number of a hypothesis: the least error that all motions together leave, and why, in words or ""."""

    errors: tuple[float, ...]
    declared: tuple[str, ...]


def ceiling_of(first: Hypothesis, matrices: Sequence[Array]) -> Ceiling:
    """matrices (k, k): normal matrices of the motions."""
    before, after = inverse(first.known), inverse(first.known + np.sum([np.zeros_like(first.known), *matrices], axis=0))
    variances = np.maximum(np.diag(after), 1e-300)
    share = np.sqrt(variances / np.maximum(np.diag(before), 1e-300))
    together = after**2 / variances[:, None] / variances
    words = []
    for number in first.numbers:
        with_prior = together[number.place, : len(first.fit.priors)]
        most = [j for j in np.argsort(-with_prior)[: rules.FEW] if with_prior[j] > rules.TELLABLE]
        own = [(first.fit.priors[j].key, first.fit.priors[j].half_width) for j in most]
        words.append(" and ".join(f"{key} is declared to {100 * width:.2g} %" for key, width in own))
    return Ceiling(errors=shrunk(first, share), declared=tuple(words))
