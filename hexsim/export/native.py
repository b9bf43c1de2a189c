# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""From the compiled hydraulics and C to a shared library: object files by LLVM, linked by the zig of the wheel `ziglang`."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import mujoco
from numba import cfunc, types

from hexsim.errors import HexsimError, shortened
from hexsim.hydraulics import valve
from hexsim.plant.callbacks import native_callbacks

MUJOCO = Path(mujoco.__path__[0])
TRIPLE = "x86_64-unknown-linux-gnu"
ZIG_TARGET = "x86_64-linux-gnu.2.17"  # the C library of 2012: any Linux that is in use has a newer one
ERROR_PATHS = ("Py", "NRT_", "numba_")  # what numba calls when Python raises: never from strict native code
SOURCES = ("plant.c", "fmi2.c")


def mujoco_library() -> Path:
    """MuJoCo's shared library in its wheel. Raises HexsimError on another system than Linux."""
    found = sorted(MUJOCO.glob("libmujoco.so.*"))
    if not found:
        raise HexsimError("the export of FMUs needs MuJoCo's Linux library: run it on Linux (64 bit)")
    return found[0]


def own_name(library: Path, digest: str) -> str:
    """Name of the library's copy in one FMU, as long as the old one: libhx2f81ab04.so.4."""
    head, tail = "libhx", ".so.4"
    return head + digest[: len(library.name) - len(head) - len(tail)] + tail


def renamed_library(library: Path, name: str) -> bytes:
    """The library under another name, so that a process that has another MuJoCo, or another FMU, keeps them apart.

    MuJoCo's callbacks are global in a library, and a loader takes libraries of one name for the same. The name is a text
    in the table of strings; `name` has its length.
    """
    content, old, new = library.read_bytes(), library.name.encode() + b"\0", name.encode() + b"\0"
    if len(old) != len(new) or content.count(old) != 1:
        raise HexsimError(f"{library.name} does not hold its name once: install mujoco 4.0.x")
    return content.replace(old, new)


def objects(folder: Path) -> tuple[list[Path], list[str]]:
    """Object files of the two callbacks and the valve's backlash in `folder`; and the error paths to leave empty."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(TRIPLE).create_target_machine(cpu="x86-64", opt=2, reloc="pic")
    number = types.float64
    play: Any = cfunc(number(number, number, number), error_model="numpy")(valve.play.py_func)
    act_dyn, act_bias = native_callbacks()
    made, missing = [], set()
    for name, function in (("act_dyn", act_dyn), ("act_bias", act_bias), ("play", play)):
        module = llvm.parse_assembly(function.inspect_llvm())
        module.triple = TRIPLE
        for part in module.functions:
            if part.name.startswith("cfunc."):
                part.name = f"hexsim_{name}"
            elif not part.is_declaration:
                part.linkage = "internal"
        undefined = [*module.functions, *module.global_variables]
        missing |= {part.name for part in undefined if part.is_declaration and part.name.startswith(ERROR_PATHS)}
        made.append(folder / f"{name}.o")
        made[-1].write_bytes(machine.emit_object(module))
    return made, sorted(missing)


def link(folder: Path, sources: list[Path], library: Path, out: Path) -> None:
    """Compile the packaged C with `folder`/machine.h and link all to the shared library `out`."""
    if importlib.util.find_spec("ziglang") is None:
        raise HexsimError("the export of FMUs compiles C: install the compiler with `pip install hexsim[fmu]`")
    ours = files("hexsim.export")
    command = [
        sys.executable, "-m", "ziglang", "cc", "-target", ZIG_TARGET, "-O2", "-shared", "-fPIC", "-fvisibility=hidden",
        "-fno-sanitize=undefined", "-s", f"-I{folder}", f"-I{MUJOCO / 'include'}",
        *(str(ours / name) for name in SOURCES), *map(str, sources), str(library), "-lm", "-Wl,-rpath,$ORIGIN",
        "-Wl,-z,nodelete", "-o", str(out),
    ]  # fmt: skip
    cache = {"ZIG_LOCAL_CACHE_DIR": str(folder / "cache")}
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | cache, check=False)
    if done.returncode:
        raise HexsimError(f"the C compiler refused the FMU: {shortened(' '.join(done.stderr.split()), 500)}")
