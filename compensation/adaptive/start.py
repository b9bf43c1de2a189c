"""The state before the first tick, and what was learned in and out of it: compiled, over the same flat array."""

from __future__ import annotations

import numpy as np

from ..compiled import compiled
from ..prediction import PREVIEW_TICKS, start_prediction
from ..records import kinds
from .delay import keep_delay, restore_delay, start_delay
from .demand import stretch_demands
from .edge_rounding import lower_bound_V, restore_rounding, start_rounding
from .engagement import AT_REST_M_S2, arm, keep_plain_control
from .friction import PAIR_POSITION_PRIOR, POSITION_PRIOR, keep_friction, restore_friction, start_friction
from .identification import want_design
from .layout import MAX_SHIFT, STATE
from .leak import restore_leak, start_leak
from .monitor import start_monitor
from .noise import position_error_m, set_noises
from .null import has_underlap
from .presliding import keep_presliding, restore_presliding
from .spool import look_ahead_shift, round_lag
from .stribeck import MOST_WEIGHT
from .taps import design
from .trust import UNKNOWN_M_S2
from .valve import keep_valve, restore_valve, start_valve, valve_ready

SETTLE_S = 0.02  # after the volts change sign, in which the spool crosses
MIN_WINDOW_TICKS = 4
START_RAMP_STEP = 0.01
MAX_UNDERLAP_V = 0.5  # of a four-way valve
LEAST_SYMMETRIC = 0.9  # ratio of areas from which a cylinder counts as symmetric
DIFFERENTIAL_MISFIT = 6.0  # times the squared misfit that else is allowed


@compiled
def start(s):
    """Nothing learned. s: a record of the layout, zero but for its settings. Designs the taps."""
    settings, tick_s = s.settings, s.settings.tick_s
    window = max(MIN_WINDOW_TICKS, round(settings.window_s / tick_s))
    s.friction.stribeck_velocity_m_s = settings.stribeck_velocity_m_s
    set_noises(s, window)
    start_valve(s.valve, tick_s, window, settings.min_speed_m_s, round(SETTLE_S / tick_s), settings.memory_windows)
    if settings.rod_ratio > 0.0:
        _start_pair(s.valve, settings.rod_ratio < LEAST_SYMMETRIC)
    prior = PAIR_POSITION_PRIOR if s.valve.four_way else POSITION_PRIOR
    start_friction(
        s.friction, tick_s, settings.stroke_m, window, settings.min_speed_m_s, settings.memory_windows, prior
    )
    s.friction.stribeck.most_weight = 1.0 if s.valve.four_way else MOST_WEIGHT
    start_monitor(s.monitor, tick_s, position_error_m(settings))
    start_delay(s.delay, settings)
    start_rounding(s.rounding, s.valve.four_way)
    start_leak(s.leak)
    s.trust.error_m_s2 = UNKNOWN_M_S2
    start_prediction(s.prediction)
    s.reference.tick_s = s.inverse.tick_s = s.lateness.tick_s = tick_s
    s.demands.count, s.damping_gain = PREVIEW_TICKS, 1.0
    s.engagement.ramp_step, s.engagement.stability_limit_m_s2 = START_RAMP_STEP, AT_REST_M_S2
    want_design(s, 0.0)
    design(s)


@compiled
def _start_pair(valve, differential):
    """A four-way valve; of a differential cylinder both pressures move together after a reversal."""
    valve.four_way, valve.differential = True, differential
    for i in range(2):
        valve.edges[i].least_V = -MAX_UNDERLAP_V
        if differential:
            valve.edges[i].misfit_allowed = DIFFERENTIAL_MISFIT


@compiled
def restore(s, known):
    """Into a state that was just started: what `keep` kept. known: a record LEARNED."""
    restore_valve(s.valve, known.flow)
    s.valve.underlap = has_underlap(s.valve)
    restore_friction(s.friction, known.friction)
    restore_presliding(s.friction.presliding, known.presliding, known.friction.half_step_Pa)
    s.trim.rounding_V = known.rounding_V
    restore_rounding(s.rounding, s.trim.rounding_V)
    s.trim.known = lower_bound_V(s.rounding) > 0.0
    restore_delay(s.delay, s.lateness, known.delay)
    if valve_ready(s.valve):
        restore_leak(s.leak, s.valve.leak_m_s)
        stretch_demands(s, look_ahead_shift(s.valve.lag_s, s.settings.tick_s))
        want_design(s, round_lag(s.valve.lag_s))
        design(s)
    arm(s, known.plain_control)


IS_FLOAT = np.array([kind == "f8" for kind in kinds(STATE)])  # (doubles of the state,)


@compiled
def finite_from(numbers, first):
    """Whether the doubles of a state are finite; numbers: doubles in which it begins at `first`, integers among them."""
    odd = 0
    for i in range(len(IS_FLOAT)):
        x = numbers[first + i]
        odd += 1 if (x - x != 0.0) & IS_FLOAT[i] else 0
    return odd == 0


@compiled
def keep(s, known):
    """What was learned, into `known`, a record LEARNED."""
    keep_valve(s.valve, known.flow)
    keep_friction(s.friction, known.friction)
    keep_presliding(s.friction.presliding, known.presliding)
    known.rounding_V = s.trim.rounding_V
    keep_delay(s.delay, s.lateness, known.delay)
    keep_plain_control(s, known.plain_control)


def looks_ahead_s(s) -> float:
    """How far ahead [s] setpoints are looked at: as the learned lag asks for, if armed; one still to be found may be any."""
    return (PREVIEW_TICKS + (s.shift if s.engagement.armed else MAX_SHIFT) + 1) * s.settings.tick_s
