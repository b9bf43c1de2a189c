"""A compensator that was exported as a native library, called through ctypes: software in the loop.

compensation.create("./libhexsim_adaptive.so"),   hexsim run heave --compensator ./libhexsim_adaptive.so
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from .adaptive.adaptive import Adaptive, sentence
from .adaptive.guarded import GUARDED
from .adaptive.layout import LEARNED, SETTINGS, empty
from .adaptive.learned import as_dict, fill
from .adaptive.not_engaged import reason
from .adaptive.start import looks_ahead_s
from .adaptive.step import DESIGN_WANTED, TELLS
from .compensator import Compensator, Context, Parameters, Sample
from .guard import SENTENCES
from .learned_parameters import check_parameters

PREFIX = "hexsim_adaptive_"


@dataclass(slots=True)
class LibraryState:
    """The library's state, and what its last step told."""

    numbers: np.ndarray  # of GUARDED
    told: int = 0


@dataclass(frozen=True, kw_only=True)
class Library(Compensator):
    """`hexsim_adaptive` from a native library; it has the guard inside. Designs are made at the tick that asks for them."""

    path: str
    configuration: Adaptive = field(default_factory=Adaptive)

    @property
    def name(self) -> str:  # type: ignore[override]
        """File name."""
        return Path(self.path).name

    @property
    def preview_s(self) -> float:  # type: ignore[override]
        """As configured [s]."""
        return self.configuration.preview_s

    @cached_property
    def functions(self) -> ctypes.CDLL:
        """The library, loaded. Raises ValueError where it is none, or one of another version."""
        try:
            library = ctypes.CDLL(str(Path(self.path).resolve()))
            size = getattr(library, f"{PREFIX}state_size")()
        except (OSError, AttributeError) as problem:
            raise ValueError(f"{self.path} is no exported compensator of this system: {problem}") from problem
        if size * 8 != GUARDED.itemsize:
            raise ValueError(
                f"{self.path} was exported by another version: its state has {size} numbers, this version's "
                f"{GUARDED.itemsize // 8}; export it anew"
            )
        double, pointer = ctypes.c_double, ctypes.c_void_p
        getattr(library, f"{PREFIX}step").argtypes = [pointer, double, pointer, ctypes.c_int, *[double] * 7, pointer]
        getattr(library, f"{PREFIX}expect").argtypes = [pointer, pointer, ctypes.c_int]
        return library

    def _call(self, function: str, *arrays: np.ndarray) -> int:
        return getattr(self.functions, PREFIX + function)(*(ctypes.c_void_p(array.ctypes.data) for array in arrays))

    def start(self, context: Context) -> LibraryState:
        state, own = LibraryState(np.zeros(1, GUARDED)), self.configuration
        settings = [float(getattr(own if hasattr(own, name) else context, name)) for name in SETTINGS.names or ()]
        if refused := self._call("init", state.numbers, np.array(settings)):
            raise ValueError(f"{self.path} refuses the setting {(SETTINGS.names or ())[refused - 1]}")
        return state

    def step(self, state: LibraryState, sample: Sample) -> tuple[float, LibraryState]:
        added, preview = ctypes.c_double(), np.ascontiguousarray(sample.preview_m, dtype=float)
        loads = np.ascontiguousarray(sample.load_preview_m_s2, dtype=float)
        if len(loads):
            getattr(self.functions, f"{PREFIX}expect")(state.numbers.ctypes.data, loads.ctypes.data, len(loads))
        state.told = getattr(self.functions, f"{PREFIX}step")(
            state.numbers.ctypes.data, sample.setpoint_m, preview.ctypes.data, len(preview), sample.position_m,
            sample.control_V, sample.feed_forward_V, sample.valve_V, sample.pressure_bottom_Pa,
            sample.pressure_top_Pa, sample.pressure_supply_Pa, ctypes.byref(added),
        )  # fmt: skip
        if state.told & DESIGN_WANTED:
            self._call("design", state.numbers)
        return added.value, state

    def preview_of(self, state: LibraryState) -> float:
        return min(self.preview_s, looks_ahead_s(state.numbers[0].algorithm))

    def tells(self, state: LibraryState) -> bool:
        return bool(state.told & TELLS)

    def hear(self, state: LibraryState, other: LibraryState) -> None:
        self._call("hear", state.numbers, other.numbers)

    def parameters(self, state: LibraryState) -> Parameters:
        learned = np.zeros(1, LEARNED)
        self._call("get_parameters", state.numbers, learned)
        return as_dict(learned[0])

    def refused(self, context: Context, parameters: Parameters) -> str:
        return self.configuration.refused(context, parameters)

    def finite(self, state: LibraryState) -> bool:
        return True  # its own guard looks

    def not_engaged(self, state: LibraryState) -> str:
        return SENTENCES.get(state.told, "") or reason(state.numbers[0].algorithm)

    def restore(self, context: Context, parameters: Parameters) -> LibraryState:
        check_parameters(self, context, parameters)
        state, learned = self.start(context), empty(LEARNED)
        fill(learned, parameters)
        self._call("set_parameters", state.numbers, np.array([learned]))
        return state

    def status(self, state: LibraryState) -> str:
        return SENTENCES.get(state.told, "") or sentence(state.told)
