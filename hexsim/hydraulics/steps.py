"""The time step of an explicit integrator (RK4), from the machine's own time constants: for the plant and for fits.

    steps a second = max( 1/longest_s,
                          omega_spool/ring, 1/(R C)_line/ring, ...       what does not depend on the state
                          omega_oil/ring,    omega_oil^2 = max eig(A A1^2) max(1/C)    oil springs at their present volumes
                          -(dq/dP1)/C / flow                             open valve at little pressure drop
                          1/fastest_law_s, omega_oil/crossing            where a chamber may cavitate within soon_s, or did
                          1/fastest_law_s                                accumulator empty
                          max eig(A G)/stiff  near standstill )          G: slope of the friction at v = 0

A (n_legs, n_legs) [1/kg] is the acceleration of each leg for a force on each. RK4 is stable up to h lambda = 2.78 on a
real eigenvalue and delays a ring by (h omega)^4/120 of its phase. Laws faster than fastest_law_s ask for no shorter step:
they are slowed to it (`leg.leg_derivatives`, `supply.line_rate`).
This is what keeps a step stable. What makes it accurate is the plant's own error of each step (`plant.stepping`); fits
and FMUs, which have none, step for accuracy at a reversal too: ringing_s near standstill and for ringing_for_s after it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexsim.compiled import compiled
from hexsim.declaration import ATMOSPHERE_Pa
from hexsim.hydraulics import learned, leg, rod_side, supply, valve
from hexsim.hydraulics.chamber import VAPOUR
from hexsim.hydraulics.parameters import LEARNED_TABLE, ROD_SIDE_SUPPLY, ROD_SIDE_VALVE, P
from hexsim.hydraulics.ports import (
    supply_edge_flow,
    tank_edge_flow,
    top_slope,
    top_supply_flow,
    top_tank_flow,
    worn_conductance,
)
from hexsim.hydraulics.supply import LINE, POWER_UNIT, S

Array = NDArray[np.float64]


class Steps(NamedTuple):
    """Limits of a time step."""

    longest_s: float = 1.0e-3  # MuJoCo's ball ends of full legs (time constant 2 ms) take no longer one
    ringing_s: float = 5.0e-4  # a step that follows the ring of a reversal, for who has no error of a step
    ringing_for_s: float = 0.1  # five periods of the band's edge
    shortest_s: float = 1.0e-5  # a hundredth of the longest: what asks for more is slowed or refused
    fastest_law_s: float = 1.0e-4  # time constant of the fastest law: 1 % of a period at 100 Hz, twice what people feel
    ring: float = 0.8  # largest h omega of a ring
    flow: float = 1.0  # largest h lambda of the valve's flow
    stiff: float = 2.2  # largest h lambda of friction
    near: float = 5.0  # widths of the friction's sign: tanh(5) = 1 - 1e-4
    empty: float = 1.01  # of the precharge: the accumulator's capacity falls a thousandfold as its oil ends
    soon_s: float = 3.0 * longest_s  # a spool of 60 Hz shuts within 5 ms
    below_air_Pa: float = 1.0e5  # above vapour pressure: no chamber rests there
    # largest h omega of a spring that begins or ends at once: (h omega)^2/8 of the speed is the error there
    crossing: float = 0.1
    settled: float = 0.01  # of the speed: a bristle that deflects more slowly slides


STEP = Steps()


class StepRule(NamedTuple):
    """What a machine asks for, apart from its state."""

    steady: float  # steps a second in any state [1/s]
    springs: float  # max eig(A A1^2): omega_oil^2 times the capacity of a chamber [m3/Pa/s2]
    standstill: float  # steps a second near standstill [1/s]
    stop: float  # steps a second within an end stop [1/s]


def step_rule(rows: Array, supply_row: Array, compliance: Array, load_rad_s: float = 0.0) -> StepRule:
    """The rule for legs (n_legs, N_PARAMETERS) and their supply.

    compliance (n_legs, n_legs) [1/kg]: acceleration of leg i for a force on leg j. load_rad_s: fastest mode of the load.
    """
    # largest eigenvalues of A diag(k), k >= 0: of a damping k in 1/s, of a spring k in (rad/s)^2
    root = np.sqrt(np.maximum(np.array([stiffness(row) for row in rows]).T, 0.0))
    fastest = np.maximum(np.linalg.eigvalsh(root[:, :, None] * compliance * root[:, None, :])[:, -1], 0.0)
    own = max(load_rad_s, *(own_frequency(row) for row in rows))
    return StepRule(*rule_of(*fastest, own, supply_rate(supply_row)))


@compiled
def stiffness(p):
    """What acts against a leg's motion: (bottom area squared [m4], bristle [N/m], viscous [N s/m], friction at standstill
    with it [N s/m], end stop's spring [N/m] and damper [N s/m])."""
    viscous = max(p[P.VISCOUS_EXTEND], p[P.VISCOUS_RETRACT]) + p[P.EXTRA_DAMPING]
    return (
        p[P.AREA_BOTTOM] ** 2,
        p[P.BRISTLE_STIFFNESS] + p[P.EXTRA_SPRING],
        viscous,
        friction_slope(p) + viscous,
        2.0 * p[P.CUSHION_STIFFNESS],
        p[P.CUSHION_DAMPING] + 2.0 * max(p[P.CUSHION_CHOKE_LOW], p[P.CUSHION_CHOKE_HIGH]) * greatest_speed(p),
    )


