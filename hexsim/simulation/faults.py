"""Faults of a scenario: what breaks, when, and how it acts on the simulation.

    [[faults]]
    kind = "valve_stuck"       # leg, at = "open" | "shut" | "present" | volts
    time_s = 6.0
    leg = 1

kind             keys (defaults)                                       what breaks
valve_stuck      leg, at ("open")                                      the spool stays at this voltage; open: full volts
spool_lag        leg, frequency_Hz (1.0), damping (0.7)                the spool lags behind its command
position_sensor  leg, how ("nan" | "frozen" | "jump"), jump_m (0.02)   the measured piston position
leg_blind        leg                                                   position and pressure of one leg are lost
pressure_loss    pressure_Pa (2e6), within_s (0.3)                     the supply falls to this pressure
pump_trip                                                              the pump stops; the accumulator still supplies
hose_burst       leg, conductance_m3_s_Pa (5e-11)                      the bottom chamber leaks to the tank, through the
                                                                       blocking valve of a [manifold]
power_loss       buffered (true)                                       mains lost: pump off, the cabinet on its battery,
                                                                       or else the spools centre and stay there, and
                                                                       a [manifold] lowers all legs
payload_shift    mass_kg (150), x_m (0.4), y_m, z_m, within_s (0.5)    part of the load slides over the platform
host_silence                                                           the host stops sending
effect           effect, where ("all legs"), parameters ({})           an effect of the library begins: leakage, wear, ...

`fault_run` runs them in a simulation.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from hexsim.declaration import Machine, Section, between, section_of, values_of
from hexsim.errors import HexsimError
from hexsim.files.toml_files import validation_sentence
from hexsim.hydraulics.effects import effect_setting
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved
from hexsim.motion_computer.computer import MotionComputer
from hexsim.plant import Plant
from hexsim.plant.plant import Setting
from hexsim.simulation.emergency_supply import EmergencySupply
from hexsim.simulation.safety_manifold import SafetyManifold, smooth

Array = NDArray[np.float64]
Position = Annotated[float, between(-50.0, 50.0, "[m]")]
Within = Annotated[float, between(0.0, 1e3, "how long the change takes [s]")]


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault. Subclasses say what breaks; `time_s` when. Keys that a kind does not have are refused."""

    kind: ClassVar[str]
    time_s: Annotated[float, between(0.0, 86_400.0, "when [s]")]

    def act(self, bench: Workbench, time_s: float, volts: Array) -> Array:
        """Called at each tick from `time_s` on; returns the volts that reach the valves."""
        return volts


@dataclass(frozen=True, kw_only=True)
class LegFault(Fault):
    leg: Annotated[int, Field(ge=1, description="from 1")]


class ChangingSensors(Protocol):
    """Sensors that an effect can change in flight."""

    def change(self, time_s: float, resolved: Resolved) -> None: ...


@dataclass(kw_only=True)
class Workbench:
    """What a fault can change."""

    plant: Plant
    computer: MotionComputer
    supply: EmergencySupply
    manifold: SafetyManifold
    sensors: ChangingSensors
    tick_s: float
    memory: dict[Fault, Any] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ValveStuck(LegFault):
    kind: ClassVar[str] = "valve_stuck"
    at: Literal["open", "shut", "present"] | Annotated[float, between(-1e3, 1e3, "[V]")] = "open"

    def act(self, bench: Workbench, time_s: float, volts: Array) -> Array:
        if self not in bench.memory:
            named = {
                "open": float(bench.computer.limit[self.leg - 1]),
                "shut": 0.0,
                "present": float(volts[self.leg - 1]),
            }
            bench.memory[self] = named[self.at] if isinstance(self.at, str) else float(self.at)
        volts = volts.copy()
        volts[self.leg - 1] = bench.memory[self]
        return volts


@lru_cache(maxsize=8)
def lagged_spool(frequency_Hz: float, damping: float, tick_s: float) -> Array:
    """exp(A T) (2, 2) of x'' = omega^2 (u - x) - 2 damping omega x': exact for a command held over a tick."""
    omega = 2.0 * math.pi * frequency_Hz
    over: Any = scipy.linalg.expm(np.array([[0.0, 1.0], [-omega * omega, -2.0 * damping * omega]]) * tick_s)
    return over


