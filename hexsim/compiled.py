"""How every equation is compiled: strict IEEE arithmetic, cached between sessions, callable from C and from numpy.

Numba's cache looks at the file of the function alone, and compiled callers hold copies of what they call; a change in
`valve` would leave an old valve in the callbacks. So the cache's version is that of all files that take part; it is read
before anything else of a stored index, which may name types that are no more.
"""

from __future__ import annotations

import hashlib
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from llvmlite.ir import Constant, PointerType
from numba import config, njit, types
from numba.core import cgutils, event
from numba.core.ccallback import CFunc
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, models, register_model

from compensation.compiled_cache import check_cache, native_function, temporary_cache
from compensation.linked import linked

LOCK = "numba:compiler_lock"


def compiled(function: Callable[..., Any], other_sources: str = "", *, allocates: bool = False) -> Any:
    """`function` as a native one. Equations are inlined where they are used: terms that two of them share are computed once.

    other_sources: digest of what it calls or whose layouts it holds of other packages. allocates: see `allocating`.
    """
    is_inlined = function.__module__.startswith("hexsim.hydraulics.")
    options = {"cache": True, "error_model": "numpy", "fastmath": False, "forceinline": is_inlined}
    options |= {"nogil": True, "no_cfunc_wrapper": True}  # threads run side by side; C gets callbacks alone
    options["_nrt"] = allocates  # numba's counting of references
    try:
        dispatcher = njit(**options)(function)
    except RuntimeError:  # no locator: neither the package's folder nor the user's can be written
        config.CACHE_DIR = temporary_cache()  # type: ignore[attr-defined]
        dispatcher = njit(**options)(function)
    check_cache(dispatcher, sources_digest() + other_sources)
    return linked(dispatcher, options)


def allocating(function: Callable[..., Any]) -> Any:
    """`compiled`, for what makes arrays. All others count no references: who calls holds the arrays, as the Python caller of a compiled
    function does. Counting costs as much as a leg's equations, and the compiler must load every parameter again after each."""
    return compiled(function, allocates=True)


def compiled_callback(signature: Any, other_sources: str = "") -> Callable[[Callable[..., Any]], Any]:
    """A native C function of a signature, cached as `compiled` ones are; other_sources as there."""
    return lambda function: native_function(signature, function, sources_digest() + other_sources)


@cache
def with_code(callback: Any) -> Any:
    """A callback compiled anew, with its LLVM code, which one from the cache has not."""
    signature = (callback._sig.args, callback._sig.return_type)
    anew = CFunc(callback._pyfunc, signature, {}, {"error_model": "numpy"})
    anew.compile()
    return anew


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


class ByAddress(types.Type):
    """A named tuple that stands in its owner's frame: functions get its address, and its arrays without reference counts."""

    def __init__(self, owner: Any) -> None:
        self.owner = owner
        super().__init__(name=f"ByAddress({owner})")


@register_model(ByAddress)
class _Address(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, PointerType(manager.lookup(kind.owner).get_value_type()))


@infer_getattr
class _FieldsByAddress(AttributeTemplate):
    key = ByAddress

    def generic_resolve(self, value: Any, name: str) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        fields = value.owner.fields
        return value.owner[fields.index(name)] if name in fields else None


@lower_getattr_generic(ByAddress)
def _field_by_address(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    place = kind.owner.fields.index(name)
    field = builder.load(cgutils.gep_inbounds(builder, value, 0, place))
    return _without_owner(context, builder, kind.owner[place], field)


def _by_address(typing_context: Any, value: Any) -> Any:
    """A named tuple of many arrays by its address: each function that takes it by value has them all as arguments, and
    counts references to each, which compiles four times as long. It is valid until the function that made it returns."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return cgutils.alloca_once_value(builder, args[0])

    return ByAddress(value)(value), codegen


by_address: Any = intrinsic(_by_address)


class _Compilation(event.Listener):
    """Seconds that numba has compiled or loaded in this process, and who wants to know that it compiles."""

    def __init__(self) -> None:
        self.seconds, self.listeners = 0.0, []
        self._begun: list[float] = []
        self._compiling = 0

    def on_start(self, event: Any) -> None:
        if event.kind == LOCK:
            self._begun.append(clock.perf_counter())
        elif _is_kept(event):
            self._compiling += 1
            if self._compiling == 1:
                self._say(True)

    def on_end(self, event: Any) -> None:
        if event.kind == LOCK:
            since = self._begun.pop() if self._begun else clock.perf_counter()
            if not self._begun:  # what compiles within a compilation counts once
                self.seconds += clock.perf_counter() - since
        elif _is_kept(event) and self._compiling:
            self._compiling -= 1
            if not self._compiling:
                self._say(False)

    def _say(self, begins: bool) -> None:
        for listener in self.listeners:
            listener(begins)


def _is_kept(event: Any) -> bool:
    """Whether the next session finds what is compiled in its cache; numba's own small parts are compiled every time."""
    return hasattr(event.data["dispatcher"]._cache, "_cache_file")


_COMPILATION = _Compilation()
for _kind in ("numba:compile", LOCK):
    event.register(_kind, _COMPILATION)


def seconds_compiled() -> float:
    """Seconds that compiling and loading of compiled functions have taken in this process [s]."""
    return _COMPILATION.seconds


@contextmanager
def while_compiling(listener: Callable[[bool], None]) -> Iterator[None]:
    """listener(True) whenever functions are compiled that no cache holds, listener(False) when that is done."""
    _COMPILATION.listeners.append(listener)
    try:
        yield
    finally:
        _COMPILATION.listeners.remove(listener)


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
