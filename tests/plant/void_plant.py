"""A leg with vapour in its chambers, written apart from hexsim: the oil of each chamber is a state, integrated at 1 us.

    dM/dt = rho Q,   rho = M/V while the oil fills the chamber, P = P_v + E ln rho;  else rho = 1, P = P_v, void V - M

M is oil in volumes at vapour pressure. Bench with constant supply, three-way (rod side on the supply) or four-way valve,
spool of second order or without lag, end stops, sharp edges, friction with tanh. SI units.
"""

import math

import numpy as np
from numba import njit

from hexsim.hydraulics.parameters import P

VAPOUR = 10.0 - 1.01325e5
STEP_S = 1.0e-6
NAMES = {
    "A1": P.AREA_BOTTOM,
    "A2": P.AREA_TOP,
    "stroke": P.STROKE,
    "dead": P.PIPELINE_VOLUME,
    "dead_top": P.ROD_SIDE_VOLUME,
    "E": P.BULK_MODULUS,
    "Ps": P.SUPPLY_PRESSURE,
    "Pt": P.TANK_PRESSURE,
    "rho": P.DENSITY,
    "Cd": P.DISCHARGE,
    "w": P.PRESSURE_WIDTH,
    "O1": P.OVERLAP_SUPPLY,
    "O2": P.OVERLAP_TANK,
    "O3": P.OVERLAP_SUPPLY_TOP,
    "O4": P.OVERLAP_TANK_TOP,
    "g1": P.AREA_GRADIENT_SUPPLY,
    "g2": P.AREA_GRADIENT_TANK,
    "g3": P.AREA_GRADIENT_SUPPLY_TOP,
    "g4": P.AREA_GRADIENT_TANK_TOP,
    "gain": P.SPOOL_GAIN,
    "travel": P.SPOOL_TRAVEL,
    "omega": P.SPOOL_OMEGA,
    "zeta": P.SPOOL_DAMPING,
    "vis_out": P.VISCOUS_EXTEND,
    "vis_in": P.VISCOUS_RETRACT,
    "c_out": P.COULOMB_EXTEND,
    "c_in": P.COULOMB_RETRACT,
    "s_out": P.STATIC_EXTEND,
    "s_in": P.STATIC_RETRACT,
    "stribeck": P.STRIBECK_VELOCITY,
    "sharp": P.SHARPNESS,
    "stop": P.CUSHION_LENGTH,
    "k_stop": P.CUSHION_STIFFNESS,
    "d_stop": P.CUSHION_DAMPING,
    "leak": P.LEAK_SUPPLY_CHAMBER,
    "piston_leak": P.LEAK_PISTON,
    "four_way": P.ROD_SIDE_CHAMBER,
}
(
    A1,
    A2,
    STROKE,
    DEAD,
    DEAD_TOP,
    E,
    PS,
    PT,
    RHO,
    CD,
    WIDTH,
    O1,
    O2,
    O3,
    O4,
    G1,
    G2,
    G3,
    G4,
    GAIN,
    TRAVEL,
    OMEGA,
    ZETA,
    VIS_OUT,
    VIS_IN,
    C_OUT,
    C_IN,
    S_OUT,
    S_IN,
    STRIBECK,
    SHARP,
    STOP,
    K_STOP,
    D_STOP,
    LEAK,
    PISTON_LEAK,
    FOUR_WAY,
    MASS,
    GRAVITY,
) = range(39)


def numbers_of(plant):
    """The leg's numbers, mass and gravity, from the machine's declaration."""
    row, machine = plant.rows[0], plant.machine
    return np.array(
        [*(row[place] for place in NAMES.values()), machine.load.moving_mass_kg, machine.machine.gravity_m_s2]
    )


fast = njit(_nrt=False)  # makes no arrays, so that no owner need be counted


@fast
def pressure(content, volume, modulus):
    return VAPOUR + modulus * math.log(content / volume) if content > volume else VAPOUR


@fast
def edge(n, x, overlap, gradient, dp):
    opening = max(x - overlap, 0.0)
    return n[CD] * gradient * opening * math.sqrt(2.0 / n[RHO]) * dp / (dp * dp + n[WIDTH] ** 2) ** 0.25