@dataclass(frozen=True, kw_only=True)
class SpoolLag(LegFault):
    kind: ClassVar[str] = "spool_lag"
    frequency_Hz: Annotated[float, between(1e-3, 1e3, "[Hz]")] = 1.0
    damping: Annotated[float, between(0.01, 100.0, "[-]")] = 0.7

    def act(self, bench: Workbench, time_s: float, volts: Array) -> Array:
        command = float(volts[self.leg - 1])
        state = bench.memory.get(self, np.array([command, 0.0]))
        bench.memory[self] = lagged_spool(self.frequency_Hz, self.damping, bench.tick_s) @ (state - [command, 0.0]) + [
            command,
            0.0,
        ]
        volts = volts.copy()
        volts[self.leg - 1] = state[0]
        return volts


@dataclass(frozen=True, kw_only=True)
class PositionSensor(LegFault):
    kind: ClassVar[str] = "position_sensor"
    how: Literal["nan", "frozen", "jump"] = "nan"
    jump_m: Position = 0.02

    def reading(self, true: float, held: float) -> float:
        """What is read, from the true reading and the one at the time of the fault."""
        return {"nan": math.nan, "frozen": held, "jump": true + self.jump_m}[self.how]


@dataclass(frozen=True, kw_only=True)
class LegBlind(LegFault):
    kind: ClassVar[str] = "leg_blind"

    def reading(self, true: float, held: float) -> float:
        return math.nan


@dataclass(frozen=True, kw_only=True)
class PressureLoss(Fault):
    kind: ClassVar[str] = "pressure_loss"
    pressure_Pa: Annotated[float, between(0.0, 1e8, "[Pa]")] = 2.0e6
    within_s: Within = 0.3

    def act(self, bench: Workbench, time_s: float, volts: Array) -> Array:
        share = min(1.0, (time_s - self.time_s) / max(self.within_s, bench.tick_s))
        nominal = bench.computer.supply.nominal
        bench.supply.ceiling_Pa = nominal + share * (self.pressure_Pa - nominal)
        return volts


@dataclass(frozen=True, kw_only=True)
class PumpTrip(Fault):
    kind: ClassVar[str] = "pump_trip"

    def act(self, bench: Workbench, time_s: float, volts: Array) -> Array:
        bench.supply.tripped = True
        return volts


@dataclass(frozen=True, kw_only=True)
class HoseBurst(LegFault):
    kind: ClassVar[str] = "hose_burst"
    conductance_m3_s_Pa: Annotated[float, between(0.0, 1e-6, "[m3/(s Pa)]")] = 5.0e-11

    def act(self, bench: Workbench, time_s: float, volts: Array) -> Array:
        before = bench.memory.setdefault(self, float(bench.plant.rows[self.leg - 1, P.LEAK_CHAMBER_TANK]))
        leak = self.conductance_m3_s_Pa * bench.manifold.open_share[self.leg - 1]
        bench.plant.change_row(self.leg - 1, P.LEAK_CHAMBER_TANK, before + leak)
        return volts


@dataclass(frozen=True, kw_only=True)
class PowerLoss(Fault):
    kind: ClassVar[str] = "power_loss"
    buffered: bool = True

    def act(self, bench: Workbench, time_s: float, volts: Array) -> Array:
        bench.supply.tripped = True
        bench.computer.mains = False
        if self.buffered:
            return volts
        bench.manifold.dead = True
        declared = bench.plant.machine.manifold
        if declared is None:
            return np.zeros_like(volts)
        held = bench.memory.setdefault(self, volts.copy())
        return held * (1.0 - smooth(min(1.0, (time_s - self.time_s) / declared.centring_time_s)))


@dataclass(frozen=True, kw_only=True)
class PayloadShift(Fault):
    """The first moment of the load changes by mass_kg (x, y, z); its moments of inertia are left as they are."""

    kind: ClassVar[str] = "payload_shift"
    mass_kg: Annotated[float, between(0.0, 1e7, "[kg]")] = 150.0
    x_m: Position = 0.4
    y_m: Position = 0.0
    z_m: Position = 0.0
    within_s: Within = 0.5

    def act(self, bench: Workbench, time_s: float, volts: Array) -> Array:
        mass, centre = bench.plant.platform_mass_and_centre()
        before = bench.memory.setdefault(self, centre)
        share = min(1.0, (time_s - self.time_s) / max(self.within_s, bench.tick_s))
        shift = self.mass_kg / mass * np.array([self.x_m, self.y_m, self.z_m])
        bench.plant.move_centre_of_mass(before + smooth(share) * shift)
        return volts


