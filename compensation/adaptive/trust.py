"""Whether the feed-forward may come in where a motion has small turns: how well compensated reversals do what is asked.

While y_m still lags the setpoint as plain control does (g = 0), small turns of the setpoint are swallowed as plain control
swallows them. With g = 1 they are made, and a compensation that does not know delay, bristles or friction yet makes them
with a bump where plain control has none. So where two reversals of the setpoint came within SHORT_S of late, g waits
for what the pressure lacks about compensated reversals,

    e = rms (F P~ - line) / p1     over the history of a reversal, F means over 5 and 4 ticks; less its noise

as acceleration of the load. It is low-passed from reversal to reversal; below QUIET g rises, above LOUD it falls. Oil that
is much softer than the data sheet's is not delivered in full either. A platform's leg that is told its load does not wait:
legs that lag differently would tilt the platform.

While e is above SURE, the step of friction is spread over more speed, and so over more time the gentler a reversal is. Delay,
bristles and soft oil make it come early or late, which is worst where plain control's bump is least. What is held back is
known, and no part of e. On four-way valves it is not: there hysteresis stayed loud by it.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from ..compiled import compiled
from .layout import REACH

UNKNOWN_M_S2 = 0.4  # e before anything is known
SHARE = 0.45  # low-pass of e, a reversal
QUIET_M_S2, LOUD_RATIO = 0.018, 1.5  # and the noise of a pressure; over it
FILTER = np.convolve(np.full(5, 0.2), np.full(4, 0.25))  # 3 dB down at 33 Hz
NOISE_PA = 4e3 * float(np.linalg.norm(FILTER))  # of F P~
SHORT_S, MEMORY_S = 0.45, 30.0  # between the two reversals of a small turn; for which it is remembered
TURN_M_S = 2e-3  # speed from which the setpoint has turned
UNSURE_S, SURE_M_S2 = 5e-3, 0.1  # speed over which friction's step is spread further, of e above this
LOUDER = 2.0  # e over the least, from which the lag in use goes back to that of the least
FORGOTTEN = 1.1  # with which the least grows, a reversal
SOFT = 0.3  # of the data sheet's compliance: oil softer by this


@compiled
def watch_turns(trust, setpoint_m_s, tick_s):
    """One tick of the setpoint's velocity."""
    trust.since_s += tick_s
    trust.turning_s = max(0.0, trust.turning_s - tick_s)
    if abs(setpoint_m_s) > TURN_M_S:
        if setpoint_m_s * trust.direction < 0.0:
            trust.turning_s = MEMORY_S if trust.since_s < SHORT_S else trust.turning_s
            trust.since_s = 0.0
        trust.direction = setpoint_m_s


@compiled
def unsure_m_s(trust):
    """Speed by which the step of friction is spread further. Friction is passive: where the pressure steps too late the
    piston stands, and what is felt is the acceleration asked for at most; where it steps too early the load is pushed."""
    return UNSURE_S * max(trust.error_m_s2 - SURE_M_S2, 0.0)


@compiled
def trusted_lag_s(trust, valve):
    """Lag to compensate: the one found, or on a four-way valve that of the quietest reversal, where the ones since then are
    much louder: in slow motion lag and null are hardly told apart, and wander together."""
    return trust.lag_s if trust.holds and valve.four_way else valve.lag_s


@compiled
def judge_compensated(trust, deviation_Pa, inertia_Pa, softness, lag_s):
    """A compensated reversal in the history (2 REACH + 1,), made with this lag; softness: of the oil beyond the data
    sheet's, over it."""
    count = 2 * REACH + 2 - len(FILTER)
    middle = 0.5 * (count - 1)
    mean = along = square = 0.0
    for i in range(count):
        value = 0.0
        for j in range(len(FILTER)):
            value += FILTER[j] * deviation_Pa[i + j]
        mean += value / count
        along += (i - middle) * value
        square += value * value
    lever = count * (count * count - 1) / 12.0
    left = (square - count * mean * mean - along * along / lever) / count - NOISE_PA**2
    e = sqrt(max(left, 0.0)) / inertia_Pa
    trust.error_m_s2 += SHARE * (e - trust.error_m_s2)
    quiet = QUIET_M_S2 + NOISE_PA / inertia_Pa
    trust.least_m_s2 *= FORGOTTEN
    if trust.lag_s == 0.0 or e < trust.least_m_s2:
        trust.least_m_s2, trust.lag_s = max(e, quiet), lag_s
    trust.holds = e > LOUDER * trust.least_m_s2
    if softness > SOFT or trust.error_m_s2 > LOUD_RATIO * quiet:
        trust.trusted = False
    elif trust.error_m_s2 < quiet:
        trust.trusted = True
