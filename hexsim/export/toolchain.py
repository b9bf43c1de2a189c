# pyright: reportAttributeAccessIssue=false
"""From compiled functions and C to native code: object files by LLVM, linked by the zig of the wheel `ziglang`."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

from hexsim.errors import HexsimError, shortened

ERROR_PATHS = ("Py", "NRT_", "numba_", "_Py")  # what numba calls when Python raises: never from strict native code
CFUNC_PREFIX = "cfunc."


@dataclass(frozen=True, kw_only=True)
class System:
    """Where native code runs. folders: of an FMU's binaries, by version of FMI."""

    name: str
    triple: str
    zig: str
    suffix: str
    prefix: str = "lib"
    cpu: str = "x86-64"
    folders: dict[int, str] = field(default_factory=dict, hash=False)
    flags: tuple[str, ...] = ()


SHARED = ("-fPIC", "-lm", "-Wl,-z,nodelete")
SYSTEMS = {
    system.name: system
    for system in (
        System(
            name="linux64",
            triple="x86_64-unknown-linux-gnu",
            suffix=".so",
            folders={2: "linux64", 3: "x86_64-linux"},
            zig="x86_64-linux-gnu.2.17",  # the C library of 2012: any Linux that is in use has a newer one
            flags=SHARED,
        ),
        System(
            name="win64",
            triple="x86_64-w64-windows-gnu",
            suffix=".dll",
            zig="x86_64-windows-gnu",
            prefix="",
            folders={2: "win64", 3: "x86_64-windows"},
        ),
        System(  # macOS 11, the first on these processors
            name="macos",
            triple="arm64-apple-macosx11.0.0",
            suffix=".dylib",
            zig="aarch64-macos.11.0",
            cpu="apple-m1",
        ),
        System(
            name="arm64",
            triple="aarch64-unknown-linux-gnu",
            suffix=".so",
            zig="aarch64-linux-gnu.2.17",
            cpu="generic",
            flags=SHARED,
        ),
    )
}


def target_machine(system: System) -> Any:
    """LLVM's code generator for a system: position-independent, for any processor of its kind."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(system.triple).create_target_machine(cpu=system.cpu, opt=2, reloc="pic")


def module_of(function: Any, symbol: str, system: System, machine: Any, exported: bool = True) -> Any:
    """LLVM module of a numba cfunc, which is called `symbol`; all else in it is internal. exported: by a Windows library."""
    module = llvm.parse_assembly(function.inspect_llvm())
    module.triple, module.data_layout = system.triple, str(machine.target_data)
    for part in module.functions:
        if part.name.startswith(CFUNC_PREFIX):
            part.name = symbol
            if exported and system.suffix == ".dll":
                part.storage_class = "dllexport"
        elif not part.is_declaration:
            part.linkage = "internal"
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    return module


def object_of(functions: Mapping[str, Any], system: System, exported: bool = True) -> bytes:
    """One object file that holds the cfuncs by their symbols, and needs the C library's mathematics alone.

    Numba's error paths, which strict native code never takes, end the process.
    """
    machine = target_machine(system)
    modules = [module_of(function, symbol, system, machine, exported) for symbol, function in functions.items()]
    for other in modules[1:]:
        modules[0].link_in(other)
    whole = llvm.parse_assembly(_without_error_paths(str(modules[0])))
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(whole, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    return machine.emit_object(whole)


def _without_error_paths(text: str) -> str:
    """LLVM assembly with the error paths' declarations made definitions that trap.

    Counting the owners of arrays, which are all the caller's, is left out: for x86 it is in x86's own words.
    """
    names = "|".join(ERROR_PATHS)
    text = re.sub(
        rf"^declare ([^@]*@(?:{names})\w*\([^)]*\))[^\n]*$",
        r"define internal \1 {\n  call void @llvm.trap()\n  unreachable\n}",
        text,
        flags=re.MULTILINE,
    )
    text = re.sub(
        rf"^(@(?:{names})\w*) = external ((?:\w+ )*)global (\S+?)(,[^\n]*)?$",
        r"\1 = internal global \3 zeroinitializer",
        text,
        flags=re.MULTILINE,
    )
    text = re.sub(
        r"^define internal void (@NRT_(?:in|de)cref[.\d]*\(ptr[^\n]*?%[.\w]+\))[^\n]*\{\n.*?^\}$",
        r"define internal void \1 {\n  ret void\n}",
        text,
        flags=re.MULTILINE | re.DOTALL,
    )
    declared = "declare void @llvm.trap()"
    return text if declared in text else f"{text}\n{declared} cold noreturn nounwind\n"


def has_linker() -> bool:
    """Whether the wheel `ziglang` is installed."""
    return importlib.util.find_spec("ziglang") is not None


def compile_and_link(sources: Iterable[Path], system: System, out: Path, flags: Iterable[str] = ()) -> None:
    """C sources, object files and libraries to a shared library `out`. Raises HexsimError with what the compiler said."""
    if not has_linker():
        raise HexsimError("the export compiles C: install the compiler with `pip install hexsim[fmu]`")
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        system.zig,
        "-O2",
        "-shared",
        "-s",
        *map(str, sources),
        *flags,
        *system.flags,
        *_own_name(out),
        "-o",
        str(out),
    ]
    cache = {"ZIG_LOCAL_CACHE_DIR": str(out.parent / "cache")}
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | cache, check=False)
    if done.returncode:
        told = "; ".join(line for line in done.stderr.splitlines() if "error" in line) or done.stderr
        raise HexsimError(f"the C compiler refused {out.name}: {shortened(told, 500)}")


def _own_name(out: Path) -> tuple[str, ...]:
    """A library of macOS says what it is called; by default with the folder in which it was made."""
    return (f"-Wl,-install_name,@rpath/{out.name}",) if out.suffix == ".dylib" else ()


def shared_library(code: bytes, system: System, name: str) -> bytes:
    """An object file as a shared library that needs the C library alone."""
    with tempfile.TemporaryDirectory(prefix="hexsim-") as folder:
        given, made = Path(folder) / f"{name}.o", Path(folder) / f"{system.prefix}{name}{system.suffix}"
        given.write_bytes(code)
        compile_and_link([given], system, made)
        return made.read_bytes()
