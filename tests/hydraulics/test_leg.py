"""The balances of one leg, each against its terms written out by hand."""

import math

import numpy as np
import pytest

from hexsim.hydraulics import learned as learned_terms
from hexsim.hydraulics import leg, parameters, ports, rod_side
from hexsim.hydraulics.parameters import P
from hexsim.machine import load_machine

A1, A2 = math.pi / 4 * 0.04**2, math.pi / 4 * (0.04**2 - 0.03**2)
PS, P1 = 7.0e6, 3.2e6
FACTOR = 0.611 * math.pi * 0.01 * math.sqrt(2 / 860)  # C_d pi d sqrt(2/rho): flow a metre of opening and root pascal


def flow_at(row, volts, pressure=P1):
    return leg.inflow(row, 0.1, 0.0, volts, leg.commanded_spool(row, volts, 0.0), pressure, PS, 0.0)


@pytest.mark.parametrize("volts", [1.0, 9.0, -1.0, -9.0])
def test_flow_of_the_three_way_valve(row, volts):
    """Eq. 3.4: from the supply with sqrt(Ps - P1), to the tank with sqrt(P1 - Pt); never both."""
    opening = abs(volts) * 1.1e-4 - 5e-6
    by_hand = FACTOR * opening * (math.sqrt(PS - P1) if volts > 0 else -math.sqrt(P1))
    assert flow_at(row, volts) == pytest.approx(by_hand, rel=1e-5)  # (w/dp)^2/4 of the regularised root: 2.5e-6


def test_dead_band_is_45_mV_either_way(row):
    """No flow up to 5 um / (0.11 mm/V) = 45.45 mV either way, flow just beyond (Fig. 3.5)."""
    edge = 5e-6 / 1.1e-4
    assert edge == pytest.approx(0.045, abs=5e-4)
    for share in np.linspace(-0.9999, 0.9999, 41):
        assert flow_at(row, share * edge) == 0.0
    assert flow_at(row, 1.0001 * edge) > 0 > flow_at(row, -1.0001 * edge)


def test_flow_runs_back_when_the_chamber_is_above_the_supply(row):
    """Above Ps an open supply edge lets oil back to the supply; below Pt an open tank edge draws oil in."""
    by_hand = FACTOR * (1.1e-4 - 5e-6) * math.sqrt(1e6)
    assert flow_at(row, 1.0, PS + 1e6) == pytest.approx(-by_hand, rel=3e-5)  # (w/dp)^2/4 = 2.5e-5
    row[P.TANK_PRESSURE] = 2e6
    assert flow_at(row, -1.0, 1e6) == pytest.approx(by_hand, rel=3e-5)


def test_edges_may_differ(row):
    """Overlap and area gradient of the two edges act each on its own side."""
    row[P.OVERLAP_SUPPLY], row[P.AREA_GRADIENT_TANK] = 2e-5, math.pi * 0.005
    assert flow_at(row, 1.0) == pytest.approx(FACTOR * (1.1e-4 - 2e-5) * math.sqrt(PS - P1), rel=1e-5)
    assert flow_at(row, -1.0) == pytest.approx(-0.5 * FACTOR * (1.1e-4 - 5e-6) * math.sqrt(P1), rel=1e-5)


def test_leaks_are_laminar_and_go_the_right_way(row):
    """Valve shut: G_s (Ps - P1) in, G_t (P1 - Pt) out, and both lands' clearance G/(1 + O/l)."""
    row[P.LEAK_SUPPLY_CHAMBER], row[P.LEAK_CHAMBER_TANK], row[P.TANK_PRESSURE] = 2e-12, 3e-12, 1e5
    assert flow_at(row, 0.0) == pytest.approx(2e-12 * (PS - P1) - 3e-12 * (P1 - 1e5), rel=1e-12)
    row[P.LEAK_SUPPLY_CHAMBER] = row[P.LEAK_CHAMBER_TANK] = 0.0
    row[P.CLEARANCE_CONDUCTANCE], row[P.CLEARANCE_LENGTH] = 2.7e-13, 3e-6
    land = 2.7e-13 / (1 + 5 / 3)
    assert flow_at(row, 0.0) == pytest.approx(land * (PS - P1) - land * (P1 - 1e5), rel=1e-12)


