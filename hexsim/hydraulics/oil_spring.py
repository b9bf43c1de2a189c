"""A leg as a spring of oil: its stiffness with the valve shut, and the speed that a volt gives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hexsim.hydraulics import leg, ports, rod_side
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P

Array = NDArray[np.float64]


def oil_stiffness(p: Array) -> float:
    """Oil spring k [N/m] of a leg at mid stroke and half the supply pressure: A1^2/C1, and A2^2/C2 on a four-way valve."""
    middle, pressure = 0.5 * p[P.STROKE], 0.5 * p[P.SUPPLY_PRESSURE]
    stiffness = p[P.AREA_BOTTOM] ** 2 / leg.chamber_capacity(p, middle, pressure)
    if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE:
        stiffness += p[P.AREA_TOP] ** 2 / rod_side.capacity(p, middle, pressure)
    return float(stiffness)


def speed_per_volt(p: Array, bottom_Pa: float) -> float:
    """Piston speed for a volt [m/s/V] at a bottom pressure: the chord between the valve wide open either way."""
    flow = 0.0
    for sign in (1.0, -1.0):
        x = sign * p[P.SPOOL_TRAVEL]
        opening = leg.flow_curve(p, x) if p[P.FLOW_POINTS] > 0.0 else x
        supply, tank = (edge(p, opening, bottom_Pa) for edge in (_from_supply, ports.tank_edge_flow))
        flow += sign * (supply - tank)
    return float(flow * p[P.SPOOL_GAIN] / (2.0 * p[P.SPOOL_TRAVEL] * p[P.AREA_BOTTOM]))


def _from_supply(p: Array, opening: float, bottom_Pa: float) -> float:
    return ports.supply_edge_flow(p, opening, bottom_Pa, p[P.SUPPLY_PRESSURE])
