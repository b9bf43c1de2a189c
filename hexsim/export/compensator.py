# pyright: reportPrivateImportUsage=false
# (numba does not list its own functions)
"""The adaptive compensator as native code: an object file, a library, a C header, an example and what an integrator must know.

The functions are those of `compensation.adaptive.guarded`, algorithm and guard, compiled for the target by LLVM. They work
on one array of doubles that the caller owns, allocate nothing, call the mathematics of the C library and nothing else.
On the machine that exports them they are Python's to the bit.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numba import carray, cfunc, types

from compensation import Context, check_parameters, preview_count
from compensation.adaptive import Adaptive
from compensation.adaptive.guarded import GUARDED, SIZE, restart_guarded, start_guarded, tick_guarded
from compensation.adaptive.layout import LEARNED, SETTINGS, empty
from compensation.adaptive.learned import fill
from compensation.adaptive.prediction import prediction_table
from compensation.adaptive.ranges import refused_parameter
from compensation.adaptive.start import keep
from compensation.adaptive.step import expect, hear
from compensation.adaptive.taps import design
from hexsim.errors import HexsimError
from hexsim.export.toolchain import SYSTEMS, System, has_linker, object_of, shared_library
from hexsim.files.atomic import written_whole

NAMES = ("adaptive",)  # compensators that are compiled throughout
TARGETS = {
    "x86_64-linux": SYSTEMS["linux64"],
    "x86_64-windows": SYSTEMS["win64"],
    "aarch64-linux": SYSTEMS["arm64"],
}
N_SETTINGS, N_LEARNED = SETTINGS.itemsize // 8, LEARNED.itemsize // 8


@cache
def native_functions() -> dict[str, Any]:
    """The functions of the header by their names, compiled once a process (half a minute)."""
    pointer, number, integer = types.voidptr, types.float64, types.int32
    table, double, guarded = prediction_table(), np.float64, GUARDED
    step_arguments = (pointer, number, pointer, integer, *[number] * 7, pointer)

    @cfunc(integer(pointer, pointer), error_model="numpy")
    def init(state, settings):
        numbers, whole = carray(state, (SIZE,), double), carray(state, (1,), guarded)
        return start_guarded(numbers, whole[0], carray(settings, (N_SETTINGS,), double))

    @cfunc(integer(*step_arguments), error_model="numpy")
    def step(state, setpoint, preview, count, position, control, feed_forward, valve, bottom, top, supply, added):
        numbers, whole = carray(state, (SIZE,), double), carray(state, (1,), guarded)
        ahead, volts = carray(preview, (count,), double), carray(added, (1,), double)
        volts[0], told = tick_guarded(
            numbers, whole[0], table, ahead, setpoint, position, control, valve, bottom, top, supply, feed_forward
        )
        return told

    @cfunc(types.void(pointer, pointer, integer), error_model="numpy")
    def expect_load(state, loads, count):
        expect(carray(state, (1,), guarded)[0].algorithm, carray(loads, (count,), double))

    @cfunc(types.void(pointer, pointer), error_model="numpy")
    def hear_other(state, other):
        hear(carray(state, (1,), guarded)[0].algorithm, carray(other, (1,), guarded)[0].algorithm)

    @cfunc(types.void(pointer), error_model="numpy")
    def make_design(state):
        design(carray(state, (1,), guarded)[0].algorithm)

    @cfunc(types.void(pointer, pointer), error_model="numpy")
    def get_parameters(state, parameters):
        whole, out = carray(state, (1,), guarded), carray(parameters, (N_LEARNED,), double)
        own = carray(state, (SIZE,), double)
        keep(whole[0].algorithm, whole[0].learned)
        for i in range(N_LEARNED):
            out[i] = own[LEARNED_PLACE + i]

    @cfunc(integer(pointer, pointer), error_model="numpy")
    def set_parameters(state, parameters):
        own, given = carray(state, (SIZE,), double), carray(parameters, (N_LEARNED,), double)
        whole = carray(state, (1,), guarded)
        refused = refused_parameter(given, whole[0].algorithm.settings)
        if refused:
            return refused
        for i in range(N_LEARNED):
            own[LEARNED_PLACE + i] = given[i]
        restart_guarded(own, whole[0])
        return 0

    @cfunc(integer(), error_model="numpy")
    def state_size():
        return SIZE

    return {
        "init": init, "step": step, "expect": expect_load, "hear": hear_other, "design": make_design, "get_parameters": get_parameters,
        "set_parameters": set_parameters, "state_size": state_size,
    }  # fmt: skip


LEARNED_PLACE = GUARDED.fields["learned"][1] // 8  # type: ignore[index]


def export_compensator(
    name: str, target: str, out: Path, context: Context, learned: Mapping[str, Any] | None = None
) -> list[Path]:
    """Write the compensator for `target` (TARGETS) into the folder `out`; the files.

    context: data sheet whose numbers the header has as a start; learned: parameters of an earlier run, in the header too.
    Raises HexsimError for a compensator that is not compiled or a target that is not known. The library is left out where
    the linker (`pip install hexsim[fmu]`) is missing; object file, header and example are enough.
    """
    if name not in NAMES:
        raise HexsimError(
            f"compensator '{name}' cannot be exported as native code, {', '.join(NAMES)} can; the learned curve of the "
            "others goes as C source: `compensation.export.to_c`"
        )
    if target not in TARGETS:
        raise HexsimError(f"target '{target}' is unknown: {', '.join(TARGETS)} are possible")
    system, prefix = TARGETS[target], f"hexsim_{name}"
    out.mkdir(parents=True, exist_ok=True)
    code = compensator_object(system)
    written = {
        f"{prefix}.o": code,
        f"{prefix}.h": header(name, context, learned).encode(),
        "main.c": _packaged("main.c"),
        "README.md": _packaged("README.md"),
    }
    if has_linker():
        written[f"{system.prefix}{prefix}{system.suffix}"] = shared_library(code, system, prefix)
    for file, content in written.items():
        with written_whole(out / file) as begun:
            begun.write_bytes(content)
    return [out / file for file in written]


def compensator_object(system: System, exported: bool = True) -> bytes:
    """Object file of `adaptive`. exported: its functions leave a Windows library that it is linked into."""
    return object_of({f"hexsim_adaptive_{key}": made for key, made in native_functions().items()}, system, exported)


def _packaged(name: str) -> bytes:
    return (files("hexsim.export") / "compensator_files" / name).read_bytes()


def settings_of(context: Context) -> dict[str, float]:
    """The numbers of the C array `settings`, in its order."""
    made = Adaptive()
    return {name: float(getattr(made if hasattr(made, name) else context, name)) for name in SETTINGS.names or ()}


def header(name: str, context: Context, learned: Mapping[str, Any] | None = None) -> str:
    """The C header: sizes, places and names of all numbers, and the functions."""
    prefix, settings = f"HEXSIM_{name.upper()}", settings_of(context)
    parameters = empty(LEARNED)
    if learned is not None:
        try:
            check_parameters(Adaptive(), context, learned)
        except ValueError as problem:
            raise HexsimError(str(problem)) from None
        fill(parameters, dict(learned))
    values = {
        "PREFIX": prefix, "prefix": f"hexsim_{name}", "STATE": SIZE, "RATE": f"{context.rate_Hz:g}",
        "PREVIEW": preview_count(Adaptive(), context),
        "SETTINGS": N_SETTINGS, "PARAMETERS": N_LEARNED,
        "SETTING_PLACES": _places(f"{prefix}_", settings),
        "SETTING_VALUES": ",\n  ".join(f"{value!r} /* {key} */" for key, value in settings.items()),
        "PARAMETER_PLACES": _places(f"{prefix}_", _learned_names(LEARNED)),
        "LEARNED": "" if learned is None else _learned_array(f"hexsim_{name}", parameters),
    }  # fmt: skip
    return re.sub(r"@(\w+)@", lambda found: str(values[found[1]]), _packaged("header.h").decode())


def _places(prefix: str, names: Any) -> str:
    return ",\n  ".join(f"{prefix}{name.upper()}" for name in names)


def _learned_names(layout: np.dtype, before: str = "LEARNED_") -> list[str]:
    """Names of the doubles of a layout in their order; of an array that of its first, the others counted."""
    names = []
    for name in layout.names or ():
        inner = layout[name]
        if inner.names:
            names += _learned_names(inner, f"{before}{name}_")
        else:
            count = int(np.prod(inner.shape))
            names += [f"{before}{name}"] if not inner.shape else [f"{before}{name}_{i}" for i in range(count)]
    return names


def _learned_array(prefix: str, parameters: Any) -> str:
    numbers = np.frombuffer(parameters.tobytes(), np.float64)
    return (
        "\n/* What an earlier run had learned: for set_parameters. */\n"
        f"static const double {prefix}_learned[{len(numbers)}] = {{\n  "
        + ",\n  ".join(map(repr, numbers.tolist()))
        + "\n};\n"
    )


def learned_of(path: Path, leg: int) -> dict[str, Any]:
    """Parameters of a leg, from 1, in a run's learned.json."""
    try:
        legs = json.loads(path.read_text(encoding="utf-8"))["legs"]
        found = legs[leg - 1]
        fill(empty(LEARNED), found)
    except (OSError, ValueError, KeyError, IndexError, TypeError) as problem:
        raise HexsimError(
            f"{path} holds no parameters of `adaptive` for leg {leg}: give learned.json of a run with it"
        ) from problem
    return found