@fast
def rates(n, state, volts, pull, out):
    y, v, m1, m2, x, speed = state
    V1, V2 = max(n[A1] * y + n[DEAD], 1e-6), max(n[A2] * (n[STROKE] - y) + n[DEAD_TOP], 1e-6)
    four = n[FOUR_WAY] > 1.0
    P1, P2 = pressure(m1, V1, n[E]), pressure(m2, V2, n[E]) if four else n[PS]
    command = min(max(volts * n[GAIN], -n[TRAVEL]), n[TRAVEL])
    at = min(max(x, -n[TRAVEL]), n[TRAVEL]) if n[OMEGA] > 0.0 else command
    q1 = edge(n, at, n[O1], n[G1], n[PS] - P1) - edge(n, -at, n[O2], n[G2], P1 - n[PT]) + n[LEAK] * (n[PS] - P1)
    q2 = edge(n, -at, n[O3], n[G3], n[PS] - P2) - edge(n, at, n[O4], n[G4], P2 - n[PT]) if four else 0.0
    across = n[PISTON_LEAK] * (P1 - P2) if four else 0.0
    outward = v >= 0.0
    viscous, coulomb, static = (n[VIS_OUT], n[C_OUT], n[S_OUT]) if outward else (n[VIS_IN], n[C_IN], n[S_IN])
    friction = viscous * v + math.tanh(v / n[SHARP]) * (coulomb + static * math.exp(-abs(v) / n[STRIBECK]))
    stops, low, high = 0.0, n[STOP] - y, y - n[STROKE] + n[STOP]
    if low > 0.0:
        stops += n[K_STOP] * low * low / n[STOP] + n[D_STOP] * max(-v, 0.0) * min(low / n[STOP], 1.0)
    if high > 0.0:
        stops -= n[K_STOP] * high * high / n[STOP] + n[D_STOP] * max(v, 0.0) * min(high / n[STOP], 1.0)
    out[0] = v
    out[1] = (P1 * n[A1] - P2 * n[A2] - friction + stops + pull) / n[MASS] - n[GRAVITY]
    out[2] = max(m1 / V1, 1.0) * (q1 - across)
    out[3] = max(m2 / V2, 1.0) * (q2 + across)
    out[4] = speed
    out[5] = n[OMEGA] ** 2 * (command - x) - 2.0 * n[ZETA] * n[OMEGA] * speed
    return P1, P2, V1 - m1 if m1 < V1 else 0.0, V2 - m2 if m2 < V2 and four else 0.0


@fast
def towards(s, h, slope, out):
    for i in range(6):
        out[i] = s[i] + h * slope[i]


@njit
def follow(n, start, volts, pull, tick_s):
    """Rows (y, P1, P2, largest void of the bottom chamber and of the rod side in the tick before) at every tick."""
    out = np.zeros((volts.shape[0], 5))
    s = start.copy()
    k1, k2, k3, k4, there = np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6)
    steps = round(tick_s / STEP_S)
    h, void1, void2 = tick_s / steps, 0.0, 0.0
    for k in range(volts.shape[0]):
        P1, P2, _, _ = rates(n, s, volts[k], pull[k], k1)
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4] = s[0], P1, P2, void1, void2
        void1 = void2 = 0.0
        for _ in range(steps):
            _, _, w1, w2 = rates(n, s, volts[k], pull[k], k1)
            void1, void2 = max(void1, w1), max(void2, w2)
            towards(s, 0.5 * h, k1, there)
            rates(n, there, volts[k], pull[k], k2)
            towards(s, 0.5 * h, k2, there)
            rates(n, there, volts[k], pull[k], k3)
            towards(s, h, k3, there)
            rates(n, there, volts[k], pull[k], k4)
            for i in range(6):
                s[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
    return out


def start_of(n, y, P1, P2):
    """The state at rest at y [m] with pressures P1 and P2 [Pa]."""
    V1, V2 = n[A1] * y + n[DEAD], n[A2] * (n[STROKE] - y) + n[DEAD_TOP]
    return np.array([y, 0.0, V1 * math.exp((P1 - VAPOUR) / n[E]), V2 * math.exp((P2 - VAPOUR) / n[E]), 0.0, 0.0])
