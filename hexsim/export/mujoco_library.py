# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""MuJoCo's shared library of each system, as an FMU carries it.

Linux: that of the installed wheel, under a name of its own and without what an FMU never calls, so that two systems fit
into 5 MB. Windows: mujoco.dll of the wheel `mujoco-core` of the same version, which pip fetches once a user into a cache;
or a file that the caller names. Both are under the Apache licence, which allows it.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import zipfile
from importlib.metadata import version
from pathlib import Path

import mujoco
import numpy as np

from hexsim.errors import HexsimError, shortened
from hexsim.files.atomic import written_whole

MUJOCO = Path(mujoco.__path__[0])
# Functions and tables that read XML and meshes, compile and write models, and draw: by their names in the library.
NEVER_CALLED = re.compile(rb"_ZNK?\d+mj[XC]|_ZNK?8tinyxml2|_ZNK?7tinyobj|mjv_|mjr_|font_")
SYMBOL = np.dtype(
    [("name", "<u4"), ("info", "u1"), ("other", "u1"), ("section", "<u2"), ("value", "<u8"), ("size", "<u8")]
)
SECTION = np.dtype(
    {
        "names": ["type", "flags", "address", "offset", "size", "link"],
        "formats": ["<u4", *["<u8"] * 4, "<u4"],
        "offsets": [4, 8, 16, 24, 32, 40],
        "itemsize": 64,
    }
)
TRAP = b"\xcc"


def linux_library() -> Path:
    """In the installed wheel. Raises HexsimError on another system than Linux."""
    found = sorted(MUJOCO.glob("libmujoco.so.*"))
    if not found:
        raise HexsimError("the export of FMUs needs MuJoCo's Linux library: run it on Linux (64 bit)")
    return found[0]


def own_name(library: Path, digest: str) -> str:
    """Name of the library's copy in one FMU, as long as the old one: libhx2f81ab04.so.4."""
    head, tail = "libhx", ".so.4"
    return head + digest[: len(library.name) - len(head) - len(tail)] + tail


def renamed(library: Path, name: str) -> bytes:
    """The library under another name, so that a process that has another MuJoCo, or another FMU, keeps them apart.

    MuJoCo's callbacks are global in a library, and a loader takes libraries of one name for the same. The name is a text
    in the table of strings; `name` has its length.
    """
    content, old, new = library.read_bytes(), library.name.encode() + b"\0", name.encode() + b"\0"
    if len(old) != len(new) or content.count(old) != 1:
        raise HexsimError(f"{library.name} does not hold its name once: install mujoco 4.0.x")
    return content.replace(old, new)


def lightened(
    content: bytes,
    *,
    symbol_table: int = 2,  # ELF: kind of a section
    no_bits: int = 8,  # ELF: kind of a section without content
    allocated: int = 2,  # ELF: flag of a section that is loaded
    executable: int = 4,  # ELF: flag of code
) -> bytes:
    """An ELF library with a trap in place of each function that an FMU never calls, cut behind what is loaded.

    It stays as it is where it has no table of local symbols.
    """
    start, size, count = (int.from_bytes(content[at : at + n], "little") for at, n in ((0x28, 8), (0x3A, 2), (0x3C, 2)))
    sections = np.frombuffer(content, SECTION, count, start)
    if size != SECTION.itemsize or symbol_table not in sections["type"]:
        return content
    table = sections[sections["type"] == symbol_table][0]
    names = content[int(sections[table["link"]]["offset"]) :]
    changed = bytearray(content)
    for symbol in np.frombuffer(content, SYMBOL, int(table["size"]) // SYMBOL.itemsize, int(table["offset"])):
        if symbol["section"] >= count or not NEVER_CALLED.match(names, int(symbol["name"])):
            continue
        section, length = sections[symbol["section"]], int(symbol["size"])
        is_table = names.startswith(b"font_", int(symbol["name"]))
        if section["flags"] & executable or (is_table and section["type"] != no_bits):
            at = int(section["offset"]) + int(symbol["value"]) - int(section["address"])
            changed[at : at + length] = TRAP * length
    loaded = sections[(sections["flags"] & allocated > 0) & (sections["type"] != no_bits)]
    changed[0x28:0x30], changed[0x3C:0x40] = bytes(8), bytes(4)  # no sections: a loader looks at segments alone
    return bytes(changed[: int((loaded["offset"] + loaded["size"]).max())])


def windows_library(given: Path | None = None) -> bytes:
    """mujoco.dll: the file given, or that of the installed version by pip. Raises HexsimError where it is not to be had."""
    if given is not None:
        content = given.read_bytes() if given.is_file() else b""
        if content[:2] != b"MZ":
            raise HexsimError(f"{given} is no library for Windows: give mujoco.dll of MuJoCo {version('mujoco')}")
        return content
    wanted = version("mujoco")
    kept = Path.home() / ".cache" / "hexsim" / f"mujoco-{wanted}-win_amd64.dll"
    if not kept.is_file():
        with tempfile.TemporaryDirectory(prefix="hexsim-dll-") as folder:
            _fetch(f"mujoco-core=={wanted}", Path(folder))
            with zipfile.ZipFile(next(Path(folder).glob("*.whl"))) as wheel:
                content = wheel.read("mujoco/mujoco.dll")
        kept.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(kept) as begun:
            begun.write_bytes(content)
    return kept.read_bytes()


def _fetch(what: str, folder: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--quiet",
        "--platform",
        "win_amd64",
        "--only-binary=:all:",
        "--no-deps",
        "--dest",
        str(folder),
        what,
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise HexsimError(
            f"the Windows part of the FMU needs mujoco.dll of {what}, and pip did not get it "
            f"({shortened(' '.join(done.stderr.split()[-30:]), 200)}): give the file with --mujoco-dll"
        )
