"""One leg's numbers as one row, so that compiled functions, MuJoCo's `actuator_user` and tracing share them.

A row is a float array (N_PARAMETERS,), SI units; physics only. Every library effect is a term that vanishes at the row's
neutral value, so the declared machine is the row with all effects neutral. Where a plant keeps the leg's states:
`plant.states`.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from hexsim.declaration import Cylinder, Friction, Machine, Manifold, Valve
from hexsim.declaration.leg import Leg
from hexsim.declaration.oil_grades import kinematic_viscosity
from hexsim.declaration.valve import FLOW_POINTS
from hexsim.signals.units import unit_to_si

LEARNED_KNOTS = 33  # a learned term is a curve through this many equidistant knots


class P(IntEnum):
    """Places in a leg's row. Compiled code reads them as constants."""

    # supply and oil
    SUPPLY_PRESSURE = 0
    TANK_PRESSURE = 1
    RETURN_RESISTANCE = 2
    DENSITY = 3
    BULK_MODULUS = 4
    AIR_FRACTION = 5
    # cylinder
    AREA_BOTTOM = 6
    AREA_TOP = 7
    STROKE = 8
    PIPELINE_VOLUME = 9
    HOSE_COMPLIANCE = 10
    LENGTH_OFFSET = 11
    ROD_SIDE_VOLUME = 12
    ROD_SIDE_CONDUCTANCE = 13
    CUSHION_LENGTH = 14
    CUSHION_STIFFNESS = 15
    CUSHION_DAMPING = 16
    # leakage
    LEAK_SUPPLY_CHAMBER = 17
    LEAK_CHAMBER_TANK = 18
    CLEARANCE_CONDUCTANCE = 19
    CLEARANCE_LENGTH = 20
    # valve
    SPOOL_GAIN = 21
    SPOOL_TRAVEL = 22
    NULL_OFFSET = 23
    NULL_DRIFT = 24
    OVERLAP_SUPPLY = 25
    OVERLAP_TANK = 26
    ROUNDING_SUPPLY = 27
    AREA_GRADIENT_SUPPLY = 28
    AREA_GRADIENT_TANK = 29
    QUADRATIC_GAIN = 30
    DISCHARGE = 31
    PRESSURE_WIDTH = 32
    SPOOL_OMEGA = 33
    SPOOL_DAMPING = 34
    SPOOL_RATE = 35
    HYSTERESIS = 36
    VALVE_DELAY = 37
    ROUNDING_TANK = 38
    HYSTERESIS_SPREAD = 39  # half the hysteresis less half the threshold [V]
    # friction
    VISCOUS_EXTEND = 40
    VISCOUS_RETRACT = 41
    COULOMB_EXTEND = 42
    COULOMB_RETRACT = 43
    STATIC_EXTEND = 44
    STATIC_RETRACT = 45
    STRIBECK_VELOCITY = 46
    SHARPNESS = 47
    ARCTAN_SLOPE = 48
    SEAL_FRICTION = 49
    RIPPLE_FORCE = 50
    RIPPLE_LENGTH = 51
    RIPPLE_PHASE = 52
    BRISTLE_STIFFNESS = 53
    BRISTLE_DAMPING = 54
    # forces on the leg's axis that the mechanical model does not carry
    EXTRA_FORCE = 55
    EXTRA_SPRING = 56
    EXTRA_DAMPING = 57
    TONE_FORCE = 58
    TONE_FREQUENCY = 59
    TONE_PHASE = 60
    # learned term
    LEARNED_BALANCE = 61
    LEARNED_SIGNAL = 62
    LEARNED_START = 63
    LEARNED_STEP = 64
    # rod side; the edges P-B and B-T and the leaks are those of a four-way valve
    ROD_SIDE_CHAMBER = 65  # one of ROD_SIDE_*
    OVERLAP_SUPPLY_TOP = 66
    OVERLAP_TANK_TOP = 67
    AREA_GRADIENT_SUPPLY_TOP = 68
    AREA_GRADIENT_TANK_TOP = 69
    LEAK_PISTON = 70  # from chamber to chamber, on the valve or behind a port
    LEAK_TOP_TANK = 71
    ROUNDING_SUPPLY_TOP = 72
    ROUNDING_TANK_TOP = 73
    AIR_FRACTION_TOP = 74  # in the oil of the rod side beyond AIR_FRACTION
    SEAL_FRICTION_TOP = 75
    SEAL_FRICTION_ACROSS = 76
    # safety manifold
    PORT_RESISTANCE = 77  # of orifice and blocking valve between each port and its chamber [Pa s2/m6]; 0: none
    SETTLING_GAIN = 78  # orifice from a chamber to the tank [m3/s/sqrt(Pa)]
    SETTLING_TAPER = 79  # the orifice narrows over this much stroke above the stop [m]
    CHECK_GAIN = 80  # check valves from chamber to supply and from tank to chamber [m3/s/sqrt(Pa)]
    FLOW_POINTS = 81  # points of the flow curve; 0: the openings follow the overlaps
    # what a leg of any kind may have besides
    RELIEF_CONDUCTANCE = 82  # from the bottom chamber to the tank beyond RELIEF_OPENS
    RELIEF_OPENS = 83
    HARDENING = 84  # of the spring about half stroke [N/m3]
    NULL_WARM_UP = 85  # of the spool's null, with its time constant
    NULL_WARM_UP_TIME = 86
    LEARNED_FORM = 87
    FRICTION_WARM_UP = 88  # share more of all friction at the start, with its time constant
    FRICTION_WARM_UP_TIME = 89
    WEAR_CONDUCTANCE = 90  # past the piston's seal where the bore is worn, with place and width of the wear
    WEAR_PLACE = 91
    WEAR_WIDTH = 92
    LEARNED_MEMORY = 93  # time constant of the low-pass that a learned term's signal has passed [s]; 0: none
    FRICTION_SETTLED = 94  # share more of all friction in the end, when it has warmed up
    VISCOUS_FADING = 95  # rate at which viscous friction falls [1/s]
    LAMINAR = 96  # Re_cr nu/2 of the metering edges [m2/s]; 0: turbulent at any opening
    CUSHION_CHOKE_LOW = 97  # A^3/K^2 of the orifices of end cushions [N s2/m2]; 0: none
    CUSHION_CHOKE_HIGH = 98


