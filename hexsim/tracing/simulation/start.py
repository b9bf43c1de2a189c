"""The state in which a simulation of a log begins: load, pressures, supply.

Both pressures of a leg with two chambers on the valve are states that no load fixes. They begin as measured, and are
then corrected by a few steps of single shooting over the first rules.BLOCK_S of the log, all along the slopes of the first: the
pressures to which the model answers best there. So a log may begin in any transient.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from hexsim.hydraulics import learned
from hexsim.hydraulics import leg as equations
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import POWER_UNIT, S, pump_flow_command
from hexsim.mechanics.kinematics import HexapodKinematics
from hexsim.mechanics.rigid_body import joint_wrenches, ride_wrench
from hexsim.signals.channels import COMPARED
from hexsim.signals.log import Log
from hexsim.signals.table import table
from hexsim.signals.weak_form import HALF_WIDTH_S
from hexsim.tracing import rules
from hexsim.tracing.simulation import closed_loop as loop
from hexsim.tracing.simulation import motion
from hexsim.tracing.simulation.rig import Rig

Array = np.ndarray


class Starting(NamedTuple):
    """Constants of the estimated start of a log."""

    rest_m: float = 2.0e-5  # [m] a log that begins this near its setpoint begins at rest
    # finite difference of a start pressure: ten times wider, the answer bends and the steps fall short
    shot_Pa: float = 1.0e3
    curve: int = 6  # order of the curve that is no ringing, up to 30 Hz
    unknown_Pa: float = 1.0e6  # what a start pressure may be off by that is not measured


STARTING = Starting()


def start_of(log: Log, gain: Array, offset: Array) -> tuple[Array, Array]:
    """Positions [m] and speeds [m/s] (n_legs,) at the beginning of a log: at rest if the first samples are at the setpoints.

    gain, offset (n_legs,): of the position sensors, y_m = gain y + offset.
    """
    first = log.position[:, :2].mean(axis=1)
    if log.setpoint is not None and np.all(np.abs(log.setpoint[:, 0] - first) < STARTING.rest_m):
        return (log.setpoint[:, 0] - offset) / gain, np.zeros(log.n_legs)
    head = max(int(HALF_WIDTH_S * log.rate), 4)
    speed, first = np.polyfit(log.time[:head] - log.time[0], log.position[:, :head].T, 1)
    return (first - offset) / gain, speed / gain


def start_state(rig: Rig, resolved: Resolved, log: Log) -> Array:
    """Load at the first positions, at rest or in steady motion; pressures that carry it (see `start_pressures`)."""
    y, v = start_of(log, *rig.sensors.position.T[:2])
    thrust, down, load = load_at(rig, resolved, y, v)
    measured = measured_start(rig, log)
    ps, shown = rig.supply[S.PRESSURE], measured.pop("pressure_supply", None)
    if rig.supply[S.MODEL] == POWER_UNIT and shown is not None:
        ps = shown[0]
    legs = np.zeros((log.n_legs, motion.LEG_STATES))
    for i, (own, row, force) in enumerate(zip(legs, rig.legs, thrust, strict=True)):
        known = {stem: values[i] for stem, values in measured.items()}
        own[motion.LEG_P1], own[motion.LEG_P2] = start_pressures(row, (y[i], v[i]), ps, force, known)
        if row[P.SPOOL_OMEGA] > 0.0:
            own[motion.LEG_X] = equations.commanded_spool(row, 0.0, 0.0)
        own[motion.LEG_MEMORY] = learned.signal_of(row, y[i], v[i], 0.0, own[motion.LEG_P1], ps, 0.0)
    travel = down / rig.load.spring.omega**2 if rig.load.spring.mass > 0 else 0.0
    return np.concatenate([[ps, travel, 0.0], power_unit_at(rig.supply, ps), legs.ravel(), load])


def power_unit_at(s: Array, ps: float) -> Array:
    """Motor speed, flows of pump and line, pressure at the pump of a power unit that keeps ps without demand; zeros without one."""
    if s[S.MODEL] != POWER_UNIT:
        return np.zeros(4)
    return np.array([1.0, pump_flow_command(s, 1.0, ps), 0.0, ps])


def measured_start(rig: Rig, log: Log) -> dict[str, Array]:
    """Pressures at the beginning of the log (n_rows,) [Pa]: pressure_bottom, pressure_top, pressure_difference, supply.

    Without what the log does not show: a channel that is missing, or that stands at zero.
    """
    head, one = max(int(HALF_WIDTH_S * log.rate), 4), np.array([[rig.sensors.supply_gain, 0.0]])
    shown = {
        "pressure_bottom": rig.sensors.pressure, "pressure_top": rig.sensors.top,
        "pressure_difference": np.tile([1.0, 0.0], (log.n_legs, 1)), "pressure_supply": one,
    }  # fmt: skip
    found = {}
    for stem, sensor in shown.items():
        rows = log.signal(stem)
        if rows is not None and np.any(rows[..., :head]):
            first = np.polyfit(log.time[:head] - log.time[0], np.atleast_2d(rows)[:, :head].T, 1)[1]
            found[stem] = (first - sensor[:, 1]) / sensor[:, 0]
    return found


def ringing_Pa(log: Log, noise_Pa: float) -> Array:
    """Rms (n_legs,) of the pressures at the bottom about a smooth curve over their first tenth of a second, beyond noise; 0 where
    that is hardly more than noise. The start state is without it: of oil that rings no start tells the phase."""
    if log.pressure is None:
        return np.zeros(log.n_legs)
    n = max(int(rules.SPREAD_S * log.rate), 2 * STARTING.curve)
    basis = np.vander(np.linspace(-1.0, 1.0, n), STARTING.curve + 1)
    first = log.pressure[:, :n].T
    square = np.sum((first - basis @ np.linalg.lstsq(basis, first)[0]) ** 2, axis=0) / (n - STARTING.curve - 1)
    return np.where(square > rules.NEAR * noise_Pa**2, np.sqrt(np.maximum(square - noise_Pa**2, 0.0)), 0.0)


def start_pressures(
    row: Array, moving: tuple[float, float], ps: float, thrust: float, known: Mapping[str, float]
) -> tuple[float, float]:
    """(P1, P2) [Pa] of a leg that begins at (y, v) and carries a thrust [N].

    A rod side on the valve: as measured; with one pressure, or the difference of both alone, so that they carry the
    thrust; with none, P1 + P2 = Ps + Pt, where matched edges shut alike. Any other rod side is at supply pressure.
    """
    if row[P.ROD_SIDE_CHAMBER] != ROD_SIDE_VALVE:
        return motion.carrying_pressure(row, *moving, ps, ps, thrust), ps
    P1, P2, difference = (known.get(f"pressure_{which}") for which in ("bottom", "top", "difference"))
    if P1 is not None and P2 is not None:
        return P1, P2
    if P2 is not None:
        return motion.carrying_pressure(row, *moving, P2, ps, thrust), P2
    areas = row[P.AREA_BOTTOM], row[P.AREA_TOP]
    lifted = motion.carrying_pressure(row, *moving, 0.0, ps, thrust) * areas[0]  # P1 A1 - P2 A2
    if P1 is not None:
        return P1, (P1 * areas[0] - lifted) / areas[1]
    if difference is not None and areas[0] > 1.01 * areas[1]:
        P2 = (lifted - difference * areas[0]) / (areas[0] - areas[1])
        return P2 + difference, P2
    total = ps + row[P.TANK_PRESSURE]
    P1 = (lifted + total * areas[1]) / (areas[0] + areas[1])
    return P1, total - P1


def load_at(rig: Rig, resolved: Resolved, y: Array, v: Array) -> tuple[Array, float, Array]:
    """(thrusts (n_legs,) [N] that carry the load without acceleration, gravity along its payload's spring [m/s2], its states)."""
    body, spring, gravity = rig.load.body, rig.load.spring, np.array(rig.load.gravity)
    if len(y) == 1:
        return -(body.carried + spring.mass) * gravity[2:], float(gravity[2]), np.array([y[0], v[0]])
    kinematics = resolved.mechanics
    assert isinstance(kinematics, HexapodKinematics)
    pose = kinematics.forward(y)
    rotation, jacobian = kinematics.rotation(pose), kinematics.jacobian(pose)
    twist, own = np.linalg.solve(jacobian, v), rotation.T @ gravity
    at_rest, down = joint_wrenches(body, np.zeros((1, 6)), np.zeros((1, 3)), own[None])[0], float(own @ spring.axis)
    if spring.mass > 0.0:
        none, field = (0.0, 0.0, 0.0), (float(own[0]), float(own[1]), float(own[2]))
        at_rest += np.concatenate(ride_wrench(spring, none, none, none, field, down / spring.omega**2, 0.0)[:2])
    thrust = kinematics.static_leg_forces(pose, kinematics.from_platform_frame(pose, at_rest))
    place = pose[:3] + np.array([0.0, 0.0, kinematics.neutral_height_m])
    turned = Rotation.from_matrix(rotation).as_quat()[[3, 0, 1, 2]]
    return thrust, down, np.concatenate([place, turned, twist[:3], rotation.T @ twist[3:]])


def shot(rig: Rig, inputs: loop.Inputs, state: Array, log: Log, noise: Mapping[str, float]) -> Array:
    """The start state with the pressures of two-chamber legs corrected by what follows, see above; else as it is.

    Least squares over all channels of the first rules.BLOCK_S with their noise, the pressures held to where they stand by what
    the log leaves open of them. A start that diverges, and a log that shows nothing but positions, change nothing.
    """
    two = [i for i, row in enumerate(rig.legs) if row[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE]
    n = min(int(rules.BLOCK_S * log.rate), log.n)
    shown = {stem: np.atleast_2d(rows)[:, :n] for stem in COMPARED if (rows := log.signal(stem)) is not None}
    if not two or not any(np.any(rows) for stem, rows in shown.items() if stem != "position"):
        return state
    scale = np.concatenate([np.full(len(rows), noise[table()[stem].kind]) for stem, rows in shown.items()])[:, None]
    measured = np.concatenate(list(shown.values())) / scale
    head = inputs._replace(**{name: np.ascontiguousarray(getattr(inputs, name)[..., :n]) for name in loop.SIGNALS})

    def off(at: Array) -> Array:
        out = outputs(loop.answer(rig, head, at), log.n_legs)
        return (
            measured - np.concatenate([np.atleast_2d(out[stem])[: len(rows)] for stem, rows in shown.items()]) / scale
        ).ravel()

    places = [motion.LEGS + i * motion.LEG_STATES + which for i in two for which in (motion.LEG_P1, motion.LEG_P2)]
    steps = np.zeros((len(places), len(state)))
    steps[range(len(places)), places] = STARTING.shot_Pa
    both = "pressure_bottom" in shown and "pressure_top" in shown
    open_Pa = rules.ERRORS * noise["pressure_bottom_Pa"] if both else STARTING.unknown_Pa
    weak, moved = (STARTING.shot_Pa / open_Pa) ** 2 * np.eye(len(places)), np.zeros(len(places))
    rest = off(state)
    columns = np.array([rest - off(state + step) for step in steps])
    if not np.isfinite(columns).all():
        return state
    for _ in range(rules.FEW):
        moved += np.linalg.solve(columns @ columns.T + weak, columns @ rest - weak @ moved)
        rest = off(state + moved @ steps)
        if not np.isfinite(rest).all():
            return state
    return state + moved @ steps


def outputs(out: Array, n_legs: int) -> dict[str, Array]:
    """Rows of `loop.answer` by signal: (n_legs, n), supply (n,), accelerations (n_axes, n)."""
    position, valve, bottom, top, rest = np.split(out, n_legs * np.arange(1, 5))
    return {
        "position": position, "valve": valve, "pressure_bottom": bottom, "pressure_top": top, "pressure_difference": bottom - top,
        "pressure_supply": rest[0], "acceleration": rest[1:4], "angular_acceleration": rest[4:],
    }  # fmt: skip
