"""Supply: what stands between the motor and the valves.

    constant    Ps = P0                                                             (report)
    line        C dPs/dt = min((P0 - Ps)/R, Q_max) - q                              line, accumulator, pump limit
    power unit  variable vane pump, accumulator, line, relief valve, reservoir      (report 2.2.2)

q is the flow that all legs take together. The supply's row and states belong to one more actuator of the MuJoCo model,
whose ctrl is 1 while the motor is switched on and whose last state is Ps.

Power unit (gauge pressures; `_abs` = from vacuum), s the motor's speed as a fraction of its nominal one:
    ds/dt    = (on - s)/T_m                                                         motor
    dQ_p/dt  = (s min(Q_max clip((P0 - P_p)/droop, 0, 1), Q_motor) - Q_p)/T_p       pressure compensator, vane pump
               Q_motor = (power rating - friction)/P_p - leak                       no more than the motor can drive
    C_p dP_p/dt = Q_p - Q_relief - Q_l,  C_p = V_gas/(n P_abs) + V_p/E + C_hose/2   accumulator and pump side
               V_gas = V_0 (P_pre/P_abs)^(1/n) above the precharge; below it the gas is shut off
    I dQ_l/dt = P_p - P_s - R_lam Q_l - R_turb Q_l |Q_l|                            line with filter and fittings
    C_s dP_s/dt = Q_l - q,  C_s = (V_manifold + V_annuli)/E + C_hose/2              manifold
    C_T dT/dt = heat - k (T - T_ambient)                                            reservoir

C_hose = V_hose/E_hose lies half at either end of the line (pi section): its first mode against the manifold is 8 % below that
of the distributed line, with all of it at the manifold it would be 27 %.
P_p and P_s are volumes that may cavitate: their states are those of chambers (`chamber`).
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np

from hexsim.compiled import compiled
from hexsim.declaration import ATMOSPHERE_Pa, Machine
from hexsim.hydraulics import chamber
from hexsim.hydraulics.oil import dynamic_viscosity


class S(IntEnum):
    """Places in the supply's row."""

    MODEL = 0  # 0 constant, 1 line, 2 power unit
    PRESSURE = 1  # [Pa] constant supply, or where the pump's flow is zero
    RESISTANCE = 2
    CAPACITY = 3
    FLOW_MAX = 4  # 0 = no limit
    # power unit
    MOTOR_POWER = 5
    MOTOR_TIME = 6
    PUMP_FLOW_MAX = 7
    PUMP_DROOP = 8
    PUMP_TIME = 9
    PUMP_LEAK = 10
    PUMP_FRICTION = 11
    GAS_VOLUME = 12
    PRECHARGE = 13  # [Pa] absolute
    EXPONENT = 14
    PUMP_SIDE_VOLUME = 15
    LINE_INERTANCE = 16
    LINE_LAMINAR = 17
    LINE_TURBULENT = 18
    MANIFOLD_VOLUME = 19
    HOSE_COMPLIANCE = 20  # [m3/Pa] of half the hose, at either end of the line
    RELIEF_PRESSURE = 21
    RELIEF_CONDUCTANCE = 22
    BULK_MODULUS = 23
    AIR_FRACTION = 24
    HEAT_CAPACITY = 25
    COOLING = 26
    AMBIENT = 27
    START_TEMPERATURE = 28
    BURST = 29  # [m3/s/sqrt(Pa)] hole in the manifold's hose, for faults; 0 = whole


class U(IntEnum):
    """States of a power unit, in their order in `act` (pressures in MPa there, in Pa everywhere else)."""

    SPEED = 0  # [1]
    PUMP_FLOW = 1  # [m3/s]
    LINE_FLOW = 2  # [m3/s]
    PUMP_PRESSURE = 3  # at pump and accumulator
    TEMPERATURE = 4  # [degC]
    PRESSURE = 5  # Ps, at the manifold


N_SUPPLY = len(S)
N_POWER_UNIT_STATES = len(U)
CONSTANT, LINE, POWER_UNIT = range(3)  # kind of a supply, as its row says
N_STATES = {CONSTANT: 0, LINE: 1, POWER_UNIT: N_POWER_UNIT_STATES}  # the last one is Ps


@compiled
def motor_flow_limit(s, pressure):
    """Flow [m3/s] at which the motor is at its rating."""
    driven = (s[S.MOTOR_POWER] - s[S.PUMP_FRICTION]) / max(pressure, 1.0e5)
    return max(driven - s[S.PUMP_LEAK] * max(pressure, 0.0), 0.0)


@compiled
def pump_flow_command(s, speed, pressure):
    """Flow [m3/s] that the pressure compensator sets: full below P0 - droop, none above P0, never beyond the motor."""
    share = min(max((s[S.PRESSURE] - pressure) / s[S.PUMP_DROOP], 0.0), 1.0)
    return speed * min(s[S.PUMP_FLOW_MAX] * share, motor_flow_limit(s, pressure))


