"""The adaptive algorithm's face: configuration, start, parameters in and out. The tick itself is `step`."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot, sqrt

import numpy as np

from ..compensator import Compensator, Context, Parameters, Sample
from .damping_design import damping_filter
from .delay import delay_parameters, restore_delay
from .demand import stretch_demands
from .edge_rounding import restore_rounding, start_rounding
from .engagement import AT_REST_M_S2
from .friction import friction_parameters, restore_friction, start_friction
from .layout import PREVIEW_TICKS, STATE, Record
from .leak import restore_leak, start_leak
from .monitor import start_monitor
from .prediction import prediction_table, start_prediction
from .spool import crossing_lead, crossing_path, lead, look_ahead_shift, round_lag
from .step import DESIGN_WANTED, REJECTED, WORSE, tick, want_design
from .valve import restore_valve, start_valve, valve_parameters, valve_ready


@dataclass(slots=True)
class AdaptiveState:
    """All that the adaptive algorithm carries from tick to tick, for one actuator."""

    context: Context
    states: np.ndarray = field(default_factory=lambda: np.zeros(1, STATE))  # the flat array, layout.py
    told: int = 0  # by the last tick

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
        s, tick_s, window = state.numbers, context.tick_s, max(4, round(self.window_s * context.rate_Hz))
        for name in s.settings.dtype.names:
            s.settings[name] = getattr(self if hasattr(self, name) else context, name)
        settle = round(0.02 * context.rate_Hz)
        start_valve(s.valve, tick_s, window, self.min_speed_m_s, settle, self.memory_windows)
        start_friction(s.friction, tick_s, context.stroke_m, window, self.min_speed_m_s, self.memory_windows)
        start_monitor(s.monitor, tick_s, hypot(context.position_noise_m, context.position_resolution_m / sqrt(12.0)))
        start_rounding(s.rounding)
        start_leak(s.leak)
        start_prediction(s.prediction)
        s.reference.tick_s = s.inverse.tick_s = s.delay.tick_s = s.lateness.tick_s = tick_s
        s.demands.count, s.delay.tested, s.damping_gain = PREVIEW_TICKS, -1, 1.0
        s.engagement.ramp_step, s.engagement.stability_limit_m_s2 = 0.01, AT_REST_M_S2
        want_design(s, 0.0)
        self._design(state)
        return state

    def _design(self, state: AdaptiveState) -> None:
        """The taps that the step asked for. At a low rate, outside of the step: least squares, kept once made."""
        s, tick_s = state.numbers, state.context.tick_s
        lag_s, delay_s, shift = float(s.lag_s), float(s.delay_s), int(s.shift)
        s.lead_taps[:] = lead(lag_s, tick_s, self.lead_smoothing, delay_s, shift)
        s.crossing_taps[:] = crossing_lead(lag_s, tick_s, delay_s, shift)
        s.crossing_path[:] = crossing_path(lag_s, tick_s, delay_s, shift)
        late_s = min(round_lag(float(s.lateness.late_s)), delay_s)  # of the position; pressure is not late
        s.damping_taps[: self.damping_count] = damping_filter(
            lag_s - late_s, tick_s, self.damping_low_Hz, self.damping_high_Hz, self.damping_count, delay_s - late_s,
            float(s.resonance_Hz), float(s.viscous_share),
        )  # fmt: skip
        s.design_wanted = False

    def step(self, state: AdaptiveState, sample: Sample) -> tuple[float, AdaptiveState]:
        volts, state.told = tick(
            state.states, prediction_table(), sample.preview_m, sample.setpoint_m, sample.position_m, sample.control_V,
            sample.valve_V, sample.pressure_bottom_Pa, sample.pressure_supply_Pa, self.extra(state, sample) - sample.feed_forward_V,
        )  # fmt: skip
        if state.told & DESIGN_WANTED:
            self._design(state)
        return volts, state

    def extra(self, state: AdaptiveState, sample: Sample) -> float:
        """Volts that a derived algorithm adds."""
        return 0.0

    def status(self, state: AdaptiveState) -> str:
        """A sentence while plain control acts because of what reversals or the valve have done."""
        if state.told & WORSE:
            return "reversals became worse than plain control's: plain control for a while"
        if state.told & REJECTED:
            return "the valve no longer follows what was learned: plain control while it is learned anew"
        return ""

    def parameters(self, state: AdaptiveState) -> Parameters:
        s = state.numbers
        return {
            "flow": valve_parameters(s.valve),
            "rounding_V": float(s.trim.rounding_V),
            "friction": friction_parameters(s.friction),
            "delay": {**delay_parameters(s.delay), "late_s": float(s.lateness.late_s)},
        }

    def restore(self, context: Context, parameters: Parameters) -> AdaptiveState:
        state = self.start(context)
        s = state.numbers
        restore_valve(s.valve, parameters["flow"])
        restore_friction(s.friction, parameters["friction"])
        s.trim.rounding_V = float(parameters["rounding_V"])
        restore_rounding(s.rounding, s.trim.rounding_V)
        restore_delay(s.delay, parameters["delay"])
        s.lateness.late_s = float(parameters["delay"]["late_s"])
        if valve_ready(s.valve):
            restore_leak(s.leak, s.valve.leak_m_s)
            stretch_demands(s, look_ahead_shift(s.valve.lag_s, context.tick_s))
            want_design(s, round_lag(s.valve.lag_s))
            self._design(state)
        return state
