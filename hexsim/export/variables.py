"""What an FMU of the plant takes and gives: volts in, signals out, and the machine's numbers as parameters.

Inputs and outputs have the names of the log's columns, parameters those of machine.toml with their table,
`friction.coulomb_extend_N`. A parameter acts through numbers of `actuator_user` that are affine in it:

    number = offset + slope value

Offset and slope come from `resolve` at three values, so that effects of the machine's file and the oil's temperature
stay in force. A key that acts in another way (a diameter, the geometry) is no parameter: change it before the export.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from hexsim.declaration import Machine
from hexsim.declaration.section import ZERO_OR
from hexsim.hydraulics.resolve import resolve
from hexsim.plant import Plant
from hexsim.plant.states import A
from hexsim.setpoints.signal_file import BENCH_COLUMN, DOF_COLUMNS
from hexsim.signals.signal import HEXAPOD_AXES
from hexsim.signals.table import label_of, table

# Keys of machine.toml that may become parameters. An earlier one has the number of the row that two of them share.
KEYS = (
    "supply.pressure_Pa",
    "supply.tank_pressure_Pa",
    "oil.density_kg_m3",
    "oil.bulk_modulus_Pa",
    "cylinder.pipeline_volume_m3",
    "cylinder.rod_side_volume_m3",
    "cylinder.rod_side_conductance_m3_s_sqrtPa",
    "cylinder.cushion_length_m",
    "cylinder.cushion_stiffness_N_m",
    "cylinder.cushion_damping_N_s_m",
    "cylinder.piston_leakage_m3_s_Pa",
    "cylinder.rod_leakage_m3_s_Pa",
    "valve.spool_diameter_m",
    "valve.rated_flow_m3_s",
    "valve.overlap_m",
    "valve.edge_rounding_m",
    "valve.discharge_coefficient",
    "valve.pressure_width_Pa",
    "valve.laminar_reynolds",
    "valve.spool_frequency_Hz",
    "valve.spool_damping",
    "friction.viscous_extend_N_s_m",
    "friction.viscous_retract_N_s_m",
    "friction.coulomb_extend_N",
    "friction.coulomb_retract_N",
    "friction.static_extend_N",
    "friction.static_retract_N",
    "friction.stribeck_velocity_m_s",
    "friction.sharpness_m_s",
    "friction.arctan_slope_s_m",
)
# Kinds of outputs in the C source, by the stem of the log's columns.
OUTPUT_KINDS = {
    "position": "POSITION",
    "velocity": "VELOCITY",
    "pressure_bottom": "BOTTOM",
    "pressure_top": "TOP",
    "pressure_supply": "SUPPLY",
    "platform": "POSE",
    "acceleration": "ACCELERATION",
    "angular_acceleration": "ANGULAR_ACCELERATION",
    "valve": "VALVE",
    "setpoint": "SETPOINT",
}
LOOP_KINDS = ("VALVE", "SETPOINT")  # of a motion computer
COMPENSATOR = "adaptive"  # the algorithm inside


@dataclass(frozen=True, kw_only=True)
class Output:
    """A column of the log; index: leg or axis from 0."""

    name: str
    description: str
    kind: str
    index: int


@dataclass(frozen=True, kw_only=True)
class Change:
    """One number of `actuator_user` that follows a parameter; start: as declared."""

    actuator: int
    place: int
    start: float
    slope: float
    offset: float


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A key of machine.toml. zero_or: the least value besides 0; 0 = no such gap."""

    name: str
    description: str
    start: float
    low: float
    high: float
    zero_or: float = 0.0
    changes: tuple[Change, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Variables:
    """All variables in the order of their value references."""

    inputs: tuple[tuple[str, str, float], ...]  # name, description, value at the start
    outputs: tuple[Output, ...]
    parameters: tuple[Parameter, ...]


def variables_of(plant: Plant, what: Literal["plant", "machine"], compensator: str = COMPENSATOR) -> Variables:
    """Of this machine: what it has not (a rod side of its own, a platform) is no output.

    plant: volts in. machine: the pose from neutral in, or the position of a bench's piston; volts and the legs' setpoints
    are outputs.
    """
    has_top = bool((plant.layout[: plant.n_legs, A.ROD_SIDE] >= 0).all())
    outputs = [
        Output(name=name, description=label_of(name), kind=kind, index=index)
        for stem, kind in OUTPUT_KINDS.items()
        if (has_top or kind != "TOP") and (what == "machine" or kind not in LOOP_KINDS)
        for index, name in enumerate(table()[stem].columns(plant.n_legs))
    ]
    inputs = [(name, label_of(name), 0.0) for name in table()["valve"].columns(plant.n_legs)]
    if what == "machine" and plant.kinematics.has_platform:
        inputs = [(name, f"setpoint {axis}", 0.0) for name, axis in zip(DOF_COLUMNS, HEXAPOD_AXES, strict=True)]
    elif what == "machine":
        inputs = [(BENCH_COLUMN, label_of(BENCH_COLUMN), float(plant.kinematics.neutral_positions[0]))]
        outputs = [output for output in outputs if output.kind != "SETPOINT"]
    switch = Parameter(
        name=f"compensator.{compensator}",
        description="adaptive compensation of valve and friction, 1 on",
        start=0.0,
        low=0.0,
        high=1.0,
    )
    parameters = (*_parameters(plant), *([switch] if what == "machine" else []))
    return Variables(inputs=tuple(inputs), outputs=tuple(outputs), parameters=parameters)


def mass_key(machine: Machine) -> str:
    """Key of the mass that the legs carry."""
    return "load.platform_mass_kg" if machine.is_hexapod else "load.moving_mass_kg"


def mass_body(plant: Plant) -> int:
    """Body of the MuJoCo model that has the mass."""
    return plant.model.body(plant.kinematics.moving_body).id


def mass_offset(plant: Plant) -> float:
    """Mass of that body less the declared one [kg]: rods are bodies of their own in full legs."""
    return float(plant.model.body_mass[mass_body(plant)]) - _value(plant.machine, mass_key(plant.machine))


def _parameters(plant: Plant) -> tuple[Parameter, ...]:
    machine, taken, found = plant.machine, set(), []
    for key in KEYS:
        value = _value(machine, key)
        if value is None or (key == "valve.spool_frequency_Hz" and value == 0.0):
            continue  # not declared; a spool without states gets none in flight
        changes = _changes(machine, key, value)
        places = {(change.actuator, change.place) for change in changes}
        if changes and not places & taken:
            taken |= places
            found.append(_parameter(machine, key, value, changes))
    mass = mass_key(machine)
    heavier_than_rods = -1.01 * mass_offset(plant)
    found.append(_parameter(machine, mass, _value(machine, mass), (), heavier_than_rods))
    return tuple(found)


def _parameter(
    machine: Machine, key: str, value: float, changes: tuple[Change, ...], above: float = -np.inf
) -> Parameter:
    """With the bounds of its declaration, made narrower where another key of the machine bounds it."""
    table_name, name = key.split(".")
    field = type(getattr(machine, table_name)).model_fields[name]
    low = max((item.ge for item in field.metadata if hasattr(item, "ge")), default=-np.inf)
    high = min((item.le for item in field.metadata if hasattr(item, "le")), default=np.inf)
    below = {
        **dict.fromkeys(
            ("friction.coulomb_extend_N", "friction.coulomb_retract_N"),
            machine.supply.pressure_Pa * machine.cylinder.area_bottom_m2,
        ),
        "valve.overlap_m": machine.valve.spool_travel_max_m,
        "cylinder.cushion_length_m": machine.cylinder.stroke_m / 2,
    }.get(key, np.inf)
    extra: Any = field.json_schema_extra or {}
    zero_or = float(extra.get(ZERO_OR, 0.0))
    if key == "valve.spool_frequency_Hz":
        low, zero_or = zero_or, 0.0
    return Parameter(
        name=key,
        description=field.description or "",
        start=value,
        zero_or=zero_or,
        changes=changes,
        low=float(max(low, above, -np.nextafter(below, 0))),
        high=float(min(high, np.nextafter(below, 0))),
    )


def _changes(machine: Machine, key: str, value: float) -> tuple[Change, ...]:
    """The numbers that follow the key; none where one of them is not affine in it."""
    step, (here, once, twice) = _steps(machine, key, value)
    difference = once - here
    if not np.allclose(twice - here, 2 * difference, rtol=1e-9, atol=0):
        return ()
    changes = []
    for actuator, place in np.argwhere(difference != 0):
        slope = difference[actuator, place] / step
        offset = here[actuator, place] - slope * value
        nothing = abs(offset) < 1e-12 * abs(here[actuator, place])
        changes.append(
            Change(
                actuator=int(actuator),
                place=int(place),
                start=float(here[actuator, place]),
                slope=float(slope),
                offset=0.0 if nothing else float(offset),
            )
        )
    return tuple(changes)


def _steps(machine: Machine, key: str, value: float) -> tuple[float, list[np.ndarray]]:
    """A step of the key, and the numbers at 0, 1 and 2 steps. A leg of its own is validated: the step stays possible."""
    step = value or 1.0
    while True:
        try:
            return step, [_numbers(_with(machine, key, value + k * step)) for k in range(3)]
        except ValueError:
            if abs(step) < 1e-9 * abs(value or 1e-9):
                raise
            step /= 10.0


def _numbers(machine: Machine) -> np.ndarray:
    """Rows of the legs and, below them, of the supply where it has states."""
    resolved = resolve(machine)
    rows = np.zeros((machine.n_legs + 1, len(resolved.rows[0])))
    rows[:-1] = resolved.rows
    rows[-1, : len(resolved.supply)] = resolved.supply
    return rows


def _value(machine: Machine, key: str) -> Any:
    table_name, name = key.split(".")
    return getattr(getattr(machine, table_name), name)


def _with(machine: Machine, key: str, value: float) -> Machine:
    """With one key changed and not validated: a value that no machine may have serves to find a slope."""
    table_name, name = key.split(".")
    section = getattr(machine, table_name).model_copy(update={name: value})
    return machine.model_copy(update={table_name: section})
