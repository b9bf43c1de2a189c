# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""A machine's plant as an FMU: volts in, motion and pressures out, for Simulink, Amesim, dSPACE and the like.

FMI 2.0 or 3.0, co-simulation, Linux and Windows with 64 bit in one file. The plant is `Plant`: the same MuJoCo, the same
compiled hydraulics, and with a constant step the same results; without one it steps by the rule, a run by the error of a
step. The file needs nothing at the receiver's;
the export needs `hexsim[fmu]`. A power unit keeps the oil of its start: temperature does not act on the numbers of the legs.
"""

from __future__ import annotations

import hashlib
import re
import tempfile
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from compensation.guard import TELLS
from compensation.native import native as native_compensator
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.export import mujoco_library, native
from hexsim.export.compensator import compensator_object, settings_of
from hexsim.export.model_description import model_description
from hexsim.export.toolchain import SYSTEMS
from hexsim.export.variables import COMPENSATOR, OUTPUT_KINDS, Variables, mass_body, mass_key, mass_offset, variables_of
from hexsim.files.atomic import written_whole
from hexsim.hydraulics.chamber import VAPOUR
from hexsim.hydraulics.parameters import N_PARAMETERS, ROD_SIDE_VALVE, P
from hexsim.hydraulics.steps import STEP
from hexsim.motion_computer.controller import N_MEMORY
from hexsim.motion_computer.data_sheet import compensator_context
from hexsim.motion_computer.leg_load import SPAN, ExpectedLoad
from hexsim.plant import Plant
from hexsim.plant.mjcf import ModelKind
from hexsim.plant.states import ROW, A

TAKES = {
    "plant": "Valve volts in, motion and pressures out",
    "machine": "Setpoints in, motion, pressures and valve volts out: the motion computer with its controllers and compensator inside",
}


def export_fmu(
    machine: Machine,
    out: Path,
    *,
    model: ModelKind = "full",
    timestep: float | None = None,
    fmi: Literal[2, 3] = 2,
    windows: bytes | None = None,
    what: Literal["plant", "machine"] = "plant",
    compensator: str = COMPENSATOR,
    step_s: float = 0.002,  # proposed to the tool
) -> Variables:
    """Write `machine` as an FMU; return its variables. what: the plant alone, or with the motion computer's controllers and
    compensator.

    model: full legs, or the tendon model. timestep [s] of the integration, constant; None: chosen by the rule of
    `hydraulics.steps`, without the error of each step.
    windows: MuJoCo's library for Windows (`mujoco_library.windows_library`); None: for Linux alone. Raises HexsimError
    where the compiler is not installed, the system is no Linux, or the file cannot be written.
    """
    if timestep is not None and not 1e-6 <= timestep <= 1e-3:
        raise HexsimError(f"a time step of {timestep:g} s: 1e-6 to 1e-3 is possible")
    plant = Plant(machine, model=model, timestep=timestep)
    variables = variables_of(plant, what, compensator)
    identifier = re.sub(r"\W", "_", f"hexsim_{machine.name}", flags=re.ASCII)
    library = mujoco_library.linux_library()
    systems = [SYSTEMS[name] for name in ("linux64", "win64")[: 1 if windows is None else 2]]
    with tempfile.TemporaryDirectory(prefix="hexsim-fmu-") as name:
        folder = Path(name)
        mujoco.mj_saveModel(plant.model, str(folder / "model.mjb"), None)
        equations = native.equations(plant) | (native.loop_equations(plant) if what == "machine" else {})
        if feels_legs(plant, what, compensator):
            equations |= {"watch_legs": native.watch_legs(plant)}
        compiled = [native.objects(equations, system, folder) for system in systems]
        if what == "machine":
            for system, (objects, _) in zip(systems, compiled, strict=True):
                objects.append(folder / f"compensator.{system.name}.o")
                objects[-1].write_bytes(compensator_object(compensator, system, exported=False))
        header = machine_header(
            plant, variables, what, compensator, sorted({name for _, missing in compiled for name in missing})
        )
        made = [path.read_bytes() for objects, _ in compiled for path in objects]
        digest = hashlib.sha256(b"".join([header.encode(), (folder / "model.mjb").read_bytes(), *made])).hexdigest()
        (folder / "machine.h").write_text(f'#define TOKEN "{digest}"\n{header}')
        description = model_description(
            variables,
            name=machine.name,
            identifier=identifier,
            guid=digest,
            step_s=step_s,
            fmi=fmi,
            description=TAKES[what],
        )
        own = folder / mujoco_library.own_name(library, digest)
        own.write_bytes(mujoco_library.renamed(library, own.name))
        light = mujoco_library.lightened(own.read_bytes())
        contents = {"modelDescription.xml": description, f"binaries/{systems[0].folders[fmi]}/{own.name}": light}
        if windows is not None:
            contents[f"binaries/{systems[1].folders[fmi]}/mujoco.dll"] = windows
        for system, (objects, _) in zip(systems, compiled, strict=True):
            binary = folder / f"{identifier}{system.suffix}"
            native.link(folder, system, fmi, [*objects, *([own] if system is systems[0] else [])], binary)
            contents[f"binaries/{system.folders[fmi]}/{binary.name}"] = binary.read_bytes()
    _write(out, contents)
    return variables


def feels_legs(plant: Plant, what: str, compensator: str) -> bool:
    """Whether the FMU's compensators must be given what all legs of the platform do."""
    return what == "machine" and plant.kinematics.has_platform and native_compensator(compensator).algorithm.feels_legs