def test_a_relief_flow_begins_at_its_threshold(row):
    """Valve shut: nothing below it, G (P1 - Pr) out above; the slope that limits the time step is that of the flow."""
    row[P.RELIEF_CONDUCTANCE], row[P.RELIEF_OPENS] = 1e-11, P1 + 2e5
    assert flow_at(row, 0.0) == 0.0
    row[P.RELIEF_OPENS] = P1 - 2e5
    assert flow_at(row, 0.0) == pytest.approx(-2e-6, rel=1e-12)
    assert ports.flow_slope(row, 0.0, P1, PS) == pytest.approx(-1e-11, rel=1e-9)


def test_a_hardening_spring_pulls_to_the_middle_with_the_third_power(row):
    """1.6 N at 20 mm from half stroke for 2e5 N/m3, 12.8 N at 40 mm, against the travel on either side."""
    bare = [leg.leg_force(row, 0.1 + off, 0.0, 0.0, P1, 0.0, PS, 0.0, 0.0) for off in (-0.04, 0.0, 0.02)]
    row[P.HARDENING] = 2e5
    hard = [leg.leg_force(row, 0.1 + off, 0.0, 0.0, P1, 0.0, PS, 0.0, 0.0) for off in (-0.04, 0.0, 0.02)]
    assert np.subtract(hard, bare) == pytest.approx([12.8, 0.0, -1.6], abs=1e-9)


def test_the_null_settles_while_the_valve_warms_up(row):
    """50 mV with 8 s: nothing at the start, 1 - 1/e of it after 8 s, all of it at last."""
    row[P.NULL_WARM_UP], row[P.NULL_WARM_UP_TIME] = 0.05, 8.0
    for t, share in ((0.0, 0.0), (8.0, 1 - math.exp(-1)), (1e3, 1.0)):
        assert leg.commanded_spool(row, 0.05 * share, t) == pytest.approx(0.0, abs=1e-18)


@pytest.mark.parametrize("v", [0.05, -0.05])
def test_all_friction_settles_while_the_seals_warm_up(row, v):
    """8 % with 5 s: 1.08 times the warm friction at the start, 1 + 0.08/e of it after 5 s, the warm one at last."""
    warm = leg.friction_force(row, 0.1, v, P1, 0.0)
    row[P.FRICTION_WARM_UP], row[P.FRICTION_WARM_UP_TIME] = 0.08, 5.0
    for t, factor in ((0.0, 1.08), (5.0, 1 + 0.08 * math.exp(-1)), (1e3, 1.0)):
        assert leg.friction_force(row, 0.1, v, P1, 0.0, 0.0, t) == pytest.approx(factor * warm, rel=1e-12)
    cold = leg.leg_force(row, 0.1, v, 0.0, P1, 0.0, PS, 0.0, 0.0) - leg.leg_force(
        row, 0.1, v, 0.0, P1, 0.0, PS, 0.0, 1e3
    )
    assert cold == pytest.approx(-0.08 * warm, rel=1e-9)


@pytest.mark.parametrize("v", [0.05, -0.05])
def test_viscous_friction_fades_evenly_and_dry_friction_stays(row, v):
    """1 % a second: nothing gone at the start, 1 - 1/e of the viscous part alone after 100 s; where no time is asked for, none."""
    whole = leg.friction_force(row, 0.1, v, P1, 0.0)
    viscous = v * row[P.VISCOUS_EXTEND if v > 0.0 else P.VISCOUS_RETRACT]
    row[P.VISCOUS_FADING] = 0.01
    for t, gone in ((0.0, 0.0), (100.0, 1 - math.exp(-1)), (math.inf, 0.0)):
        assert whole - leg.friction_force(row, 0.1, v, P1, 0.0, 0.0, t) == pytest.approx(gone * viscous, abs=1e-12)


