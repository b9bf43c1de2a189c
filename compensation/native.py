# pyright: reportPrivateImportUsage=false, reportCallIssue=false
# (numba does not list its own functions, and intrinsics are called without their typing context)
"""An algorithm behind the guard as compiled functions of one flat array: what leaves Python (`hexsim export compensator`).

The same ticks as `Guarded`, to the bit. What an algorithm is to native code is its `NATIVE`, in its module `native`; everything
else is shared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from .compensator import MOST_LEGS, Compensator, Context, Parameters
from .compiled import in_its_caller
from .guard import GUARD, Todo, accept, check, start_guard

EXPORTED = ("adaptive",)  # algorithms that are compiled throughout
LOADS = 32  # of a preview, more than any algorithm looks ahead
# What is given before a tick, for that tick alone: `Sample.load_preview_m_s2`, and what all legs of a platform do.
INPUTS = np.dtype(
    (
        np.record,
        [
            ("loads", "i8"),
            ("legs", "i8"),
            ("loads_m_s2", "f8", (LOADS,)),
            ("pose_m_s2", "f8"),
            ("mobility", "f8", (MOST_LEGS,)),
            ("forces_N", "f8", (MOST_LEGS,)),
            ("speeds_m_s", "f8", (MOST_LEGS,)),
        ],
    )
)


@dataclass(frozen=True, kw_only=True)
class Native:
    """What an algorithm is to native code.

    Layouts are records of 8-byte numbers: settings (doubles alone, those of guard.SHEET among them), learned (doubles alone), state,
    and what checks need beside them. Functions are compiled; s is a record `state`, own (n,) the same memory as doubles, given (n,)
    the settings, whole the record `Native.whole`.
    """

    algorithm: type[Compensator]
    state_of: Callable[
        [Context, np.ndarray, int], Any
    ]  # its Python state around states (1,), and what the last tick told
    settings: np.dtype
    learned: np.dtype
    state: np.dtype
    space: Mapping[str, np.dtype] = field(default_factory=dict)
    positive: Sequence[str]  # settings that must be above zero
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # of others
    table: Callable[[], np.ndarray]  # constants, of `tick`
    start: Any  # (s, own, given): nothing learned, in a state of zeros
    # (s, inputs, table, preview, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, forward_V): volts to add,
    # and what the caller must know
    tick: Any
    finite: Any  # (s, own)
    hear: Any  # (s, other)
    keep: Any  # (s, learned)
    forget: Any  # (learned): what does not hold in the midst of a motion
    restore: Any  # (s, learned), in a state that was just started
    refused: Any  # (known (n,), whole): 0, or 1 + the place of the first learned number that cannot be this machine's
    as_dict: Callable[[Any], Parameters]  # a record `learned` by name
    fill: Callable[[Any, Parameters], None]  # its inverse; ValueError, KeyError
    names: Mapping[str, Sequence[str]] = field(default_factory=dict)  # of the numbers of arrays in `learned`

    @cached_property
    def whole(self) -> np.dtype:
        """The layout of a state behind the guard."""
        before = [("guard", GUARD), ("given", self.settings), ("learned", self.learned), ("inputs", INPUTS)]
        return np.dtype((np.record, [*before, *self.space.items(), ("algorithm", self.state)]))

    @property
    def size(self) -> int:
        """Doubles of it."""
        return self.whole.itemsize // 8

    @cached_property
    def setting_names(self) -> list[str]:
        """Of the doubles of `settings`."""
        return names_of(self.settings)

    @cached_property
    def learned_names(self) -> list[str]:
        """Of the doubles of `learned`."""
        return names_of(self.learned, elements=self.names)

    def place(self, name: str) -> int:
        """Of a part of it, in doubles."""
        return self.whole.fields[name][1] // 8  # type: ignore[index]

    def settings_of(self, made: Compensator, context: Context) -> np.ndarray:
        """The record `settings` (1,) of a configuration and a data sheet."""
        settings = np.zeros(1, self.settings)
        for name in self.settings.names or ():
            value, to = getattr(made if hasattr(made, name) else context, name), settings[name][0]
            if np.ndim(to):
                to[: len(value)] = value
            else:
                settings[name] = value
        return settings


@intrinsic
def as_argument(typingctx: Any, array: Any) -> Any:  # type: ignore[misc]
    """An array of constants as any other one, so that what is compiled for those serves it too. Nobody may write to it."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return args[0]

    return types.Array(array.dtype, array.ndim, array.layout)(array), codegen


