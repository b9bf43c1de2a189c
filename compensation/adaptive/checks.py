"""What must hold before compensation engages: whether the motion is fit for it, and the machine known.

Valve and friction identified; excited at the last reversal; the overlap closes the valve for less than a quarter of the
half stroke; the performance monitor has a baseline that is worth it; both edges agree on the spool's lag; the reversals of
plain control are explained by the identified valve (edge_rounding.py), and on a four-way valve some were held against it:
with an overlap, its rounding is told by plain control alone. Reversals have told the leak; a platform's leg does not wait
for them where its edges lie about zero volts.
"""

from __future__ import annotations

from ..compiled import compiled
from .edge_rounding import explains_reversals, jumps, reversals_seen, seem_sharp
from .friction import resonance_of_load_Hz, step_acceleration_m_s2
from .monitor import monitor_ready, noise_range, worth_compensating, worth_crossing
from .valve import crossing_in_time, lags_agree
from .valve_edge import edge_V

ENABLE_RATIO = 1.3  # enable/disable hysteresis ratio of the excitation
NO_NULL_V = 2e-3  # off zero volts up to which there is neither null offset nor leak; two standard errors of an edge
MAX_CLOSED_SHARE = 0.25  # of a half stroke; with more, plain control's motion is not the reference's


@compiled
def checks_passed(state):
    """Whether the motion is fit for compensation and the identified valve explains plain control's reversals."""
    engagement = state.engagement
    return (
        excited_enough(engagement, state.settings)
        and engagement.closed_ticks < MAX_CLOSED_SHARE * engagement.half_ticks
        and monitor_ready(state.monitor)
        and worth_compensating(
            state.monitor,
            step_acceleration_m_s2(state.friction),
            state.reference.load_given == 2,
            noise_range(state.valve.four_way, state.reference.load_given == 2),
        )
        and lags_agree(state.valve, state.reference.load_given == 2)
        and crossing_in_time(state.valve)
        and (
            not jumps(state.valve)
            or worth_crossing(state.monitor, resonance_of_load_Hz(state.friction, state.settings))
        )
        and explains_reversals(state.rounding)
        and (reversals_seen(state.rounding) or not state.valve.four_way)
        and (state.valve.leak_known != 0 or plain_valve_told(state))
    )


@compiled
def plain_valve_told(state):
    """Of a platform's leg, which tilts it while it waits: whether nothing seen of the valve speaks of a leak or of rounded edges,
    though too few reversals were quick enough to tell."""
    told, leaks = state.reference.load_given == 2, state.valve.leak_m_s != 0.0
    return told and not leaks and _no_null_offset(state.valve) and seem_sharp(state.rounding)


@compiled
def _no_null_offset(valve):
    """Whether the edges lie about zero volts as windows see them: a leak would then have to undo a null offset just so."""
    off_V = valve.null_V + 0.5 * (edge_V(valve.edges[1]) - edge_V(valve.edges[0]))
    return abs(off_V) < NO_NULL_V


@compiled
def excited_enough(engagement, settings):
    """Whether reversals of late were strong enough to begin with."""
    enable, least = ENABLE_RATIO * engagement.stability_limit_m_s2, settings.min_excitation_m_s2
    return engagement.excitation_m_s2 > (enable if enable > least else least)