def test_a_worn_bore_leaks_where_the_seal_passes_it(row):
    """Valve shut: G (Ps - P1) at the place, 1/e of it a width aside, nothing far off; the supply gives what flows in."""
    row[P.WEAR_CONDUCTANCE], row[P.WEAR_PLACE], row[P.WEAR_WIDTH] = 1e-12, 0.09, 0.008
    for y, share in ((0.09, 1.0), (0.082, math.exp(-1)), (0.098, math.exp(-1)), (0.19, 0.0)):
        flow = leg.inflow_bottom(row, y, 0.0, 0.0, 0.0, P1, PS, PS, 0.0)
        assert flow == pytest.approx(1e-12 * share * (PS - P1), rel=1e-12, abs=1e-30)
        assert leg.supply_demand_in_step(row, y, 0.0, 0.0, P1, PS, PS) == pytest.approx(flow, rel=1e-12, abs=1e-30)


def test_a_worn_bore_slows_a_time_step_by_its_slope(row):
    """Valve shut, a bore that is open: with h G = 4 C the pressure's rate is divided to h lambda = 1; far off it is not."""
    h = 1e-4
    row[P.WEAR_PLACE], row[P.WEAR_WIDTH] = 0.09, 0.008
    row[P.WEAR_CONDUCTANCE] = 4.0 * leg.chamber_capacity(row, 0.09, P1) / h
    assert leg.pressure_slowdown(row, 0.09, 0.0, P1, PS, h) == pytest.approx(4.0, rel=1e-9)
    assert leg.pressure_slowdown(row, 0.18, 0.0, P1, PS, h) == 1.0


def test_null_offset_and_drift_shift_the_curve(row):
    """u_0 + r t: after 10 s at 1 mV/s and 20 mV the spool stands at 0 for 30 mV."""
    row[P.NULL_OFFSET], row[P.NULL_DRIFT] = 0.02, 1e-3
    assert leg.commanded_spool(row, 0.03, 10.0) == pytest.approx(0.0, abs=1e-18)
    assert leg.commanded_spool(row, 1.03, 10.0) == pytest.approx(1.1e-4)


VARIANTS = {
    "report": {},
    "rounded": {P.ROUNDING_SUPPLY: 2e-6, P.ROUNDING_TANK: 2e-6},
    "quadratic": {P.QUADRATIC_GAIN: 300.0},
    "leaks": {P.LEAK_SUPPLY_CHAMBER: 2e-10, P.LEAK_CHAMBER_TANK: 3e-10},
    "clearance": {P.CLEARANCE_CONDUCTANCE: 1e-10, P.CLEARANCE_LENGTH: 3e-6},
    "return line": {P.RETURN_RESISTANCE: 5e9},
}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("volts", [2.0, 0.02, 0.0, -0.02, -2.0])
@pytest.mark.parametrize("pressure", [2e5, 3.2e6, 6.9e6, 7.5e6])
def test_flow_slope_is_the_derivative_of_the_flow(row, variant, volts, pressure):
    """d inflow/d P1 by a central difference, of every term that depends on P1; never positive (it stabilises)."""
    for place, value in VARIANTS[variant].items():
        row[place] = value
    x, h = leg.commanded_spool(row, volts, 0.0), 50.0
    numeric = (flow_at(row, volts, pressure + h) - flow_at(row, volts, pressure - h)) / (2 * h)
    slope = leg.flow_slope(row, x, pressure, PS)
    # h = 50 Pa against the width of 1e4 Pa: 1e-5; rounding of the flow 1e-16 * 1e-3 m3/s / 100 Pa = 1e-21
    assert slope == pytest.approx(numeric, rel=1e-4, abs=1e-20)
    assert slope <= 0


