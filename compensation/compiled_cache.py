"""Numba's cache of compiled functions, made safe: a damaged file is compiled again, a full disk costs time only.

What numba reads of a file that was cut short (a full disk, a kill) raises any kind of error, and code with a flipped bit
may end the process in LLVM. So each file with code ends with its SHA-256, which numba's own reading passes over.

Machine code is loaded as it is: numba's tables of what it can compile, and the code's LLVM form, take four times as long
to load, and are needed by a compilation alone.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from numba.core import caching, codegen
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]

DIGEST_BYTES = 32


class CheckedFiles(caching.IndexDataCacheFile):
    """Index and data files of one function; what is not whole counts as absent."""

    def _dump(self, obj: Any) -> bytes:
        data = super()._dump(obj)
        return data + hashlib.sha256(data).digest()

    def _load_index(self) -> dict[Any, str]:
        try:
            return super()._load_index()
        except Exception:  # of a damaged file, any kind
            return {}

    def _load_data(self, name: str) -> Any:
        content = Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(content[:-DIGEST_BYTES]).digest() != content[-DIGEST_BYTES:]:
            raise OSError(f"{name} was cut short or changed")  # numba's own sign of an absent file
        return super()._load_data(name)

    def save(self, key: Any, data: Any) -> None:
        """Keep a compiled function, where there is room for it."""
        with suppress(OSError):
            super().save(key, data)


class ReadyLibrary(codegen.JITCodeLibrary):
    """Machine code with the names that it defines; its LLVM code is read when a caller is compiled."""

    _bitcode: bytes

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> ReadyLibrary:
        name, names, (code, bitcode) = state
        library = cls(codegen, name)
        library.enable_object_caching()
        library._set_compiled_object(code)
        library._finalize_final_module()
        library._bitcode = bitcode
        codegen._engine._defined_symbols |= names
        return library

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = llvm.parse_bitcode(self._bitcode)
        return self._shared_module


class ReadyCode(caching.CompileResultCacheImpl):
    """What a cache keeps of a compiled function, with its names in place of numba's mark of the kind."""

    def reduce(self, cres: Any) -> Any:
        (name, _, code), *rest = super().reduce(cres)
        module = cres.library._get_module_for_linking()
        of_module = [*module.functions, *module.global_variables]
        return ((name, {one.name for one in of_module if not one.is_declaration}, code), *rest)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        generator = target_context.codegen()
        generator._library_class = ReadyLibrary  # of this one alone: numba's lock is held
        try:
            return super().rebuild(target_context, payload)
        finally:
            del generator._library_class


class CheckedCache(caching.FunctionCache):
    """A function's cache that loads machine code without numba's tables, which it fills before it compiles."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        _name_runtime()
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


@cache
def _name_runtime() -> None:
    """Tell LLVM where numba's runtime stands, which machine code calls."""
    for name, address in _nrt_python.c_helpers.items():
        llvm.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


def check_cache(dispatcher: Any, sources: str) -> None:
    """Let a dispatcher keep its compiled code in files that are checked, valid for sources of this digest."""
    kept = getattr(dispatcher, "_cache", None)
    if isinstance(kept, caching.FunctionCache):  # none when numba runs without a cache
        stored = kept._cache_file
        kept.__class__, kept._impl.__class__, stored.__class__ = CheckedCache, ReadyCode, CheckedFiles
        stored._version = (stored._version, "ready", sources)


@cache
def temporary_cache() -> str:
    """A cache folder of this user alone below the system's temporary one; a new one where somebody else has it."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"hexsim-cache-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        state = folder.lstat()
        if not folder.is_symlink() and (os.name == "nt" or (state.st_uid == user and not state.st_mode & 0o077)):
            return str(folder)
    except OSError:
        pass
    return tempfile.mkdtemp(prefix="hexsim-cache-")
