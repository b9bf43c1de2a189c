# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""The plant: MuJoCo's masses and the oil's states, stepped together. Volts in, state and accelerations out."""

from __future__ import annotations

from typing import Literal

import mujoco
import numpy as np

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve, warm_oil
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import POWER_UNIT, S, U, power_unit_start
from hexsim.machine.geometry import machine_kinematics
from hexsim.mechanics.kinematics import HexapodKinematics
from hexsim.plant.callbacks import POWER_UNIT_SCALE, MPa, native_hydraulics
from hexsim.plant.layout import check_layout
from hexsim.plant.mjcf import ModelKind, build_spec

Scheme = Literal["rk4", "fast"]
OIL_STEP_K = 0.1  # 0.06 % of the bulk modulus, 0.5 % of the viscosity
KNOWN_ERROR = {
    "rk4": "converged: reversal peaks within 0.1 % of RK4 at ten times the rate",
    "fast": "reversal peaks within 0.4 % of RK4 (Euler, actearly, linearly implicit pressure, 100 us)",
}


class PlantError(HexsimError):
    """The simulation left the real numbers; the text is MuJoCo's word for it."""


class Plant:
    """A machine in MuJoCo with native hydraulics, one leg or six.

    machine: declared machine with its effects. model: "full" (legs as bodies) or "tendon" (hexapod only; a bench is the
    same either way). scheme: "rk4", or "fast" = Euler with actearly and linearly implicit pressure. timestep [s].
    Use inside `with plant.running():`, which installs the callbacks.
    """

    def __init__(
        self, machine: Machine, *, model: ModelKind = "full", scheme: Scheme = "rk4", timestep: float = 1e-4
    ) -> None:
        self.machine = machine
        self.resolved: Resolved = resolve(machine)
        self.kinematics: HexapodKinematics | None = machine_kinematics(machine) if machine.is_hexapod else None
        self.model_kind, self.scheme, self.timestep = model, scheme, timestep
        self.spec, actuator_rows = build_spec(self.resolved, self.kinematics, model, timestep, scheme == "fast")
        self.model = self.spec.compile()
        self.model.actuator_user[:] = actuator_rows
        self.data = mujoco.MjData(self.model)
        self.rows = self.resolved.rows  # (n_legs, N_PARAMETERS)
        self.n_legs = machine.n_legs
        self.pressure_places = self.rows[:, P.ACT_PRESSURE].astype(int)
        self.is_tendon = machine.is_hexapod and model == "tendon"
        if not self.is_tendon:
            joints = [self.model.joint(f"slide_{i + 1}") for i in range(self.n_legs)]
            self.slides = np.array([joint.qposadr[0] for joint in joints])
            self.slide_speeds = np.array([joint.dofadr[0] for joint in joints])
        check_layout(self.model, self.data)
        self.reset()

    def running(self):
        """Context in which the callbacks are installed."""
        return native_hydraulics()

    def reset(self) -> None:
        """Neutral pose, at rest, valves shut, pressures in static equilibrium."""
        mujoco.mj_resetData(self.model, self.data)
        data = self.data
        supply = self.resolved.supply[S.PRESSURE] if self.has_supply_states else None
        if supply is not None:
            data.ctrl[self.n_legs] = 1.0
            self._start_supply()
        rod_sides = self.rows[:, P.ACT_ROD_SIDE].astype(int)
        data.act[rod_sides[rod_sides >= 0]] = self.machine.supply.pressure_Pa / MPa
        for row, pressure in zip(self.rows, self.static_pressures(), strict=True):
            data.act[int(row[P.ACT_PRESSURE])] = pressure / MPa
        self.history: list[tuple[float, np.ndarray, np.ndarray]] = []
        self.keep_rows()
        with self.running():
            mujoco.mj_forward(self.model, data)

    def keep_rows(self) -> None:
        """Note in `history` (time, legs' rows, supply's row) what holds from now on, when it has changed."""
        rows, supply = self.rows, self.resolved.supply
        if self.history and np.array_equal(rows, self.history[-1][1]) and np.array_equal(supply, self.history[-1][2]):
            return
        self.history.append((self.data.time, rows.copy(), supply.copy()))

    def add_home_keyframe(self) -> None:
        """Keep the static equilibrium at neutral as keyframe `home` of the spec."""
        self.reset()
        key = self.spec.add_key(name="home")
        key.qpos, key.act, key.ctrl = self.data.qpos, self.data.act, self.data.ctrl

    @property
    def has_supply_states(self) -> bool:
        return self.model.nu > self.n_legs

    def _start_supply(self) -> None:
        row = self.resolved.supply
        first, last = int(row[S.ACT]), int(row[S.ACT] + row[S.STATES]) - 1
        if row[S.MODEL] == POWER_UNIT:
            self.data.act[first : last + 1] = power_unit_start(row) / POWER_UNIT_SCALE
        self.data.act[last] = self.machine.supply.pressure_Pa / MPa

    def follow_oil_temperature(self) -> None:
        """Take the oil in all rows to the reservoir's present temperature, once it has moved by OIL_STEP_K."""
        row = self.resolved.supply
        if row[S.MODEL] != POWER_UNIT:
            return
        temperature = float(self.data.act[int(row[S.ACT]) + U.TEMPERATURE])
        if abs(temperature - self.resolved.oil_temperature_degC) < OIL_STEP_K:
            return
        of_legs, of_supply = warm_oil(self.resolved, temperature)
        self.model.actuator_user[: self.n_legs] *= of_legs
        self.model.actuator_user[self.n_legs, : len(row)] *= of_supply
        self.keep_rows()

    def static_pressures(self) -> np.ndarray:
        """Bottom pressures (n_legs,) [Pa] that hold the machine still in its present pose.

        P1 = Ps A2/A1 + F/A1 (Eq. 3.3 corrected), F the axial force that the load asks of each leg: the platform's
        accelerations are affine in the six forces, so seven evaluations and one solve give them. (The legs' own
        accelerations are left out: they settle within the 0.1 um give of the ball ends.)
        """
        model, data, n = self.model, self.data, self.n_legs

        def accelerations(pressures: np.ndarray) -> np.ndarray:
            data.act[self.pressure_places] = pressures / MPa
            mujoco.mj_forward(model, data)
            return data.qacc[:n].copy()  # the platform's free joint, or the bench's slide

        with self.running():
            start = np.full(n, self.machine.supply.pressure_Pa / 2)
            early = model.actuator_actearly.copy()
            model.actuator_actearly[:] = 0
            at_start = accelerations(start)
            step = 1e5
            slopes = np.column_stack([(accelerations(start + step * np.eye(n)[i]) - at_start) / step for i in range(n)])
            pressures = start - np.linalg.solve(slopes, at_start)
            model.actuator_actearly[:] = early
        low, high = self.machine.supply.tank_pressure_Pa, self.machine.supply.pressure_Pa
        if np.any(pressures <= low) or np.any(pressures >= high):
            worst = int(np.argmax(np.abs(pressures - (low + high) / 2)))
            raise HexsimError(
                f"machine {self.machine.name}: leg {worst + 1} needs {pressures[worst] / 1e5:.1f} bar to hold the load at "
                f"rest, outside {low / 1e5:.1f}..{high / 1e5:.1f} bar: lower the mass or raise the supply"
            )
        return pressures

    def step(self, steps: int) -> None:
        """Advance by `steps` time steps with the volts in `data.ctrl`."""
        mujoco.mj_step(self.model, self.data, steps)

    def bottom_pressures(self) -> np.ndarray:
        """P1 of each leg (n_legs,) [Pa]."""
        return self.data.act[self.pressure_places] * MPa

    def supply_pressure(self) -> float:
        """Ps [Pa]."""
        place = int(self.rows[0, P.ACT_SUPPLY])
        return float(self.data.act[place] * MPa) if place >= 0 else float(self.rows[0, P.SUPPLY_PRESSURE])

    def piston_positions(self) -> np.ndarray:
        """Piston positions (n_legs,) [m] of the present state (not of the last evaluation)."""
        if self.is_tendon:
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_tendon(self.model, self.data)
            return self.data.ten_length - self.rows[:, P.LENGTH_OFFSET]
        return self.data.qpos[self.slides] - self.rows[:, P.LENGTH_OFFSET]

    def check(self) -> None:
        """Raise PlantError when MuJoCo warned or a state is not finite."""
        counts = self.data.warning.number
        bad = [w for w in mujoco.mjtWarning.__members__.values() if w.value < len(counts) and counts[w.value]]
        if bad or not (np.isfinite(self.data.act).all() and np.isfinite(self.data.qpos).all()):
            what = bad[0].name.removeprefix("mjWARN_").lower() if bad else "state not finite"
            raise PlantError(what)
