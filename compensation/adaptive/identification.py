"""What a control tick tells of the machine: valve, edge rounding, leak, delay, friction, each by its own file."""

from __future__ import annotations

from ..arithmetic import clip, push
from ..compiled import compiled
from .chamber_pressures import across_Pa, edge_roots, pair_roots
from .chambers import compliance_m_Pa
from .delay import add_to_delay, found_delay_s, found_lateness_s, softness_m_Pa
from .demand import stretch_demands
from .edge_rounding import add_to_rounding, add_to_trim, disturb_rounding, lower_bound_V, told_while_compensated
from .friction import (
    add_to_friction,
    friction_ready,
    inertia_Pa,
    resonance_of_load_Hz,
    stribeck_share,
    viscous_decay_1_s,
)
from .lateness import pressure_then_Pa
from .leak import follow_leak, start_leak, tell_leak
from .null import edges_moved
from .piston_leak import leaked_across_m_s
from .presliding import add_to_presliding, update_presliding
from .spool import look_ahead_shift, round_lag
from .stribeck import add_to_stribeck, update_stribeck
from .trust import judge_compensated
from .valve import add_to_valve, valve_ready, valve_usable

DELAY_TOLERANCE_S = 4e-5  # change of the delay from which the taps are designed anew
LAG_REVERSAL_S = 1.5e-4  # most that the lag of a compensated leg moves at a reversal
LAG_TOLERANCE_S = 2e-5  # change of the lag from which the taps are designed anew
RESONANCE_TOLERANCE = 0.06  # relative change of the load's resonance from which they are, too


@compiled
def identify(state, position_m, valve_V, p, supply_Pa, load_Pa, now):
    """One tick of valve, edge rounding, delay and friction. now: the demand for this tick."""
    settings, v, valve = state.settings, valve_V - state.valve.null_V, state.valve
    _, share, acceleration_m_s2, reference_m, oil_m, velocity_m_s, sign, friction_step = now
    compensated, engaged = state.engagement.ramp == 1.0, state.engagement.ramp > 0.0
    p_late = pressure_then_Pa(state.lateness, p)
    means = _mean_roots(state, position_m, p_late, supply_Pa)
    state.last_bottom_Pa = p_late
    z = position_m + compliance_m_Pa(settings, position_m) * p_late
    push(state.oil_error_m, z - oil_m)
    leak_m_s = follow_leak(valve, means)
    state.leaked_m += leak_m_s * settings.tick_s
    if valve.four_way:
        chambers = state.chambers
        valve.across_Pa = across_Pa(settings, position_m, chambers.mean_bottom_Pa, chambers.mean_top_Pa)
        state.leaked_m -= leaked_across_m_s(valve, valve.across_Pa) * settings.tick_s
    z -= state.leaked_m
    add_to_valve(valve, z, v, means[1 if v > 0 else 0])
    if not engaged and edges_moved(valve):
        start_leak(state.leak)
    find_delay(state, position_m, p, v, velocity_m_s, means, compensated)
    if compensated and not valve.four_way:
        identified_V, highest_V = lower_bound_V(state.rounding), 0.5 * valve.edges[0].dead_band_V
        add_to_trim(state.trim, state.oil_error_m, velocity_m_s - leak_m_s, identified_V, highest_V)
    disturb_rounding(state.rounding, state.reference.load_given == 2)
    if valve_usable(valve):
        if engaged and not told_while_compensated(valve):
            state.rounding.ticks = 0
        elif add_to_rounding(state.rounding, state.leak, z, v, means, valve, settings.spool_damping):
            tell_leak(state.leak, valve)
            state.trim.rounding_V = lower_bound_V(state.rounding)
        state.friction.told = state.reference.load_given == 2
        add_to_friction(state.friction, position_m, load_Pa, acceleration_m_s2)
    if abs(valve.lag_s - state.lag_s) > LAG_TOLERANCE_S and valve_ready(valve):
        if not engaged:
            stretch_demands(state, look_ahead_shift(valve.lag_s, settings.tick_s))
        if not engaged or valve.four_way:
            want_design(state, round_lag(valve.lag_s))
        elif state.engagement.after_reversal:  # a spool's lag does not jump; an edge that is read badly may
            moved_s = clip(valve.lag_s - state.lag_s, -LAG_REVERSAL_S, LAG_REVERSAL_S)
            want_design(state, round_lag(state.lag_s + moved_s))
    elif friction_ready(state.friction) and valve_ready(valve):
        resonance_Hz = resonance_of_load_Hz(state.friction, settings)
        if abs(resonance_Hz - state.resonance_Hz) > RESONANCE_TOLERANCE * resonance_Hz:
            want_design(state, state.lag_s)
    friction, late = state.friction, position_m - reference_m
    stribeck, presliding, inertia = friction.stribeck, friction.presliding, inertia_Pa(friction)
    complete = add_to_stribeck(stribeck, velocity_m_s, state.deviation_Pa[0], late, share)
    travel_m = abs(velocity_m_s) * settings.tick_s
    add_to_presliding(
        presliding, sign, travel_m, stribeck_share(velocity_m_s, settings.stribeck_velocity_m_s), friction_step
    )
    if complete and compensated and not state.engagement.armed:  # armed it is where the motion begins, no reversal
        softness = softness_m_Pa(state.delay) / compliance_m_Pa(settings, 0.5 * settings.stroke_m)
        judge_compensated(state.trust, stribeck.deviation_Pa, inertia, softness)
        update_presliding(
            presliding, stribeck.deviation_Pa, stribeck.position_error_m, inertia, friction.half_step_Pa,
            settings.tick_s,
        )  # fmt: skip
        update_stribeck(stribeck, inertia, 2.0 * friction.half_step_Pa)