@compiled
def greatest_speed(p):
    """Speed [m/s] that supply pressure across the open valve would give a piston: what meets a cushion is slower."""
    area = valve.edge_area(p[P.SPOOL_TRAVEL], 0.0, 0.0, p[P.AREA_GRADIENT_SUPPLY], p[P.QUADRATIC_GAIN])
    return p[P.DISCHARGE] * area * math.sqrt(2.0 * p[P.SUPPLY_PRESSURE] / p[P.DENSITY]) / p[P.AREA_BOTTOM]


@compiled
def own_frequency(p):
    """Of a leg's spool or of a tone on it, the faster one [rad/s]."""
    tone = 2.0 * math.pi * p[P.TONE_FREQUENCY] if p[P.TONE_FORCE] != 0.0 else 0.0
    return max(p[P.SPOOL_OMEGA], tone)


@compiled
def rule_of(springs, bristle, viscous, standstill, stop, stop_damping, own_rad_s, supply_rad_s):
    """The numbers of StepRule. Arguments: max eig(A K), K each of `stiffness`; rates of the machine's parts [rad/s]."""
    ring = max(math.sqrt(bristle), own_rad_s, min(supply_rad_s, STEP.ring / STEP.fastest_law_s))
    return (
        max(1.0 / STEP.longest_s, ring / STEP.ring, viscous / STEP.stiff),
        springs,
        standstill / STEP.stiff,
        max(math.sqrt(stop) / STEP.ring, stop_damping / STEP.stiff),
    )


@compiled
def friction_slope(p):
    """Slope of a leg's friction at v = 0 [N s/m], viscous part apart: what makes a reversal stiff. With the jump of a
    learned force that has a curve for each direction."""
    learned_jump = 0.0
    if p[P.LEARNED_BALANCE] == learned.FORCE and p[P.LEARNED_FORM] == learned.DIRECTION:
        for k in range(LEARNED_TABLE, LEARNED_TABLE + learned.HALF):
            learned_jump = max(learned_jump, 0.5 * abs(p[k] - p[k + learned.HALF]))
    if p[P.BRISTLE_STIFFNESS] > 0.0:
        return p[P.BRISTLE_DAMPING] + learned_jump / friction_width(p)
    level = max(p[P.COULOMB_EXTEND], p[P.COULOMB_RETRACT]) + max(p[P.STATIC_EXTEND], p[P.STATIC_RETRACT])
    seals = p[P.SEAL_FRICTION] + p[P.SEAL_FRICTION_TOP] + p[P.SEAL_FRICTION_ACROSS]
    return (level + seals * p[P.SUPPLY_PRESSURE] + abs(p[P.RIPPLE_FORCE]) + learned_jump) / friction_width(p)


@compiled
def supply_rate(row):
    """Fastest rate of the supply [1/s]."""
    if row[S.MODEL] == LINE:
        return 1.0 / (row[S.RESISTANCE] * supply.line_capacity(row, row[S.PRESSURE]))
    if row[S.MODEL] != POWER_UNIT:
        return 0.0
    ring = 1.0 / math.sqrt(row[S.LINE_INERTANCE] * supply.manifold_capacity(row, row[S.PRESSURE]))
    damping = row[S.LINE_LAMINAR] + 2.0 * row[S.LINE_TURBULENT] * row[S.PUMP_FLOW_MAX]
    return max(ring, damping / row[S.LINE_INERTANCE], 1.0 / row[S.MOTOR_TIME], 1.0 / row[S.PUMP_TIME])


