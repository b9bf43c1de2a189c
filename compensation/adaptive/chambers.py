"""Two chambers on a four-way valve, told as one on a three-way valve, so that one law serves both.

With r = A2/A1, pL = P1 - r P2 the load pressure, c1 and c2 the compliances V/(E A) of the chambers as travel:

    F = A1 pL,   z1 = y + c1 P1,  z1' = k x R1,   z2 = y - c2 P2,  z2' = k x R2 / r

Weighed by the stiffness of the chambers, w1 = c2 / (c2 + r c1), both oil displacements make one of the load pressure,

    z = w1 z1 + (1 - w1) z2 = y + c pL,   c = c1 c2 / (c2 + r c1),   z' = k x (w1 R1 + (1 - w1) R2 / r)

in which the mean pressure does not appear: the chambers are springs in series. At steady flow R2 = r R1, and the open edge
pair has the drops (Ps - r Pt - pL) / m extending, (pL + r Ps - Pt) / m retracting, m = 1 + r^3. A three-way valve
with the pressures `equivalent_Pa` gives has the same drops, the same load and, with m c, the same oil.
"""

from __future__ import annotations

import math

from ..compiled import compiled

BISECTIONS, NEWTON_STEPS = 12, 6  # of the inverse
TAIL = 12.0  # roundings below a sharp edge from which next to nothing flows


@compiled
def compliance_m_Pa(settings, position_m):
    """Travel by which the oil is compressed, per pressure: V / (E A1) (Eq. 3.7), or m c of two chambers."""
    c1 = (position_m + settings.pipeline_length_m) / settings.bulk_modulus_Pa
    r = settings.rod_ratio
    if r == 0.0:
        return c1
    c2 = (settings.stroke_m - position_m + settings.pipeline_length_top_m) / settings.bulk_modulus_Pa
    return (1.0 + r**3) * c1 * c2 / (c2 + r * c1)


@compiled
def equivalent_Pa(settings, bottom_Pa, top_Pa, supply_Pa):
    """Bottom and supply pressure of the three-way valve that is alike."""
    r, tank = settings.rod_ratio, settings.tank_pressure_Pa
    if r == 0.0:
        return bottom_Pa, supply_Pa
    m = 1.0 + r**3
    load = bottom_Pa - r * top_Pa
    return (load + r * supply_Pa - tank) / m + tank, (1.0 + r) * (supply_Pa - tank) / m + tank


@compiled
def softplus_V(volts, rounding_V):
    """Opening of one edge, `volts` beyond where it opens: s log(1 + exp(x / s)), or sharp."""
    if abs(volts) >= 30.0 * rounding_V:
        return max(volts, 0.0)
    return rounding_V * math.log1p(math.exp(volts / rounding_V))


@compiled
def pair_flow_m_s(volts, edges, roots, rounding_V):
    """Oil velocity of both edge pairs together: near critical lap either is open, and where their drops differ what one
    lets in is not what the other lets out. edges: retracting, extending; roots: sqrt(dp/dp_ref) of them."""
    into = edges[1].gain_m_s_V * roots[1] * softplus_V(volts - edges[1].dead_band_V, rounding_V)
    return into - edges[0].gain_m_s_V * roots[0] * softplus_V(-volts - edges[0].dead_band_V, rounding_V)


@compiled
def pair_volts(flow_m_s, edges, roots, rounding_V):
    """The inverse of `pair_flow_m_s`, by bisection about that of one sharp edge, and Newton's steps."""
    down, up = edges[0], edges[1]
    gain_up, gain_down = up.gain_m_s_V * roots[1], down.gain_m_s_V * roots[0]
    x = up.dead_band_V + flow_m_s / gain_up if flow_m_s > 0.0 else flow_m_s / gain_down - down.dead_band_V
    low = high = x
    if flow_m_s > 0.0:
        low -= TAIL * rounding_V
        high += 2.0 * gain_down / gain_up * softplus_V(-x - down.dead_band_V, rounding_V) + rounding_V
    else:
        low -= 2.0 * gain_up / gain_down * softplus_V(x - up.dead_band_V, rounding_V) + rounding_V
        high += TAIL * rounding_V
    for step in range(BISECTIONS + NEWTON_STEPS):
        error = pair_flow_m_s(x, edges, roots, rounding_V) - flow_m_s
        if error > 0.0:
            high = x
        else:
            low = x
        near, far = (x - up.dead_band_V) / rounding_V, (-x - down.dead_band_V) / rounding_V
        slope = gain_up / (1.0 + math.exp(min(-near, 50.0))) + gain_down / (1.0 + math.exp(min(-far, 50.0)))
        x = x - error / slope if slope > 0.0 else low
        if step < BISECTIONS or not low <= x <= high:
            x = 0.5 * (low + high)
    return x
