"""The adaptive algorithm's face: configuration, start, parameters in and out. The tick itself is `step`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..compensator import Compensator, Context, Parameters, Sample
from ..guard import TELLS
from ..prediction import prediction_table
from ..records import Record, empty
from .layout import LEARNED, STATE
from .learned import as_dict, fill
from .legs import AdaptiveLegs
from .not_engaged import reason
from .ranges import refusal
from .start import finite_from, keep, looks_ahead_s, restore, start
from .step import DESIGN_WANTED, REJECTED, WORSE, hear_first, tick
from .taps import design


@dataclass(slots=True)
class AdaptiveState:
    """All that the adaptive algorithm carries from tick to tick, for one actuator."""

    context: Context
    states: np.ndarray = field(default_factory=lambda: np.zeros(1, STATE))  # the flat array, layout.py
    told: int = 0  # by the last tick

    flat: np.ndarray = field(init=False)  # the same memory as doubles

    def __post_init__(self) -> None:
        self.flat = self.states.view(np.float64)

    @property
    def numbers(self) -> Record:
        """The array's numbers by name."""
        return self.states[0]


@dataclass(frozen=True, kw_only=True)
class Adaptive(Compensator):
    """Identifies valve, friction and spool lag while the machine moves, and feeds forward through their inverse.

    The algorithm to use when nothing is known of the motion. Needs 20 ms of preview.

    Feed-forward. lead_smoothing: higher values make the lead softer, slower and kinder to the valve. step_min_s,
    step_max_s, jerk_m_s3: the pressure's step at a reversal is spread over the time that gives the load this jerk,
    within these bounds; lower jerk protects a light load, whose resonance is high. presliding_m_s: velocity within
    which friction reverses.

    Damping. damping_1_s: share of a pressure oscillation let out a second, between damping_low_Hz and damping_high_Hz,
    by an FIR filter of damping_count taps. damping_max_V: bound of its volts; the gain falls as they come near.

    Identification. window_s: length of a window; min_speed_m_s: mean speed from which a window counts; memory_windows:
    windows after which old data weigh 1/e. learn: False uses restored parameters as they are.

    Engagement (engagement.py). min_excitation_m_s2: reversal acceleration from which it engages.
    max_stability_limit_m_s2: it never disengages from motions with a higher one. engage_s, feed_forward_s,
    disengage_s: longest ramp, and times of the feed-forward; higher values make the transfer slower and smoother.
    """

    name: str = "adaptive"
    place = 4
    preview_s: float = 0.028
    reference_drop_Pa: float = 3.5e6
    lead_smoothing: float = 1e-4
    step_min_s: float = 3e-3
    step_max_s: float = 8e-3
    jerk_m_s3: float = 1300.0
    presliding_m_s: float = 3e-4
    damping_1_s: float = 80.0
    damping_count: int = 7
    damping_low_Hz: float = 15.0
    damping_high_Hz: float = 65.0
    damping_max_V: float = 0.2
    window_s: float = 0.032
    min_speed_m_s: float = 3e-3
    memory_windows: float = 200.0
    engage_s: float = 1.0
    feed_forward_s: float = 4.0
    disengage_s: float = 1.5
    max_stability_limit_m_s2: float = 0.03
    min_excitation_m_s2: float = 0.04
    learn: bool = True

    def start(self, context: Context) -> AdaptiveState:
        state = AdaptiveState(context)
        settings = state.numbers.settings
        for name in settings.dtype.names:
            settings[name] = getattr(self if hasattr(self, name) else context, name)
        start(state.numbers)
        design(state.numbers)  # so that it is compiled before the first tick, as `start` holds a copy of its own
        return state

    def step(self, state: AdaptiveState, sample: Sample) -> tuple[float, AdaptiveState]:
        volts, state.told = tick(
            state.states, prediction_table(), sample.preview_m, sample.load_preview_m_s2, sample.setpoint_m,
            sample.position_m, sample.control_V, sample.valve_V, sample.pressure_bottom_Pa, sample.pressure_top_Pa,
            sample.pressure_supply_Pa, self.extra(state, sample) - sample.feed_forward_V,
        )  # fmt: skip
        if state.told & DESIGN_WANTED:
            design(state.numbers)
        return volts, state

    def together(self, states: Sequence[AdaptiveState]) -> AdaptiveLegs:
        """What steps these legs in one call."""
        return AdaptiveLegs(self, states, type(self).extra is not Adaptive.extra)

    def preview_of(self, state: AdaptiveState) -> float:
        return min(self.preview_s, looks_ahead_s(state.numbers))

    def tells(self, state: AdaptiveState) -> bool:
        return bool(state.told & TELLS)

    def hear(self, state: AdaptiveState, other: AdaptiveState) -> None:
        hear_first(state.states, other.states)

    def extra(self, state: AdaptiveState, sample: Sample) -> float:
        """Volts that a derived algorithm adds."""
        return 0.0

    def has_sound_extra(self, state: AdaptiveState) -> bool:
        """Whether what makes them is finite."""
        return True

    def status(self, state: AdaptiveState) -> str:
        """A sentence while plain control acts because of what reversals or the valve have done."""
        return sentence(state.told)

    def parameters(self, state: AdaptiveState) -> Parameters:
        learned = empty(LEARNED)
        keep(state.numbers, learned)
        return as_dict(learned)

    def refused(self, context: Context, parameters: Parameters) -> str:
        learned = empty(LEARNED)
        try:
            fill(learned, parameters)
        except (KeyError, TypeError, ValueError, OverflowError) as problem:
            return f"{problem} is missing" if isinstance(problem, KeyError) else str(problem)
        return refusal(learned, self.start(context).numbers.settings)

    def finite(self, state: AdaptiveState) -> bool:
        return self.has_sound_extra(state) and finite_from(state.flat, 0)

    def not_engaged(self, state: AdaptiveState) -> str:
        return reason(state.numbers)

    def restore(self, context: Context, parameters: Parameters) -> AdaptiveState:
        state, learned = self.start(context), empty(LEARNED)
        fill(learned, parameters)
        restore(state.numbers, learned)
        return state

    def resume(self, context: Context, parameters: Parameters) -> AdaptiveState:
        """In the middle of a motion nothing is armed: plain control's bumps are measured again before it engages."""
        return self.restore(context, {name: value for name, value in parameters.items() if name != "plain_control"})


def sentence(told: int) -> str:
    """What a tick's flags mean, in words."""
    if told & WORSE:
        return "reversals became worse than plain control's: plain control for a while"
    if told & REJECTED:
        return "the valve no longer follows what was learned: plain control while it is learned anew"
    return ""
