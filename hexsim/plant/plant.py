# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""The plant: MuJoCo's masses and the oil's states, stepped together. Volts in, state and accelerations out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.hydraulics.effects import Effect
from hexsim.hydraulics.parameters import N_PARAMETERS, P
from hexsim.hydraulics.resolve import add_effects, check_load, resolve, warm_oil
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.steps import STEP, StepRule, step_rule
from hexsim.hydraulics.supply import POWER_UNIT, S, U
from hexsim.hydraulics.valve import delay_in_ticks
from hexsim.plant import start, stepping
from hexsim.plant.callbacks import MPa, install_hydraulics, installed, pressures_of
from hexsim.plant.mjcf import ModelKind, build_spec
from hexsim.plant.newton_euler import is_one_body
from hexsim.plant.states import A, lay_out_states
from hexsim.plant.structs import check_layout

Array = NDArray[np.float64]
Setting = tuple[Effect, tuple[int, ...], dict[str, Any]]
NAMES = ("names", "paths", "text_data")  # of the model's parts, not its numbers
SILENT = 1  # warnings of a kind that MuJoCo takes for written down already
MODEL_STEP_S = 1.0e-4  # of a model file, for MuJoCo without a plant


class PlantError(HexsimError):
    """The simulation left what is real; the text is MuJoCo's word for it, or says what did."""


class InterventionError(PlantError):
    """What acts on the plant has failed; the plant's own states are real."""


def whole_ratio(a: float, b: float, what: str) -> int:
    """a/b as a whole number, or a HexsimError."""
    ratio = round(a / b)
    if ratio < 1 or abs(a / b - ratio) > 1e-6:
        raise HexsimError(f"{what}: {a:g} Hz is not a whole multiple of {b:g} Hz; choose rates that are")
    return ratio


