"""First-order lag of a sampled signal, exact where it is straight between samples.

    tau df/dt + f = s:   f_k = p f_(k-1) + b0 s_k + b1 s_(k-1)
    p = exp(-h/tau),  b0 = 1 - (1 - p) tau/h,  b1 = 1 - p - b0          h: time between samples

Without a lag f = s, and df/dtau = -ds/dt there: a fit may begin at none. The inverse is s = f + tau df/dt.
"""

from __future__ import annotations

import math

from hexsim.compiled import compiled


@compiled
def lag_weights(lag_s, sample_s):
    """p, b0, b1 of a lag [s] at samples so far apart [s]."""
    if lag_s <= 0.0:
        return 0.0, 1.0, 0.0
    p = math.exp(-sample_s / lag_s)
    b0 = 1.0 - (1.0 - p) * lag_s / sample_s
    return p, b0, 1.0 - p - b0


@compiled
def lagged(rows, lag_s, sample_s, memory):
    """Rows (m, n) behind lags (n,) [s], in place. memory (2, n): the sample before, as it was and as it came out."""
    for i in range(rows.shape[1]):
        p, b0, b1 = lag_weights(lag_s[i], sample_s)
        for k in range(rows.shape[0]):
            s = rows[k, i]
            rows[k, i] = p * memory[1, i] + b0 * s + b1 * memory[0, i]
            memory[0, i], memory[1, i] = s, rows[k, i]