@compiled
def gas_volume(s, pressure):
    """Gas volume of the accumulator [m3]; all of it below the precharge."""
    absolute = max(pressure + ATMOSPHERE_Pa, s[S.PRECHARGE])
    return s[S.GAS_VOLUME] * (s[S.PRECHARGE] / absolute) ** (1.0 / s[S.EXPONENT])


@compiled
def accumulator_oil(s, pressure):
    """Oil in the accumulator [m3]."""
    return s[S.GAS_VOLUME] - gas_volume(s, pressure)


@compiled
def accumulator_energy(s, pressure):
    """Work [J] that the oil has done on the gas since precharge, atmosphere's share taken off."""
    absolute = max(pressure + ATMOSPHERE_Pa, s[S.PRECHARGE])
    gas, n = gas_volume(s, pressure), s[S.EXPONENT]
    if n - 1.0 < 1.0e-9:
        work = s[S.PRECHARGE] * s[S.GAS_VOLUME] * math.log(s[S.GAS_VOLUME] / gas)
    else:
        work = (absolute * gas - s[S.PRECHARGE] * s[S.GAS_VOLUME]) / (n - 1.0)
    return work - ATMOSPHERE_Pa * (s[S.GAS_VOLUME] - gas)


@compiled
def gas_capacity(s, pressure):
    """-dV_gas/dP [m3/Pa] of the accumulator's gas, at its precharge below that."""
    return gas_volume(s, pressure) / (s[S.EXPONENT] * max(pressure + ATMOSPHERE_Pa, s[S.PRECHARGE]))


@compiled
def line_capacity(s, pressure):
    """C [m3/Pa] of the accumulator behind a line: linear, and gas above it where there is any."""
    if s[S.GAS_VOLUME] <= 0.0:
        return s[S.CAPACITY]
    return s[S.CAPACITY] + gas_capacity(s, pressure)


@compiled
def line_rate(s, state, demand, nominal, h):
    """Rate [Pa/s] of the state of a manifold behind a laminar line whose pump gives no more than FLOW_MAX (0 = no limit).

    h [s]: time step of who integrates; a line with R C < h/2 is slowed to that, towards the same balance. 0 = exact.
    """
    pressure = chamber.pressure(state)
    delivered = (nominal - pressure) / s[S.RESISTANCE]
    if s[S.FLOW_MAX] > 0.0:
        delivered = min(delivered, s[S.FLOW_MAX])
    room = line_capacity(s, pressure)
    slower = 2.0 * h / (s[S.RESISTANCE] * room)
    return chamber.state_rate(state, chamber.slowed(delivered - demand, state, room, slower, h), room)


@compiled
def pump_side_capacity(s, pressure):
    """C_p [m3/Pa] of accumulator, oil and half the hose at the pump."""
    oil = s[S.PUMP_SIDE_VOLUME] / s[S.BULK_MODULUS] + s[S.HOSE_COMPLIANCE]
    if pressure + ATMOSPHERE_Pa <= s[S.PRECHARGE]:
        return oil
    return oil + gas_capacity(s, pressure)


@compiled
def manifold_capacity(s, pressure):
    """C_s [m3/Pa] of manifold, annuli and half the hose."""
    return chamber.capacity(s[S.MANIFOLD_VOLUME], pressure, s[S.BULK_MODULUS], s[S.AIR_FRACTION], s[S.HOSE_COMPLIANCE])


@compiled
def relief_flow(s, pressure):
    """Flow back to the reservoir [m3/s]."""
    return s[S.RELIEF_CONDUCTANCE] * max(pressure - s[S.RELIEF_PRESSURE], 0.0)


@compiled
def pump_leakage(s, speed, pressure):
    """Case drain of the running pump [m3/s]; a check valve holds the pressure when it stands."""
    return s[S.PUMP_LEAK] * max(pressure, 0.0) * speed


@compiled
def line_drop(s, flow):
    """Pressure lost in line, filter and fittings [Pa]."""
    return (s[S.LINE_LAMINAR] + s[S.LINE_TURBULENT] * abs(flow)) * flow


@compiled
def burst_flow(s, pressure):
    """Flow [m3/s] out of a burst hose."""
    return s[S.BURST] * math.sqrt(max(pressure, 0.0))


@compiled
def motor_power(s, speed, flow, pressure):
    """Shaft power [W]: delivered flow, case drain and friction."""
    return pressure * (flow + pump_leakage(s, speed, pressure)) + speed * s[S.PUMP_FRICTION]


@compiled
def power_unit_heat(s, speed, line_flow, pump_pressure, pressure):
    """Heat [W] that pump, relief valve, line and a burst hose put into the oil."""
    lost = pump_leakage(s, speed, pump_pressure) + relief_flow(s, pump_pressure)
    heat = pump_pressure * lost + speed * s[S.PUMP_FRICTION] + line_drop(s, line_flow) * line_flow
    return heat + pressure * burst_flow(s, pressure)


