"""Recursive least squares with exponential forgetting, bounded, in plain floats."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class RecursiveLeastSquares:
    """theta of y = phi . theta + noise, newest data weighing most.

        K = C phi / (lambda + phi C phi),  theta += K (y - phi theta),  C = (C - K phi C) / lambda

    theta: start values (n,); scale: their believed spread (n,), in units of the noise: C starts as diag(scale^2)
    and no diagonal of it may grow beyond that, so that old knowledge is kept in directions that no new data excite.
    """

    theta: list[float]
    scale: list[float]
    memory: float  # samples after which old data weigh 1/e
    covariance: list[list[float]] = field(default_factory=list)
    residual: float = 0.0  # mean of the last 50 or so squared residuals, each over what the spread of theta makes of it
    count: int = 0

    def __post_init__(self) -> None:
        if not self.covariance:
            self.doubt()

    def doubt(self) -> None:
        """Forget how sure it was: what comes next counts as if it were the first, from where theta stands."""
        self.covariance = [[s * s if i == j else 0.0 for j in range(len(self.scale))] for i, s in enumerate(self.scale)]
        self.residual, self.count = 0.0, 0

    def update(self, phi: list[float], y: float) -> float:
        """Take one sample in; returns its residual before the update."""
        c, theta = self.covariance, self.theta
        keep = 1.0 - 1.0 / self.memory
        cphi = [sum([a * b for a, b in zip(row, phi, strict=True)]) for row in c]
        gain = 1.0 / (keep + sum([a * b for a, b in zip(phi, cphi, strict=True)]))
        error = y - sum([a * b for a, b in zip(phi, theta, strict=True)])
        step = error * gain
        for i, ci in enumerate(cphi):
            theta[i] += ci * step
            gi, row = ci * gain, c[i]
            c[i] = [(a - gi * b) for a, b in zip(row, cphi, strict=True)]
        if all([c[i][i] < keep * s * s for i, s in enumerate(self.scale)]):
            grow = 1.0 / keep
            for i, row in enumerate(c):
                c[i] = [a * grow for a in row]
        self.count += 1
        self.residual += (error * step - self.residual) / min(self.count, 50)
        return error
