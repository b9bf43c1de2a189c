"""The half stroke under plain control: for how long the valve was open in it, and whether enough of it is left to engage."""

from __future__ import annotations

import math

from ..compiled import compiled


@compiled
def track_opening(engagement, valve, control_V):
    """For how long plain control has held the valve open, and how long the overlap closed it before.

    A wide overlap keeps the valve closed for much of a small motion.
    """
    edge = valve.edges[1 if control_V > 0.0 else 0]
    if abs(control_V) > edge.dead_band_V + edge.backlash_V:
        engagement.open_ticks += 1
    elif engagement.open_ticks:
        engagement.open_ticks, engagement.closed_ticks = 0, 1
    else:
        engagement.closed_ticks += 1


@compiled
def far_from_reversal(state, velocity_m_s):
    """Whether the speed outlasts the ramp: of a leg that decelerates as it does now."""
    engagement, settings = state.engagement, state.settings
    if engagement.half_ticks == 0 or abs(velocity_m_s) < settings.min_speed_m_s:
        return False
    lost_m_s2 = -math.copysign(engagement.acceleration_m_s2, engagement.acceleration_m_s2 * velocity_m_s)
    return abs(velocity_m_s) > lost_m_s2 * settings.tick_s / engagement.ramp_step
