"""A compensator that was exported as a native library, called through ctypes: software in the loop.

compensation.create("./libhexsim_adaptive.so"),   hexsim run heave --compensator ./libhexsim_adaptive.so
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .compensator import Compensator, Context, Parameters, Sample
from .guard import SENTENCES, TELLS
from .knowledge import Knowledge
from .learned_parameters import check_parameters
from .native import EXPORTED, Native, native


@dataclass(slots=True)
class LibraryState:
    """The library's state, and what its last step told."""

    context: Context
    numbers: np.ndarray  # (1,) of `Native.whole`
    told: int = 0


class Loaded(NamedTuple):
    """A library, the algorithm that it has, and what its functions begin with."""

    library: ctypes.CDLL
    native: Native
    prefix: str


@dataclass(frozen=True, kw_only=True)
class Library(Compensator):
    """An algorithm from a native library; it has the guard inside. Designs are made at the tick that asks for them."""

    path: str
    configuration: Compensator | None = None  # of the algorithm; None: as it is by itself

    def __post_init__(self) -> None:
        assert self.loaded  # or ValueError

    @property
    def name(self) -> str:  # type: ignore[override]
        """File name."""
        return Path(self.path).name

    @property
    def preview_s(self) -> float:  # type: ignore[override]
        """As configured [s]."""
        return self.made.preview_s

    @property
    def feels_legs(self) -> bool:  # type: ignore[override]
        """Whether the algorithm needs to."""
        return self.made.feels_legs

    @cached_property
    def made(self) -> Compensator:
        """The algorithm in Python, whose words are used."""
        return self.configuration or self.loaded.native.algorithm()

    @cached_property
    def loaded(self) -> Loaded:
        """Raises ValueError where the file is no library, or one of another version."""
        try:
            library = ctypes.CDLL(str(Path(self.path).resolve()))
        except OSError as problem:
            raise ValueError(f"{self.path} is no exported compensator of this system: {problem}") from problem
        prefixes = {name: f"hexsim_{name}_" for name in EXPORTED}
        name = next((name for name in EXPORTED if hasattr(library, f"{prefixes[name]}state_size")), None)
        if name is None:
            raise ValueError(f"{self.path} is no exported compensator: it has none of {', '.join(EXPORTED)}")
        prefix, size, wanted = prefixes[name], getattr(library, f"{prefixes[name]}state_size")(), native(name).size
        if size != wanted:
            raise ValueError(
                f"{self.path} was exported by another version: its state has {size} numbers, this version's {wanted}; export it anew"
            )
        double, pointer = ctypes.c_double, ctypes.c_void_p
        getattr(library, f"{prefix}step").argtypes = [pointer, double, pointer, ctypes.c_int, *[double] * 7, pointer]
        getattr(library, f"{prefix}expect").argtypes = [pointer, pointer, ctypes.c_int]
        if native(name).algorithm.feels_legs:
            getattr(library, f"{prefix}feel").argtypes = [pointer, double, *[pointer] * 3, ctypes.c_int]
        return Loaded(library, native(name), prefix)

    def _function(self, name: str) -> Any:
        return getattr(self.loaded.library, self.loaded.prefix + name)

    def _call(self, function: str, *arrays: np.ndarray) -> int:
        return self._function(function)(*(ctypes.c_void_p(array.ctypes.data) for array in arrays))

    def start(self, context: Context) -> LibraryState:
        made = self.loaded.native
        state = LibraryState(context, np.zeros(1, made.whole))
        if refused := self._call("init", state.numbers, made.settings_of(self.made, context)):
            raise ValueError(f"{self.path} refuses the setting {made.setting_names[refused - 1]}")
        return state

    def step(self, state: LibraryState, sample: Sample) -> tuple[float, LibraryState]:
        added, own, preview = ctypes.c_double(), state.numbers.ctypes.data, _doubles(sample.preview_m)
        if len(sample.load_preview_m_s2):
            loads = _doubles(sample.load_preview_m_s2)
            self._function("expect")(own, loads.ctypes.data, len(loads))
        if self.feels_legs and len(sample.forces_N):
            legs = [_doubles(of_legs) for of_legs in (sample.mobility, sample.forces_N, sample.speeds_m_s)]
            pointers = [of_legs.ctypes.data for of_legs in legs]
            self._function("feel")(own, sample.load_of_pose_m_s2, *pointers, len(sample.forces_N))
        state.told = self._function("step")(
            own,
            sample.setpoint_m,
            preview.ctypes.data,
            len(preview),
            sample.position_m,
            sample.control_V,
            sample.feed_forward_V,
            sample.valve_V,
            sample.pressure_bottom_Pa,
            sample.pressure_top_Pa,
            sample.pressure_supply_Pa,
            ctypes.byref(added),
        )
        return added.value, state

    def _inner(self, state: LibraryState) -> Any:
        """The algorithm's own state, in the library's memory."""
        return self.loaded.native.state_of(state.context, state.numbers["algorithm"], state.told)

    def preview_of(self, state: LibraryState) -> float:
        return self.made.preview_of(self._inner(state))

    def tells(self, state: LibraryState) -> bool:
        return bool(state.told & TELLS)

    def hear(self, state: LibraryState, other: LibraryState) -> None:
        self._call("hear", state.numbers, other.numbers)

    def parameters(self, state: LibraryState) -> Parameters:
        learned = np.zeros(1, self.loaded.native.learned)
        self._call("get_parameters", state.numbers, learned)
        return self.loaded.native.as_dict(learned[0])

    def refused(self, context: Context, parameters: Parameters) -> str:
        return self.made.refused(context, parameters)

    def finite(self, state: LibraryState) -> bool:
        return True  # its own guard looks

    def not_engaged(self, state: LibraryState) -> str:
        return SENTENCES.get(state.told, "") or self.made.not_engaged(self._inner(state))

    def knows(self, state: LibraryState) -> Knowledge | None:
        return self.made.knows(self._inner(state))

    def restore(self, context: Context, parameters: Parameters) -> LibraryState:
        check_parameters(self, context, parameters)
        state, learned = self.start(context), np.zeros(1, self.loaded.native.learned)
        self.loaded.native.fill(learned[0], parameters)
        if refused := self._call("set_parameters", state.numbers, learned):
            raise ValueError(f"{self.path} refuses the parameter {self.loaded.native.learned_names[refused - 1]}")
        return state

    def status(self, state: LibraryState) -> str:
        return SENTENCES.get(state.told, "") or self.made.status(self._inner(state))


def _doubles(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=float)
