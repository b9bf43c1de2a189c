"""How every equation is compiled: strict IEEE arithmetic, cached between sessions, callable from C and from numpy.

Numba's cache looks at the file of the function alone, and compiled callers hold copies of what they call; a change in
`valve` would leave an old valve in the callbacks. So the cache's version is that of all files that take part; it is read
before anything else of a stored index, which may name types that are no more.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from llvmlite.ir import Constant
from numba import config, njit, types
from numba.core import sigutils
from numba.core.ccallback import CFunc
from numba.extending import intrinsic


def compiled(function: Callable[..., Any]) -> Any:
    """`function` as a native one. Equations are inlined where they are used: terms that two of them share are computed once.

    So are the parts of a tick, which would count references to each other's arrays.
    """
    is_inlined = function.__module__.startswith(("hexsim.hydraulics.", "hexsim.plant.stepping"))
    options = {"cache": True, "error_model": "numpy", "fastmath": False, "forceinline": is_inlined}
    try:
        dispatcher = njit(nogil=True, **options)(function)  # threads run side by side
    except RuntimeError:  # no locator: neither the package's folder nor the user's can be written
        config.CACHE_DIR = temporary_cache()  # type: ignore[attr-defined]
        dispatcher = njit(nogil=True, **options)(function)
    return _versioned(dispatcher)


def compiled_callback(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """A native C function of a signature, cached as `compiled` ones are (`numba.cfunc` compiles before the cache has a version)."""

    def made(function: Callable[..., Any]) -> Any:
        callback = CFunc(function, sigutils.normalize_signature(signature), {}, {"error_model": "numpy"})
        try:
            callback.enable_caching()
        except RuntimeError:  # no locator, see `compiled`
            config.CACHE_DIR = temporary_cache()  # type: ignore[attr-defined]
            callback.enable_caching()
        _versioned(callback).compile()
        return callback

    return made


def _versioned(made: Any) -> Any:
    """What numba made, with a cache that holds for the present sources alone."""
    stored = getattr(getattr(made, "_cache", None), "_cache_file", None)
    if stored is not None and hasattr(stored, "_version"):  # absent when numba runs without a cache
        stored._version = (stored._version, sources_digest())
    return made


def _borrowed(typing_context: Any, value: Any) -> Any:
    """The same array, or a tuple of them, without reference counts, for inner loops: counting costs as much as a leg's equations.

    Whoever lends it must hold the arrays until the borrower returns, as the Python caller of a compiled function does.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _without_owner(context, builder, signature.return_type, args[0])

    return value(value), codegen


def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        for i, part in enumerate(parts):
            inner = _without_owner(context, builder, part, builder.extract_value(value, i))
            value = builder.insert_value(value, inner, i)
    if not isinstance(kind, types.Array):
        return value
    struct = context.make_array(kind)(context, builder, value=value)
    struct.meminfo = Constant(struct.meminfo.type, None)
    struct.parent = Constant(struct.parent.type, None)
    return struct._getvalue()


borrowed: Any = intrinsic(_borrowed)


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


@cache
def sources_digest() -> str:
    """Digest of the files that hold compiled functions or the places of their parameters."""
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        if path.parent == package / "hydraulics" or b"hexsim.compiled" in source or b"IntEnum" in source:
            digest.update(source)
    return digest.hexdigest()
