"""A learned term: a curve over one signal of the leg, or over what of it a low-pass has kept; it joins one of its balances.

tau dm/dt = s - m         m in place of the signal s where the term has a memory; m = s at the start
"""

import numpy as np

from hexsim.compiled import allocating, compiled
from hexsim.hydraulics import friction
from hexsim.hydraulics.parameters import LEARNED_KNOTS, LEARNED_TABLE, P
from hexsim.signals.lag import lag_weights

NONE, CONTINUITY, FORCE = range(3)  # balance that a learned term joins: [m3/s] or [N]
SIGNALS = ("position_m", "velocity_m_s", "valve_V", "pressure_bottom_Pa", "pressure_supply_Pa", "time_s", "speed_m_s")
PLAIN, DIRECTION, PRODUCT = range(3)  # g(s); one g(s) moving out and one moving in; v g(s)
FORMS = ("plain", "direction", "product")
HALF = LEARNED_KNOTS // 2  # knots of each curve of "direction": moving out first


@compiled
def curve(p, signal, first=0, count=LEARNED_KNOTS):
    """Value of the learned term: linear between equidistant knots, `count` from the `first` on, constant beyond them."""
    place = min(max((signal - p[P.LEARNED_START]) / p[P.LEARNED_STEP], 0.0), count - 1.000001)
    if not place >= 0.0:  # NaN of a diverging run may not become a place in memory
        return place
    knot = int(place)
    share = place - knot
    start = LEARNED_TABLE + first + knot
    return (1.0 - share) * p[start] + share * p[start + 1]


@compiled
def signal_of(p, y, v, volts, P1, Ps, t):
    """The signal of the learned term, numbered as in SIGNALS."""
    which = int(p[P.LEARNED_SIGNAL])
    signal = y
    if which == 1:
        signal = v
    elif which == 2:
        signal = volts
    elif which == 3:
        signal = P1
    elif which == 4:
        signal = Ps
    elif which == 5:
        signal = t
    elif which == 6:
        signal = abs(v)
    return signal


@compiled
def memory_rate(p, y, v, volts, P1, Ps, t, memory):
    """dm/dt of a learned term with a memory; 0 of one without."""
    if p[P.LEARNED_MEMORY] <= 0.0:
        return 0.0
    return (signal_of(p, y, v, volts, P1, Ps, t) - memory) / p[P.LEARNED_MEMORY]


@allocating
def memories(p, y, v, volts, P1, Ps, t):
    """m (n,) of every sample of measured signals (n,), straight between samples; zeros of a term without a memory."""
    m = np.zeros(y.shape[0])
    if p[P.LEARNED_MEMORY] <= 0.0:
        return m
    before = m[0] = signal_of(p, y[0], v[0], volts[0], P1[0], Ps[0], t[0])
    for i in range(1, y.shape[0]):
        pole, b0, b1 = lag_weights(p[P.LEARNED_MEMORY], t[i] - t[i - 1])
        now = signal_of(p, y[i], v[i], volts[i], P1[i], Ps[i], t[i])
        m[i], before = pole * m[i - 1] + b0 * now + b1 * before, now
    return m


@compiled
def term(p, y, v, volts, P1, Ps, t, memory=0.0):
    """The learned curve over its signal, or over its memory, in its form; directions change as dry friction's does."""
    signal = memory if p[P.LEARNED_MEMORY] > 0.0 else signal_of(p, y, v, volts, P1, Ps, t)
    if p[P.LEARNED_FORM] == DIRECTION:
        out = 0.5 + 0.5 * friction.direction(v, p[P.SHARPNESS], p[P.ARCTAN_SLOPE])
        return out * curve(p, signal, 0, HALF) + (1.0 - out) * curve(p, signal, HALF, HALF)
    return v * curve(p, signal) if p[P.LEARNED_FORM] == PRODUCT else curve(p, signal)