def _write(out: Path, contents: dict[str, bytes]) -> None:
    """The archive, whole or not at all."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(out) as begun, zipfile.ZipFile(begun, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            archive.writestr(name, content)


def machine_header(
    plant: Plant,
    variables: Variables,
    what: str,
    compensator: str,
    missing: list[str],
    *,
    n_delayed: int = 1024,  # that an instance remembers where a valve is late
) -> str:
    """machine.h: what the C source must know of this machine. missing: functions of numba's error paths."""
    delay, supply, rule = plant.rows[:, P.VALVE_DELAY], plant.resolved.supply, plant.step_rule()
    along = np.take(plant.kinematics.jacobian(np.zeros(6)), plant.kinematics.dof_places, axis=1)
    changes = [(k, c) for k, p in enumerate(variables.parameters) for c in p.changes if c.actuator < len(plant.layout)]
    made, load = native_compensator(compensator), ExpectedLoad.of(plant.resolved)
    contexts = [compensator_context(plant.machine, None, leg, load) for leg in range(1, plant.n_legs + 1)]
    seen = 2 * SPAN * plant.n_legs if feels_legs(plant, what, compensator) else 0
    settings = [settings_of(compensator, context) for context in contexts]
    numbers = _places(plant, variables) | {
        "IS_MACHINE": int(what == "machine"),
        "TICK": 1.0 / plant.machine.controller.rate_Hz,
        "N_MEMORY": N_MEMORY,
        "N_INPUTS": len(variables.inputs),
        "RING": n_delayed if delay.any() else 2,
        "LONGEST_DELAY": float(delay.max()),
        "N_CHANGES": len(changes),
        "COMPENSATOR_SIZE": made.size if what == "machine" else 1,
        "N_SETTINGS": len(settings[0]),
        "N_SEEN": seen,
        "TELLS": TELLS,
        "COMPENSATOR_PARAMETER": len(variables.parameters) - 1,
    }
    kinds = ", ".join(OUTPUT_KINDS.values())
    lines = [
        *(f"#define {name} ({value!r})" for name, value in numbers.items()),
        f"#define COMPENSATOR(function) hexsim_{compensator}_##function",
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
        *(
            _array(f"double {name}", map(repr, np.ravel(values).tolist()))
            for name, values in (
                ("DELAY", delay),
                ("HYSTERESIS", plant.rows[:, P.HYSTERESIS]),
                ("SPREAD", plant.rows[:, P.HYSTERESIS_SPREAD]),
                ("START_ACT", plant.data.act),
                ("START_CTRL", plant.data.ctrl),
                ("START_RULE", rule),
                ("SUPPLY_ROW", supply),
                ("ALONG", along),
                ("COMPENSATOR_SETTINGS", settings),
                ("INPUT_START", [start for *_, start in variables.inputs]),
            )
        ),
        _array("unsigned char ALIKE", (str(int(own == other)) for own in contexts for other in contexts)),
        _array("unsigned char MODEL", ['\n#embed "model.mjb"\n']),
        f"#define STUBS {' '.join(f'STUB({name})' for name in missing)}",
    ]
    return "\n".join(lines) + "\n"


def _places(plant: Plant, variables: Variables) -> dict[str, float]:
    """Counts and places of the machine's numbers, and what it starts with."""
    parameters, supply = {p.name: k for k, p in enumerate(variables.parameters)}, plant.machine.supply
    return {
        "N_LEGS": plant.n_legs,
        "N_ACTUATORS": len(plant.layout),
        "N_OUTPUTS": len(variables.outputs),
        "N_PARAMETERS": len(variables.parameters),
        "N_VELOCITIES": plant.model.nv,
        "N_STIFF": native.N_STIFF,
        "TIMESTEP": plant.timestep or 0.0,
        "LONGEST_PART": STEP.longest_s,
        "LOAD_FREQUENCY": max((2 * np.pi * mode.frequency_Hz for mode in plant.resolved.payload_modes), default=0.0),
        "AREA_BOTTOM": int(P.AREA_BOTTOM),
        "AREA_TOP": int(P.AREA_TOP),
        "ROW": ROW,
        "LAYOUT": N_PARAMETERS,
        "PRESSURE": int(A.PRESSURE),
        "ROD_SIDE": int(A.ROD_SIDE),
        "SUPPLY_PLACE": int(A.SUPPLY),
        "LENGTH_OFFSET": int(P.LENGTH_OFFSET),
        "ROW_SUPPLY_PRESSURE": int(P.SUPPLY_PRESSURE),
        "ROD_SIDE_CHAMBER": int(P.ROD_SIDE_CHAMBER),
        "ROD_SIDE_VALVE": ROD_SIDE_VALVE,
        "MASS_BODY": mass_body(plant),
        "MASS_OFFSET": mass_offset(plant),
        "MASS_PARAMETER": parameters[mass_key(plant.machine)],
        "SUPPLY_PARAMETER": parameters.get("supply.pressure_Pa", -1),
        "SUPPLY_PRESSURE": supply.pressure_Pa,
        "TANK_PARAMETER": parameters.get("supply.tank_pressure_Pa", -1),
        "TANK_PRESSURE": supply.tank_pressure_Pa,
        "NEUTRAL_HEIGHT": plant.kinematics.neutral_height_m,
        "VAPOUR": VAPOUR,
    }


def _array(declared: str, items: Iterable[str]) -> str:
    return f"static const {declared}[] = {{{','.join(items)}}};"
