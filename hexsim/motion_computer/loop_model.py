"""The declared loop as a linear one: legs about neutral, controllers as they are, and what follows for stability.

A leg (hydraulics of `leg.leg_derivatives`, differentiated numerically) pushes a mass m along its axis:
    s = (P1, P2, x, x', y, v),  v' = F(s)/m,      Coulomb and static friction left out: they damp
It stands open by open_share of its travel beyond the lap, once either way: shut, an overlapped valve has no gain at all, and
wide open it damps more. Equal legs on a platform part into as many single loops as there are legs: the modes of
A = J M^-1 J', each with the mass 1/eigenvalue. A machine whose legs differ is judged by each leg in each mode.

Sampled exactly (zero-order hold, matrix exponential), delays as powers of z. The controller's matrices are read off
`controller.py` itself, which is linear where nothing saturates: unit memory or unit input in, next memory and volts out.
Left out: hysteresis, slew of the spool, supply as it droops, sensor noise and resolution.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.hydraulics import leg, ports
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P
from hexsim.hydraulics.resolve import resolve
from hexsim.hydraulics.resolved import Resolved
from hexsim.motion_computer import controller
from hexsim.motion_computer.controller import N_MEMORY, C, Control
from hexsim.motion_computer.declared_control import control_of
from hexsim.motion_computer.leg_load import holding_forces, leg_compliance
from hexsim.smoothness.band import BANDWIDTH_Hz

Array = NDArray[np.float64]


class L(IntEnum):
    """Places in a leg's state, and of its volts behind it."""

    P1 = 0
    P2 = 1
    X = 2
    RATE = 3
    Y = 4
    V = 5
    VOLTS = 6


Matrices = tuple[Any, Any, Any, Any]  # A, B, C, D: arrays
OUTSIDE = 1e-9  # of the unit circle, beyond which a pole counts as unstable


def leg_at(
    p: Array,
    force: float,
    supply_Pa: float,
    sign: float,
    position_m: float | None = None,
    *,
    open_share: float = 0.01,  # of the spool's travel, beyond the lap
) -> tuple[Array, Array]:
    """A leg's state and volts (7,) in steady motion with its valve open one way, and its row without dry friction.

    position_m: of the piston; None: half stroke.
    """
    p = p.copy()
    for place in (P.COULOMB_EXTEND, P.COULOMB_RETRACT, P.STATIC_EXTEND, P.STATIC_RETRACT, P.BRISTLE_STIFFNESS):
        p[place] = 0.0
    viscous = 0.5 * (p[P.VISCOUS_EXTEND] + p[P.VISCOUS_RETRACT])
    p[P.VISCOUS_EXTEND] = p[P.VISCOUS_RETRACT] = viscous
    four_way = p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE
    bottom, top, tank = p[P.AREA_BOTTOM], p[P.AREA_TOP], p[P.TANK_PRESSURE]
    at = np.zeros(7)
    at[L.P1] = (force + supply_Pa * top) / bottom
    at[L.P2] = supply_Pa
    if four_way:
        at[L.P1] = (force + (supply_Pa + tank) * top) / (bottom + top)
        at[L.P2] = supply_Pa + tank - at[L.P1]
    laps = [p[P.OVERLAP_SUPPLY], p[P.OVERLAP_TANK]]
    laps += [p[P.OVERLAP_SUPPLY_TOP], p[P.OVERLAP_TANK_TOP]] if four_way else []
    at[L.X] = sign * (max(0.0, *laps) + open_share * p[P.SPOOL_TRAVEL])
    at[L.VOLTS] = at[L.X] / p[P.SPOOL_GAIN] + p[P.NULL_OFFSET]
    at[L.Y] = 0.5 * p[P.STROKE] if position_m is None else position_m
    opening = leg.flow_curve(p, at[L.X]) if p[P.FLOW_POINTS] > 0.0 else at[L.X]
    at[L.V] = ports.supply_edge_flow(p, opening, at[L.P1], supply_Pa) - ports.tank_edge_flow(p, opening, at[L.P1])
    at[L.V] /= bottom
    return at, p