ROD_SIDE_SUPPLY, ROD_SIDE_PORT, ROD_SIDE_VALVE = map(float, range(3))  # at supply pressure; behind a port; on port B
ROD_SIDES = {"supply": ROD_SIDE_SUPPLY, "chamber": ROD_SIDE_PORT, "valve": ROD_SIDE_VALVE}

LEARNED_TABLE = len(P)  # the curve stands behind the named places
FLOW_TABLE = LEARNED_TABLE + LEARNED_KNOTS  # spool positions of a flow curve, then the openings that they stand for
N_PARAMETERS = FLOW_TABLE + 2 * FLOW_POINTS  # volts and flows of a measured valve behind all others


def declared_rows(machine: Machine) -> np.ndarray:
    """Rows (n_legs, N_PARAMETERS) of the machine as declared, without its [effects].

    Spool Eq. 3.2: gain = x_max/u_max. Area gradient Eq. 3.3: pi d, or what gives the rated flow, with the sharp or
    rounded overlap law, or Eq. 3.11 when QUADRATIC_GAIN > 0.
    """
    rows = np.zeros((machine.n_legs, N_PARAMETERS))
    for row, leg in zip(rows, machine.legs, strict=True):
        parts = _cylinder(machine, leg.cylinder) | _valve(machine, leg) | _friction(leg.friction)
        for name, value in (parts | _manifold(machine.manifold)).items():
            row[name] = value
        if leg.valve.flow_curve is not None:
            points = flow_points(leg.valve, machine.oil.density_kg_m3)
            row[P.FLOW_POINTS] = points.shape[1]
            for k, start in enumerate((FLOW_TABLE, FLOW_TABLE + FLOW_POINTS)):
                row[start : start + points.shape[1]] = points[k]
    return rows