@dataclass(frozen=True, kw_only=True)
class HostSilence(Fault):
    kind: ClassVar[str] = "host_silence"


@dataclass(frozen=True, kw_only=True)
class EffectFault(Fault):
    """Any effect of the library, as `[effects.<name>]` of a machine file has it, from `time_s` on."""

    kind: ClassVar[str] = "effect"
    effect: Annotated[str, Field(max_length=100, description="its name in the library")]
    where: str | list[str] = dataclasses.field(default="all legs", hash=False)
    parameters: dict[str, Any] | None = dataclasses.field(default=None, hash=False)

    def setting(self, machine: Machine, place: str) -> Setting:
        """(effect, 0-based legs, values). Raises HexsimError that begins with `place`."""
        setting = effect_setting(machine, self.effect, {"where": self.where, **(self.parameters or {})}, place)
        if setting[0].built_in:
            raise HexsimError(
                f"{place} {self.effect} is how the machine is built and cannot begin in a run: put it into [effects]"
            )
        return setting

    def act(self, bench: Workbench, time_s: float, volts: Array) -> Array:
        if self not in bench.memory:
            effect, legs, values = bench.memory[self] = self.setting(bench.plant.machine, "fault effect:")
            bench.plant.switch_on(effect, legs, values)
            if effect.balance == "sensor":
                bench.sensors.change(self.time_s, bench.plant.resolved)
        return volts


KINDS: Mapping[str, type[Fault]] = {
    fault.kind: fault
    for fault in (
        ValveStuck,
        SpoolLag,
        PositionSensor,
        LegBlind,
        PressureLoss,
        PumpTrip,
        HoseBurst,
        PowerLoss,
        PayloadShift,
        HostSilence,
        EffectFault,
    )
}


if TYPE_CHECKING:
    FaultTable = Section
else:
    FaultTable = Annotated[reduce(or_, (section_of(fault) for fault in KINDS.values())), Field(discriminator="kind")]
_CHECK = TypeAdapter(FaultTable)


def fault_from_dict(data: Mapping[str, Any], machine: Machine, where: str) -> Fault:
    """Check one table of [[faults]]. Raises HexsimError that names kind and key."""
    try:
        table = _CHECK.validate_python(data)
    except ValidationError as error:
        kind = data.get("kind") if isinstance(data, Mapping) else None
        place = f"{where} ({kind})" if isinstance(kind, str) and kind in KINDS else where
        raise HexsimError(f"{place}: {validation_sentence(error, FaultTable)}") from None
    kind = dict(table)["kind"]
    fault = KINDS[kind](**values_of(table))
    if isinstance(fault, LegFault) and fault.leg not in range(1, machine.n_legs + 1):
        raise HexsimError(
            f"{where} ({kind}): leg is {fault.leg}; machine {machine.name} has legs 1 to {machine.n_legs}"
        )
    if isinstance(fault, EffectFault):
        fault.setting(machine, f"{where} (effect {fault.effect}):")
    if isinstance(fault, PayloadShift) and not machine.is_hexapod:
        raise HexsimError(f"{where}: payload_shift needs a platform; machine {machine.name} is a bench")
    return fault


def read_faults(tables: Sequence[Mapping[str, Any]], machine: Machine, source: str) -> list[Fault]:
    """The [[faults]] of a scenario, checked."""
    return [fault_from_dict(table, machine, f"{source}: fault {i}") for i, table in enumerate(tables, start=1)]


def later_effects(faults: Sequence[Fault], machine: Machine) -> list[Setting]:
    """The effects that faults will switch on, in the order of their times."""
    effects = [fault for fault in faults if isinstance(fault, EffectFault)]
    return [fault.setting(machine, "fault effect:") for fault in sorted(effects, key=lambda fault: fault.time_s)]