@cache
def native(name: str) -> Native:
    """The description of one of EXPORTED."""
    return import_module(f"{__package__}.{name}.native").NATIVE


def guarded(made: Native) -> SimpleNamespace:
    """`start`, `load` and `tick` of the algorithm behind the guard, compiled at their first call.

    numbers (n,): a state as doubles; whole: the record in the same memory.
    """
    size, algorithm, given = made.size, made.place("algorithm"), made.place("given")
    learned, n_learned, n_settings = made.place("learned"), made.learned.itemsize // 8, made.settings.itemsize // 8
    names = made.setting_names
    positive = tuple(names.index(name) for name in made.positive)
    ranges = tuple((names.index(name), *map(float, ends)) for name, ends in made.ranges.items())
    begin, table, step, finite = made.start, made.table(), made.tick, made.finite
    keep, forget, put_back, refused_number = made.keep, made.forget, made.restore, made.refused

    @in_its_caller
    def refused_setting(settings):
        """0, or 1 + the place of the first number that is not finite, or not one of a machine."""
        for i in range(n_settings):
            if not math.isfinite(settings[i]):
                return 1 + i
        for place in positive:
            if not settings[place] > 0.0:
                return 1 + place
        for place, low, high in ranges:
            if not low <= settings[place] <= high:
                return 1 + place
        return 0

    @in_its_caller
    def begin_anew(numbers, whole):
        for i in range(algorithm, size):
            numbers[i] = 0.0
        begin(whole.algorithm, numbers[algorithm:], numbers[given : given + n_settings])

    @in_its_caller
    def start(numbers, whole, settings):
        """As `refused_setting`: then nothing is done."""
        refused = refused_setting(settings)
        if refused:
            return refused
        for i in range(size):
            numbers[i] = 0.0
        for i in range(n_settings):
            numbers[given + i] = settings[i]
        start_guard(whole.guard, whole.given)
        begin_anew(numbers, whole)
        return 0

    @in_its_caller
    def load(numbers, whole, known):
        """Start with what was learned, as `restore`. 0, or as `refused`: then nothing is done."""
        refused = refused_number(known, whole)
        if refused:
            return refused
        for i in range(n_learned):
            numbers[learned + i] = known[i]
        begin_anew(numbers, whole)
        put_back(whole.algorithm, whole.learned)
        return 0

    @in_its_caller
    def tick(
        numbers, whole, ahead, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, forward_V
    ):
        """Volts to add, and what the algorithm told, or a fault of guard.py."""
        guard = whole.guard
        todo = check(guard, setpoint_m, ahead, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa)
        volts, told = guard.output_V, guard.reason
        if todo == Todo.ACT:
            volts, told = step(
                whole.algorithm,
                whole.inputs,
                as_argument(table),
                ahead,
                setpoint_m,
                position_m,
                control_V,
                valve_V,
                bottom_Pa,
                top_Pa,
                supply_Pa,
                forward_V,
            )
            volts = accept(guard, volts, forward_V, finite(whole.algorithm, numbers[algorithm:]))
            told = guard.reason if guard.reason else told
        elif todo == Todo.BEGIN_ANEW:
            begin_anew(numbers, whole)
        elif todo == Todo.RESTART:
            keep(whole.algorithm, whole.learned)
            forget(whole.learned)
            begin_anew(numbers, whole)
            put_back(whole.algorithm, whole.learned)
        whole.inputs.loads = whole.inputs.legs = 0
        whole.inputs.pose_m_s2 = 0.0
        return volts, told

    return SimpleNamespace(start=start, load=load, tick=tick)


def names_of(layout: np.dtype, before: str = "", elements: Mapping[str, Sequence[str]] | None = None) -> list[str]:
    """Names of the numbers of a layout in their order; those of an array are counted, or have names among `elements`."""
    names = []
    for name in layout.names or ():
        inner = layout[name]
        if inner.names:
            names += names_of(inner, f"{before}{name}_", elements)
        elif not inner.shape:
            names += [f"{before}{name}"]
        else:
            each = (elements or {}).get(name, range(int(np.prod(inner.shape))))
            names += [f"{before}{name}_{one}" for one in each]
    return names