@pytest.mark.parametrize("drop", [1e4, 1e6, 3.2e6, -1e6])
@pytest.mark.parametrize("resistance", [1e8, 2e9, 1e11])
def test_return_line_solves_its_implicit_equation(row, drop, resistance):
    """The closed form is the q of q = K sqrt(dp - R q), mirrored for dp < 0, found here by bisection."""
    row[P.RETURN_RESISTANCE], x = resistance, -3e-4
    gain = FACTOR * (3e-4 - 5e-6)
    low, high = 0.0, min(gain * math.sqrt(abs(drop)), abs(drop) / resistance)
    for _ in range(200):
        middle = (low + high) / 2
        if gain * math.sqrt(max(abs(drop) - resistance * middle, 0.0)) > middle:
            low = middle
        else:
            high = middle
    assert leg.tank_edge_flow(row, x, drop) == pytest.approx(math.copysign(low, drop), rel=1e-9)


def test_return_line_of_no_resistance_is_the_plain_orifice(row):
    """R -> 0 is the orifice, R -> infinity a laminar line dp/R, a shut edge passes nothing."""
    plain = leg.tank_edge_flow(row, -3e-4, P1)
    row[P.RETURN_RESISTANCE] = 1e3
    assert leg.tank_edge_flow(row, -3e-4, P1) == pytest.approx(plain, rel=1e-5)
    row[P.RETURN_RESISTANCE] = 1e15
    assert leg.tank_edge_flow(row, -3e-4, P1) == pytest.approx(P1 / 1e15, rel=1e-3)
    assert leg.tank_edge_flow(row, 0.0, P1) == 0.0
    assert leg.flow_slope(row, 0.0, 0.0, PS) == 0.0


@pytest.mark.parametrize("v", [0.1, -0.1])
def test_pressure_rate_is_the_volume_balance(row, v):
    """Eq. 3.7: E/(y A1 + V_pl) (phi_1 - A1 v); a steady speed phi_1/A1 leaves the pressure alone."""
    capacity = (0.1 * A1 + 5e-7) / 1.5e9

    def rate(speed):
        return leg.leg_derivatives(row, 0.1, speed, 1.0, 0.0, PS, (P1, PS, 0.0, 0.0, 0.0), 0.0)[0][0]

    row[P.SPOOL_OMEGA] = 0.0
    assert rate(v) == pytest.approx((flow_at(row, 1.0) - A1 * v) / capacity, rel=1e-12)
    assert rate(flow_at(row, 1.0) / A1) == pytest.approx(0.0, abs=1e-3)


def test_velocity_gain_is_the_fields(row):
    """0.154 up and 0.149 m/s down a volt beyond the overlap at 40 kg (shared field.md), at static pressure."""
    static = (PS * A2 + 40 * 9.8) / A1
    assert flow_at(row, 1.0, static) / A1 / (1 - 0.0454) == pytest.approx(0.154, rel=0.01)
    assert -flow_at(row, -1.0, static) / A1 / (1 - 0.0454) == pytest.approx(0.149, rel=0.01)


@pytest.mark.parametrize("v", [0.2, -0.2])
def test_rod_side_as_a_chamber(row, v):
    """It shrinks as the piston extends: dP2/dt = E/((s - y) A2 + V_2) (port + A2 v + leak); the port flows from Ps to P2."""
    row[P.ROD_SIDE_VOLUME], row[P.ROD_SIDE_CONDUCTANCE], row[P.LEAK_PISTON] = 5e-7, 2e-6, 3e-12
    for P2 in (6.5e6, 7.5e6):
        port = math.copysign(2e-6 * math.sqrt(abs(PS - P2)), PS - P2)
        assert rod_side.port_flow(row, P2, PS) == pytest.approx(port, rel=2e-4)  # (w/dp)^2/4 = 1e-4
        volume = (0.2 - 0.05) * A2 + 5e-7
        by_hand = 1.5e9 / volume * (rod_side.port_flow(row, P2, PS) + A2 * v + 3e-12 * (P1 - P2))
        assert rod_side.port_rate(row, 0.05, v, P1, P2, PS) == pytest.approx(by_hand, rel=1e-12)