def _cylinder(machine: Machine, cylinder: Cylinder) -> dict[P, float]:
    """Supply, oil, cylinder and its leaks."""
    values = {
        P.SUPPLY_PRESSURE: machine.supply.pressure_Pa,
        P.TANK_PRESSURE: machine.supply.tank_pressure_Pa,
        P.DENSITY: machine.oil.density_kg_m3,
        P.BULK_MODULUS: machine.oil.bulk_modulus_Pa,
        P.AREA_BOTTOM: cylinder.area_bottom_m2,
        P.AREA_TOP: cylinder.area_top_m2,
        P.STROKE: cylinder.stroke_m,
        P.PIPELINE_VOLUME: cylinder.pipeline_volume_m3,
        P.ROD_SIDE_VOLUME: cylinder.rod_side_volume_m3,
        P.ROD_SIDE_CONDUCTANCE: cylinder.rod_side_conductance_m3_s_sqrtPa,
        P.CUSHION_LENGTH: cylinder.cushion_length_m,
        P.CUSHION_STIFFNESS: cylinder.cushion_stiffness_N_m,
        P.CUSHION_DAMPING: cylinder.cushion_damping_N_s_m,
        P.CUSHION_CHOKE_LOW: cylinder.cushion_choke_N_s2_m2(cylinder.area_bottom_m2),
        P.CUSHION_CHOKE_HIGH: cylinder.cushion_choke_N_s2_m2(cylinder.area_top_m2),
        P.ROD_SIDE_CHAMBER: ROD_SIDES[cylinder.rod_side],
    }
    if cylinder.rod_side == "supply":  # the annulus is at supply pressure
        return values | {P.LEAK_SUPPLY_CHAMBER: cylinder.piston_leakage_m3_s_Pa}
    if cylinder.rod_side == "chamber":
        return values | {P.LEAK_PISTON: cylinder.piston_leakage_m3_s_Pa}
    return values | {
        P.LEAK_PISTON: cylinder.piston_leakage_m3_s_Pa,
        P.LEAK_TOP_TANK: cylinder.rod_leakage_m3_s_Pa,
        P.LEAK_CHAMBER_TANK: cylinder.rod_leakage_m3_s_Pa if cylinder.through_rod else 0.0,
    }


def _valve(machine: Machine, leg: Leg) -> dict[P, float]:
    """Valve and spool; edges of port B where the rod side hangs on it."""
    valve = leg.valve
    omega, damping, speed = valve.spool
    roundings = valve.roundings_m
    gradients, overlaps = valve.area_gradients_m(machine.oil.density_kg_m3), valve.overlaps_m
    values = {
        P.CLEARANCE_LENGTH: 3.0e-6,  # [m] assumed radial clearance scale of the land
        P.SPOOL_GAIN: valve.spool_travel_max_m / valve.voltage_max_V,
        P.SPOOL_TRAVEL: valve.spool_travel_max_m,
        P.OVERLAP_SUPPLY: overlaps[0],
        P.OVERLAP_TANK: overlaps[1],
        P.ROUNDING_SUPPLY: roundings[0],
        P.ROUNDING_TANK: roundings[1],
        P.AREA_GRADIENT_SUPPLY: gradients[0],
        P.AREA_GRADIENT_TANK: gradients[1],
        P.QUADRATIC_GAIN: valve.quadratic_gain if valve.flow_area == "quadratic" else 0.0,
        P.DISCHARGE: valve.discharge_coefficient,
        P.PRESSURE_WIDTH: valve.pressure_width_Pa,
        P.LAMINAR: laminar_number(machine, valve.reynolds(machine.oil.density_kg_m3), machine.oil.temperature_degC),
        P.SPOOL_OMEGA: omega,
        P.SPOOL_DAMPING: damping,
        P.SPOOL_RATE: speed,
        P.NULL_OFFSET: valve.null_shift_percent / 100 * valve.voltage_max_V,
        P.HYSTERESIS: valve.hysteresis_percent / 200 * valve.voltage_max_V,  # half of the loop's width
        P.HYSTERESIS_SPREAD: (valve.hysteresis_percent - valve.threshold) / 200 * valve.voltage_max_V,
    }
    if leg.cylinder.rod_side == "valve":
        values |= {
            P.OVERLAP_SUPPLY_TOP: overlaps[2],
            P.OVERLAP_TANK_TOP: overlaps[3],
            P.AREA_GRADIENT_SUPPLY_TOP: gradients[2],
            P.AREA_GRADIENT_TANK_TOP: gradients[3],
            P.ROUNDING_SUPPLY_TOP: roundings[2],
            P.ROUNDING_TANK_TOP: roundings[3],
        }
    return values


