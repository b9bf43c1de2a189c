"""Whether the feed-forward may come in where a motion has small turns: how well compensated reversals do what is asked.

While y_m still lags the setpoint as plain control does (g = 0), small turns of the setpoint are swallowed as plain control
swallows them. With g = 1 they are made, and a compensation that does not know delay, bristles or friction yet makes them
with a bump where plain control has none. So where two reversals of the setpoint came within SHORT_S of late, g waits
for what the pressure lacks about compensated reversals,

    e = rms (F P~ - line) / p1     over the history of a reversal, F means over 5 and 4 ticks; less its noise

as acceleration of the load. It is low-passed from reversal to reversal; below QUIET g rises, above LOUD it falls. Oil that
is much softer than the data sheet's is not delivered in full either. A platform's leg that is told its load does not wait:
legs that lag differently would tilt the platform.
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
NOISE_SHARE = float(np.linalg.norm(FILTER))  # of a pressure's noise, in F P~
SHORT_S, MEMORY_S = 0.45, 30.0  # between the two reversals of a small turn; for which it is remembered
TURN_M_S = 2e-3  # speed from which the setpoint has turned
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
def judge_compensated(trust, deviation_Pa, inertia_Pa, softness):
    """A compensated reversal in the history (2 REACH + 1,); softness: of the oil beyond the data sheet's, over it."""
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
    noise_Pa = NOISE_SHARE * trust.noise_Pa
    left = (square - count * mean * mean - along * along / lever) / count - noise_Pa**2
    e = sqrt(max(left, 0.0)) / inertia_Pa
    trust.error_m_s2 += SHARE * (e - trust.error_m_s2)
    quiet = QUIET_M_S2 + noise_Pa / inertia_Pa
    if softness > SOFT or trust.error_m_s2 > LOUD_RATIO * quiet:
        trust.trusted = False
    elif trust.error_m_s2 < quiet:
        trust.trusted = True
