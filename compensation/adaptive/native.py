"""The adaptive algorithm for native code."""

from __future__ import annotations

from ..compiled import compiled
from ..damping_design import MAX_DAMPING_TAPS
from ..native import Native
from ..prediction import prediction_table
from .adaptive import Adaptive, AdaptiveState
from .layout import LEARNED, SETTINGS, STATE
from .learned import as_dict, fill
from .ranges import refused_parameter
from .start import finite_from, keep, restore, start
from .step import expect, hear, tick_of
from .taps import design


@compiled
def start_given(s, own, given):
    """s: a record STATE of zeros; own (n,): its doubles, the settings first; given (n,): of SETTINGS."""
    for i in range(len(given)):
        own[i] = given[i]
    start(s)


@compiled
def tick_given(
    s, inputs, table, preview, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, forward_V
):
    """`expect` and `tick_of` with the loads of inputs."""
    expect(s, inputs.loads_m_s2[: inputs.loads])
    return tick_of(
        s, table, preview, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, 0.0 - forward_V
    )


@compiled
def is_finite(s, own):
    """Whether the doubles of a state are; own (n,)."""
    return finite_from(own, 0)


@compiled
def forget(learned):
    """As `Adaptive.resume`: in motion nothing is armed."""
    learned.plain_control.baseline_m_s2[:] = 0.0
    learned.plain_control.reversal_m_s2[:] = 0.0


@compiled
def refused(known, whole):
    """As `refused_parameter`."""
    return refused_parameter(known, whole.algorithm.settings)


NATIVE = Native(
    algorithm=Adaptive, state_of=AdaptiveState, settings=SETTINGS, learned=LEARNED, state=STATE, table=prediction_table,
    positive=(
        "tick_s", "position_gain_V_per_m", "voltage_max_V", "stroke_m", "area_ratio", "bulk_modulus_Pa", "reference_drop_Pa",
        "jerk_m_s3", "presliding_m_s", "damping_count", "window_s", "memory_windows", "engage_s", "feed_forward_s", "disengage_s",
        "damping_low_Hz", "damping_high_Hz", "spool_damping", "stribeck_velocity_m_s", "edge_V", "velocity_gain_m_s_V",
    ),
    ranges={"damping_count": (0.0, MAX_DAMPING_TAPS)}, start=start_given, tick=tick_given, finite=is_finite, hear=hear, keep=keep,
    forget=forget, restore=restore, refused=refused, design=design, as_dict=as_dict, fill=fill,
)  # fmt: skip
