"""The threshold of perception: the one that every figure, page and limit of the project uses.

Means over people, bells of 3 s: of acceleration along an axis (Benson, Spencer and Stott, Aviat. Space Environ. Med. 57, 1986), of
rate about one (Benson 1989). Short transients are felt at less. The leg of a bench is vertical and counts as heave.
"""

from __future__ import annotations

import math

PERCEPTION_m_s2 = {"x": 0.063, "y": 0.057, "z": 0.154, "leg": 0.154}
PERCEPTION_rad_s = {"roll": math.radians(2.05), "pitch": math.radians(2.05), "yaw": math.radians(1.5)}
SOURCE = "Benson 1986"  # of PERCEPTION_m_s2, where there is room for no more


def times_threshold(axis: str, deviation_m_s2: float | None) -> float | None:
    """An acceleration [m/s2] along an axis over the threshold there; None without one, and for rotations, which are felt by their
    rate."""
    limit = PERCEPTION_m_s2.get(axis)
    return None if limit is None or deviation_m_s2 is None else deviation_m_s2 / limit
