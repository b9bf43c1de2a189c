"""A learned term: a curve over one signal of the leg, which joins one of its balances."""

from hexsim.compiled import compiled
from hexsim.hydraulics.parameters import LEARNED_KNOTS, LEARNED_TABLE, P

NONE, CONTINUITY, FORCE = 0, 1, 2  # balance that a learned term joins: [m3/s] or [N]
SIGNALS = ("position_m", "velocity_m_s", "valve_V", "pressure_bottom_Pa", "pressure_supply_Pa", "time_s")


@compiled
def curve(p, signal):
    """Value of the learned term: linear between equidistant knots, constant beyond the first and last."""
    place = min(max((signal - p[P.LEARNED_START]) / p[P.LEARNED_STEP], 0.0), LEARNED_KNOTS - 1.000001)
    if not place >= 0.0:  # NaN of a diverging run may not become a place in memory
        return place
    knot = int(place)
    share = place - knot
    return (1.0 - share) * p[LEARNED_TABLE + knot] + share * p[LEARNED_TABLE + knot + 1]


@compiled
def term(p, y, v, volts, P1, Ps, t):
    """The learned curve over its signal, numbered as in SIGNALS."""
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
    return curve(p, signal)
