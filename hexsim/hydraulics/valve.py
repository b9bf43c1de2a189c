"""Valve: volts to spool to opening to flow, Eq. 3.2-3.4 and 3.11.

    x_c  = clip((u - u_0) x_max/u_max, +-x_max)                           Eq. 3.2, with null offset u_0
    x''  = w^2 (x_c - x) - 2 zeta w x'                                    optional spool, off = x = x_c (report)
    a(x) = g max(x - O, 0)        or  g s log(1 + exp((x - O)/s))         Eq. 3.3, edge rounding s
    a(x) = 300 x^2                                                        Eq. 3.11
    Q    = C_d a sqrt(2/rho) dp / (dp^2 + w^2)^(1/4)                      Eq. 3.4, smooth within w of dp = 0

The regularised root keeps the sign of dp (flow in both directions), differs from sqrt(|dp|) by less than 0.3 % beyond
10 w, and has the finite slope C_d a sqrt(2/rho)/sqrt(w) at dp = 0.

An edge that opens by o is laminar below a Reynolds number Re_cr (`[valve] laminar_reynolds`), of the mean velocity Q/a
and the hydraulic diameter 2 o of a slot. There the width w grows to that of the transition:

    w^2  = w_0^2 + p_cr^2,   p_cr = rho/2 (Re_cr nu/(2 C_d o))^2

    Re >> Re_cr    C_d as declared, the root law
    Re << Re_cr    C_d sqrt(Re/Re_cr),   Q = 4 C_d^2/Re_cr g o^2 dp/(rho nu)      linear in dp, square in o, over nu

The form is that of Borutzky, Barnard and Thoma 2002 (Simulation Modelling Practice and Theory 10) and of commercial
libraries. Re_cr is where the two asymptotes meet: C_d = delta sqrt(Re) with delta = 0.157 of a sharp-edged slot (Merritt
1967, 3-4) gives (0.611/0.157)^2 = 15. Without Re_cr every opening is turbulent, down to w_0.
Limits: one Re_cr for all edges; measured curves may overshoot C_d about the transition; nu is that of oil without pressure.
"""

import math

import numpy as np

from hexsim.compiled import compiled


@compiled
def spool_command(volts, null_offset, gain, travel):
    """Spool position asked for [m], saturated, Eq. 3.2."""
    return min(max((volts - null_offset) * gain, -travel), travel)


@compiled
def spool_acceleration(position, velocity, command, omega, damping):
    """Second-order spool [m/s2]."""
    return omega * omega * (command - position) - 2.0 * damping * omega * velocity


@compiled
def spool_rates(position, velocity, command, omega, damping, limit):
    """(dx/dt [m/s], d2x/dt2 [m/s2]) of a spool no faster than `limit` [m/s] (0: none).

    damping 0: first order, dx/dt = omega (command - x), a spool that a pilot of limited flow moves. At the limit the
    speed of a second-order spool winds up no further.
    """
    if damping <= 0.0:
        velocity, acceleration = omega * (command - position), 0.0
    else:
        acceleration = spool_acceleration(position, velocity, command, omega, damping)
    if limit <= 0.0:
        return velocity, acceleration
    if abs(velocity) >= limit and velocity * acceleration > 0.0:
        acceleration = 0.0
    return min(max(velocity, -limit), limit), acceleration


@compiled
def opening(x, overlap, rounding):
    """Length of the open edge [m] for travel x towards it, Eq. 3.3; rounding s > 0 smooths the corner."""
    beyond = x - overlap
    if rounding <= 0.0:
        return max(beyond, 0.0)
    z = beyond / rounding
    if z > 40.0:
        return beyond
    if z < -40.0:
        return 0.0
    e = math.exp(-abs(z))
    # below e^-12 = 6e-6 three terms of the series are log(1 + e) to the last digit, in a fifth of the time
    more = e * (1.0 - e * (0.5 - e / 3.0)) if abs(z) > 12.0 else math.log1p(e)
    return max(beyond, 0.0) + rounding * more


@compiled
def transition_pressure(opening, laminar, discharge, density, width):
    """Pressure drop [Pa] about which the flow through an edge turns from laminar to turbulent; at least `width`.

    opening [m]: of the edge; laminar = Re_cr nu/2 [m2/s], 0: turbulent at any opening.
    """
    if laminar <= 0.0:
        return width
    # far below an atom the transition pressure stays finite, and the flow is none
    speed = laminar / (discharge * max(opening, 1.0e-12))
    pressure = 0.5 * density * speed * speed
    return math.sqrt(width * width + pressure * pressure)


@compiled
def edge_area(x, overlap, rounding, gradient, quadratic_gain):
    """Flow area of one edge [m2] for travel x towards it."""
    if quadratic_gain > 0.0:
        return quadratic_gain * max(x, 0.0) ** 2
    return gradient * opening(x, overlap, rounding)


@compiled
def smooth_root(dp, width):
    """dp/(dp^2 + w^2)^(1/4) [sqrt(Pa)], an odd, smooth stand-in for sign(dp) sqrt(|dp|)."""
    return dp / math.sqrt(math.sqrt(dp * dp + width * width))


@compiled
def smooth_root_slope(dp, width):
    """d smooth_root / d dp [1/sqrt(Pa)]."""
    square = dp * dp + width * width
    return (0.5 * dp * dp + width * width) / (square * math.sqrt(math.sqrt(square)))


@compiled
def orifice_flow(area, dp, discharge, density, width):
    """Flow through a sharp orifice [m3/s], both directions, Eq. 3.4."""
    return discharge * area * math.sqrt(2.0 / density) * smooth_root(dp, width)


@compiled
def clearance_conductance(x, overlap, conductance, length):
    """Laminar conductance of a closed land [m3/s/Pa]: G / (1 + (O - x)/l), G at the edge, l the clearance length.

    Poiseuille flow through the remaining sealing length; an open edge leaks no more than at its corner.
    """
    return conductance / (1.0 + max(overlap - x, 0.0) / length)


def delay_in_ticks(delay_s: np.ndarray, tick_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Whole ticks of each delay (n_legs,), and what is left of a tick [s]: the volts, constant over a tick, change within one.

    A rest below a millionth of a tick is rounding.
    """
    whole = np.floor(delay_s / tick_s + 1e-6).astype(np.int64)
    rest = delay_s - whole * tick_s
    return whole, np.where(rest > 1e-6 * tick_s, rest, 0.0)


@compiled
def play(volts, previous, half_width):
    """Backlash operator: the value that follows `volts` within +-half_width (hysteresis of the spool)."""
    return min(max(previous, volts - half_width), volts + half_width)


@compiled
def hysteresis(volts, held, apart, half_width, spread):
    """Volts that reach the spool, and how far its two plays are apart [V]: half the sum of two backlashes (Prandtl-Ishlinskii).

    Half widths h - d and h + d, d = `spread`: a full cycle has a loop of 2 h, a reversal moves the spool after
    2 (h - d), the threshold. d = 0: one backlash, threshold and loop are as wide.
    """
    narrow = max(half_width - spread, 0.0)
    quick = play(volts, held - 0.5 * apart, narrow)
    slow = play(volts, held + 0.5 * apart, 2.0 * half_width - narrow)
    return 0.5 * (quick + slow), slow - quick
