# pyright: reportPrivateImportUsage=false
# (numba does not list its own functions)
"""A compensator as native code: an object file, a library, a C header, an example and what an integrator must know.

The functions are those of `compensation.native`, algorithm and guard, compiled for the target by LLVM. They work
on one array of doubles that the caller owns, allocate nothing, call the mathematics of the C library and nothing else.
On the machine that exports them they are Python's to the bit.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numba import carray, cfunc, types

from compensation import Context, check_parameters, preview_count
from compensation.compensator import MOST_LEGS
from compensation.native import EXPORTED, LOADS, guarded, native
from hexsim.errors import HexsimError
from hexsim.export.toolchain import SYSTEMS, System, has_linker, object_of, shared_library
from hexsim.files.atomic import written_whole

TARGETS = {
    "x86_64-linux": SYSTEMS["linux64"],
    "x86_64-windows": SYSTEMS["win64"],
    "aarch64-linux": SYSTEMS["arm64"],
}


@cache
def native_functions(name: str) -> dict[str, Any]:
    """The functions of the header by their names, compiled once a process (half a minute)."""
    made, double = native(name), np.float64
    pointer, number, integer = types.voidptr, types.float64, types.int32
    of_guarded, layout, size, hear, keep = guarded(made), made.whole, made.size, made.hear, made.keep
    n_settings, n_learned, learned = len(made.setting_names), len(made.learned_names), made.place("learned")
    start, tick, load = of_guarded.start, of_guarded.tick, of_guarded.load

    @cfunc(integer(pointer, pointer), error_model="numpy")
    def init(state, settings):
        numbers, whole = carray(state, (size,), double), carray(state, (1,), layout)
        return start(numbers, whole[0], carray(settings, (n_settings,), double))

    @cfunc(integer(pointer, number, pointer, integer, *[number] * 7, pointer), error_model="numpy")
    def step(state, setpoint, preview, count, position, control, feed_forward, valve, bottom, top, supply, added):
        numbers, whole = carray(state, (size,), double), carray(state, (1,), layout)
        ahead, volts = carray(preview, (count,), double), carray(added, (1,), double)
        volts[0], told = tick(
            numbers, whole[0], ahead, setpoint, position, control, valve, bottom, top, supply, feed_forward
        )
        return told

    @cfunc(types.void(pointer, pointer, integer), error_model="numpy")
    def expect(state, loads, count):
        inputs, given = carray(state, (1,), layout)[0].inputs, carray(loads, (count,), double)
        inputs.loads = min(max(count, 0), LOADS)
        for i in range(inputs.loads):
            inputs.loads_m_s2[i] = given[i]

    @cfunc(types.void(pointer, number, *[pointer] * 3, integer), error_model="numpy")
    def feel(state, pose, mobility, forces, speeds, count):
        inputs, given = carray(state, (1,), layout)[0].inputs, carray(mobility, (count,), double)
        forces_N, speeds_m_s = carray(forces, (count,), double), carray(speeds, (count,), double)
        inputs.legs, inputs.pose_m_s2 = min(max(count, 0), MOST_LEGS), pose
        for i in range(inputs.legs):
            inputs.mobility[i], inputs.forces_N[i], inputs.speeds_m_s[i] = given[i], forces_N[i], speeds_m_s[i]

    @cfunc(types.void(pointer, pointer), error_model="numpy")
    def hear_other(state, other):
        hear(carray(state, (1,), layout)[0].algorithm, carray(other, (1,), layout)[0].algorithm)

    @cfunc(types.void(pointer, pointer), error_model="numpy")
    def get_parameters(state, parameters):
        whole, out = carray(state, (1,), layout), carray(parameters, (n_learned,), double)
        own = carray(state, (size,), double)
        keep(whole[0].algorithm, whole[0].learned)
        for i in range(n_learned):
            out[i] = own[learned + i]

    @cfunc(integer(pointer, pointer), error_model="numpy")
    def set_parameters(state, parameters):
        numbers, whole = carray(state, (size,), double), carray(state, (1,), layout)
        return load(numbers, whole[0], carray(parameters, (n_learned,), double))

    @cfunc(integer(), error_model="numpy")
    def state_size():
        return size

    return {
        "init": init,
        "step": step,
        "expect": expect,
        "feel": feel,
        "hear": hear_other,
        "get_parameters": get_parameters,
        "set_parameters": set_parameters,
        "state_size": state_size,
    }


def export_compensator(
    name: str, target: str, out: Path, context: Context, learned: Mapping[str, Any] | None = None
) -> list[Path]:
    """Write the compensator for `target` (TARGETS) into the folder `out`; the files.

    context: data sheet whose numbers the header has as a start; learned: parameters of an earlier run, in the header too.
    Raises HexsimError for a compensator that is not compiled or a target that is not known. The library is left out where
    the linker (`pip install hexsim[fmu]`) is missing; object file, header and example are enough.
    """
    if name not in EXPORTED:
        raise HexsimError(
            f"compensator '{name}' cannot be exported as native code, {', '.join(EXPORTED)} can; the learned curve of the "
            "others goes as C source: `compensation.export.to_c`"
        )
    if target not in TARGETS:
        raise HexsimError(f"target '{target}' is unknown: {', '.join(TARGETS)} are possible")
    system, prefix = TARGETS[target], f"hexsim_{name}"
    out.mkdir(parents=True, exist_ok=True)
    code = compensator_object(name, system)
    values = {
        "PREFIX": prefix.upper(),
        "prefix": prefix,
        "STATE_KB": native(name).size * 8 // 1000,
        "CODE_KB": len(code) // 1000,
    }
    written = {
        f"{prefix}.o": code,
        f"{prefix}.h": header(name, context, learned).encode(),
        "main.c": filled("main.c", values).encode(),
        "README.md": filled("README.md", values).encode(),
    }
    if has_linker():
        written[f"{system.prefix}{prefix}{system.suffix}"] = shared_library(code, system, prefix)
    for file, content in written.items():
        with written_whole(out / file) as begun:
            begun.write_bytes(content)
    return [out / file for file in written]


@cache
def compensator_object(name: str, system: System, exported: bool = True) -> bytes:
    """Object file of an algorithm. exported: its functions leave a Windows library that it is linked into."""
    return object_of({f"hexsim_{name}_{key}": made for key, made in native_functions(name).items()}, system, exported)


def filled(file: str, values: Mapping[str, Any]) -> str:
    """A file of `compensator_files`: @KEY@ becomes its value."""
    text = (files("hexsim.export") / "compensator_files" / file).read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda found: str(values[found[1]]), text)


def settings_of(name: str, context: Context) -> list[float]:
    """The numbers of the C array `settings`, in its order."""
    made = native(name)
    return made.settings_of(made.algorithm(), context).view(np.float64).tolist()


def header(name: str, context: Context, learned: Mapping[str, Any] | None = None) -> str:
    """The C header: sizes, places and names of all numbers, and the functions."""
    made, prefix, settings = native(name), f"HEXSIM_{name.upper()}", settings_of(name, context)
    algorithm, parameters = made.algorithm(), np.zeros(1, made.learned)
    if learned is not None:
        try:
            check_parameters(algorithm, context, learned)
        except ValueError as problem:
            raise HexsimError(str(problem)) from None
        made.fill(parameters[0], dict(learned))
    named = zip(made.setting_names, settings, strict=True)
    values = {
        "PREFIX": prefix,
        "prefix": f"hexsim_{name}",
        "STATE": made.size,
        "RATE": f"{context.rate_Hz:g}",
        "PREVIEW": preview_count(algorithm, context),
        "SETTINGS": len(settings),
        "PARAMETERS": len(made.learned_names),
        "SETTING_PLACES": _places(f"{prefix}_", made.setting_names),
        "SETTING_VALUES": ",\n  ".join(f"{value!r} /* {key} */" for key, value in named),
        "PARAMETER_PLACES": _places(f"{prefix}_LEARNED_", made.learned_names),
        "LEARNED": "" if learned is None else _learned_array(f"hexsim_{name}", parameters),
    }
    return filled("header.h", values)


def _places(prefix: str, names: Iterable[str]) -> str:
    return ",\n  ".join(f"{prefix}{name.upper()}" for name in names)


def _learned_array(prefix: str, parameters: np.ndarray) -> str:
    numbers = parameters.view(np.float64)
    return (
        "\n/* What an earlier run had learned: for set_parameters. */\n"
        f"static const double {prefix}_learned[{len(numbers)}] = {{\n  "
        + ",\n  ".join(map(repr, numbers.tolist()))
        + "\n};\n"
    )


def learned_of(name: str, path: Path, leg: int) -> dict[str, Any]:
    """Parameters of a leg, from 1, in a run's learned.json."""
    try:
        legs = json.loads(path.read_text(encoding="utf-8"))["legs"]
        found = legs[leg - 1]
        native(name).fill(np.zeros(1, native(name).learned)[0], found)
    except (OSError, ValueError, KeyError, IndexError, TypeError, AttributeError) as problem:
        raise HexsimError(
            f"{path} holds no parameters of `{name}` for leg {leg}: give learned.json of a run with it"
        ) from problem
    return found
