# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""States that a plant begins with: pressures in static equilibrium, the supply at rest, spools at their command."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hexsim.errors import HexsimError
from hexsim.hydraulics import learned, leg
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P
from hexsim.hydraulics.supply import POWER_UNIT, S, power_unit_start
from hexsim.plant.callbacks import POWER_UNIT_SCALE, MPa, supply_pressure
from hexsim.plant.states import A

Array = NDArray[np.float64]


def static_pressures(plant: Any) -> tuple[np.ndarray, np.ndarray]:
    """Bottom pressures (n_legs,) [Pa] that hold the machine still in its present pose, and its legs' compliance.

    P1 A1 - P2 A2 = F, F the axial force that the load asks of each leg, P2 as `hold_still` says: the platform's
    accelerations are affine in the six forces, so seven evaluations and one solve give them. (The legs' own
    accelerations are left out: they settle within the 0.1 um give of the ball ends.)
    compliance (n_legs, n_legs) [1/kg]: the acceleration of each leg for a force on each.
    """
    model, data, n = plant.model, plant.data, plant.n_legs

    def accelerations(pressures: Array) -> Array:
        hold_still(plant, pressures)
        mujoco.mj_forward(model, data)
        return data.qacc[:n].copy()  # the platform's free joint, or the bench's slide

    start = np.full(n, plant.machine.supply.pressure_Pa / 2)
    at_start = accelerations(start)
    step = 1e5
    slopes = np.column_stack([(accelerations(start + step * np.eye(n)[i]) - at_start) / step for i in range(n)])
    pressures = start - np.linalg.solve(slopes, at_start)
    along = np.take(plant.kinematics.jacobian(np.zeros(6)), plant.kinematics.dof_places, axis=1)
    on_valve = plant.rows[:, P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE  # P2 falls there as P1 rises
    compliance = along @ slopes / (plant.rows[:, P.AREA_BOTTOM] + on_valve * plant.rows[:, P.AREA_TOP])
    low, high = plant.machine.supply.tank_pressure_Pa, plant.machine.supply.pressure_Pa
    if np.any(pressures <= low) or np.any(pressures >= high):
        worst = int(np.argmax(np.abs(pressures - (low + high) / 2)))
        raise HexsimError(
            f"machine {plant.machine.name}: leg {worst + 1} needs {pressures[worst] / 1e5:.1f} bar to hold the load at "
            f"rest, outside {low / 1e5:.1f}..{high / 1e5:.1f} bar: lower the mass or raise the supply"
        )
    return pressures, 0.5 * (compliance + compliance.T)


def hold_still(plant: Any, bottom_Pa: Array) -> None:
    """Write bottom pressures (n_legs,) [Pa] into the state, and the rod sides that rest with them.

    On the supply or behind a port: P2 = Ps. On port B: P1 + P2 = Ps + Pt, which matched edges need to pass no net
    flow at one spool position, (Ps - P1)/(P1 - Pt) = (P2 - Pt)/(Ps - P2).
    """
    supply, tank = plant.machine.supply.pressure_Pa, plant.machine.supply.tank_pressure_Pa
    plant.data.act[plant.pressure_places] = bottom_Pa / MPa
    for i in np.flatnonzero(plant.layout[: plant.n_legs, A.ROD_SIDE] >= 0):
        on_valve = plant.rows[i, P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE
        top = supply + tank - bottom_Pa[i] if on_valve else supply
        plant.data.act[int(plant.layout[i, A.ROD_SIDE])] = top / MPa
    for i in np.flatnonzero(plant.layout[: plant.n_legs, A.MEMORY] >= 0):
        begin_memory(plant, int(i), bottom_Pa[i])


def begin_memory(plant: Any, i: int, bottom_Pa: float) -> None:
    """What the learned term of leg i remembers begins at its signal."""
    y, v, volts = plant.piston_positions()[i], float(plant.data.actuator_velocity[i]), plant.context.spool_volts[i]
    supply = float(supply_pressure(plant.rows[i], plant.layout[i], plant.data.act))
    now = learned.signal_of(plant.rows[i], y, v, volts, bottom_Pa, supply, plant.data.time)
    plant.data.act[int(plant.layout[i, A.MEMORY])] = now


def start_supply(plant: Any) -> None:
    """The manifold at its pressure, the pump running."""
    row = plant.resolved.supply
    first, last = int(plant.layout[-1, A.SUPPLY]), int(plant.layout[-1, A.PRESSURE])
    if row[S.MODEL] == POWER_UNIT:
        plant.data.act[first : last + 1] = power_unit_start(row) / POWER_UNIT_SCALE
    plant.data.act[last] = plant.machine.supply.pressure_Pa / MPa


def begin_states(plant: Any, before: Array) -> None:
    """Start the states of legs that had none with the rows `before`: spool at its command, bristle in balance with friction."""
    act, t = plant.data.act, plant.data.time
    for i, (was, row, places) in enumerate(zip(before, plant.rows, plant.layout, strict=False)):
        if row[P.SPOOL_OMEGA] > 0.0 and was[P.SPOOL_OMEGA] <= 0.0:
            act[int(places[A.SPOOL])] = leg.commanded_spool(row, plant.context.spool_volts[i], t)
        if row[P.LEARNED_MEMORY] > 0.0 and was[P.LEARNED_MEMORY] <= 0.0:
            begin_memory(plant, i, plant.bottom_pressures()[i])
        if row[P.BRISTLE_STIFFNESS] > 0.0 and was[P.BRISTLE_STIFFNESS] <= 0.0:
            y, v = plant.piston_positions()[i], float(plant.data.actuator_velocity[i])
            dry = leg.friction_force(was, y, v, plant.bottom_pressures()[i], 0.0, t=t)
            dry -= leg.viscous_friction(was, v, t)
            act[int(places[A.BRISTLE])] = dry / row[P.BRISTLE_STIFFNESS]