@compiled
def _mean_roots(state, position_m, p, supply_Pa):
    """R of the edges retracting and extending, with the mean pressures of the tick past; p: that of the position."""
    settings, chambers = state.settings, state.chambers
    if settings.rod_ratio == 0.0:
        return edge_roots(settings, supply_Pa, 0.5 * (p + state.last_bottom_Pa))
    return pair_roots(settings, position_m, chambers.mean_bottom_Pa, chambers.mean_top_Pa, chambers.supply_Pa)


@compiled
def find_delay(state, position_m, p, volts_V, velocity_m_s, roots, compensated):
    """One tick of the delay, and of how much of it is the position's."""
    delay, lateness, valve = state.delay, state.lateness, state.valve
    y, flow_m_s = position_m - state.leaked_m, velocity_m_s - valve.leak_m_s * valve.leak_ratio
    compliance = compliance_m_Pa(state.settings, position_m)
    delay.rounding_V = state.trim.rounding_V
    delay.tells = add_to_delay(delay, y, p, volts_V, flow_m_s, roots, valve, compliance, compensated)
    if delay.tells or (delay.hears and state.lag_s > 0.0):
        delay.hears = False
        late_s = found_lateness_s(delay, state.lag_s)
        change_s = max(abs(late_s - lateness.late_s), abs(found_delay_s(delay, state.lag_s) - state.delay_s))
        lateness.late_s = late_s
        if change_s > DELAY_TOLERANCE_S:
            want_design(state, state.lag_s)


@compiled
def want_design(state, lag_s):
    """The taps are to be designed anew, for this lag."""
    state.lag_s, state.delay_s, state.design_wanted = lag_s, round_lag(found_delay_s(state.delay, lag_s)), True
    if friction_ready(state.friction):
        state.resonance_Hz = round(resonance_of_load_Hz(state.friction, state.settings))
        state.viscous_share = (
            round(20.0 * viscous_decay_1_s(state.friction) / max(state.settings.damping_1_s, 1.0)) / 20.0
        )
