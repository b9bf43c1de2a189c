"""How a tick is compiled: strict IEEE arithmetic, cached between sessions, at the first call and not before.

Numba's cache looks at the file of the function alone, but compiled callers hold copies of what they call. So the cache's
version is that of all files that hold compiled functions.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import config, njit, types
from numba.core.imputils import lower_cast

from .compiled_cache import check_cache, native_function, temporary_cache
from .linked import linked

SHARED = (
    "compensator",
    "guard",
    "spool_model",
    "volts_bound",
    "records",
    "arithmetic",
    "least_squares",
    "prediction",
    "loop_feedback",
    "damping_design",
    "desk",
    "rows",
    "report_functions",
    "exact",
    "iterative",
    "buffered",
    "repetitive",
    "native_ticks",
)
FOLDERS = ("adaptive",)  # every file of these


# Into the functions that call it: it returns part of an array, or would be compiled with all of an algorithm once more.
in_its_caller = njit(inline="always")


def compiled(function: Callable[..., Any], *, forceinline: bool = False, hands_views: bool = False) -> Any:
    """`function` as a native one. It gets records and arrays of the state layout, allocates nothing and counts no references: who
    calls holds the arrays. forceinline: into its callers. hands_views: it returns arrays at an address, which nobody owns.

    Compiled callers share one native function for all constants and lengths that they give it, where numba makes one for each.
    """
    options = {"cache": True, "error_model": "numpy", "fastmath": False, "nogil": True, "forceinline": forceinline}
    options["no_cfunc_wrapper"] = True  # C gets callbacks alone; a twelfth of the time to compile
    options["_nrt"] = hands_views  # numba's counting of references
    try:
        dispatcher = njit(**options)(function)
    except RuntimeError:  # neither the package's folder nor the user's can be written
        config.CACHE_DIR = temporary_cache()  # type: ignore[attr-defined]
        dispatcher = njit(**options)(function)
    check_cache(dispatcher, sources_digest())
    return linked(dispatcher, options, _general, hands_views)


def inlined(function: Callable[..., Any]) -> Any:
    """`compiled`, for what is called in the innermost loops: a fifth of a tick's time is the calls."""
    return compiled(function, forceinline=True)


def views(function: Callable[..., Any]) -> Any:
    """`compiled`, for what returns arrays at an address."""
    return compiled(function, hands_views=True)


def compiled_callback(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """A native C function of a signature, cached as `compiled` ones are; it is compiled at once."""
    return lambda function: native_function(signature, function, sources_digest())


@lower_cast(types.NestedArray, types.Array)
def _as_array(context: Any, builder: Any, kind: Any, wanted: Any, value: Any) -> Any:
    """An array inside a record is held as any other array is; numba lacks the cast."""
    return value


def _general(kind: Any) -> Any:
    """The type that a literal is one of; of an array inside a record the same array of any length."""
    if isinstance(kind, types.NestedArray):
        return types.Array(kind.dtype, kind.ndim, "C")
    return types.unliteral(kind)


@cache
def sources_digest() -> str:
    """Digest of the files that hold compiled functions or the layout of a state."""
    digest = hashlib.sha256()
    for path in compiled_sources():
        digest.update(path.read_bytes())
    return digest.hexdigest()


def compiled_sources() -> list[Path]:
    """The files of this package that compiled code depends on."""
    package = Path(__file__).parent
    return [
        *(package / f"{name}.py" for name in SHARED),
        *(path for name in FOLDERS for path in sorted((package / name).glob("*.py"))),
    ]