def _manifold(manifold: Manifold | None) -> dict[P, float]:
    """Lines and check valves of a safety manifold; its settling orifices are shut."""
    if manifold is None:
        return {}
    return {
        P.PORT_RESISTANCE: manifold.port_resistance_Pa_s2_m6,
        P.SETTLING_TAPER: manifold.settling_taper_m,
        P.CHECK_GAIN: manifold.check_gain_m3_s_sqrtPa,
    }


def _friction(friction: Friction) -> dict[P, float]:
    return {
        P.VISCOUS_EXTEND: friction.viscous_extend_N_s_m,
        P.VISCOUS_RETRACT: friction.viscous_retract_N_s_m,
        P.COULOMB_EXTEND: friction.coulomb_extend_N,
        P.COULOMB_RETRACT: friction.coulomb_retract_N,
        P.STATIC_EXTEND: friction.static_extend_N,
        P.STATIC_RETRACT: friction.static_retract_N,
        P.STRIBECK_VELOCITY: friction.stribeck_velocity_m_s,
        P.SHARPNESS: friction.sharpness_m_s,
        P.ARCTAN_SLOPE: friction.arctan_slope_s_m if friction.form == "report" else 0.0,
        P.RIPPLE_LENGTH: 1.0,
        P.NULL_WARM_UP_TIME: 1.0,
        P.FRICTION_WARM_UP_TIME: 1.0,
        P.WEAR_WIDTH: 1.0,
    }


def laminar_number(machine: Machine, reynolds: float, temperature_degC: float) -> float:
    """Re_cr nu/2 [m2/s] of edges that are laminar below a Reynolds number, in the machine's oil at a temperature."""
    return 0.5 * reynolds * kinematic_viscosity(temperature_degC, machine.oil.properties)


def flow_points(valve: Valve, density_kg_m3: float) -> np.ndarray:
    """Flow curve (2, n_points) of a valve that has one: spool positions [m], and the openings that give the flow [m]."""
    curve = valve.flow_curve
    assert curve is not None
    at, flow = np.array(curve.signal), np.array(curve.flow)
    if at[0] >= 0:  # one sign: the other is its mirror image
        at, flow = np.r_[-at[:0:-1], at], np.r_[-flow[:0:-1], flow]
    units = {unit: unit_to_si(unit, "[valve] flow_curve")[0] for unit in (curve.signal_unit, curve.flow_unit)}
    share = at * units[curve.signal_unit] / (valve.voltage_max_V if curve.signal_unit.endswith("V") else 1.0)
    is_share = curve.flow_unit in ("%", "1")
    opening = flow * units[curve.flow_unit] / (1.0 if is_share else valve.rated_flow_m3_s or 1.0)
    places, opening = valve.spool_travel_max_m * np.stack([share, opening])
    return np.stack([places, turbulent_opening(valve, opening, density_kg_m3)])


def turbulent_opening(valve: Valve, opening: np.ndarray, density_kg_m3: float) -> np.ndarray:
    """Openings [m] whose flow at rated drop and the sheet's viscosity is what `opening` would give by the root law.

    Q = K o (dp^2/(dp^2 + p_cr^2))^(1/4) with p_cr = c/o^2 (`hydraulics.valve`) is quadratic in o^4.
    """
    reynolds = valve.reynolds(density_kg_m3)
    if reynolds == 0.0:
        return opening
    speed = 0.5e-6 * reynolds * valve.sheet_viscosity_mm2_s / valve.discharge_coefficient
    ratio = (0.5 * density_kg_m3 * speed**2 / (valve.rated_pressure_drop_Pa or 1.0)) ** 2  # (c/dp)^2
    fourth = opening**4
    return np.copysign((0.5 * (fourth + np.sqrt(fourth * (fourth + 4.0 * ratio)))) ** 0.25, opening)