def leg_matrices(p: Array, mass: float, force: float, supply_Pa: float, sign: float) -> Matrices:
    """x' = A x + B u, (y, p, y) = C x + D u of one leg that pushes `mass`; u: valve volts, p = P1 - P2 A2/A1 [Pa]."""
    slopes, there = leg_slopes(*leg_at(p, force, supply_Pa, sign), supply_Pa)
    slopes[L.V] /= mass
    ratio = p[P.AREA_TOP] / p[P.AREA_BOTTOM] if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE else 0.0
    read = np.zeros((3, 6))
    read[[0, 2], L.Y], read[1, L.P1], read[1, L.P2] = 1.0, 1.0, -ratio
    return slopes[np.ix_(there, there)], slopes[there][:, [L.VOLTS]], read[:, there], np.zeros((3, 1))


def leg_slopes(at: Array, p: Array, supply_Pa: float) -> tuple[Array, list[int]]:
    """Slopes (6, 7) of (P1', P2', x', x'', v, F) along (P1, P2, x, x', y, v, volts) at `at`, and which states the leg has.

    F [N]: what the leg pushes with.
    """

    def rates(s: Array) -> Array:
        state = (s[L.P1], s[L.P2], s[L.X], s[L.RATE], 0.0)
        (d1, d2, dx, dr, _), _, _ = leg.leg_derivatives(p, s[L.Y], s[L.V], s[L.VOLTS], 0.0, supply_Pa, state, 0.0)
        pushed = leg.leg_force(p, s[L.Y], s[L.V], s[L.VOLTS], s[L.P1], s[L.P2], supply_Pa, 0.0, 0.0)
        return np.array([d1, d2, dx, dr, s[L.V], pushed])

    steps = np.diag([1e3, 1e3, 1e-8, 1e-4, 1e-6, 1e-5, 1e-5])  # Pa, Pa, m, m/s, m, m/s, V
    slopes = np.column_stack([(rates(at + step) - rates(at - step)) / (2 * step.sum()) for step in steps])
    there: list[int] = [L.P1, L.Y, L.V]
    if p[P.ROD_SIDE_CHAMBER] > 0.0:
        there.insert(1, L.P2)
    if p[P.SPOOL_OMEGA] > 0.0:
        there += [L.X, L.RATE]
    return slopes, there


def with_transducers(plant: Matrices, resolved: Resolved, leg: int) -> Matrices:
    """The same behind the transducers of a leg, of y and of p as they are read: first-order lag, then Butterworth low-pass.

    The third output stays the piston itself. leg: from 0.
    """
    for output, name in enumerate(("position", "pressure")):
        lag = _of_leg(resolved, f"{name}_lag_s", leg)
        cut_off = getattr(resolved.sensors, f"{name}_filter_Hz")
        if lag > 0.0:
            plant = _filtered(plant, output, ([1.0], [lag, 1.0]))
        if cut_off > 0.0:
            order = getattr(resolved.sensors, f"{name}_filter_order")
            plant = _filtered(plant, output, scipy.signal.butter(order, 2 * np.pi * cut_off, analog=True))
    return plant


def _of_leg(resolved: Resolved, key: str, leg: int) -> float:
    """An error of a leg's transducer as it is in the run."""
    values = resolved.leg_sensors.get(key)
    return float(getattr(resolved.sensors, key) if values is None else values[leg])


def _filtered(plant: Matrices, output: int, fraction: Any) -> Matrices:
    A, B, read, _ = plant
    F, G, H, _ = scipy.signal.tf2ss(*fraction)
    n = len(A)
    whole = np.block([[A, np.zeros((n, len(F)))], [G @ read[[output]], F]])
    out = np.hstack([read, np.zeros((3, len(F)))])
    out[output] = np.r_[np.zeros(n), H[0]]
    return whole, np.vstack([B, np.zeros((len(F), 1))]), out, np.zeros((3, 1))


def sampled(plant: Matrices, tick_s: float, late_ticks: float = 0.0) -> Matrices:
    """The same from tick to tick, u held in between, and behind the fraction f of a delay of n + f ticks.

    The volts of the tick before act for the first f of a tick, this tick's for the rest: exact, with one more state.
    """
    A, B, read, through = plant
    n, part = len(A), late_ticks % 1.0

    def held(time_s: float) -> tuple[Array, Array]:
        """exp(A t), and the state that one volt builds up in t."""
        whole: Any = scipy.linalg.expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * time_s)
        return whole[:n, :n], whole[:n, n:]

    rest, newer = held((1.0 - part) * tick_s)
    if part == 0.0:
        return rest, newer, read, through
    first, older = held(part * tick_s)
    whole = np.block([[rest @ first, rest @ older], [np.zeros((1, n + 1))]])
    return whole, np.vstack([newer, [[1.0]]]), np.hstack([read, np.zeros((3, 1))]), through


