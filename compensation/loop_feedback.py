"""What the controller's own feedback makes of the motion asked for, so that only what is missing is added.

Beside Kp (r - y) a controller may feed back velocity and pressure, each through a filter of first order:

    u = .. - K_d v_f(y) - K_p H(p),     v_f = w s/(s + w) y,   H = s/(s + w_p),   p = P1 - P2 A2/A1 (three-way valve: P1)

In the motion asked for these are K_d v_f(y_m) and K_p H(p_m), known beforehand: a friction step of 0.2 MPa alone is
12 mV for 0.2 s. They are added back, as Kp (r - y_m) is taken off; the controller is left with deviations. What it
makes of the setpoint alone is its feed-forward, which the lead replaces. The integral stands still without deviation.
"""

from __future__ import annotations

from .compiled import compiled
from .records import record

LOOP = record(  # state
    started="i8",
    position_m="f8",
    velocity_m_s="f8",
    pressure_Pa="f8",
    passed_Pa="f8",
)


@compiled
def fed_back_V(loop, settings, position_m, pressure_Pa):
    """One tick: volts that velocity and pressure feedback take off in the motion asked for; both of now."""
    if loop.started == 0:
        loop.started, loop.position_m, loop.pressure_Pa = True, position_m, pressure_Pa
    moved_m, change_Pa = position_m - loop.position_m, pressure_Pa - loop.pressure_Pa
    loop.position_m, loop.pressure_Pa = position_m, pressure_Pa
    loop.velocity_m_s = settings.velocity_pole * loop.velocity_m_s + settings.velocity_share * moved_m
    loop.passed_Pa = settings.pressure_pole * loop.passed_Pa + settings.pressure_share * change_Pa
    return settings.velocity_gain_V_s_per_m * loop.velocity_m_s + settings.pressure_gain_V_per_Pa * loop.passed_Pa
