"""Smooth motions through a host's setpoints: Gaussian processes of given lengths, for what no polynomial continues.

    f ~ b_0 + b_1 t + GP(0, exp(-(t - s)^2 / 2 l^2)),  setpoints y_i = f(t_i) + n_i,  n_i ~ rounding

The posterior mean is linear in the setpoints, and its derivatives are those of the kernel. A motion without parts above
about 0.4/l Hz is continued by a tenth of a second where a polynomial of the same points has long turned away; one that is
not band-limited is continued badly, which its errors tell (`host_prediction` weighs by them).
Source: C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2, 2.7, 9.4.
"""

from __future__ import annotations

import numpy as np

from hexsim.compiled import allocating, compiled

# l [s], of motions to 4 and 2 Hz; variance of a setpoint's rounding or noise over the process's: 20 um, 0.6 um and 20 nm of a motion of
# 20 mm. By less the matrix is hardly regular
PROCESSES = np.array([(length_s, nugget) for length_s in (0.1, 0.2) for nugget in (1e-6, 1e-9, 1e-12)])
POINTS = 32  # newest setpoints that a process goes through at most
FEWEST = 4  # and at least
TREND = 2  # terms: place and speed


@allocating
def fit_process(times, motions, n, length_s, nugget, weights, trend):
    """Weights (POINTS, axes) and trend (TREND, axes) of a process through the newest n setpoints of motions (m, 3, axes) at
    times (m,), oldest first, n at most POINTS; both count from the newest. In place; weights without a setpoint become 0."""
    newest, axes = len(times) - 1, motions.shape[2]
    gram, right = np.zeros((n, n)), np.zeros((n, TREND + axes))
    for i in range(n):
        for k in range(i + 1):
            x = (times[newest + 1 - n + i] - times[newest + 1 - n + k]) / length_s
            gram[i, k] = np.exp(-0.5 * x * x)
        gram[i, i] += nugget
        right[i, 0], right[i, 1] = 1.0, (times[newest + 1 - n + i] - times[newest]) / length_s
        for d in range(axes):
            right[i, TREND + d] = motions[newest + 1 - n + i, 0, d] - motions[newest, 0, d]
    solve(gram, right, n)
    normal, found = np.zeros((TREND, TREND)), np.zeros((TREND, axes))
    for i in range(n):
        beyond = (times[newest + 1 - n + i] - times[newest]) / length_s
        for a in range(TREND):
            for b in range(TREND):
                normal[a, b] += beyond**a * right[i, b]
            for d in range(axes):
                found[a, d] += beyond**a * right[i, TREND + d]
    solve(normal, found, TREND)
    for d in range(axes):
        for i in range(POINTS):
            weights[i, d] = (
                right[i, TREND + d] - right[i, 0] * found[0, d] - right[i, 1] * found[1, d] if i < n else 0.0
            )
        trend[0, d], trend[1, d] = found[0, d] + motions[newest, 0, d], found[1, d]


@compiled
def add_process(times, n, weights, trend, length_s, time, share, out):
    """Add to out (3, axes): share (axes,) of position, velocity and acceleration at a time, of a process through
    the first n of the setpoints at these times."""
    beyond = (time - times[n - 1]) / length_s
    for d in range(out.shape[1]):
        out[0, d] += share[d] * (trend[0, d] + beyond * trend[1, d])
        out[1, d] += share[d] * trend[1, d] / length_s
    for i in range(n):
        x = (time - times[i]) / length_s
        value = np.exp(-0.5 * x * x)
        slope, bend = -x / length_s * value, (x * x - 1.0) / length_s**2 * value
        for d in range(out.shape[1]):
            part = share[d] * weights[i, d]
            out[0, d] += part * value
            out[1, d] += part * slope
            out[2, d] += part * bend


@compiled
def solve(gram, right, n):
    """right <- gram^-1 right, by Cholesky's factors of the lower half, in place."""
    for a in range(n):
        for b in range(a + 1):
            value = gram[a, b]
            for k in range(b):
                value -= gram[a, k] * gram[b, k]
            gram[a, b] = np.sqrt(max(value, 1e-30)) if a == b else value / gram[b, b]
    for d in range(right.shape[1]):
        for a in range(n):
            for k in range(a):
                right[a, d] -= gram[a, k] * right[k, d]
            right[a, d] /= gram[a, a]
        for a in range(n - 1, -1, -1):
            for k in range(a + 1, n):
                right[a, d] -= gram[k, a] * right[k, d]
            right[a, d] /= gram[a, a]
