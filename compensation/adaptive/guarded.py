"""The algorithm behind the guard as compiled functions of one flat array: what leaves Python (`hexsim export compensator`).

The same ticks as `Guarded(Adaptive())`, to the bit, if every design that a tick asks for is made before the next one.
"""

from __future__ import annotations

import math

from ..compiled import compiled
from ..guard import ACTS, BEGINS_ANEW, GUARD, RESTARTS, accept, check, start_guard
from .layout import LEARNED, MAX_DAMPING_TAPS, SETTINGS, STATE, record
from .start import finite_from, keep, restore, start
from .step import tick_of

GUARDED = record(guard=GUARD, learned=LEARNED, algorithm=STATE)  # `algorithm` last, its settings first
SIZE = GUARDED.itemsize // 8  # doubles
ALGORITHM = SIZE - STATE.itemsize // 8  # doubles before the algorithm's
KEPT = (GUARD.itemsize + LEARNED.itemsize + SETTINGS.itemsize) // 8  # doubles before what a restart makes zero
POSITIVE = (
    "tick_s", "position_gain_V_per_m", "voltage_max_V", "stroke_m", "area_ratio", "bulk_modulus_Pa", "reference_drop_Pa",
    "jerk_m_s3", "presliding_m_s", "damping_count", "window_s", "memory_windows", "engage_s", "feed_forward_s",
    "disengage_s", "damping_low_Hz", "damping_high_Hz", "spool_damping", "stribeck_velocity_m_s", "edge_V", "velocity_gain_m_s_V",
)  # fmt: skip
PLACES = tuple(SETTINGS.names.index(name) for name in POSITIVE)  # type: ignore[union-attr]
DAMPING_COUNT = SETTINGS.names.index("damping_count")  # type: ignore[union-attr]


@compiled
def refused_setting(settings):
    """0, or 1 + the place of the first number that is not finite or must be above zero. settings: (n,) doubles."""
    for i in range(len(settings)):
        if not math.isfinite(settings[i]):
            return 1 + i
    for i in range(len(PLACES)):
        if not settings[PLACES[i]] > 0.0:
            return 1 + PLACES[i]
    return 1 + DAMPING_COUNT if settings[DAMPING_COUNT] > MAX_DAMPING_TAPS else 0


@compiled
def start_guarded(numbers, whole, settings):
    """numbers: (SIZE,) doubles; whole: the record GUARDED in the same memory. As `refused_setting`: then nothing is done."""
    refused = refused_setting(settings)
    if refused:
        return refused
    for i in range(SIZE):
        numbers[i] = 0.0
    for i in range(len(settings)):
        numbers[KEPT - len(settings) + i] = settings[i]
    start_guard(whole.guard, whole.algorithm.settings)
    start(whole.algorithm)
    return 0


@compiled
def restart_guarded(numbers, whole):
    """Starts anew with `whole.learned`, as `Adaptive.resume`."""
    for i in range(KEPT, SIZE):
        numbers[i] = 0.0
    start(whole.algorithm)
    whole.learned.plain_control.baseline_m_s2[:] = 0.0  # in motion nothing is armed
    whole.learned.plain_control.reversal_m_s2[:] = 0.0
    restore(whole.algorithm, whole.learned)


@compiled
def tick_guarded(
    numbers, whole, table, preview, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, forward_V
):
    """Volts to add, and what the caller must know: DESIGN_WANTED | WORSE | REJECTED, or a fault of guard.py."""
    guard = whole.guard
    todo = check(guard, setpoint_m, preview, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa)
    if todo == ACTS:
        volts, told = tick_of(
            whole.algorithm, table, preview, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa,
            -forward_V,
        )  # fmt: skip
        volts = accept(guard, volts, forward_V, finite_from(numbers, ALGORITHM))
        return volts, guard.reason if guard.reason else told
    if todo == BEGINS_ANEW:
        for i in range(KEPT, SIZE):
            numbers[i] = 0.0
        start(whole.algorithm)
    elif todo == RESTARTS:
        keep(whole.algorithm, whole.learned)
        restart_guarded(numbers, whole)
    return guard.output_V, guard.reason
