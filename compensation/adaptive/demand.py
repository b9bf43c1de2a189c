"""What the algorithm asks for at one tick boundary."""

from __future__ import annotations

from typing import NamedTuple


class Demand(NamedTuple):
    """What is asked for at one tick boundary."""

    pressure_Pa: float  # P1 - Ps A2/A1
    stribeck_share: float  # of the Stribeck pressure in it, signed
    acceleration_m_s2: float
    position_m: float  # reference y_m
    oil_m: float  # oil displacement z_m
    velocity_m_s: float
