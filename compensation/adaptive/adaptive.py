"""The face of the algorithm: configuration, start, numbers in and out. The tick itself is `step`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..compensator import Compensator, Context, Parameters, Sample
from ..compiled import compiled
from ..knowledge import Knowledge
from ..records import Record, empty
from .estimator import FEWEST, KNOWN_LEG
from .known import knowledge_of
from .layout import STATE
from .learned import LEARNED, PRIOR, as_dict, fill, keep, missing, refusal, restore
from .legs import AdaptiveLegs, tick_legs
from .step import SAY_TICKS, hear_leg, start


@dataclass(slots=True)
class AdaptiveState:
    """All that the algorithm carries from tick to tick, for one actuator."""

    context: Context
    states: np.ndarray = field(default_factory=lambda: np.zeros(1, STATE))

    @property
    def numbers(self) -> Record:
        """The array's numbers by name."""
        return self.states[0]


@compiled
def hear_first(states, others):
    """`hear_leg` of states (1,)."""
    hear_leg(states[0], others[0])


@compiled
def start_first(states):
    """`start` of states (1,)."""
    start(states[0])


@dataclass(frozen=True, kw_only=True)
class Adaptive(Compensator):
    """Estimates every number of the leg with its variance, and feeds the inverse of the same model forward.

    Adds its volts as soon as the bump that its doubt would make is smaller than plain control's. Legs of a platform tell each other what
    they know, and engage together.
    """

    name: str = "adaptive"
    place = 5
    feels_legs = True
    preview_s: float = 0.028
    learn: bool = True

    def start(self, context: Context) -> AdaptiveState:
        state = AdaptiveState(context)
        settings = state.numbers.settings
        for name in settings.dtype.names:
            settings[name] = getattr(self if hasattr(self, name) else context, name)
        state.numbers.mobility[: context.legs] = context.mobility
        start_first(state.states)
        return state

    def step(self, state: AdaptiveState, sample: Sample) -> tuple[float, AdaptiveState]:
        preview, loads, mobility, forces, speeds = (
            np.asarray(values, float)
            for values in (
                sample.preview_m, sample.load_preview_m_s2, sample.mobility, sample.forces_N, sample.speeds_m_s
            )
        )  # fmt: skip
        numbers = (
            sample.load_of_pose_m_s2, sample.setpoint_m, sample.position_m, sample.control_V, sample.valve_V, sample.pressure_bottom_Pa,
            sample.pressure_top_Pa, sample.feed_forward_V, 0.0,
        )  # fmt: skip
        pose, *others, added = np.array(numbers, float).reshape(9, 1)
        acts, counts = np.ones((2, 1), bool), np.array([max(len(preview), len(loads))])
        given = preview[None], loads[None], pose, mobility[None], forces, speeds, *others
        tick_legs(state.states, acts[0], counts, given, sample.pressure_supply_Pa, added, acts[1])
        return float(added[0]), state

    def together(self, states: Sequence[AdaptiveState]) -> AdaptiveLegs:
        """What steps these legs in one call."""
        return AdaptiveLegs(states)

    def tells(self, state: AdaptiveState) -> bool:
        s = state.states  # its fields as arrays (1,): a record gives them ten times as slowly
        return bool(s["platform"][0]) and s["past"]["ticks"][0] % SAY_TICKS == 0

    def hear(self, state: AdaptiveState, other: AdaptiveState) -> None:
        hear_first(state.states, other.states)

    def finite(self, state: AdaptiveState) -> bool:
        inverse = state.states["inverse"]
        return bool(np.isfinite(inverse["U"]).all() and np.isfinite(inverse["x"]).all())

    def parameters(self, state: AdaptiveState) -> Parameters:
        """Numbers, the scale of the fit's units, the lower factor of its information row by row, misfit, noises."""
        learned = empty(LEARNED)
        keep(state.numbers, learned)
        return as_dict(learned)

    def refused(self, context: Context, parameters: Parameters) -> str:
        learned = empty(LEARNED)
        try:
            fill(learned, parameters)
        except ValueError as problem:
            return str(problem)
        return refusal(learned, self.start(context).numbers.settings, empty(PRIOR))

    def restore(self, context: Context, parameters: Parameters) -> AdaptiveState:
        """Starts with the numbers and their covariance: what is uncertain moves, what is known stays."""
        state, learned = self.start(context), empty(LEARNED)
        if not missing(parameters):
            fill(learned, parameters)
            restore(state.numbers, learned)
        return state

    def knows(self, state: AdaptiveState) -> Knowledge | None:
        return knowledge_of(state.numbers)

    def not_engaged(self, state: AdaptiveState) -> str:
        s, e = state.numbers, state.numbers.expected
        if s.share > 0.0:
            return ""
        if not s.known.valid:
            return f"{s.fit.count} windows of motion seen, {FEWEST} begin the fit: the leg's numbers are not known yet"
        if e.halves < 1:
            return "the leg's numbers are known; the next reversal says what they are good for"
        if s.wants:
            return "this leg is ready; another leg of the platform is not yet"
        if max(s.known.chi2) > KNOWN_LEG:
            return f"the leg is not one that the model knows: misfit chi2 {max(s.known.chi2):.1f}; it engages below {KNOWN_LEG:g}"
        return (
            f"doubt about the leg's numbers, and noise, would leave {(e.sigma2 + e.missed2) ** 0.5:.2f} m/s2 where plain control makes "
            f"{e.bump2**0.5:.2f} m/s2 (misfit chi2 {max(s.known.chi2):.1f}, 1 is a leg as the model knows it)"
        )