def test_supply_demand_counts_valve_leak_and_annulus(row):
    """Extension gives A2 v back, retraction draws A2 |v|; supply edge and leak add; the tank edge does not.

    In steady motion that is (A1 - A2) v on extension and A2 |v| on retraction (shared field.md).
    """
    up, down = flow_at(row, 1.0) / A1, flow_at(row, -1.0) / A1
    assert leg.supply_demand(row, up, 1.1e-4, P1, PS, PS) == pytest.approx((A1 - A2) * up, rel=1e-12)
    assert leg.supply_demand(row, down, -1.1e-4, P1, PS, PS) == pytest.approx(-A2 * down, rel=1e-12)
    assert leg.supply_demand(row, 0.0, 0.0, P1, PS, PS) == 0.0
    row[P.LEAK_SUPPLY_CHAMBER] = 1e-12
    assert leg.supply_demand(row, 0.0, 0.0, P1, PS, PS) == pytest.approx(1e-12 * (PS - P1))


def test_supply_demand_with_a_rod_side_chamber_is_its_port(row):
    """With its own chamber the annulus takes what its port passes, whatever the speed."""
    row[P.ROD_SIDE_CHAMBER] = 1
    for v in (0.0, 0.3):
        by_hand = rod_side.port_flow(row, 6.8e6, PS)
        assert leg.supply_demand(row, v, 0.0, P1, 6.8e6, PS) == pytest.approx(by_hand, rel=1e-12)
    assert by_hand > 0


@pytest.mark.parametrize(("volts", "v"), [(1.0, 0.15), (-1.0, -0.15), (0.0, 0.0), (0.5, -0.1)])
def test_heat_is_pressure_drop_times_flow_and_friction(row, volts, v):
    """(Ps - P1) Q_1 + (P1 - Pt) Q_2 + F_f v: what throttling and rubbing turn into heat, never negative."""
    x = leg.commanded_spool(row, volts, 0.0)
    supplied, drained = leg.supply_edge_flow(row, x, P1, PS), leg.tank_edge_flow(row, x, P1)
    by_hand = (PS - P1) * supplied + P1 * drained + leg.friction_force(row, 0.1, v, P1, 0.0) * v
    demand = leg.supply_demand(row, v, x, P1, PS, PS)
    heat = leg.heat(row, 0.1, v, x, P1, PS, PS, 0.0, supplied - drained, demand)
    assert heat == pytest.approx(by_hand, rel=1e-9, abs=1e-9)
    assert heat >= 0


@pytest.mark.parametrize("v", [0.05, -0.05])
def test_force_beyond_pressure_sums_its_terms(row, v):
    """-Ps A2 - F_f + end stop + F_0 - k (y - s/2) - c v + tone, Eq. 3.8 and the effects of the force balance."""
    arguments = (0.1 + 0.03, v, 0.0, P1, PS, PS, 0.0, 0.7)
    plain = leg.force_beyond_pressure(row, *arguments)
    assert plain == pytest.approx(-PS * A2 - leg.friction_force(row, 0.13, v, P1, 0.0), rel=1e-12)
    row[P.EXTRA_FORCE], row[P.EXTRA_SPRING], row[P.EXTRA_DAMPING] = 100.0, 2000.0, 300.0
    row[P.CUSHION_LENGTH] = 0.005
    row[P.TONE_FORCE], row[P.TONE_FREQUENCY], row[P.TONE_PHASE] = 12.0, 3.0, 0.4
    added = 100 - 2000 * 0.03 - 300 * v + 12 * math.sin(2 * math.pi * 3 * 0.7 + 0.4)
    assert leg.force_beyond_pressure(row, *arguments) - plain == pytest.approx(added, rel=1e-9)
    inside, outside = (leg.force_beyond_pressure(row, y, *arguments[1:]) for y in (0.002, 0.006))
    # 3 mm of the 5 mm cushion, damped on the way in; the spring is 4 mm further out
    stop = row[P.CUSHION_STIFFNESS] * 0.003**2 / 0.005 + (row[P.CUSHION_DAMPING] * 0.05 * 0.6 if v < 0 else 0.0)
    assert inside - outside == pytest.approx(stop + 2000 * 0.004, rel=1e-9)


