"""Damping of the oil column: oil is let out in proportion to the pressure's oscillation about the model's.

At each leg that takes energy out of whatever the platform's legs do together, so that the modes need not be known; the filter makes
up for the valve's lag (damping_design.py), which is that of the identified leg.
"""

from __future__ import annotations

from math import pi, sqrt

from ..arithmetic import clip, dot, push
from ..compiled import compiled
from ..damping_design import damping_filter, next_damping_gain
from .leg import (
    AIR,
    AMP_LAG,
    DELAY,
    MASS,
    P1,
    P2,
    S_A1,
    S_A2,
    S_E,
    S_FOUR_WAY,
    S_OWN,
    S_STROKE,
    S_TICK,
    S_V1,
    S_V2,
    SOFT,
    VISCOUS_DN,
    VISCOUS_UP,
    ZETA,
    Y,
    capacity,
    valve_lag_s,
)  # fmt: skip

RATE_1_S = 80.0  # of an oscillation let out a second: it is gone within a period of the slowest, 40 Hz
TAPS, LOW_Hz, HIGH_Hz = 7, 15.0, 65.0  # ticks of pressure; band of the oil's resonances below what is judged
PEAK = 3.0  # standard deviations that noise reaches within a stroke
NOISE_SHARE = 0.5  # of the expected bump that it may make: both together are then an eighth more
LIMIT_V = 0.2  # of its volts
SAME_LAG_S = 2e-4  # of the valve: 4 deg at 60 Hz


@compiled
def start_damping(d, tick_s):
    """d: a record DAMPING of zeros."""
    d.tick_s, d.damping_count, d.damping_low_Hz, d.damping_high_Hz = tick_s, TAPS, LOW_Hz, HIGH_Hz
    d.gain, d.lag_s = 1.0, -1.0


@compiled
def watch_damping(d, numbers, off_Pa, turn):
    """A tick's deviation of the load pressure from the model's [Pa]; d.wanted: the filter is for another valve, and it is this leg's
    turn, for one design takes most of a tick."""
    push(d.deviation_Pa, off_Pa)
    if turn and abs(valve_lag_s(numbers) - d.lag_s) > SAME_LAG_S:
        d.wanted = 1


@compiled
def design_damping(s):
    """The filter for the valve and the load that are identified. Takes longer than a tick."""
    d, n = s.damping, s.numbers
    d.lag_s, d.spool_damping, d.wanted = valve_lag_s(n), n[ZETA], 0
    mass = n[MASS] * s.sheet[S_OWN]
    resonance_Hz = sqrt(oil_stiffness(n, s.sheet, s.inverse.x, s.inverse.w) / mass) / (2.0 * pi)
    viscous = 0.5 * (n[VISCOUS_UP] + n[VISCOUS_DN]) / mass
    damping_filter(d.work, d.taps, d.lag_s, n[DELAY] + n[AMP_LAG], (resonance_Hz, viscous / RATE_1_S), d)


@compiled
def oil_stiffness(n, sheet, x, w):
    """Of the oil in a leg with numbers n in the state x [N/m]. w (4,): space."""
    E, a1, a2 = sheet[S_E] / (1.0 + n[SOFT]), sheet[S_A1], sheet[S_A2]
    capacity(x[Y] * a1 + sheet[S_V1], x[P1], E, n[AIR], w)
    k = a1 * a1 / w[0]
    if sheet[S_FOUR_WAY] != 0.0:
        capacity((sheet[S_STROKE] - x[Y]) * a2 + sheet[S_V2], x[P2], E, n[AIR], w)
        k += a2 * a2 / w[0]
    return k


@compiled
def damping_rate_1_s(n, sheet, noise_Pa, bump2):
    """Rate at which an oscillation is let out: as high as the noise of the pressure allows.

    White noise of variance R a tick T, let out at a rate g, keeps a mode at the pressure variance g T R/2; PEAK standard deviations of
    that acceleration are at most NOISE_SHARE of the bump that is expected anyway or that nobody feels, its square bump2.
    """
    push_m_s2 = PEAK / NOISE_SHARE * sheet[S_A1] * noise_Pa / (n[MASS] * sheet[S_OWN])
    return min(RATE_1_S, 2.0 * bump2 / (sheet[S_TICK] * push_m_s2 * push_m_s2))


@compiled
def let_out_V_Pa(rate_1_s, stiffness_N_m, area_m2, gain_m_s_V, own_V_Pa):
    """Volts a pressure that let the oil out. own_V_Pa: what the controller's own pressure feedback lets out already."""
    return max(rate_1_s * area_m2 / (stiffness_N_m * gain_m_s_V) - own_V_Pa, 0.0)


@compiled
def let_out_V(d, deviation_Pa):
    """Volts that let the oil out at these deviations (MAX_DAMPING_TAPS,), the newest first."""
    return clip(d.gain * d.let_out_V_Pa * dot(d.taps, deviation_Pa, TAPS), -LIMIT_V, LIMIT_V)


@compiled
def damping_V(d):
    """`let_out_V` at the leg's own deviations; the gain falls as the volts come near their bound."""
    u = let_out_V(d, d.deviation_Pa)
    d.gain = next_damping_gain(d.gain, u, LIMIT_V, d.tick_s)
    return u
