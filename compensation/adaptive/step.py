"""One control tick of the adaptive algorithm as a compiled function of its state, from sample to volts.

At each tick, for the tick boundary PREVIEW_TICKS ahead:

    y_m                                      reference (reference.py): the setpoint r, once the feed-forward is all in
    P_m = p(y_m', y_m'') + step + Stribeck   pressure that motion needs, its step at a reversal spread over some ms
    z_m = y_m + V P_m / (E A1)               oil displacement that gives both, Eq. 3.7
    x_m = g^-1(z_m' ; dp)                    spool position that lets this oil through: inverse of the valve
    u   = lead(x_m) - Kp (r - y_m) - D (P1 - P_m) + backlash inverse

The lead undoes the spool's lag; the dead-band compensation has a lead of its own (inverse.py, taps.py). The position
loop's own volts are taken off while y_m lags the setpoint. D lets oil out while the pressure oscillates above the
demand, which damps the hydraulic resonance. The backlash inverse acts on the side the volts move to. All that is
identified is bounded, acts only once its standard error is small, and comes in slowly.

docs/compensation_derivation.md derives it.
"""

from __future__ import annotations

from ..arithmetic import clip, dot, push
from ..compiled import compiled
from ..guard import TELLS
from ..loop_feedback import fed_back_V
from ..prediction import PREVIEW_TICKS, predict, watch_setpoint
from .chamber_pressures import edge_roots, measure_pressures, roots_ahead
from .chambers import compliance_m_Pa, equivalent_Pa
from .crossing_oil import settle_crossing, stay_on_side
from .delay import hear_delay, softness_m_Pa
from .demand import append_demand, drop_demand
from .edge_rounding import jumps
from .engagement import hear_engagement, tells_now, update_engagement, weight
from .feedback import backlash_inverse, cross_backlash, damping
from .friction import demanded_pressure, missing_step_Pa
from .identification import identify
from .inverse import advance_inverse
from .lateness import due_pressure_Pa
from .layout import LEAD_TAPS
from .leak import leak_at_m_s
from .piston_leak import leaked_across_m_s
from .reference import advance_reference, expect_load
from .trust import watch_turns
from .valve import valve_rejected

SUPPLY_SHARE = 0.1  # low-pass of the supply pressure, a tick
DEVIATION_SHARE = 0.06  # low-pass of the pressure's deviation from the demand, a tick
PRESSURE_MEAN_S = 0.2  # time constant of the pressures that the gain of plain control is computed with
DESIGN_WANTED, WORSE, REJECTED = 1, 2, 4  # what a tick tells its caller, beside what guard.py has
LAGS_ALIKE_S = 1.5e-3  # difference in lag up to which legs are alike


@compiled
def tick(
    states,
    table,
    preview,
    loads_m_s2,
    setpoint_m,
    position_m,
    control_V,
    valve_V,
    bottom_Pa,
    top_Pa,
    supply_Pa,
    extra_V,
):
    """`expect` and `tick_of` of states (1,), which Python hands over."""
    expect(states[0], loads_m_s2)
    return tick_of(
        states[0], table, preview, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, extra_V
    )


@compiled
def expect(state, loads_m_s2):
    """Before a tick: load (n,) that the setpoints of all legs give this one at this tick and the next; of none: its own."""
    expect_load(state.reference, loads_m_s2, PREVIEW_TICKS + state.shift)


@compiled
def tick_of(state, table, preview, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, extra_V):
    """Volts to add, and what its caller must know (DESIGN_WANTED | WORSE | REJECTED | TELLS).

    state: a record of the layout; table: prediction.prediction_table(); preview: setpoints (n,) of this tick and the
    next, taken as unknown where they do not reach as far as is looked ahead; extra_V: volts that a derived algorithm
    adds. Everything else is of the sample. Nothing is allocated.
    """
    measure_pressures(state.chambers, bottom_Pa, top_Pa, supply_Pa)
    bottom_Pa, supply_Pa = equivalent_Pa(state.settings, bottom_Pa, top_Pa, supply_Pa)
    look = PREVIEW_TICKS + state.shift
    n = len(preview) if len(preview) > look + 1 else 1
    middle = (n - 1) // 2
    bend = preview[0] - 2.0 * preview[middle] + preview[2 * middle]
    if watch_setpoint(state.prediction, n, bend, preview[0]):
        behind, here, ahead = predict(state.prediction, table, look, preview[0])
        state.reference.load_given = 0
    else:
        behind, here, ahead = preview[look - 1], preview[look], preview[look + 1]
    volts = step(state, behind, here, ahead, setpoint_m, position_m, control_V, valve_V, bottom_Pa, supply_Pa, extra_V)
    told = DESIGN_WANTED if state.design_wanted else 0
    if state.engagement.lockout_s > 0.0:
        told |= REJECTED if state.engagement.other else WORSE
    if valve_rejected(state.valve):
        told |= REJECTED
    if (state.settings.learn and state.delay.tells) or tells_now(state.engagement):
        told |= TELLS
    return volts, told


@compiled
def hear(state, other):
    """After a tick in which another leg of the machine told TELLS: how far it is with engaging, and what its reversal says of the
    delay. On four-way valves each leg's lag holds a leak by its own load: nothing is heard of it."""
    hear_engagement(state.engagement, other.engagement)
    if other.delay.tells and not state.valve.four_way and abs(state.valve.lag_s - other.valve.lag_s) < LAGS_ALIKE_S:
        hear_delay(state.delay, other.delay)


@compiled
def hear_first(states, others):
    """`hear` of states (1,)."""
    hear(states[0], others[0])


