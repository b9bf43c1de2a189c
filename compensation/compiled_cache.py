"""Numba's cache of compiled functions, made safe: a damaged file is compiled again, a full disk costs time only.

What numba reads of a file that was cut short (a full disk, a kill) raises any kind of error, and code with a flipped bit
may end the process in LLVM. So each file with code ends with its SHA-256, which numba's own reading passes over.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba import config
from numba.core import caching, sigutils
from numba.core.ccallback import CFunc
from numba.core.dispatcher import Dispatcher


class NamedClosures(caching.FunctionCache):
    """A function by its code and what it closes over: of compiled functions their name and when their file was written. Numba names them
    by a number of the process, so that none which closes over one was found again."""

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        held = (cell.cell_contents for cell in self._py_func.__closure__ or ())
        named = [
            (x.__module__, x.__qualname__, os.stat(x.py_func.__code__.co_filename).st_mtime_ns)
            if isinstance(x, Dispatcher)
            else x
            for x in held
        ]
        return sig, codegen.magic_tuple(), self._py_func.__code__.co_code, *named


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
        size = hashlib.sha256().digest_size
        if hashlib.sha256(content[:-size]).digest() != content[-size:]:
            raise OSError(f"{name} was cut short or changed")  # numba's own sign of an absent file
        return super()._load_data(name)

    def save(self, key: Any, data: Any) -> None:
        """Keep a compiled function, where there is room for it."""
        with suppress(OSError):
            super().save(key, data)


def check_cache(dispatcher: Any, sources: str) -> None:
    """Let a dispatcher keep its compiled code in files that are checked, valid for sources of this digest."""
    stored = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if isinstance(stored, caching.IndexDataCacheFile):  # none when numba runs without a cache
        stored.__class__ = CheckedFiles
        stored._version = (stored._version, "checked", sources)


def native_function(signature: Any, function: Callable[..., Any], sources: str) -> Any:
    """A C function of a signature, cached as other compiled ones are (`numba.cfunc` compiles before the cache has a version)."""
    callback: Any = CFunc(function, sigutils.normalize_signature(signature), {}, {"error_model": "numpy"})
    try:
        callback._cache = NamedClosures(function)
    except RuntimeError:  # neither the package's folder nor the user's can be written
        config.CACHE_DIR = temporary_cache()  # type: ignore[attr-defined]
        callback._cache = NamedClosures(function)
    check_cache(callback, sources)
    callback.compile()
    return callback


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