def controller_matrices(control: Control, mass: float) -> Matrices:
    """m_+ = A m + B (r, y, p), u = C m + D (r, y, p) of one leg in a mode of `mass`, read off the compiled controller."""
    row = control.rows[:1].copy()
    row[:, C.LIMIT], row[:, C.EVERY] = np.inf, 1.0
    row[:, [C.COULOMB_EXTEND, C.COULOMB_RETRACT]] = 0.0
    alone = Control(row, np.array([[mass if row[0, C.LOAD_FORWARD] > 0.0 else 0.0]]))

    def step(memory: Array, inputs: Array) -> Array:
        after, volts = memory[None].copy(), np.empty(1)
        controller.tick(alone, after, inputs[:1], inputs[1:2], inputs[2:], volts)
        return np.r_[after[0], volts]

    units = np.eye(N_MEMORY + 3)
    whole = np.column_stack([step(unit[:N_MEMORY], unit[N_MEMORY:]) for unit in units])
    n = N_MEMORY
    return whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:]


def reduced(system: Matrices) -> Matrices:
    """Without memory that nothing reads: as far as the output or a kept place depends on it."""
    A, B, read, through = system
    kept = np.any(read != 0.0, axis=0)
    while (more := kept | np.any(A[kept] != 0.0, axis=0)).sum() > kept.sum():
        kept = more
    return A[np.ix_(kept, kept)], B[kept], read[:, kept], through


