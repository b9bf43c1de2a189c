"""What the sliders of the page change, each by keys that `hexsim run --set` takes too."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hexsim.machine import Machine
from hexsim.machine.files import changed
from hexsim.mechanics.workspace import excursions
from hexsim.recording.quantity import BAR, L_MIN
from hexsim.scenarios import Scenario, load_scenario
from hexsim.scenarios.scenario import ROTATIONS, available_scenarios

DRY_FRICTION = tuple(
    f"friction.{name}_N" for name in ("coulomb_extend", "coulomb_retract", "static_extend", "static_retract")
)
LEAK, DELAY = "effects.leakage_supply_to_chamber", "effects.valve_delay"
L_MIN_BAR = BAR / L_MIN  # l/min/bar in m3/s/Pa


@dataclass(frozen=True, kw_only=True)
class Knob:
    """A slider. The number that it sets is its value times `unit`, in each of `keys` that has one; what is declared
    stands at `declared`. added: keys that an effect needs besides, once it is not 0."""

    name: str
    label: str
    hint: str
    keys: tuple[str, ...]
    low: float
    high: float
    step: float
    declared: float
    unit: float
    relative: bool = False
    added: tuple[tuple[str, Any], ...] = ()

    def settings(self, machine: Machine, value: float) -> dict[str, Any]:
        """Keys of the machine file and what they are set to; nothing where the slider stands as declared."""
        if value == self.declared:
            return {}
        to = {
            key: float(f"{self.unit * value * (declared_at(machine, key) or 0.0 if self.relative else 1.0):.6g}")
            for key in self.keys
        }
        return to | dict(self.added)


def declared_at(machine: Machine, key: str) -> float | None:
    """A number of the machine file by its dotted key; None where there is none."""
    table, _, name = key.partition(".")
    value = getattr(getattr(machine, table, None), name, None)
    return float(value) if isinstance(value, int | float) else None


def knobs(machine: Machine) -> list[Knob]:
    """The sliders that this machine has: a number that its file does not declare has none."""
    made = [
        _declared(
            machine,
            "overlap",
            "Overlap [µm]",
            ("valve.overlap_m",),
            1e-6,
            (0.0, 40.0, 1.0),
            "Of the valve: the land is wider than its port, so that nothing flows until the spool has left it.",
        ),
        _declared(
            machine,
            "friction",
            "Friction [%]",
            DRY_FRICTION,
            0.01,
            (0.0, 300.0, 10.0),
            "Coulomb and static friction of all cylinders, against what the machine file says.",
            relative=True,
        ),
        _declared(
            machine,
            "spool",
            "Spool [Hz]",
            ("valve.spool_frequency_Hz",),
            1.0,
            (10.0, 200.0, 5.0),
            "Bandwidth of the spool.",
        ),
        _declared(
            machine,
            "load",
            "Load [kg]",
            ("load.platform_mass_kg" if machine.mechanics.has_platform else "load.moving_mass_kg",),
            1.0,
            None,
            "What the legs carry. The run begins anew with another load.",
        ),
    ]
    effects = [
        Knob(
            name="leak",
            label="Leak [l/min/bar]",
            keys=(f"{LEAK}.conductance_m3_s_Pa",),
            hint="From the supply into the chamber of leg 1, laminar: past the spool's edge or the piston's seal.",
            low=0.0,
            high=0.03,
            step=0.001,
            declared=0.0,
            unit=L_MIN_BAR,
            added=((f"{LEAK}.where", "leg 1"),),
        ),
        Knob(
            name="delay",
            label="Delay [ms]",
            keys=(f"{DELAY}.delay_s",),
            low=0.0,
            high=10.0,
            step=1.0,
            hint="Dead time of the valve: from the command to its electronics.",
            declared=0.0,
            unit=1e-3,
        ),
    ]
    there = {f"effects.{name}" for name in machine.effects}
    return [knob for knob in made if knob] + [knob for knob in effects if knob.keys[0].rpartition(".")[0] not in there]


def _declared(
    machine: Machine,
    name: str,
    label: str,
    keys: tuple[str, ...],
    unit: float,
    limits: tuple[float, float, float] | None,
    hint: str,
    relative: bool = False,
) -> Knob | None:
    """A slider of declared numbers. limits: low, high and step of its value; None: from 1/4 to 2 of what is declared."""
    there = declared_at(machine, keys[0])
    if there is None or (relative and there <= 0.0):
        return None
    value = 1.0 / unit if relative else float(f"{there / unit:.6g}")
    if limits is None:
        step = 10.0 ** np.floor(np.log10(value / 20.0))
        limits = step * np.ceil(value / 4 / step), 2 * value, step
    low, high, step = (float(limit) for limit in limits)
    return Knob(
        name=name,
        label=label,
        hint=hint,
        keys=keys,
        low=min(low, value),
        high=max(high, value),
        step=step,
        declared=value,
        unit=unit,
        relative=relative,
    )


def machine_with(machine: Machine, values: Mapping[str, float]) -> Machine:
    """The declared machine with the sliders at these values; one that is not named stands as declared."""
    settings = settings_of(machine, values)
    return changed(machine, settings, "the sliders") if settings else machine


def settings_of(machine: Machine, values: Mapping[str, float]) -> dict[str, Any]:
    """What `--set` says for these values."""
    found: dict[str, Any] = {}
    for knob in knobs(machine):
        found |= knob.settings(machine, values.get(knob.name, knob.declared))
    return found


@dataclass(frozen=True, kw_only=True)
class Wave:
    """A sine along or about one axis: amplitude in mm or deg."""

    scenario: Scenario
    amplitude: float
    frequency_Hz: float

    @property
    def axis(self) -> str:
        return next(iter(self.scenario.signals))

    @property
    def unit(self) -> tuple[float, str]:
        """Of the amplitude: in m or rad, and its name."""
        return (np.pi / 180.0, "deg") if self.axis in ROTATIONS else (1e-3, "mm")

    def built(self) -> Scenario:
        """The scenario with this amplitude and frequency."""
        signal: Any = self.scenario.signals[self.axis]
        size = math.copysign(float(f"{self.unit[0] * self.amplitude:.12g}"), signal.amplitude)
        return replace(
            self.scenario, signals={self.axis: replace(signal, amplitude=size, frequency_Hz=self.frequency_Hz)}
        )

    def largest_amplitude(self, machine: Machine) -> float:
        """How far the axis may go alone on a machine, in mm or deg."""
        reach = dict(zip(machine.mechanics.dofs, excursions(machine.mechanics), strict=True))[self.axis]
        return float(np.floor(0.9 * min(-reach.minimum, reach.maximum) / self.unit[0]))


def wave_of(scenario: Scenario) -> Wave | None:
    """A scenario as one sine; None where it is another motion."""
    signal: Any = next(iter(scenario.signals.values()), None)
    if len(scenario.signals) != 1 or signal.fundamental_Hz is None or not hasattr(signal, "amplitude"):
        return None
    wave = Wave(scenario=scenario, amplitude=0.0, frequency_Hz=float(signal.fundamental_Hz))
    return replace(wave, amplitude=float(f"{abs(signal.amplitude) / wave.unit[0]:.4g}"))


def waves(machine: Machine) -> dict[str, Wave]:
    """Shipped scenarios that are one sine of an axis that the machine has, as declared otherwise."""
    found = {name: wave_of(load_scenario(name)) for name in available_scenarios()}
    return {
        name: wave
        for name, wave in found.items()
        if wave and wave.scenario.mode == "dof" and wave.axis in machine.mechanics.dofs
        if not wave.scenario.machine_changes
    }