@compiled
def friction_width(p):
    """Speed [m/s] within which the friction changes its sign."""
    return 1.0 / p[P.ARCTAN_SLOPE] if p[P.ARCTAN_SLOPE] > 0.0 else p[P.SHARPNESS]


@compiled
def near_standstill(p, v, v_before):
    """Whether the leg is near standstill, or may come there within as long as it took from v_before to v."""
    return abs(v) < STEP.near * friction_width(p) + abs(v - v_before)


@compiled
def leg_steps(rule, p, y, v, x, P1, P2, Ps, z):
    """Steps a second [1/s] that a leg asks for in this state."""
    capacity = leg.chamber_capacity(p, y, P1)
    worn = worn_conductance(p, y)
    law = max(worn - leg.flow_slope(p, x, P1, Ps), 0.0) / (capacity * STEP.flow)
    springs = 1.0 / capacity
    if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE:
        room = rod_side.capacity(p, y, P2)
        law = max(law, (worn - top_slope(p, x, P2, Ps)) / (room * STEP.flow))
        springs += (p[P.AREA_TOP] / p[P.AREA_BOTTOM]) ** 2 / room
    if p[P.BRISTLE_STIFFNESS] > 0.0 and abs(leg.bristle_rate(p, y, v, P1, z, P2)) > STEP.settled * abs(v):
        law = max(law, p[P.BRISTLE_STIFFNESS] * abs(v) / (leg.friction_level(p, y, v, P1, P2) * STEP.flow))
    steps = max(math.sqrt(rule.springs * springs) / STEP.ring, min(law, 1.0 / STEP.fastest_law_s))
    if may_cavitate(p, y, v, x, P1, P2, Ps, capacity):
        steps = max(steps, 1.0 / STEP.fastest_law_s, math.sqrt(rule.springs * springs) / STEP.crossing)
    if min(y, p[P.STROKE] - y) < p[P.CUSHION_LENGTH]:
        steps = max(steps, rule.stop)
    return steps


@compiled
def may_cavitate(p, y, v, x, P1, P2, Ps, capacity):
    """Is a pressure below that of the air, or on the way to that of vapour within soon_s? capacity: of the bottom chamber.

    Before the valve's flow is asked for: could what the piston sweeps do it alone?
    """
    if min(P1, P2, Ps) < VAPOUR + STEP.below_air_Pa:
        return True
    swept = p[P.AREA_BOTTOM] * v * STEP.soon_s
    if P1 - swept / capacity < VAPOUR:
        flow = supply_edge_flow(p, x, P1, Ps) - tank_edge_flow(p, x, P1)
        if P1 + (STEP.soon_s * flow - swept) / capacity < VAPOUR:
            return True
    if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_SUPPLY:
        return False
    room, swept = rod_side.capacity(p, y, P2), -p[P.AREA_TOP] * v * STEP.soon_s
    if P2 - swept / room >= VAPOUR:
        return False
    if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE:
        flow = top_supply_flow(p, x, P2, Ps) - top_tank_flow(p, x, P2)
    else:
        flow = rod_side.port_flow(p, P2, Ps)
    return P2 + (STEP.soon_s * flow - swept) / room < VAPOUR


@compiled
def power_unit_steps(s, pump_pressure):
    """Steps a second [1/s] that a power unit asks for at this pressure of pump and accumulator."""
    return 1.0 / STEP.fastest_law_s if pump_pressure + ATMOSPHERE_Pa < STEP.empty * s[S.PRECHARGE] else 0.0


@compiled
def count_steps(rule, steps_a_second, is_near, span_s):
    """Whole steps of the next `span_s` that are stable. is_near: whether a leg is near standstill."""
    steps = max(rule.steady, steps_a_second)
    if is_near:
        steps = max(steps, rule.standstill)
    if not steps < 1.0 / STEP.shortest_s:  # NaN of a diverging run too
        steps = 1.0 / STEP.shortest_s
    return max(math.ceil(steps * span_s - 1e-6), 1)


@compiled
def count_steps_by_rule(rule, steps_a_second, calm_s, span_s):
    """`count_steps` for who has no error of a step: calm_s after a leg was last near standstill (0: one is)."""
    asked = max(steps_a_second, 1.0 / STEP.ringing_s) if calm_s < STEP.ringing_for_s else steps_a_second
    return count_steps(rule, asked, calm_s <= 0.0, span_s)
