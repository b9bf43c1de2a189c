"""Recursive least squares with exponential forgetting, bounded, in plain floats."""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import mul


@dataclass(slots=True)
class RecursiveLeastSquares:
    """theta of y = phi . theta + noise, the newest data weighing most.

        r = phi C phi,   theta += C phi (y - phi theta) / (lambda + r),   C = (C - C phi phi C / (lambda + r)) / lambda

    or, `directional` (Bittanti, Bolzern, Campi 1990), old data forgotten only in the direction that new data tell of,
    so that what was identified in a large motion is not lost in a small one:

        theta += C phi (y - phi theta) / (1 + r),   C -= C phi phi C / (1 / e + r),   e = lambda - (1 - lambda) / r

    theta: start values (n,); scale: their prior standard deviation (n,), in units of the noise. C starts as
    diag(scale^2) and no diagonal of it may grow beyond that: no covariance wind-up in directions that no data excite.
    """

    theta: list[float]
    scale: list[float]
    memory: float  # samples after which old data weigh 1/e
    directional: bool = False
    forgetting: float = field(init=False)  # lambda
    covariance: list[list[float]] = field(default_factory=list)
    residual: float = 0.0  # mean square of the last 50 or so, each over the variance that theta's own adds to it
    count: int = 0

    def __post_init__(self) -> None:
        self.forgetting = 1.0 - 1.0 / self.memory
        if not self.covariance:
            self.reset_covariance()

    def reset_covariance(self) -> None:
        """Back to the prior covariance, theta as it stands: the next data count as if they were the first."""
        self.covariance = [[s * s if i == j else 0.0 for j in range(len(self.scale))] for i, s in enumerate(self.scale)]
        self.residual, self.count = 0.0, 0

    def shift(self, index: int, source: int, slope: float, offset: float = 0.0) -> None:
        """theta[index] += slope theta[source] + offset: the same fit, in other coordinates."""
        self.theta[index] += slope * self.theta[source] + offset
        c = self.covariance
        c[index] = [a + slope * b for a, b in zip(c[index], c[source], strict=True)]
        for row in c:
            row[index] += slope * row[source]

    def inflate(self, index: int, variance: float) -> None:
        """Add `variance` to that of one parameter, and to the others as they are correlated with it.

        Nothing is added where a variance would exceed its prior.
        """
        c = self.covariance
        slopes = [row[index] / c[index][index] for row in c]
        for i, hi in enumerate(slopes):
            if c[i][i] + variance * hi * hi > self.scale[i] * self.scale[i]:
                return
        for row, hi in zip(c, slopes, strict=True):
            for j, hj in enumerate(slopes):
                row[j] += variance * hi * hj

    def update(self, phi: list[float], y: float) -> float:
        """One sample in; returns its residual before the update."""
        c, theta = self.covariance, self.theta
        cphi = [sum(map(mul, row, phi)) for row in c]
        spread = sum(map(mul, phi, cphi))
        error = y - sum(map(mul, phi, theta))
        gain = 1.0 / ((1.0 if self.directional else self.forgetting) + spread)
        step = error * gain
        for i, ci in enumerate(cphi):
            theta[i] += ci * step
        grow = 1.0
        if self.directional:
            gain = self.forgetting - (1.0 - self.forgetting) / spread if spread > 0.0 else 0.0
            gain /= 1.0 + gain * spread
        else:
            grow = 1.0 / self.forgetting
        for i, ci in enumerate(cphi):
            if (c[i][i] - gain * ci * ci) * grow >= self.scale[i] * self.scale[i]:
                grow, gain = 1.0, max(gain, 0.0)
                break
        positive = True
        for i, ci in enumerate(cphi):
            gi = ci * gain
            row = c[i] = [(a - gi * b) * grow for a, b in zip(c[i], cphi)]  # noqa: B905 (the innermost loop of a tick)
            positive = positive and row[i] > 0.0
        if not positive:  # lost to rounding
            self.reset_covariance()
        self.count += 1
        self.residual += (error * step - self.residual) / min(self.count, 50)
        return error
