"""Friction of the cylinder: asymmetric Stribeck curve, Eq. 2.4 and 3.9, with presliding (LuGre) as an option.

    sharp   F = sigma v + tanh(v/v_s)   [F_c + F_s exp(-|v|/c_s)]        Eq. 2.4, sign regularised within v_s
    report  F = sigma v + arctan(k v)   [F_c + F_s exp(-|v|/c_s)]        Eq. 3.9 as printed (tends to 1.57 F_c)
    LuGre   F = sigma v + s0 z + s1 dz/dt,   dz/dt = v - s0 |v| z / g(v),  g = F_c + F_s exp(-|v|/c_s)

sigma, F_c, F_s of the direction of motion. The force acts against v.
"""

import math

from hexsim.compiled import compiled


@compiled
def stribeck_level(velocity, coulomb, static, stribeck_velocity):
    """g(v) = F_c + F_s exp(-|v|/c_s) [N]."""
    return coulomb + static * math.exp(-abs(velocity) / stribeck_velocity)


@compiled
def direction(velocity, sharpness, arctan_slope):
    """Smooth sign(v): tanh(v/v_s), or arctan(k v) of Eq. 3.9 when arctan_slope > 0."""
    if arctan_slope > 0.0:
        return math.atan(arctan_slope * velocity)
    return math.tanh(velocity / sharpness)


@compiled
def bristle_rate(velocity, bristle, level, stiffness):
    """dz/dt [m/s] of the LuGre bristle."""
    return velocity - stiffness * abs(velocity) * bristle / level


@compiled
def end_stop_force(y, velocity, stroke, length, stiffness, damping, choke_low=0.0, choke_high=0.0):
    """Soft end stops [N], positive pushes outwards: a progressive spring k d^2/l within l of either end, with damping.

    choke_low, choke_high [N s2/m2]: A^3/K^2 of a cushion whose pocket of area A empties through an orifice, q = K sqrt(dp):
    force A dp = A (A v/K)^2; a tapered spear shuts the way past it over l. Its oil is taken for stiff.
    Damping and orifice act only on the way in, so that a stop never pulls: a check valve fills the pocket on the way out.
    """
    low = length - y
    high = y - (stroke - length)
    force = 0.0
    if low > 0.0:
        inwards = max(-velocity, 0.0)
        force += stiffness * low * low / length + (damping + choke_low * inwards) * inwards * min(low / length, 1.0)
    if high > 0.0:
        inwards = max(velocity, 0.0)
        force -= stiffness * high * high / length + (damping + choke_high * inwards) * inwards * min(high / length, 1.0)
    return force
