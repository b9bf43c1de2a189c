"""What is asked for at the tick boundaries to come: a queue of demands."""

from __future__ import annotations

from ..compiled import compiled


@compiled
def append_demand(demands, pressure, share, acceleration, position, oil, velocity, sign, step):
    """The demand for the boundary looked at now goes to the end of the queue."""
    n = demands.count
    demands.pressure_Pa[n], demands.stribeck_share[n] = pressure, share
    demands.acceleration_m_s2[n], demands.position_m[n] = acceleration, position
    demands.oil_m[n], demands.velocity_m_s[n] = oil, velocity
    demands.sign[n], demands.step_Pa[n] = sign, step
    demands.count = n + 1


@compiled
def drop_demand(demands):
    """The demand for now, the first of the queue, is met."""
    demands.count -= 1
    for i in range(demands.count):
        demands.pressure_Pa[i], demands.stribeck_share[i] = demands.pressure_Pa[i + 1], demands.stribeck_share[i + 1]
        demands.acceleration_m_s2[i] = demands.acceleration_m_s2[i + 1]
        demands.position_m[i], demands.oil_m[i] = demands.position_m[i + 1], demands.oil_m[i + 1]
        demands.velocity_m_s[i], demands.sign[i] = demands.velocity_m_s[i + 1], demands.sign[i + 1]
        demands.step_Pa[i] = demands.step_Pa[i + 1]


@compiled
def stretch_demands(state, shift):
    """Demands `shift` ticks further ahead than PREVIEW_TICKS, while nothing is added."""
    d = state.demands
    while state.shift < shift:
        n = d.count - 1
        append_demand(
            d, d.pressure_Pa[n], d.stribeck_share[n], d.acceleration_m_s2[n], d.position_m[n], d.oil_m[n],
            d.velocity_m_s[n], d.sign[n], d.step_Pa[n],
        )  # fmt: skip
        state.shift += 1
    if state.shift > shift:
        d.count -= state.shift - shift
        state.shift = shift