def transfer(system: Matrices, z: Array) -> Array:
    """C (z - A)^-1 B + D at z (n,): (n, outputs, inputs)."""
    A, B, read, through = system
    return (
        read @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(z), *B.shape))) + through
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Loop:
    """One leg's loop in one mode of the load. plant: u to (y, p) as read and y, controller: (r, y, p) to u, both sampled.

    late_ticks: delays of the valve, of y and of p as they are read, of any length. The computer's is in the controller.
    """

    leg: int  # from 1
    mode: int  # from 1, the heaviest first
    mass_kg: float
    extends: bool
    tick_s: float
    plant: Matrices
    controller: Matrices
    late_ticks: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def _sensed(self, z: Array) -> Array:
        """(y, p, piston) over volts (n, 3). Readings are linear between ticks: (1 - f) z^-n + f z^-(n + 1)."""
        volts, *readings = self.late_ticks
        answers = transfer(self.plant, z)[:, :, 0] * z[:, None] ** -np.floor(volts)
        for output, late in enumerate(readings):
            whole, part = np.floor(late), late % 1.0
            answers[:, output] *= z**-whole * (1.0 - part + part / z)
        return answers

    def _returned(self, z: Array) -> tuple[Array, Array, Array]:
        """L, controller (n, 3) and plant (n, 3) at z (n,)."""
        sensed, volts = self._sensed(z), transfer(self.controller, z)[:, 0]
        return -np.sum(volts[:, 1:] * sensed[:, :2], axis=1), volts, sensed

    @cached_property
    def is_stable(self) -> bool:
        """Nyquist: 1 + L winds about 0 on a circle just outside the unit circle as often as the open loop has poles outside."""
        outside = sum(
            int(np.sum(np.abs(np.linalg.eigvals(part[0])) > 1.0 + OUTSIDE)) for part in (self.plant, self.controller)
        )
        return self._turns() == outside

    def _turns(
        self,
        *,
        step_rad: float = 0.5,  # of the angle of 1 + L: no delay is too long for it and no resonance too sharp
        points_a_turn: int = 20,  # of a delay's z^-n, to begin with
        near_decades: int = 9,  # of angles towards the integrators at z = 1
        most_halvings: int = 40,  # of an angle's step: to the last bit of any resonance
    ) -> int:
        """How often 1 + L winds about 0."""
        far = np.linspace(0.0, np.pi, int(points_a_turn * (sum(self.late_ticks) + len(self.plant[0]) + N_MEMORY)))[1:]
        angles = np.r_[0.0, np.geomspace(OUTSIDE, far[0], points_a_turn * near_decades)[:-1], far]

        def of(angle: Array) -> Array:
            return 1.0 + self._returned((1.0 + OUTSIDE) * np.exp(1j * angle))[0]

        values = of(angles)
        for _ in range(most_halvings):
            wide = np.flatnonzero(np.abs(np.angle(values[1:] / values[:-1])) > step_rad)
            if not len(wide):
                break
            middle = 0.5 * (angles[wide] + angles[wide + 1])
            angles, values = np.insert(angles, wide + 1, middle), np.insert(values, wide + 1, of(middle))
        return round(float(np.sum(np.angle(values[1:] / values[:-1])) / np.pi))

    def open_response(self, frequency_Hz: Array) -> Array:
        """L (n,): volts that come back for volts sent, broken at the valve's command, sign turned."""
        return self._returned(np.exp(2j * np.pi * frequency_Hz * self.tick_s))[0]

    def closed_responses(self, frequency_Hz: Array) -> Array:
        """Piston over setpoint and over noise of the readings (r, y, p) of the loop closed, (n, 3)."""
        back, volts, sensed = self._returned(np.exp(2j * np.pi * frequency_Hz * self.tick_s))
        return volts * (sensed[:, 2] / (1.0 + back))[:, None]

    def closed_response(self, frequency_Hz: Array) -> Array:
        """Piston over setpoint (n,)."""
        return self.closed_responses(frequency_Hz)[:, 0]

    def shaken_m_s2(
        self,
        position_m: float,
        pressure_Pa: float,
        band_Hz: float = BANDWIDTH_Hz,
        *,
        n_points: int = 100,  # frequencies of the felt band
    ) -> float:
        """Acceleration of the piston below `band_Hz`, rms, by white noise of the readings, rms of a tick's.

        a^2 = int |w^2 T|^2 2 T_s n^2 df, T piston over reading.
        """
        f = np.linspace(0.0, band_Hz, n_points + 1)[1:]
        over = np.abs(self.closed_responses(f)[:, 1:] * (2 * np.pi * f[:, None]) ** 2)
        density = 2 * self.tick_s * np.sum((over * [position_m, pressure_Pa]) ** 2, axis=1)
        return float(np.sqrt(f[0] * (np.sum(density) - 0.5 * density[-1])))  # trapezia; 0 at rest


def loops(
    machine: Machine,
    *,
    equal: float = 1e-6,  # relative difference of modes that count as one
) -> list[Loop]:
    """Every leg in every mode, extending and retracting; equal ones once."""
    resolved, tick_s = resolve(machine), 1.0 / machine.controller.rate_Hz
    control = control_of(machine)
    masses = 1.0 / np.linalg.eigvalsh(leg_compliance(resolved))
    forces = holding_forces(resolved)
    found: list[Loop] = []
    seen: list[Array] = []
    for i, p in enumerate(resolved.rows):
        own = Control(control.rows[i : i + 1], control.inertia)
        position_s, pressure_s = (_of_leg(resolved, f"{name}_delay_s", i) for name in ("position", "pressure"))
        late = (float(p[P.VALVE_DELAY]) / tick_s, position_s / tick_s, pressure_s / tick_s)
        lags = [_of_leg(resolved, f"{name}_lag_s", i) for name in ("position", "pressure")]
        for mode, mass in enumerate(masses):
            what = np.r_[p, own.rows[0], late, lags, mass, forces[i] / max(abs(forces).max(), 1.0)]
            if any(np.allclose(what, other, rtol=equal, atol=0.0) for other in seen):
                continue
            seen.append(what)
            controller = reduced(controller_matrices(own, float(mass)))
            for sign in (1.0, -1.0):
                plant = leg_matrices(p, mass, forces[i], machine.supply.pressure_Pa, sign)
                found.append(
                    Loop(
                        leg=i + 1,
                        mode=mode + 1,
                        mass_kg=float(mass),
                        extends=sign > 0,
                        tick_s=tick_s,
                        plant=sampled(with_transducers(plant, resolved, i), tick_s, late[0]),
                        controller=controller,
                        late_ticks=late,
                    )
                )
    return found
