# pyright: reportPrivateImportUsage=false, reportAttributeAccessIssue=false
# (numba does not list its own functions)
"""What compiled functions call is linked into them; it is optimised with them, and has no machine code of its own.

Numba optimises each function for each signature with all that it calls, and makes machine code of both and a function for Python. Most
signatures are asked for by compiled callers alone, which do it once more. Without, compiling from nothing takes less than half the time.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from llvmlite import binding
from numba import njit, types
from numba.core import event
from numba.core.codegen import JITCodeLibrary
from numba.core.environment import lookup_environment
from numba.core.registry import cpu_target

_COMPILING: list[dict[str, Any]] = []  # options of the functions that are being compiled, each within the one before


class Library(JITCodeLibrary):
    """The code of one function and of what it calls. for_callers: compiled ones alone ask for it, and no machine code is made."""

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self.for_callers = bool(_COMPILING) and bool(_COMPILING[-1].get("no_cpython_wrapper"))

    @property
    def codegen(self) -> Any:
        return self if self.for_callers else self._codegen

    def set_env(self, name: str, env: Any) -> None:
        """Nothing is executed here: the code of the callers has the environment."""

    def get_pointer_to_function(self, name: str) -> int:
        return 0 if self.for_callers else super().get_pointer_to_function(name)

    def _optimize_final_module(self) -> None:
        if not self.for_callers:
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        if self.for_callers:
            self._finalize_dynamic_globals()
            self._finalized = True
            return
        super()._finalize_final_module()
        for place in self._final_module.global_variables:
            env = lookup_environment(place.name)
            if env is not None:  # of what was linked, too
                self._codegen.set_env(place.name, env)

    def serialize_using_object_code(self) -> Any:
        if not self.for_callers:
            return super().serialize_using_object_code()
        return self.name, "linked", self._get_module_for_linking().as_bitcode()

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, data = state
        if kind != "linked":
            return super()._unserialize(codegen, state)
        library = codegen.create_library(name)
        library.for_callers = True
        library._final_module = library._shared_module = binding.parse_bitcode(data)
        library._finalize_final_module()
        return library


class _Nesting(event.Listener):
    def on_start(self, event: Any) -> None:
        _COMPILING.append(getattr(event.data["dispatcher"], "targetoptions", {}))  # a lifted loop has none

    def on_end(self, event: Any) -> None:
        _COMPILING.pop()


def _counts(options: dict[str, Any]) -> bool:
    """Does code of these options count who holds an array?"""
    return bool(options.get("_nrt", True))


def _refuse_array(dispatcher: Any, kind: Any) -> None:
    """An array that one side counts and the other does not would be freed under its user, or never."""
    if isinstance(kind, types.Array):
        raise TypeError(f"{dispatcher.py_func.__name__} hands an array to code that counts references otherwise")
    for part in getattr(kind, "types", ()):  # of a tuple
        _refuse_array(dispatcher, part)


def _handing_on(function: Callable[..., Any], inner: Any) -> Any:
    """A function of the same parameters that calls another one."""
    names = ", ".join(inspect.signature(function).parameters)
    return eval(f"lambda {names}: inner({names})", {"__name__": function.__module__, "inner": inner})


def _compiled(dispatcher: Any, args: tuple[Any, ...]) -> Any:
    """What is compiled of it for these types, here or by an earlier process; None: nothing."""
    return dispatcher.overloads.get(args) or dispatcher._cache.load_overload(args, dispatcher.targetctx)


# private names of numba that this stands on: where a version lacks one, functions are compiled as numba does
KNOWN = hasattr(cpu_target.target_context.codegen(), "_library_class") and all(
    hasattr(JITCodeLibrary, name)
    for name in (
        "_optimize_final_module",
        "_finalize_final_module",
        "_finalize_dynamic_globals",
        "_get_module_for_linking",
        "_unserialize",
        "serialize_using_object_code",
        "get_pointer_to_function",
    )
)
if KNOWN:
    cpu_target.target_context.codegen()._library_class = Library
    event.register("numba:compile", _Nesting())


def linked(
    dispatcher: Any,
    options: dict[str, Any],
    general: Callable[[Any], Any] = lambda kind: kind,
    hands_views: bool = False,
) -> Any:
    """The dispatcher, whose compiled callers get another one's signatures, which Python cannot call. general: the type they ask for.

    hands_views: the arrays that it returns have no owner, so that whoever counts may have them.
    """
    if not hasattr(dispatcher, "get_call_template"):
        return dispatcher  # numba is switched off
    without: Any = options | {"no_cpython_wrapper": True}
    inner: Any = njit(**without)(dispatcher.py_func) if KNOWN else dispatcher
    stored = getattr(inner._cache, "_cache_file", None)
    if KNOWN and stored is not None:
        own = dispatcher._cache._cache_file
        stored.__class__, stored._version = own.__class__, own._version
        for name in ("_index_name", "_data_name_pattern"):
            setattr(stored, name, "linked-" + getattr(stored, name))
        stored._index_path = stored._data_path(stored._index_name)
    template, compile_ = inner.get_call_template, dispatcher._compiler.compile

    def implementation(args: Any, kws: Any) -> Any:
        """For Python: a call of what compiled callers have, where one of them has asked for it, and not all of it once more."""
        made = None if inner is dispatcher else _compiled(inner, tuple(args))
        if made is None:
            return dispatcher.py_func
        if not _counts(options):
            _refuse_array(dispatcher, made.signature.return_type)
        return _handing_on(dispatcher.py_func, inner)

    def compile_for_python(args: Any, return_type: Any) -> Any:
        made = compile_(args, return_type)
        if not _counts(options):  # before it is kept
            _refuse_array(dispatcher, made.signature.return_type)
        return made

    def get_call_template(args: Any, kws: Any) -> Any:
        found = template(tuple(map(general, args)), {name: general(kind) for name, kind in kws.items()})
        if _COMPILING and not hands_views and _counts(_COMPILING[-1]) != _counts(options):
            _refuse_array(dispatcher, inner.overloads[tuple(found[2])].signature.return_type)
        return found

    dispatcher._compiler.compile, dispatcher._compiler._get_implementation = compile_for_python, implementation
    dispatcher.get_call_template, dispatcher.get_overload = get_call_template, inner.get_overload
    return dispatcher
