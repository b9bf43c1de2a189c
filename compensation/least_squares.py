"""Recursive least squares with exponential forgetting, bounded, in plain floats."""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import mul


@dataclass(slots=True)
class RecursiveLeastSquares:
    """theta of y = phi . theta + noise, newest data weighing most.

        r = phi C phi,   theta += C phi (y - phi theta) / (lambda + r),   C = (C - C phi phi C / (lambda + r)) / lambda

    or, `directional` (Bittanti, Bolzern, Campi 1990), old data forgotten only in the direction that new data tell of,
    so that what a large motion taught is not lost in a small one:

        theta += C phi (y - phi theta) / (1 + r),   C -= C phi phi C / (1 / e + r),   e = lambda - (1 - lambda) / r

    theta: start values (n,); scale: their believed spread (n,), in units of the noise: C starts as diag(scale^2) and
    no diagonal of it may grow beyond that, so that old knowledge is kept in directions that no new data excite.
    """

    theta: list[float]
    scale: list[float]
    memory: float  # samples after which old data weigh 1/e
    directional: bool = False
    keep: float = field(init=False)  # lambda
    covariance: list[list[float]] = field(default_factory=list)
    residual: float = 0.0  # mean of the last 50 or so squared residuals, each over what the spread of theta makes of it
    count: int = 0

    def __post_init__(self) -> None:
        self.keep = 1.0 - 1.0 / self.memory
        if not self.covariance:
            self.doubt()

    def doubt(self) -> None:
        """Forget how sure it was: what comes next counts as if it were the first, from where theta stands."""
        self.covariance = [[s * s if i == j else 0.0 for j in range(len(self.scale))] for i, s in enumerate(self.scale)]
        self.residual, self.count = 0.0, 0

    def loosen(self, index: int, variance: float) -> None:
        """Be less sure of one parameter by `variance`, and of those that were found along with it as they hang on it."""
        c = self.covariance
        hang = [row[index] / c[index][index] for row in c]
        for i, hi in enumerate(hang):
            if c[i][i] + variance * hi * hi > self.scale[i] * self.scale[i]:
                return
        for row, hi in zip(c, hang, strict=True):
            for j, hj in enumerate(hang):
                row[j] += variance * hi * hj

    def update(self, phi: list[float], y: float) -> float:
        """Take one sample in; returns its residual before the update."""
        c, theta = self.covariance, self.theta
        cphi = [sum(map(mul, row, phi)) for row in c]
        seen = sum(map(mul, phi, cphi))
        error = y - sum(map(mul, phi, theta))
        gain = 1.0 / ((1.0 if self.directional else self.keep) + seen)
        step = error * gain
        for i, ci in enumerate(cphi):
            theta[i] += ci * step
        grow = 1.0
        if self.directional:
            gain = self.keep - (1.0 - self.keep) / seen if seen > 0.0 else 0.0
            gain /= 1.0 + gain * seen
        else:
            grow = 1.0 / self.keep
        for i, ci in enumerate(cphi):
            if (c[i][i] - gain * ci * ci) * grow >= self.scale[i] * self.scale[i]:
                grow, gain = 1.0, max(gain, 0.0)
                break
        sound = True
        for i, ci in enumerate(cphi):
            gi = ci * gain
            row = c[i] = [(a - gi * b) * grow for a, b in zip(c[i], cphi)]  # noqa: B905 (this is what a tick costs)
            sound = sound and row[i] > 0.0
        if not sound:  # lost to rounding
            self.doubt()
        self.count += 1
        self.residual += (error * step - self.residual) / min(self.count, 50)
        return error