@compiled
def step(state, behind, here, ahead, setpoint_m, position_m, control_V, valve_V, bottom_Pa, supply_Pa, u):
    """The step itself; behind, here, ahead: setpoints at the boundary before the one looked at, at it, and after it."""
    settings, reference, demands = state.settings, state.reference, state.demands
    _track_plain_control(state, bottom_Pa, supply_Pa)
    advance_reference(reference, behind, here, ahead)

    compliance = compliance_m_Pa(settings, reference.position_m)
    friction_share = state.engagement.friction_share
    pressure, friction_step, share, sign = demanded_pressure(reference, state.friction, friction_share, settings)
    oil, a, v = reference.position_m + compliance * pressure, reference.load_m_s2, reference.velocity_m_s
    append_demand(demands, pressure, share, a, reference.position_m, oil, v, sign, friction_step)
    now = (
        demands.pressure_Pa[0], demands.stribeck_share[0], demands.acceleration_m_s2[0], demands.position_m[0],
        demands.oil_m[0], demands.velocity_m_s[0], demands.sign[0], demands.step_Pa[0],
    )  # fmt: skip
    drop_demand(demands)
    lag = setpoint_m - now[3]
    load = bottom_Pa - supply_Pa * settings.area_ratio
    due_Pa = due_pressure_Pa(state.lateness, now[0], demands.pressure_Pa)
    deviation = load - due_Pa
    fed_back = fed_back_V(state.loop, settings, now[3], (1.0 + settings.rod_ratio**3) * due_Pa)
    push(state.deviation_Pa, deviation)
    state.mean_deviation_Pa += DEVIATION_SHARE * (deviation - state.mean_deviation_Pa)

    bottom = pressure + state.mean_deviation_Pa + state.supply_Pa * settings.area_ratio
    roots = edge_roots(settings, state.supply_Pa, bottom)
    leak_m_s = leak_at_m_s(state.valve, roots)
    four_way = state.valve.four_way != 0
    if four_way:
        load_ahead, engaged = pressure + state.mean_deviation_Pa, state.engagement.ramp > 0.0
        roots = roots_ahead(state.chambers, settings, reference, oil, load_ahead, state.supply_Pa, engaged, state.shift)
        leak_m_s -= leaked_across_m_s(state.valve, state.chambers.across_Pa)
    oil += softness_m_Pa(state.delay) * friction_share * friction_step
    crosses, missing_m = jumps(state.valve), 0.0
    if crosses:
        missing_m = compliance * friction_share * missing_step_Pa(reference, state.friction, settings, friction_step)
        oil = stay_on_side(state.inverse, oil, leak_m_s, v, reference.acceleration_m_s2, missing_m)
    flow, dead_band = advance_inverse(state.inverse, oil, roots, state.valve, state.trim, state.crossing_path, leak_m_s)
    if crosses:
        settle_crossing(state, dead_band, roots, leak_m_s, v, reference.acceleration_m_s2, missing_m)
    push(state.flow_V, flow)
    push(state.dead_band_V, dead_band)
    if state.engagement.ramp > 0.0:
        u += fed_back
        u += dot(state.lead_taps, state.flow_V, LEAD_TAPS) + dot(state.crossing_taps, state.dead_band_V, LEAD_TAPS)
        u += (0.0 if four_way else backlash_inverse(state, u)) - settings.position_gain_V_per_m * lag
        u += state.valve.null_V - damping(state, settings.damping_1_s * compliance, roots)
        if four_way:
            u += cross_backlash(state, control_V, valve_V, u)
    if settings.learn:
        identify(state, position_m, valve_V, bottom_Pa, supply_Pa, load, now)
    setpoint_m_s = (ahead - behind) / (2.0 * settings.tick_s)
    watch_turns(state.trust, setpoint_m_s, settings.tick_s)
    setpoint_m_s2 = (ahead - 2 * here + behind) / (settings.tick_s * settings.tick_s)
    update_engagement(state, setpoint_m_s, setpoint_m_s2, position_m, control_V, now[3] - position_m)
    return weight(state.engagement.ramp) * clip(u, -settings.voltage_max_V, settings.voltage_max_V)


@compiled
def _track_plain_control(state, bottom, supply):
    """Loop gain and dead band of plain control, for the reference.

    Pressures are low-passed: the reference is differentiated, and must not answer to noise or to itself.
    """
    settings, reference, valve = state.settings, state.reference, state.valve
    if state.mean_bottom_Pa == 0.0:
        state.mean_bottom_Pa, state.supply_Pa, state.mean_supply_Pa = bottom, supply, supply
    state.supply_Pa += SUPPLY_SHARE * (supply - state.supply_Pa)
    if reference.feed_forward == 1.0 and settings.controller_feeds_forward == 0.0:
        return
    share = settings.tick_s / PRESSURE_MEAN_S
    state.mean_bottom_Pa += share * (bottom - state.mean_bottom_Pa)
    state.mean_supply_Pa += share * (supply - state.mean_supply_Pa)
    roots = edge_roots(settings, state.mean_supply_Pa, state.mean_bottom_Pa)
    kp = settings.position_gain_V_per_m
    reference.null_m, reference.leak_m_s = valve.null_V / kp, leak_at_m_s(valve, roots)
    for i in range(2):
        reference.loop_1_s[i] = kp * valve.edges[i].gain_m_s_V * roots[i]
        dead_band_V = valve.edges[i].dead_band_V
        reference.dead_band_m[i] = (dead_band_V if valve.underlap else max(dead_band_V, 0.0)) / kp
