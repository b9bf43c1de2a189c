"""The face of the algorithm: configuration, start, numbers in and out. The tick itself is `step`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..adaptive.prediction import prediction_table
from ..compensator import Compensator, Context, Parameters, Sample
from ..compiled import compiled
from .layout import STATE, Record
from .leg import NAMES
from .step import start, tick_of


@dataclass(slots=True)
class EstimatedState:
    """All that the algorithm carries from tick to tick, for one actuator."""

    context: Context
    states: np.ndarray = field(default_factory=lambda: np.zeros(1, STATE))
    added_V: float = 0.0

    @property
    def numbers(self) -> Record:
        """The array's numbers by name."""
        return self.states[0]


@compiled
def tick_first(states, table, preview, loads, setpoint, position, control, valve, bottom, top, supply, forward):
    """`tick_of` of states (1,)."""
    return tick_of(states[0], table, preview, loads, setpoint, position, control, valve, bottom, top, supply, forward)


@compiled
def start_first(states):
    """`start` of states (1,)."""
    start(states[0])


@dataclass(frozen=True, kw_only=True)
class Estimated(Compensator):
    """Estimates every number of the leg with its variance, and feeds the inverse of the same model forward.

    Adds its volts as soon as the bump that its doubt would make is smaller than plain control's.
    """

    name: str = "estimated"
    place = 5
    preview_s: float = 0.028
    learn: bool = True

    def start(self, context: Context) -> EstimatedState:
        state = EstimatedState(context)
        settings = state.numbers.settings
        for name in settings.dtype.names:
            settings[name] = getattr(self if hasattr(self, name) else context, name)
        start_first(state.states)
        return state

    def step(self, state: EstimatedState, sample: Sample) -> tuple[float, EstimatedState]:
        state.added_V = tick_first(
            state.states, prediction_table(), sample.preview_m, sample.load_preview_m_s2, sample.setpoint_m, sample.position_m,
            sample.control_V, sample.valve_V, sample.pressure_bottom_Pa, sample.pressure_top_Pa, sample.pressure_supply_Pa,
            sample.feed_forward_V,
        )  # fmt: skip
        return state.added_V, state

    def finite(self, state: EstimatedState) -> bool:
        s = state.numbers
        return bool(np.isfinite(s.inverse.U).all() and np.isfinite(s.inverse.x).all())

    def parameters(self, state: EstimatedState) -> Parameters:
        known = state.numbers.known
        return {"numbers": dict(zip(NAMES, map(float, known.numbers), strict=True)), "chi2": [float(c) for c in known.chi2]}

    def restore(self, context: Context, parameters: Parameters) -> EstimatedState:
        return self.start(context)

    def not_engaged(self, state: EstimatedState) -> str:
        s = state.numbers
        return "" if s.share > 0.0 else "learning"