@compiled
def power_unit_rates(s, state, switched_on, demand, leg_heat):
    """d state/dt (6 numbers, places U, SI). demand [m3/s] and leg_heat [W]: of all legs together."""
    speed, flow, line_flow, pump_state, temperature, manifold_state = state
    pump_pressure, pressure = chamber.pressure(pump_state), chamber.pressure(manifold_state)
    net = flow - relief_flow(s, pump_pressure) - line_flow
    surge = (pump_pressure - pressure - line_drop(s, line_flow)) / s[S.LINE_INERTANCE]
    heat = leg_heat + power_unit_heat(s, speed, line_flow, pump_pressure, pressure)
    gain = line_flow - demand - burst_flow(s, pressure)
    return (
        (switched_on - speed) / s[S.MOTOR_TIME],
        (pump_flow_command(s, speed, pump_pressure) - flow) / s[S.PUMP_TIME],
        surge,
        chamber.state_rate(pump_state, net, pump_side_capacity(s, pump_pressure)),
        (heat - s[S.COOLING] * (temperature - s[S.AMBIENT])) / s[S.HEAT_CAPACITY],
        chamber.state_rate(manifold_state, gain, manifold_capacity(s, pressure)),
    )


def power_unit_start(s: np.ndarray) -> np.ndarray:
    """States (places U, SI) at rest: motor at speed, all at P0, no flow, oil at its starting temperature."""
    state = np.zeros(N_POWER_UNIT_STATES)
    state[U.SPEED] = 1.0
    state[U.PUMP_PRESSURE] = state[U.PRESSURE] = s[S.PRESSURE]
    state[U.TEMPERATURE] = s[S.START_TEMPERATURE]
    return state


# Powers of (density, modulus, viscosity) of the oil with which a place follows, as in `oil.LEG_POWERS`.
SUPPLY_POWERS: dict[S, tuple[float, float, float]] = {
    S.BULK_MODULUS: (0, 1, 0),
    S.PUMP_LEAK: (0, 0, -1),
    S.LINE_LAMINAR: (0, 0, 1),
    S.LINE_TURBULENT: (1, 0, 0),
    S.LINE_INERTANCE: (1, 0, 0),
}


def declared_supply(machine: Machine) -> np.ndarray:
    """The supply's row (N_SUPPLY,) as declared: constant, or the power unit with oil at its reference temperature."""
    row = np.zeros(N_SUPPLY)
    row[S.PRESSURE] = machine.supply.pressure_Pa
    if machine.power_unit is None:
        return row
    unit, oil, cylinder = machine.power_unit, machine.oil, machine.cylinder
    bore = math.pi / 4 * unit.line_diameter_m**2
    viscosity = dynamic_viscosity(oil.temperature_degC, machine.supply.pressure_Pa, oil.density_kg_m3, oil.properties)
    hose = 128 * viscosity * unit.line_length_m / (math.pi * unit.line_diameter_m**4)  # Hagen-Poiseuille
    annuli = 0.0
    if cylinder.rod_side == "supply":
        annuli = machine.n_legs * cylinder.area_top_m2 * cylinder.stroke_m / 2
        half = [leg.cylinder.area_top_m2 * leg.cylinder.stroke_m / 2 for leg in machine.legs]
        annuli += sum(own - cylinder.area_top_m2 * cylinder.stroke_m / 2 for own in half)
    values = {
        S.MODEL: POWER_UNIT,
        S.MOTOR_POWER: unit.motor_power_W,
        S.MOTOR_TIME: unit.motor_time_constant_s,
        S.PUMP_FLOW_MAX: unit.pump_flow_max_m3_s,
        S.PUMP_DROOP: unit.pump_droop_Pa,
        S.PUMP_TIME: unit.pump_time_constant_s,
        S.PUMP_LEAK: unit.pump_leakage_m3_s_Pa,
        S.PUMP_FRICTION: unit.pump_friction_W,
        S.GAS_VOLUME: unit.accumulator_volume_m3,
        S.PRECHARGE: unit.accumulator_precharge_fraction * machine.supply.pressure_Pa + ATMOSPHERE_Pa,
        S.EXPONENT: unit.polytropic_exponent,
        S.PUMP_SIDE_VOLUME: unit.pump_side_volume_m3,
        S.LINE_INERTANCE: oil.density_kg_m3 * unit.line_length_m / bore,
        S.LINE_LAMINAR: hose + unit.filter_resistance_Pa_s_m3,
        S.LINE_TURBULENT: unit.line_resistance_Pa_s2_m6,
        S.MANIFOLD_VOLUME: unit.manifold_volume_m3 + annuli,
        S.HOSE_COMPLIANCE: 0.5 * bore * unit.line_length_m / unit.hose_modulus_Pa,
        S.RELIEF_PRESSURE: unit.relief_pressure_Pa,
        S.RELIEF_CONDUCTANCE: unit.relief_conductance_m3_s_Pa,
        S.BULK_MODULUS: oil.bulk_modulus_Pa,
        S.HEAT_CAPACITY: oil.density_kg_m3 * oil.properties.specific_heat_J_kg_K * unit.reservoir_volume_m3,
        S.COOLING: unit.cooling_W_K,
        S.AMBIENT: unit.ambient_temperature_degC,
        S.START_TEMPERATURE: unit.oil_temperature_degC,
    }
    for place, value in values.items():
        row[place] = value
    return row
