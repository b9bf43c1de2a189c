"""What the volts fed forward are corrected by: pressure damping, and the inverse of the backlash."""

from __future__ import annotations

import math

from ..arithmetic import clip, dot
from ..compiled import compiled
from ..damping_design import next_damping_gain
from .layout import LEAD_TICKS

BACKLASH_WIDTH_V = 1e-3  # smoothing width of the backlash inverse: half of the travel from one side to the other
NO_CROSSING_V = 2e-3  # by which the volts behind a backlash may be off before it is crossed


@compiled
def damping(state, oil_m_s_Pa, roots):
    """Volts that let oil out while the pressure oscillates above the demand; oil_m_s_Pa: its rate, per pressure. What the
    controller's own pressure feedback lets out is less to let out: both together are too much for a spool's lag."""
    settings = state.settings
    limit_V, up = settings.damping_max_V, 1 if state.flow_V[LEAD_TICKS + state.shift] > 0 else 0
    gain = state.valve.edges[up].gain_m_s_V * roots[up]
    oscillation = dot(state.damping_taps, state.deviation_Pa, int(settings.damping_count))
    own = settings.pressure_gain_V_per_Pa * (1.0 + settings.rod_ratio**3)
    u = state.damping_gain * max(oil_m_s_Pa / gain - own, 0.0) * oscillation
    state.damping_gain = next_damping_gain(state.damping_gain, u, limit_V, settings.tick_s)
    return clip(u, -limit_V, limit_V)


@compiled
def backlash_inverse(state, volts):
    """Volts that cross the valve's backlash, to the side that the volts fed forward have moved to."""
    held = clip(state.backlash_input_V, volts - BACKLASH_WIDTH_V, volts + BACKLASH_WIDTH_V)
    state.backlash_input_V = held
    return state.valve.edges[1 if volts > 0.0 else 0].backlash_V * (volts - held) / BACKLASH_WIDTH_V


@compiled
def cross_backlash(state, control_V, valve_V, volts):
    """Volts to add to `volts` so that behind the backlash of a four-way valve there is what both and the controller ask for,
    pressure damping included. valve_V: sent in the tick past. One spool has one backlash: the mean of what both edges tell."""
    half_V = 0.5 * (state.valve.edges[0].backlash_V + state.valve.edges[1].backlash_V)
    behind_V = state.backlash_input_V = clip(state.backlash_input_V, valve_V - half_V, valve_V + half_V)
    missing_V = control_V + volts - behind_V
    if abs(missing_V) < NO_CROSSING_V:
        return clip(valve_V - control_V - volts, -half_V, half_V)
    return math.copysign(half_V, missing_V)
