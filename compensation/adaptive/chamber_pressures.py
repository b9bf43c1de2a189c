"""The two pressures behind a load pressure: measured, and as the motion asked for will make them.

The load pressure leaves open how high both pressures stand. Their drops set the flow (chambers.py),

    R = (c2 R1 + c1 R2) / (c2 + r c1),     extending R1^2 ~ Ps - P1, R2^2 ~ P2 - Pt; retracting P1 - Pt, Ps - P2

At steady flow R2 = r R1. A differential cylinder has other pressures for either direction, between which both chambers
move together for some ten milliseconds after a reversal; a symmetric one off its middle does a little of it. So the rod
side is carried along with the motion asked for,

    c2 P2' = y_m' - z_m' R2 / (r R),     P1 = pL + r P2

and what the measured one deviates from it is added, low-passed.
"""

from __future__ import annotations

from math import sqrt

from ..arithmetic import push
from ..compiled import compiled
from ..prediction import PREVIEW_TICKS

LEAST_DROP = 0.02  # of the reference drop: lower bound of a pressure drop
DEVIATION_SHARE = 0.06  # low-pass of the measured deviation, a tick


@compiled
def measure_pressures(chambers, bottom_Pa, top_Pa, supply_Pa):
    """One tick: as measured now; the means over the tick past are kept."""
    if chambers.supply_Pa == 0.0:
        chambers.bottom_Pa, chambers.top_Pa = bottom_Pa, top_Pa
        _fill(chambers.tops_Pa, top_Pa)
    chambers.mean_bottom_Pa = 0.5 * (bottom_Pa + chambers.bottom_Pa)
    chambers.mean_top_Pa = 0.5 * (top_Pa + chambers.top_Pa)
    chambers.bottom_Pa, chambers.top_Pa, chambers.supply_Pa = bottom_Pa, top_Pa, supply_Pa


@compiled
def across_Pa(settings, position_m, bottom_Pa, top_Pa):
    """Pressure across the piston as it leaks away from z: (P1 - P2) (w1 + w2 / r)."""
    c1, c2, over = _weights(settings, position_m)
    return (bottom_Pa - top_Pa) * (c1 + c2) / over


@compiled
def edge_roots(settings, supply_Pa, bottom_Pa):
    """R = sqrt(dp / dp_ref) of a single chamber's edges, to the tank and from the supply."""
    return _root(settings, bottom_Pa - settings.tank_pressure_Pa), _root(settings, supply_Pa - bottom_Pa)


@compiled
def pair_roots(settings, position_m, bottom_Pa, top_Pa, supply_Pa):
    """R of the edge pairs, retracting and extending."""
    tank = settings.tank_pressure_Pa
    c1, c2, over = _weights(settings, position_m)
    down = c2 * _root(settings, bottom_Pa - tank) + c1 * _root(settings, supply_Pa - top_Pa)
    up = c2 * _root(settings, supply_Pa - bottom_Pa) + c1 * _root(settings, top_Pa - tank)
    return down / over, up / over


@compiled
def _fill(history, value):
    for i in range(len(history)):
        history[i] = value


@compiled
def _weights(settings, position_m):
    c1 = position_m + settings.pipeline_length_m
    c2 = settings.stroke_m - position_m + settings.pipeline_length_top_m
    return c1, c2, c2 + settings.rod_ratio * c1


@compiled
def _root(settings, drop_Pa):
    drop = drop_Pa / settings.reference_drop_Pa
    return sqrt(drop if drop > LEAST_DROP else LEAST_DROP)


@compiled
def roots_ahead(chambers, settings, reference, oil_m, equivalent_Pa, equivalent_supply_Pa, engaged, shift):
    """R of both edge pairs at the boundary looked at. equivalent_Pa: load there, as of the three-way valve that is alike;
    equivalent_supply_Pa: its supply pressure, low-passed."""
    r, tank, tick_s = settings.rod_ratio, settings.tank_pressure_Pa, settings.tick_s
    m = 1.0 + r**3
    supply = tank + (equivalent_supply_Pa - tank) * m / (1.0 + r)
    load = m * equivalent_Pa + tank * (1.0 - r + m * (settings.area_ratio - 1.0))
    flow, chambers.oil_m = (oil_m - chambers.oil_m) / tick_s, oil_m
    if not engaged:
        chambers.off_Pa = 0.0
        _fill(chambers.tops_Pa, chambers.top_Pa)
        chambers.across_Pa = across_Pa(settings, reference.position_m, chambers.bottom_Pa, chambers.top_Pa)
        return pair_roots(settings, reference.position_m, chambers.bottom_Pa, chambers.top_Pa, supply)
    chambers.off_Pa += DEVIATION_SHARE * (
        chambers.top_Pa - chambers.tops_Pa[PREVIEW_TICKS + shift - 1] - chambers.off_Pa
    )
    top = chambers.tops_Pa[0] + chambers.off_Pa
    chambers.across_Pa = across_Pa(settings, reference.position_m, load + r * top, top)
    roots = pair_roots(settings, reference.position_m, load + r * top, top, supply)
    extends = flow > 0.0
    second = _root(settings, top - tank if extends else supply - top) / (r * roots[1 if extends else 0])
    c2 = (settings.stroke_m - reference.position_m + settings.pipeline_length_top_m) / settings.bulk_modulus_Pa
    push(chambers.tops_Pa, chambers.tops_Pa[0] + tick_s * (reference.velocity_m_s - flow * second) / c2)
    return roots