def learned(row, balance, signal):
    """A learned curve k^2 over knots -1.6, -1.5 .. 1.6 of its signal."""
    row[P.LEARNED_BALANCE], row[P.LEARNED_SIGNAL] = balance, signal
    row[P.LEARNED_START], row[P.LEARNED_STEP] = -1.6, 0.1
    row[parameters.LEARNED_TABLE : parameters.LEARNED_TABLE + parameters.LEARNED_KNOTS] = (
        np.arange(parameters.LEARNED_KNOTS) - 16.0
    ) ** 2
    return row


def test_learned_curve_is_linear_between_knots_and_constant_beyond(row):
    """numpy.interp of the knots, which clamps too; the last knot is met to 1e-6 of the last segment."""
    learned(row, learned_terms.FORCE, 0)
    knots = -1.6 + 0.1 * np.arange(parameters.LEARNED_KNOTS)
    signals = np.concatenate([np.linspace(-1.6, 1.6, 501), [-1e9, -1.7, 1.7, 1e9]])
    found = [learned_terms.curve(row, s) for s in signals]
    np.testing.assert_allclose(
        found,
        np.interp(signals, knots, row[parameters.LEARNED_TABLE : parameters.LEARNED_TABLE + parameters.LEARNED_KNOTS]),
        atol=1e-6 * 31,
    )


def test_learned_curve_of_nan_is_nan(row):
    """A diverging run asks for the curve at NaN: the answer is NaN, not a place in memory far outside the row."""
    assert math.isnan(learned_terms.curve(learned(row, learned_terms.FORCE, 0), math.nan))


def test_learned_term_reads_the_signal_it_names(row):
    """Each of SIGNALS in turn moves the term, and the others do not; the speed is the velocity without its sign. With a time
    constant it is over what was remembered."""
    values = dict(zip(learned_terms.SIGNALS, (0.11, -0.23, 0.37, 0.53, 0.71, 0.97, 0.23), strict=True))
    for number, name in enumerate(learned_terms.SIGNALS):
        row[P.LEARNED_MEMORY] = 0.0
        learned(row, learned_terms.CONTINUITY, number)
        assert learned_terms.term(row, *values.values()) == learned_terms.curve(row, values[name])
        row[P.LEARNED_MEMORY] = 0.4
        assert learned_terms.term(row, *list(values.values())[:6], 0.61) == learned_terms.curve(row, 0.61)


def test_learned_term_in_its_form(row):
    """A product is the velocity times the curve. Of a direction's two curves of 16 knots each holds its own way; at rest their mean."""
    learned(row, learned_terms.FORCE, 0)
    row[P.LEARNED_FORM] = learned_terms.PRODUCT
    assert learned_terms.term(row, 0.4, -0.3, 0.0, 0.0, 0.0, 0.0) == pytest.approx(-0.3 * learned_terms.curve(row, 0.4))
    row[P.LEARNED_FORM] = learned_terms.DIRECTION
    row[parameters.LEARNED_TABLE : parameters.LEARNED_TABLE + 2 * learned_terms.HALF] = np.repeat(
        [5.0, -7.0], learned_terms.HALF
    ) + np.tile(np.arange(learned_terms.HALF), 2)
    out, rest, back = (learned_terms.term(row, -1.1, v, 0.0, 0.0, 0.0, 0.0) for v in (0.1, 0.0, -0.1))
    assert (out, rest, back) == pytest.approx((10.0, 4.0, -2.0))
    assert learned_terms.term(row, 9.0, 0.1, 0.0, 0.0, 0.0, 0.0) == pytest.approx(
        20.0, abs=1e-5
    )  # the last knot of its own curve


