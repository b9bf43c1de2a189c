"""The algorithm for native code."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compensator import MOST_LEGS, Context
from ..compiled import compiled, in_its_caller
from ..guard import TELLS
from ..native import Native
from ..prediction import prediction_table
from ..records import record
from .adaptive import Adaptive, AdaptiveState
from .layout import SETTINGS, STATE
from .learned import LEARNED, PRIOR, as_dict, fill, keep, refused_number, restore
from .leg import NAMES
from .legs import is_finite, tells
from .step import hear_leg, start, tick_of

NUMBERS = SETTINGS.names or ()
GIVEN = record(
    **dict.fromkeys(NUMBERS, "f8"), spool_damping="f8", position_noise_m="f8", position_resolution_m="f8", mobility=("f8", (MOST_LEGS,))
)  # fmt: skip
LEG, ALL_LEGS, MOBILITY = NUMBERS.index("leg"), NUMBERS.index("legs"), GIVEN.fields["mobility"][1] // 8  # type: ignore[index]
assert (len(NUMBERS) - 2, len(NUMBERS) - 1) == (LEG, ALL_LEGS)


@compiled
def start_given(s, own, given):
    """s: a record STATE of zeros; own (n,): its doubles, the settings first; given (n,): of GIVEN."""
    for i in range(LEG):
        own[i] = given[i]
    s.settings.leg, s.settings.legs = int(given[LEG]), int(given[ALL_LEGS])
    for i in range(MOST_LEGS):
        s.mobility[i] = given[MOBILITY + i]
    start(s)


@in_its_caller
def tick_given(
    s, inputs, table, preview, setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, forward_V
):
    """`tick_of` with inputs."""
    n = inputs.legs
    volts = tick_of(
        s, table, preview, inputs.loads_m_s2[: inputs.loads], inputs.pose_m_s2, inputs.mobility[:n], inputs.forces_N[:n],
        inputs.speeds_m_s[:n], setpoint_m, position_m, control_V, valve_V, bottom_Pa, top_Pa, supply_Pa, forward_V,
    )  # fmt: skip
    return volts, TELLS if tells(s) else 0


@compiled
def finite(s, own):
    """As `is_finite`."""
    return is_finite(s)


@compiled
def forget(learned):
    """What is known holds in motion too."""
    return


@compiled
def refused(known, whole):
    """As `refused_number`."""
    return refused_number(known, whole.algorithm.settings, whole.prior)


def state_of(context: Context, states: np.ndarray, told: int) -> Any:
    """The state around states (1,)."""
    return AdaptiveState(context, states)


NATIVE = Native(
    algorithm=Adaptive, state_of=state_of, settings=GIVEN, learned=LEARNED, state=STATE, space={"prior": PRIOR}, table=prediction_table,
    positive=(
        "tick_s", "position_gain_V_per_m", "voltage_max_V", "stroke_m", "area_bottom_m2", "area_top_m2", "supply_pressure_Pa",
        "bulk_modulus_Pa", "stribeck_velocity_m_s", "edge_V", "velocity_gain_m_s_V", "own_mobility", "load_over_weight",
        "spool_damping",
    ),
    ranges={"leg": (0.0, MOST_LEGS - 1.0), "legs": (0.0, MOST_LEGS)}, start=start_given, tick=tick_given, finite=finite, hear=hear_leg,
    keep=keep, forget=forget, restore=restore, refused=refused, as_dict=as_dict, fill=fill, names={"numbers": NAMES, "scale": NAMES},
)  # fmt: skip
