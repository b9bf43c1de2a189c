"""A learned term: a curve over one signal of the leg, which joins one of its balances."""

from hexsim.compiled import compiled
from hexsim.hydraulics import friction
from hexsim.hydraulics.parameters import LEARNED_KNOTS, LEARNED_TABLE, P

NONE, CONTINUITY, FORCE = 0, 1, 2  # balance that a learned term joins: [m3/s] or [N]
SIGNALS = ("position_m", "velocity_m_s", "valve_V", "pressure_bottom_Pa", "pressure_supply_Pa", "time_s")
PLAIN, DIRECTION, PRODUCT = 0, 1, 2  # g(s); one g(s) moving out and one moving in; v g(s)
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
def term(p, y, v, volts, P1, Ps, t):
    """The learned curve over its signal, numbered as in SIGNALS, in its form; directions change as dry friction's does."""
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
    if p[P.LEARNED_FORM] == DIRECTION:
        out = 0.5 + 0.5 * friction.direction(v, p[P.SHARPNESS], p[P.ARCTAN_SLOPE])
        return out * curve(p, signal, 0, HALF) + (1.0 - out) * curve(p, signal, HALF, HALF)
    return v * curve(p, signal) if p[P.LEARNED_FORM] == PRODUCT else curve(p, signal)