def test_learned_term_joins_the_balance_it_names(row):
    """In continuity it adds to the flow, in force to the force, and to nothing else."""
    force = (0.1, 0.0, 0.0, P1, PS, PS, 0.0, 0.0)
    plain_flow, plain_force = flow_at(row, 1.0), leg.force_beyond_pressure(row, *force)
    learned(row, learned_terms.CONTINUITY, 0)
    added = learned_terms.curve(row, 0.1)
    assert flow_at(row, 1.0) - plain_flow == pytest.approx(added, rel=1e-12)
    assert leg.force_beyond_pressure(row, *force) == plain_force
    learned(row, learned_terms.FORCE, 0)
    assert flow_at(row, 1.0) == plain_flow
    assert leg.force_beyond_pressure(row, *force) - plain_force == pytest.approx(added, rel=1e-6)


def naive_valve_volts(volts, half_width, delay):
    """Delay, then backlash, as a reader would write it down."""
    delayed = [volts[0]] * delay + list(volts[: len(volts) - delay])
    held, out = delayed[0], []
    for value in delayed:
        if value > held + half_width:
            held = value - half_width
        elif value < held - half_width:
            held = value + half_width
        out.append(held)
    return out


@pytest.mark.parametrize("half_width", [0.0, 0.05, 0.4])
@pytest.mark.parametrize("delay", [0, 1, 7])
def test_valve_volts_are_delayed_and_lag_by_the_backlash(half_width, delay):
    """Equal to a plain loop on 400 random samples; nothing changes without backlash and delay."""
    volts = np.random.default_rng(5).uniform(-1, 1, 400)
    found = leg.valve_volts(volts, half_width, delay)
    np.testing.assert_allclose(found, naive_valve_volts(volts, half_width, delay), rtol=0, atol=1e-15)
    if half_width == 0.0 and delay == 0:
        np.testing.assert_array_equal(found, volts)


@pytest.mark.parametrize("name", ["bench", "servo_bench"])
def test_the_quick_answer_on_stiffness_is_never_wrong(name):
    """Where the slope of the flow is said to be surely below the limit it is; most instants are answered so."""
    rng, machine_row, quick, trials = np.random.default_rng(3), parameters.declared_rows(load_machine(name))[0], 0, 5000
    Ps, sound = machine_row[P.SUPPLY_PRESSURE], []
    for _ in range(trials):
        row = machine_row.copy()
        row[P.ROUNDING_SUPPLY] = row[P.ROUNDING_TANK] = rng.choice([0.0, 1e-6, 5e-6])
        row[P.LEAK_CHAMBER_TANK] = rng.choice([0.0, 1e-11])
        pressure = rng.choice([rng.uniform(0.0, Ps), Ps - 10 ** rng.uniform(0.0, 6.0), 10 ** rng.uniform(0.0, 6.0)])
        x, h = rng.normal() * 10 ** rng.uniform(-7.0, -3.0), 10 ** rng.uniform(-5.0, -2.5)
        limit = 2.0 * leg.chamber_capacity(row, rng.uniform(0.0, row[P.STROKE]), pressure)
        if ports.is_slope_below(row, x, pressure, Ps, h, limit):
            quick += 1
            sound.append(-h * ports.flow_slope(row, x, pressure, Ps) <= limit)
    assert all(sound) and quick > 0.5 * trials
