"""Recursive least squares with exponential forgetting, bounded.

theta of y = phi . theta + noise, the newest data weighing most:

    r = phi C phi,   theta += C phi (y - phi theta) / (lambda + r),   C = (C - C phi phi C / (lambda + r)) / lambda

or, `directional` (Bittanti, Bolzern, Campi 1990), old data forgotten only in the direction that new data tell of, so
that what was identified in a large motion is not lost in a small one:

    theta += C phi (y - phi theta) / (1 + r),   C -= C phi phi C / (1 / e + r),   e = lambda - (1 - lambda) / r

C starts as diag(scale^2) and no diagonal of it may grow beyond that: no covariance wind-up in directions that no data
excite. `residual` is the mean square of the last 50 errors or so, each over the variance that theta's own adds to it.
"""

from __future__ import annotations

from math import sqrt

from ..compiled import compiled


@compiled
def start_fit(fit, theta, scale, memory, directional=False):
    """theta: start values (n,); scale: their prior standard deviation (n,), in units of the noise; memory: samples
    after which old data weigh 1/e."""
    fit.n, fit.directional, fit.memory, fit.forgetting = len(theta), directional, memory, 1.0 - 1.0 / memory
    for i in range(len(theta)):
        fit.theta[i], fit.scale[i] = theta[i], scale[i]
    reset_covariance(fit)


@compiled
def reset_covariance(fit):
    """Back to the prior covariance, theta as it stands: the next data count as if they were the first."""
    for i in range(fit.n):
        for j in range(fit.n):
            fit.covariance[i, j] = fit.scale[i] * fit.scale[i] if i == j else 0.0
    fit.residual, fit.count = 0.0, 0


@compiled
def scale_covariance(fit, share):
    """What is known counts for more: a share of the covariance."""
    for i in range(fit.n):
        for j in range(fit.n):
            fit.covariance[i, j] *= share


@compiled
def shift_fit(fit, index, source, slope, offset):
    """theta[index] += slope theta[source] + offset: the same fit, in other coordinates."""
    fit.theta[index] += slope * fit.theta[source] + offset
    c = fit.covariance
    for j in range(fit.n):
        c[index, j] += slope * c[source, j]
    for i in range(fit.n):
        c[i, index] += slope * c[i, source]


@compiled
def inflate(fit, index, variance):
    """Add `variance` to that of one parameter, and to the others as they are correlated with it.

    Nothing is added where a variance would exceed its prior.
    """
    c, slopes = fit.covariance, fit.work
    for i in range(fit.n):
        slopes[i] = c[i, index] / c[index, index]
    for i in range(fit.n):
        if c[i, i] + variance * slopes[i] * slopes[i] > fit.scale[i] * fit.scale[i]:
            return
    for i in range(fit.n):
        for j in range(fit.n):
            c[i, j] += variance * slopes[i] * slopes[j]


@compiled
def bound_influence(fit, phi, y, noise, errors):
    """Scales phi down where the sample lies further than `errors` standard errors from what was expected (Huber 1964),
    so that what is no part of the model moves theta a bounded way. noise: of a sample; returns y, scaled as well."""
    spread, off = 1.0, y
    for i in range(fit.n):
        off -= phi[i] * fit.theta[i]
        for j in range(fit.n):
            spread += phi[i] * fit.covariance[i, j] * phi[j]
    limit = errors * noise * sqrt(spread)
    if abs(off) <= limit:
        return y
    share = sqrt(limit / abs(off))
    for i in range(fit.n):
        phi[i] *= share
    return share * y


@compiled
def update_fit(fit, phi, y):
    """One sample in; returns its residual before the update."""
    n, c, theta, cphi = fit.n, fit.covariance, fit.theta, fit.work
    spread = explained = 0.0
    for i in range(n):
        cphi[i] = 0.0
        for j in range(n):
            cphi[i] += c[i, j] * phi[j]
        spread += phi[i] * cphi[i]
        explained += phi[i] * theta[i]
    error = y - explained
    gain = 1.0 / ((1.0 if fit.directional else fit.forgetting) + spread)
    step = error * gain
    for i in range(n):
        theta[i] += cphi[i] * step
    grow = 1.0
    if fit.directional:
        gain = fit.forgetting - (1.0 - fit.forgetting) / spread if spread > 0.0 else 0.0
        gain /= 1.0 + gain * spread
    else:
        grow = 1.0 / fit.forgetting
    for i in range(n):
        if (c[i, i] - gain * cphi[i] * cphi[i]) * grow >= fit.scale[i] * fit.scale[i]:
            grow, gain = 1.0, max(gain, 0.0)
            break
    positive = True
    for i in range(n):
        for j in range(n):
            c[i, j] = (c[i, j] - cphi[i] * gain * cphi[j]) * grow
        positive = positive and c[i, i] > 0.0
    if not positive:  # lost to rounding
        reset_covariance(fit)
    fit.count += 1
    fit.residual += (error * step - fit.residual) / min(fit.count, 50)
    return error
