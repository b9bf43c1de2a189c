"""The spool on measured volts: the recursions of delay, play and spool, sample by sample."""

from __future__ import annotations

import numpy as np

from hexsim.compiled import allocating
from hexsim.hydraulics import leg as leg_equations
from hexsim.hydraulics import valve
from hexsim.hydraulics.parameters import P

Array = np.ndarray
SETTLED = -float(np.log(np.finfo(float).eps))  # time constants after which a spool stands where it is sent
OF_SPOOL = (  # all of a row that the spool depends on
    P.HYSTERESIS, P.VALVE_DELAY, P.NULL_OFFSET, P.NULL_DRIFT, P.NULL_WARM_UP, P.NULL_WARM_UP_TIME, P.SPOOL_GAIN, P.SPOOL_TRAVEL,
    P.SPOOL_OMEGA, P.SPOOL_DAMPING, P.SPOOL_RATE,
)  # fmt: skip


def at_samples(row: Array, volts: Array, t: Array, rate: float) -> tuple[Array, Array]:
    """Volts that reach the spool and its position at the samples: as volts are held, the mean of both sides."""
    logged, delay = np.ascontiguousarray(volts), row[P.VALVE_DELAY] * rate
    held = leg_equations.valve_volts(logged, row[P.HYSTERESIS], delay, row[P.HYSTERESIS_SPREAD])
    x = spool_positions(row, held, t)
    return held, 0.5 * (x + np.concatenate([x[:1], x[:-1]]))


@allocating
def spool_positions(p, volts, t):
    """Mean spool position [m] from each sample to the next for volts held between samples: midpoints, 5 steps a sample or more."""
    n = volts.shape[0]
    x = np.empty(n)
    omega, damping, limit = p[P.SPOOL_OMEGA], p[P.SPOOL_DAMPING], p[P.SPOOL_RATE]
    place = leg_equations.commanded_spool(p, volts[0], t[0])
    speed = 0.0
    for i in range(n):
        command = leg_equations.commanded_spool(p, volts[i], t[i])
        dt = t[i] - t[i - 1] if i > 0 else t[1] - t[0]
        if omega <= 0.0 or omega * dt > SETTLED:
            x[i], place, speed = command, command, 0.0
            continue
        steps = max(5, int(2.0 * omega * dt))
        h = dt / steps
        x[i] = 0.0
        for _ in range(steps):
            x[i] += 0.5 * place / steps
            drift, push = valve.spool_rates(place, speed, command, omega, damping, limit)
            halfway = place + 0.5 * h * drift, speed + 0.5 * h * push
            drift, push = valve.spool_rates(halfway[0], halfway[1], command, omega, damping, limit)
            place, speed = place + h * drift, speed + h * push
            x[i] += 0.5 * place / steps
    return x
