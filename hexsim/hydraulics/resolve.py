"""The machine as the plant builds it: declared values with the effects of its file switched on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from hexsim.declaration import Machine
from hexsim.declaration.leg import OF_SENSOR
from hexsim.errors import HexsimError
from hexsim.hydraulics.effects import Effect, effect_settings
from hexsim.hydraulics.oil import LEG_POWERS, row_factors
from hexsim.hydraulics.parameters import P, declared_rows
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import POWER_UNIT, SUPPLY_POWERS, S, declared_supply


def resolve(machine: Machine) -> Resolved:
    """Declared rows, then each effect of the machine's file in turn.

    A scale counts its lines: the pitch of a ripple is that of the reading, and a position gain stretches the wave on the machine.
    """
    resolved = Resolved(
        machine=machine,
        rows=declared_rows(machine),
        supply=declared_supply(machine),
        load=machine.load,
        sensors=machine.sensors,
        mechanics=machine.mechanics,
        gravity_m_s2=np.array([0.0, 0.0, -machine.machine.gravity_m_s2]),
        leg_sensors={key: machine.of_legs("sensors", key) for key in OF_SENSOR},
        oil_temperature_degC=machine.oil.temperature_degC,
    )
    add_effects(resolved, effect_settings(machine))
    resolved.position_ripple[:, 1] /= resolved.leg_sensors["position_gain"]
    if machine.power_unit is not None:
        resolved.supply[S.AIR_FRACTION] = resolved.rows[:, P.AIR_FRACTION].mean()
        warm_oil(resolved, machine.power_unit.oil_temperature_degC)
    return resolved


def add_effects(resolved: Resolved, settings: Iterable[tuple[Effect, tuple[int, ...], dict[str, Any]]]) -> None:
    """Switch on effects, each as (effect, 0-based legs, values). Raises HexsimError where a power unit is replaced."""
    for effect, legs, values in settings:
        effect.add_to(resolved, legs, values)
    if resolved.machine.power_unit is not None and resolved.supply[S.MODEL] != POWER_UNIT:
        raise HexsimError(
            f"machine {resolved.machine.name} has a [power_unit] and an effect that replaces it (supply_droop, "
            "pump_flow_limit or gas_accumulator): keep one of them"
        )


def check_load(resolved: Resolved) -> None:
    """Raise HexsimError where effects leave a load that no body can be: no mass, or moments of inertia that do not go together."""
    load, machine = resolved.load, resolved.machine
    key = "moving_mass_kg" if load.moving_mass_kg is not None else "platform_mass_kg"
    mass, moments = getattr(load, key) or 0.0, load.platform_inertia_kg_m2 or (1.0, 1.0, 1.0)
    if not mass > 0.0:
        raise HexsimError(
            f"machine {machine.machine.name}: [effects] leave {mass:g} kg of [load] {key} = {getattr(machine.load, key):g} kg: "
            "let mass_change and flexible_payload take off less"
        )
    if not 0.0 < max(moments) <= sum(moments) - max(moments):
        raise HexsimError(
            f"machine {machine.machine.name}: [load] platform_inertia_kg_m2 with [effects] is "
            f"{', '.join(f'{moment:g}' for moment in moments)}: each moment must be above 0 and at most the sum of the other two"
        )


def warm_oil(resolved: Resolved, temperature_degC: float) -> tuple[np.ndarray, np.ndarray]:
    """Take the oil of all rows to another temperature; return the factors of the legs' rows and of the supply's."""
    before, oil = resolved.oil_temperature_degC, resolved.machine.oil.properties
    of_legs = row_factors(LEG_POWERS, resolved.rows.shape[1], before, temperature_degC, oil)
    of_supply = row_factors(SUPPLY_POWERS, len(resolved.supply), before, temperature_degC, oil)
    resolved.rows *= of_legs
    resolved.supply *= of_supply
    resolved.oil_temperature_degC = temperature_degC
    return of_legs, of_supply
