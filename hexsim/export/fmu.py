# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""A machine's plant as an FMU: volts in, motion and pressures out, for Simulink, Amesim, dSPACE and the like.

FMI 2.0, co-simulation, Linux with 64 bit. The plant is `Plant` with RK4 at a constant step: the same MuJoCo, the same
compiled hydraulics, and the same results. The file needs nothing at the receiver's; the export needs `hexsim[fmu]`.
A power unit keeps the oil of its start: temperature does not act on the numbers of the legs.
"""

from __future__ import annotations

import hashlib
import re
import tempfile
import zipfile
from collections.abc import Iterable
from pathlib import Path

import mujoco
import numpy as np

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.export import native
from hexsim.export.model_description import model_description
from hexsim.export.variables import OUTPUT_KINDS, Variables, mass_body, mass_key, mass_offset, plant_variables
from hexsim.hydraulics.parameters import N_PARAMETERS, ROD_SIDE_VALVE, P
from hexsim.plant import Plant
from hexsim.plant.mjcf import ModelKind
from hexsim.plant.states import ROW, A

TIMESTEP_s = 1e-4
LONGEST_DELAY_STEPS = 100_000


def export_fmu(machine: Machine, out: Path, *, model: ModelKind = "full", timestep: float = TIMESTEP_s) -> Variables:
    """Write the plant of `machine` as an FMU; return its variables.

    model: full legs, or their tendon equal. timestep [s] of the integration, constant. Raises HexsimError where the
    compiler is not installed, the system is no Linux, or the file cannot be written.
    """
    if not 1e-6 <= timestep <= 1e-3:
        raise HexsimError(f"a time step of {timestep:g} s: 1e-6 to 1e-3 is possible")
    plant = Plant(machine, model=model, timestep=timestep)
    variables = plant_variables(plant)
    identifier = re.sub(r"\W", "_", f"hexsim_{machine.name}", flags=re.ASCII)
    library = native.mujoco_library()
    with tempfile.TemporaryDirectory(prefix="hexsim-fmu-") as name:
        folder = Path(name)
        mujoco.mj_saveModel(plant.model, str(folder / "model.mjb"), None)
        objects, missing = native.objects(folder)
        header = machine_header(plant, variables, missing)
        parts = [header.encode(), *(path.read_bytes() for path in (folder / "model.mjb", *objects))]
        digest = hashlib.sha256(b"".join(parts)).hexdigest()
        (folder / "machine.h").write_text(f'#define GUID "{digest}"\n{header}')
        own = folder / native.own_name(library, digest)
        own.write_bytes(native.renamed_library(library, own.name))
        binary = folder / f"{identifier}.so"
        native.link(folder, objects, own, binary)
        description = model_description(
            variables, name=machine.name, identifier=identifier, guid=digest, timestep=timestep
        )
        binaries = {f"binaries/linux64/{path.name}": path.read_bytes() for path in (binary, own)}
        _write(out, {"modelDescription.xml": description, **binaries})
    return variables


def _write(out: Path, contents: dict[str, bytes]) -> None:
    """The archive, whole or not at all."""
    out.parent.mkdir(parents=True, exist_ok=True)
    begun = out.with_name(f"{out.name}.part")
    try:
        with zipfile.ZipFile(begun, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
            for name, content in contents.items():
                archive.writestr(name, content)
        begun.replace(out)
    finally:
        begun.unlink(missing_ok=True)


def machine_header(plant: Plant, variables: Variables, missing: list[str]) -> str:
    """machine.h: what the C source must know of this machine. missing: functions of numba's error paths."""
    delay = np.rint(plant.rows[:, P.VALVE_DELAY] / plant.timestep).astype(int)
    if delay.max() > LONGEST_DELAY_STEPS:
        raise HexsimError(f"a valve delay of {delay.max()} time steps: at most {LONGEST_DELAY_STEPS} are possible")
    changes = [(k, c) for k, p in enumerate(variables.parameters) for c in p.changes if c.actuator < len(plant.layout)]
    numbers = _places(plant, variables) | {"RING": int(delay.max()) + 1, "N_CHANGES": len(changes)}
    kinds = ", ".join(OUTPUT_KINDS.values())
    lines = [
        *(f"#define {name} ({value!r})" for name, value in numbers.items()),
        f"typedef enum {{{kinds}}} OutputKind;",
        "typedef struct {OutputKind kind; int index;} Output;",
        "typedef struct {int parameter, actuator, place; double start, slope, offset;} Change;",
        "typedef struct {const char *name; double start, low, high, zero_or;} Parameter;",
        _array("Output OUTPUTS", (f"{{{v.kind},{v.index}}}" for v in variables.outputs)),
        _array(
            "Change CHANGES",
            (f"{{{k},{c.actuator},{c.place},{c.start!r},{c.slope!r},{c.offset!r}}}" for k, c in changes),
        ),
        _array(
            "Parameter PARAMETERS",
            (f'{{"{p.name}",{p.start!r},{p.low!r},{p.high!r},{p.zero_or!r}}}' for p in variables.parameters),
        ),
        _array("int DELAY", map(str, delay)),
        _array("double HYSTERESIS", map(repr, plant.rows[:, P.HYSTERESIS].tolist())),
        _array("double START_ACT", map(repr, plant.data.act.tolist())),
        _array("double START_CTRL", map(repr, plant.data.ctrl.tolist())),
        _array("unsigned char MODEL", ['\n#embed "model.mjb"\n']),
        f"#define STUBS {' '.join(f'STUB({name})' for name in missing)}",
    ]
    return "\n".join(lines) + "\n"


def _places(plant: Plant, variables: Variables) -> dict[str, float]:
    """Counts and places of the machine's numbers, and what it starts with."""
    parameters, supply = {p.name: k for k, p in enumerate(variables.parameters)}, plant.machine.supply
    return {
        "N_LEGS": plant.n_legs, "N_ACTUATORS": len(plant.layout), "N_OUTPUTS": len(variables.outputs),
        "N_PARAMETERS": len(variables.parameters), "N_VELOCITIES": plant.model.nv,
        "ROW": ROW, "LAYOUT": N_PARAMETERS, "PRESSURE": int(A.PRESSURE), "ROD_SIDE": int(A.ROD_SIDE),
        "SUPPLY_PLACE": int(A.SUPPLY), "LENGTH_OFFSET": int(P.LENGTH_OFFSET),
        "ROW_SUPPLY_PRESSURE": int(P.SUPPLY_PRESSURE), "ROD_SIDE_CHAMBER": int(P.ROD_SIDE_CHAMBER),
        "ROD_SIDE_VALVE": ROD_SIDE_VALVE, "MASS_BODY": mass_body(plant), "MASS_OFFSET": mass_offset(plant),
        "MASS_PARAMETER": parameters[mass_key(plant.machine)],
        "SUPPLY_PARAMETER": parameters.get("supply.pressure_Pa", -1), "SUPPLY_PRESSURE": supply.pressure_Pa,
        "TANK_PARAMETER": parameters.get("supply.tank_pressure_Pa", -1), "TANK_PRESSURE": supply.tank_pressure_Pa,
        "NEUTRAL_HEIGHT": plant.kinematics.neutral_height_m,
    }  # fmt: skip


def _array(declared: str, items: Iterable[str]) -> str:
    return f"static const {declared}[] = {{{','.join(items)}}};"
