# pyright: reportAttributeAccessIssue=false, reportPrivateImportUsage=false
# (MuJoCo's bindings carry no types, and numba does not list its own functions)
"""The hydraulic leg as an actuator plugin of MuJoCo, and the machine as an MJCF that uses it: hydraulics in anybody's MuJoCo.

The plugin is native code: the equations that `Plant` and the FMU run, compiled, behind MuJoCo's plugin interface. Whoever
receives it needs MuJoCo of the same version and nothing of hexsim; the export needs `hexsim[fmu]`.
"""

from __future__ import annotations

import ctypes
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numba import cfunc, types

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.export.mujoco_library import linux_library
from hexsim.export.native import HEADERS
from hexsim.export.toolchain import SYSTEMS, System, compile_and_link, object_of
from hexsim.files.atomic import written_whole
from hexsim.files.run_folder import file_name
from hexsim.hydraulics.parameters import FLOW_TABLE, LEARNED_TABLE, N_PARAMETERS, ROD_SIDE_VALVE, P
from hexsim.plant import Plant, callbacks
from hexsim.plant.plant import MODEL_STEP_S
from hexsim.plant.states import LEG, A

NAME = "hexsim.leg"
TABLES = {"learned_curve": (LEARNED_TABLE, FLOW_TABLE), "flow_curve": (FLOW_TABLE, N_PARAMETERS)}  # attribute -> places
OF_THE_COMPUTER = ("HYSTERESIS", "VALVE_DELAY")  # numbers that act from tick to tick, outside MuJoCo


def attributes() -> dict[str, tuple[int, int]]:
    """Attribute of the plugin -> its first place in a leg's row and how many numbers it takes, SI units."""
    single = {
        place.name.lower(): (int(place), 1) for place in P if place.name not in (*OF_THE_COMPUTER, "LENGTH_OFFSET")
    }
    return {"length_offset": (int(P.LENGTH_OFFSET), 1), **single} | {
        name: (first, end - first) for name, (first, end) in TABLES.items()
    }


def export_plugin(
    machine: Machine,
    out: Path,
    timestep: float | None = None,
    systems: Sequence[str] = ("linux64", "win64", "macos"),
) -> list[Path]:
    """Write the plugin's libraries for Linux, Windows and macOS and MACHINE.xml into the folder `out`; the files.

    timestep [s] of the MJCF, RK4; None: MODEL_STEP_S. systems: names of `toolchain.SYSTEMS`. Raises HexsimError for a machine
    whose supply or valves have states outside the leg, where the compiler is not installed, the system is no Linux, or `out`
    cannot be written.
    """
    step = MODEL_STEP_S if timestep is None else timestep
    if not 1e-6 <= step <= 1e-3:
        raise HexsimError(f"a time step of {step:g} s: 1e-6 to 1e-3 is possible")
    plant = Plant(machine, model="full", timestep=step, furnish=lambda spec: None)
    refuse_what_is_outside(plant)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HexsimError(f"cannot write {out}: {error.strerror or error}; give --out a folder") from None
    contents = {f"{file_name(machine.name)}.xml": machine_xml(plant).encode()}
    of_systems = [SYSTEMS[name] for name in systems]
    contents |= {f"{system.prefix}hexsim_leg{system.suffix}": library(system) for system in of_systems}
    for name, content in contents.items():
        with written_whole(out / name) as begun:
            begun.write_bytes(content)
    return [out / name for name in contents]


def refuse_what_is_outside(plant: Plant) -> None:
    """HexsimError for what a leg's plugin cannot hold."""
    if plant.has_supply_states:
        raise HexsimError(
            f"machine {plant.machine.name}: its supply has states, which all legs share; a plugin is one leg: "
            "export it with [power_unit] and effects of the supply left out"
        )
    for name in OF_THE_COMPUTER:
        if plant.rows[:, P[name]].any():
            raise HexsimError(
                f"machine {plant.machine.name}: its valves have a {name.lower().replace('_', ' ')}, which acts from tick to "
                "tick outside MuJoCo: set it to 0 and put it into what gives the volts"
            )


