"""Numba's cache of compiled functions, made safe: a damaged file is compiled again, a full disk costs time only.

Numba unpickles what it finds. A file that was cut short (a full disk, a kill) raises any kind of error there, and one
with a flipped bit may end the process in LLVM. So each file's content comes after its SHA-256.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import caching

DIGEST_BYTES = 32


class CheckedFiles(caching.IndexDataCacheFile):
    """Index and data files of one function; what is not whole counts as absent."""

    def _dump(self, obj: Any) -> bytes:
        data = super()._dump(obj)
        return hashlib.sha256(data).digest() + data

    def _load_index(self) -> dict[Any, str]:
        try:
            with open(self._index_path, "rb") as file:
                if (
                    pickle.load(file) != self._version
                ):  # that of numba and of the sources; types in the rest may be gone
                    return {}
                stamp, overloads = pickle.loads(_whole(file.read()))
        except Exception:  # unpickling a damaged file raises any kind
            return {}
        return overloads if stamp == self._source_stamp else {}

    def _load_data(self, name: str) -> Any:
        try:
            with open(self._data_path(name), "rb") as file:
                return pickle.loads(_whole(file.read()))
        except Exception as error:
            raise OSError(f"{name} is damaged: {error}") from None  # numba's own sign of an absent file

    def save(self, key: Any, data: Any) -> None:
        """Keep a compiled function, where there is room for it."""
        with suppress(OSError):
            super().save(key, data)


def _whole(content: bytes) -> bytes:
    """What follows the digest. ValueError where it is not what was written."""
    digest, data = content[:DIGEST_BYTES], content[DIGEST_BYTES:]
    if hashlib.sha256(data).digest() != digest:
        raise ValueError("cut short or changed")
    return data


def check_cache(dispatcher: Any, sources: str) -> None:
    """Let a dispatcher keep its compiled code in files that are checked, valid for sources of this digest."""
    stored = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if isinstance(stored, caching.IndexDataCacheFile):  # none when numba runs without a cache
        stored.__class__ = CheckedFiles
        stored._version = (stored._version, "checked", sources)


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