class Plant:
    """A machine in MuJoCo with native hydraulics, one leg or six. `tick` is the only way to drive it.

    machine: declared machine with its effects. model: "full" (legs as bodies) or "tendon" (hexapod only; a bench is the
    same either way). timestep [s]: constant; None: chosen from the machine and its state (`hydraulics.steps`).
    furnish: adds to the scene what does not touch the machine, before the model is compiled; None: nothing is to be seen.
    later: effects that `switch_on` will add, as (effect, legs, values): their states are there from the start and stand still until then.
    load_moves: `move_centre_of_mass` will be called.
    Plants in several threads do not touch each other.
    """

    def __init__(
        self,
        machine: Machine,
        *,
        model: ModelKind = "full",
        timestep: float | None = None,
        furnish: Callable[[mujoco.MjSpec], None] | None = None,
        later: Sequence[Setting] = (),
        load_moves: bool = False,
    ) -> None:
        install_hydraulics()
        self.machine = machine
        self.resolved: Resolved = resolve(machine)
        self.kinematics = self.resolved.mechanics
        self.timestep = timestep
        self.model_kind: ModelKind = model if self.kinematics.has_platform else "full"
        final = resolve(machine)
        add_effects(final, later)
        check_load(self.resolved)
        check_load(final)
        self._final_modes = final.payload_modes
        self._load_moves = load_moves or final.load.centre_of_mass_m != machine.load.centre_of_mass_m
        self.longest_delay_s = float(final.rows[:, P.VALVE_DELAY].max())
        self.layout = lay_out_states(final)  # where the states stand, (n_actuators, len(A))
        self._furnish = furnish
        self.spec, self.model = self._compile()
        self.data = mujoco.MjData(self.model)
        self.rows = self.resolved.rows  # (n_legs, N_PARAMETERS)
        self.n_legs = machine.n_legs
        self.pressure_places = self.layout[: self.n_legs, A.PRESSURE].astype(int)
        self.is_tendon = self.model_kind == "tendon"
        self.is_one_body = self.is_tendon and is_one_body(self.model)  # else MuJoCo steps the tendons
        if not self.is_tendon:
            joints = [self.model.joint(f"slide_{i + 1}") for i in range(self.n_legs)]
            self.slides = np.array([joint.qposadr[0] for joint in joints])
            self.slide_speeds = np.array([joint.dofadr[0] for joint in joints])
        check_layout(self.model, self.data)
        self.compliance = np.zeros((self.n_legs, self.n_legs))  # until `reset` measures it
        self.prepare(machine.controller.rate_Hz)
        self.reset()

    def _compile(
        self,
        *,
        light_share: float = 1e-6,  # of its mass, a payload's mode before it is switched on
    ) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
        """The model of what `resolved` says at present. A payload's mode that comes later is there with next to no mass."""
        modes = self.resolved.payload_modes
        light = [dataclasses.replace(m, mass_kg=light_share * m.mass_kg) for m in self._final_modes[len(modes) :]]
        load = self.resolved.load
        if self._load_moves and not any(load.centre_of_mass_m):
            off_centre_m = (0.0, 0.0, 2e-6)  # below 1 um MuJoCo takes a body for centred, for good
            load = load.model_copy(update={"centre_of_mass_m": off_centre_m})
        now = dataclasses.replace(self.resolved, load=load, payload_modes=[*modes, *light])
        step_s, furnish = self.timestep or MODEL_STEP_S, self._furnish
        spec, rows = build_spec(now, self.kinematics, self.model_kind, step_s, self.layout, furnish is not None)
        if furnish:
            furnish(spec)
        model = spec.compile()
        # no search for islands, 4 % of a step: the platform ties all bodies together
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
        model.actuator_user[: len(rows)] = rows
        return spec, model

    def switch_on(self, effect: Effect, legs: tuple[int, ...], values: dict[str, float]) -> None:
        """Add an effect in flight; one of `later`. Its spool begins at its command, its bristle in balance with friction."""
        before = self.rows.copy()
        add_effects(self.resolved, [(effect, legs, values)])
        _, model = self._compile()
        for name in dir(model):
            there = getattr(self.model, name)
            if isinstance(there, np.ndarray) and there.flags.writeable and name not in NAMES:
                there[...] = getattr(model, name)
        self.model.opt.gravity = model.opt.gravity
        self.context.hysteresis[:] = self.rows[:, P.HYSTERESIS]
        self.follow_delay()
        start.begin_states(self, before)
        self.keep_rows()

    def follow_delay(self) -> None:
        """Take the valves' delay from the rows."""
        self.context.delay[:], self.context.part_s[:] = delay_in_ticks(self.rows[:, P.VALVE_DELAY], self.context.tick_s)

    def prepare(self, rate_Hz: float, ticks: int = 0) -> None:
        """Ticks at `rate_Hz` from now on; the next `ticks` of them are written down in `record`."""
        steps = 0
        if self.timestep is not None:
            steps = whole_ratio(1.0 / self.timestep, rate_Hz, "time step and log or control rate")
        self.context = stepping.step_context(self, 1.0 / rate_Hz, steps, ticks > 0)
        self.record = stepping.new_record(self, max(ticks, 1))

    def tick(self, volts: Array, at_spool: Callable[[Array], Array] | None = None) -> None:
        """One tick under the volts (n_legs,) that the motion computer commands: through the valves' delay and hysteresis
        to the spools, then the time steps.

        at_spool: what a fault makes of the volts that reach the spools.
        """
        if at_spool is None:
            stepping.for_python(self.context, self.record, volts, False, True, True)
            return
        stepping.for_python(self.context, self.record, volts, False, True, False)
        self.context.spool_volts[:] = at_spool(self.context.spool_volts.copy())
        stepping.for_python(self.context, self.record, volts, False, False, True)

    def sense(self) -> Array:
        """Piston positions (n_legs,) [m] of the present state, written down in the present row of `record`."""
        context, positions = self.context, self.record.positions
        row = context.count[0] if context.is_recorded else 0
        if self.is_tendon:
            stepping.for_python(context, self.record, context.spool_volts, True, False, False)
        else:  # as `stepping.sense`: to hand over the context takes five times as long as that
            positions[row] = context.qpos[context.slides] - context.offsets
        return positions[row]

    def reset(self) -> None:
        """Neutral pose, at rest, valves shut, pressures in static equilibrium."""
        mujoco.mj_resetData(self.model, self.data)
        data = self.data
        # MuJoCo writes the first warning of a kind into MUJOCO_LOG.TXT of the working folder; `check` reports them all
        data.warning.number[:] = SILENT
        if self.has_supply_states:
            data.ctrl[self.n_legs] = 1.0
            start.start_supply(self)
        start.hold_still(self, self.static_pressures())
        self.context.count[0], self.context.spool_volts[:], self.context.apart[:] = 0, 0.0, 0.0
        self.context.velocity_before[:] = 0.0
        self.context.next_step[0], self.context.level[0], self.context.slow[:] = (
            STEP.longest_s,
            stepping.ERROR.least_level_m_s2,
            0.0,
        )
        self.history: list[tuple[float, np.ndarray, np.ndarray]] = []
        self.keep_rows()
        mujoco.mj_forward(self.model, data)

    def keep_rows(self) -> None:
        """Note in `history` (time, legs' rows, supply's row) what holds from now on."""
        if self.history and self.history[-1][0] == self.data.time:
            self.history.pop()
        self.history.append((self.data.time, self.rows.copy(), self.resolved.supply.copy()))
        self.context = self.context._replace(rule=self.step_rule(), push=self.push())

    def step_rule(self) -> StepRule:
        """What the machine as it is now asks of the time step."""
        modes = [2 * np.pi * mode.frequency_Hz for mode in self.resolved.payload_modes]
        return step_rule(self.rows, self.resolved.supply, self.compliance, max(modes, default=0.0))

    def reach(self) -> Array:
        """What a unit of each generalised acceleration is at the platform's joints (nv,): 1, or their radius [m]."""
        reach = np.zeros(self.model.nv)
        if not self.kinematics.has_platform:
            reach[0] = 1.0
            return reach
        reach[:3] = 1.0
        reach[3:6] = np.linalg.norm(self.kinematics.platform_joints[:, :2], axis=1).max()
        return reach

    def push(self) -> Array:
        """Acceleration of a leg [m/s2] that a unit of each state of `act` makes (na,): of its pressures [MPa]."""
        push, own = np.zeros(self.model.na), np.diag(self.compliance)
        bottom, top = self.layout[: self.n_legs, A.PRESSURE], self.layout[: self.n_legs, A.ROD_SIDE]
        push[bottom.astype(int)] = own * self.rows[:, P.AREA_BOTTOM] * MPa
        for i in np.flatnonzero(top >= 0):
            push[int(top[i])] = own[i] * self.rows[i, P.AREA_TOP] * MPa
        return push

    def change_row(self, leg: int | slice, place: int, value: float) -> None:
        """Change one number of a leg (from 0), or of several, in flight."""
        if np.all(self.rows[leg, place] == value):
            return
        self.rows[leg, place] = value
        self.model.actuator_user[: self.n_legs, :N_PARAMETERS] = self.rows
        self.keep_rows()

    def change_supply(self, place: S, value: float) -> None:
        """Change one number of the supply in flight."""
        if self.resolved.supply[place] == value:
            return
        self.resolved.supply[place] = value
        self.model.actuator_user[self.n_legs : len(self.layout), : len(self.resolved.supply)] = self.resolved.supply
        self.keep_rows()

    def switch_pump(self, on: bool) -> None:
        """Motor of a supply that has states; a constant supply has none to switch."""
        if self.has_supply_states:
            self.data.ctrl[self.n_legs] = float(on)

    def move_centre_of_mass(self, centre_m: Array) -> None:
        """Centre of mass (3,) [m] of a hexapod's platform in its frame; its moments of inertia stay."""
        body = self.model.body("platform").id
        self.model.body_sameframe[body] = 0  # mjSAMEFRAME_NONE: centre of mass and frame part now
        self.model.body_ipos[body] = centre_m

    def platform_mass_and_centre(self) -> tuple[float, Array]:
        """Mass [kg] of a hexapod's platform, and its centre (3,) [m] in its frame."""
        body = self.model.body("platform").id
        return float(self.model.body_mass[body]), self.model.body_ipos[body].copy()

    def add_home_keyframe(self) -> None:
        """Keep the static equilibrium at neutral as keyframe `home` of the spec."""
        self.reset()
        key = self.spec.add_key(name="home")
        key.qpos, key.act, key.ctrl = self.data.qpos, self.data.act, self.data.ctrl

    @property
    def has_supply_states(self) -> bool:
        return len(self.layout) > self.n_legs

    @property
    def oil_temperature_degC(self) -> float | None:
        """Of the reservoir, where the machine has a power unit."""
        if self.resolved.supply[S.MODEL] != POWER_UNIT:
            return None
        return float(self.data.act[int(self.layout[-1, A.SUPPLY]) + U.TEMPERATURE])

    def follow_oil_temperature(
        self,
        *,
        oil_step_K: float = 0.1,  # 0.06 % of the bulk modulus, 0.5 % of the viscosity
    ) -> None:
        """Take the oil in all rows to the reservoir's present temperature, once it has moved by oil_step_K."""
        temperature = self.oil_temperature_degC
        if temperature is None or abs(temperature - self.resolved.oil_temperature_degC) < oil_step_K:
            return
        if not -60.0 <= temperature <= 300.0:  # beyond: no oil any more, and no viscosity by ASTM D341
            raise PlantError(f"oil at {temperature:.3g} degC")
        of_legs, of_supply = warm_oil(self.resolved, temperature)
        self.model.actuator_user[: self.n_legs, :N_PARAMETERS] *= of_legs
        self.model.actuator_user[self.n_legs, : len(of_supply)] *= of_supply
        self.keep_rows()

    def static_pressures(self) -> np.ndarray:
        """Bottom pressures (n_legs,) [Pa] that hold the machine still in its present pose; measures `compliance` on the way."""
        pressures, self.compliance = start.static_pressures(self)
        return pressures

    def bottom_pressures(self) -> np.ndarray:
        """P1 of each leg (n_legs,) [Pa]."""
        return pressures_of(self.data.act[self.pressure_places])

    @property
    def rod_side_places(self) -> NDArray[np.int64]:
        """Where the rod sides that are chambers stand in the state (n_legs,); -1: on the supply."""
        return self.layout[: self.n_legs, A.ROD_SIDE].astype(np.int64)

    def rod_side_pressures(self) -> np.ndarray:
        """P2 of each leg (n_legs,) [Pa]; Ps where the rod side is on the supply."""
        places, own = self.rod_side_places, self.rod_side_places >= 0
        return np.where(own, pressures_of(self.data.act[np.maximum(places, 0)]), self.supply_pressure())

    def instant_acceleration(self) -> np.ndarray:
        """Generalised accelerations (nv,) of the present state under the present volts at the spools."""
        mujoco.mj_forward(self.model, self.data)
        return self.data.qacc.copy()

    def supply_pressure(self) -> float:
        """Ps [Pa]."""
        place = int(self.layout[0, A.SUPPLY])
        return float(pressures_of(self.data.act[place])) if place >= 0 else float(self.rows[0, P.SUPPLY_PRESSURE])

    def piston_positions(self) -> np.ndarray:
        """Piston positions (n_legs,) [m] of the present state (not of the last evaluation)."""
        if self.is_tendon:
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_tendon(self.model, self.data)
            return self.data.ten_length - self.rows[:, P.LENGTH_OFFSET]
        return self.data.qpos[self.slides] - self.rows[:, P.LENGTH_OFFSET]

    def check(self) -> None:
        """Raise PlantError when MuJoCo warned, a state is not finite, or another program took MuJoCo's callbacks."""
        if not installed():
            raise PlantError("another program in this process replaced MuJoCo's callbacks")
        bad = np.flatnonzero(self.data.warning.number > SILENT)
        if len(bad):
            raise PlantError(mujoco.mjtWarning(int(bad[0])).name.removeprefix("mjWARN_").lower())
        if not (np.isfinite(self.data.act).all() and np.isfinite(self.data.qpos).all()):
            raise PlantError("state not finite")