def machine_xml(plant: Plant) -> str:
    """The MJCF of the machine with the plugin's actuators and keyframe `home` in static equilibrium."""
    plant.add_home_keyframe()
    hold_home(plant)
    with exact_numbers():
        root = ET.fromstring(plant.spec.to_xml())
    if (size := root.find("size")) is not None:
        root.remove(size)  # user data of hexsim's own callbacks
    actuators, extension = root.find("actuator"), ET.Element("extension")
    assert actuators is not None
    root.insert(1, extension)
    plugin = ET.SubElement(extension, "plugin", plugin=NAME)
    for i, general in enumerate(list(actuators)):
        instance = ET.SubElement(plugin, "instance", name=f"leg_{i + 1}")
        for key, value in numbers_of(plant.rows[i]).items():
            ET.SubElement(instance, "config", key=key, value=value)
        general.tag = "plugin"
        for key in ("biastype", "gainprm", "biasprm"):
            general.attrib.pop(key, None)
        general.attrib |= {"plugin": NAME, "instance": f"leg_{i + 1}"}
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def hold_home(plant: Plant) -> None:
    """Give the keyframe `home` the volts and pressures at which nothing flows.

    A valve with both chambers on it leaks at null: at 0 V it passes oil, and the leg creeps. Keyframe `shut` has the valves
    shut, as a run begins.
    """
    legs, data = np.flatnonzero(plant.rows[:, P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE), plant.data
    if not len(legs):
        return
    shut = plant.spec.add_key(name="shut")
    shut.qpos, shut.act, shut.ctrl = data.qpos, data.act, data.ctrl
    for i in legs:
        hold_leg(plant, int(i))
    home = plant.spec.key("home")
    home.act, home.ctrl = data.act, data.ctrl


def hold_leg(
    plant: Plant,
    i: int,
    *,
    # of the differences that Newton's method takes: small beside a valve's null region (0.1 V, 10 um) and the supply
    volt_step_V: float = 1e-4,
    spool_step_m: float = 1e-8,
    step_MPa: float = 1e-4,
    newton_steps: int = 12,  # steps; each squares the error
) -> None:
    """Unknown are volts, spool (where it lags) and both pressures; known are the force that holds the load and rates of zero:
    Newton's method from the equilibrium of forces. Legs at rest in one pose do not depend on each other."""
    data, places = plant.data, plant.layout[i]
    spool = [int(places[A.SPOOL])] if places[A.SPOOL] >= 0 else []
    chambers = [int(places[A.ROD_SIDE]), int(places[A.PRESSURE])]
    states, rates = spool + chambers, [place + 1 for place in spool] + chambers  # the spool's velocity stands behind it
    steps = np.array([volt_step_V, *[spool_step_m] * len(spool), *[step_MPa] * 2])
    force = float(data.actuator_force[i])

    def residual(z: np.ndarray) -> np.ndarray:
        data.ctrl[i], data.act[states] = z[0], z[1:]
        mujoco.mj_forward(plant.model, data)
        return np.array([data.actuator_force[i] - force, *data.act_dot[rates]])

    z = np.array([data.ctrl[i], *data.act[states]])
    for _ in range(newton_steps):
        off = residual(z)
        slopes = np.column_stack([residual(z + step) - off for step in np.diag(steps)])
        z = z - steps * np.linalg.lstsq(slopes, off, rcond=None)[0]
    residual(z)


def numbers_of(row: np.ndarray) -> dict[str, str]:
    """Attributes of a leg that are not zero, which is what an attribute that is left out means."""
    found = {}
    for name, (first, count) in attributes().items():
        values = row[first : first + count]
        if values.any():
            found[name] = " ".join(repr(float(value)) for value in values)
    return found


@contextmanager
def exact_numbers(
    *,
    digits: int = 17,  # digits that give a double back
) -> Iterator[None]:
    """MuJoCo's writer of XML with all digits in place of six, which would move joints by micrometres."""
    mj = ctypes.CDLL(mujoco._functions.__file__)
    try:
        get, set_to = mj._mjPRIVATE__get_xml_precision, mj._mjPRIVATE__set_xml_precision
    except AttributeError:
        raise HexsimError("this MuJoCo writes XML with six digits alone: install mujoco 4.0.x") from None
    before = get()
    set_to(digits)
    try:
        yield
    finally:
        set_to(before)


@cache
def equations() -> dict[str, Any]:
    """The compiled functions that leg_plugin.c calls, by their symbols."""
    number, pointer = types.float64, types.CPointer(types.float64)
    leg_rates, leg_bias = callbacks.leg_rates, callbacks.leg_bias

    @cfunc(types.void(*[pointer] * 4, *[number] * 5), error_model="numpy")
    def rates(row, places, act, act_dot, y, v, volts, t, h):
        leg_rates(row, places, act, act_dot, y, v, volts, t, h)

    @cfunc(number(*[pointer] * 3, *[number] * 4), error_model="numpy")
    def bias(row, places, act, y, v, volts, t):
        return leg_bias(row, places, act, y, v, volts, t)

    return {"hexsim_leg_rates": rates, "hexsim_leg_bias": bias}


def header() -> str:
    """leg_plugin.h: the attributes, and the places that the C source reads."""
    given = attributes()
    places = {"N_ROW": N_PARAMETERS, "N_PLACES": len(A), "N_ATTRIBUTES": len(given), "OWNER_LEG": LEG}
    places |= {place.name: int(place) for place in A}
    used = (P.SPOOL_OMEGA, P.BRISTLE_STIFFNESS, P.LEARNED_MEMORY, P.ROD_SIDE_CHAMBER, P.LENGTH_OFFSET, P.AREA_BOTTOM)
    places |= {place.name: int(place) for place in used}
    lines = [f"#define {name} ({value!r})" for name, value in places.items()]
    columns = {
        "char *const ATTRIBUTES": (f'"{name}"' for name in given),
        "int FIRST": (str(first) for first, _ in given.values()),
        "int COUNT": (str(count) for _, count in given.values()),
    }
    lines += [f"static const {name}[] = {{{','.join(values)}}};" for name, values in columns.items()]
    return "\n".join(lines) + "\n"


def library(system: System) -> bytes:
    """The plugin as a shared library."""
    with tempfile.TemporaryDirectory(prefix="hexsim-plugin-") as name:
        folder = Path(name)
        (folder / "leg_plugin.h").write_text(header())
        code, made = folder / "equations.o", folder / f"{system.prefix}hexsim_leg{system.suffix}"
        code.write_bytes(object_of(equations(), system, exported=False))
        given = [Path(str(files("hexsim.export") / "leg_plugin.c")), code]
        flags = ["-std=c23", "-fvisibility=hidden", "-fno-sanitize=undefined", f"-I{folder}", f"-I{HEADERS}"]
        if system.suffix == ".so":
            given.append(linux_library())
        compile_and_link(given, system, made, flags)
        return made.read_bytes()
