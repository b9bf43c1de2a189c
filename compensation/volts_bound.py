"""The most volts that a declared valve can explain: what the guard holds every algorithm to.

    e = overlap + rounding + half the hysteresis + |null| + (leak + friction's oil) / k        `Context.edge_V`
    S = EDGE_MARGIN e + (GAIN_MARGIN / k + K_d) v + |u_f|                                     of the spool
    |u| <= (1 + 2 (2 zeta / (w T) + 1 / (w T)^2)) S                                           of the volts

e is what stands in the way of the flow at a reversal, k the velocity per volt at half the supply pressure, v the largest speed of
the setpoint of late, K_d and u_f the controller's velocity feedback and feed-forward, which an algorithm may replace. S bounds the
spool that the added volts alone would move, the declared one; while it is within S volts may be larger, by what takes a spool of
frequency w and damping zeta from one edge to the other within T = 2 ms.
"""

from __future__ import annotations

EDGE_MARGIN = 4.0  # an overlap four times as wide as declared is still compensated: worn, or mounted 15 um off
GAIN_MARGIN = 2.0  # on the flow gain: a quarter of the reference drop is left, or half of the discharge coefficient
USUAL_SPOOL_HZ = 60.0  # where none is declared


def edge_V(
    overlap_V: float,
    rounding_V: float,
    hysteresis_V: float,
    null_V: float,
    leak_m_s: float,
    friction_Pa: float,
    compliance_m_Pa: float,
    velocity_gain_m_s_V: float,
    friction_s: float = 3e-3,  # shortest time in which friction's pressure step is given
) -> float:
    """e [V]. overlap_V, rounding_V: the widest of the edges; hysteresis_V: half its width; leak_m_s: of the piston; friction_Pa: the
    step of the load pressure at a reversal; compliance_m_Pa: of the oil at mid-stroke; velocity_gain_m_s_V: k."""
    oil_m_s = leak_m_s + compliance_m_Pa * friction_Pa / friction_s
    return overlap_V + rounding_V + hysteresis_V + abs(null_V) + oil_m_s / velocity_gain_m_s_V


def lead_gain(frequency_Hz: float, damping: float) -> float:
    """Largest volts over the spool that they move, of a spool with this data sheet; 0 Hz: not declared."""
    shortest_s = 2e-3  # in which a spool is moved across an overlap
    turn = 2.0 * 3.141592653589793 * (frequency_Hz or USUAL_SPOOL_HZ) * shortest_s
    return 1.0 + 2.0 * (2.0 * damping / turn + 1.0 / (turn * turn))
