"""How smooth a motion is: the figures of the field, from arrays of time and acceleration.

Half-hertz noise after AGARD-AR-144 (drive one degree of freedom with a sine, see what else is in the acceleration),
reversal bumps (`reversals`), describing function, turn-around check, parasitic motion, and the `axes` of a
run's summary. Every figure names its band: the same run can read 2.3 m/s2 raw and 0.58 m/s2 in 50 Hz. Raw means the
record as it is, sampled as it is; a sensor's noise is in all of it.

Units: functions return the unit of the acceleration they are given (m/s2 or rad/s2).
"""

from hexsim.smoothness.band import BANDWIDTH_Hz, band_limit, inner_span_s
from hexsim.smoothness.harmonic import (
    HalfHertzNoise,
    HarmonicDeviation,
    describing_function,
    frequency_below,
    half_hertz_noise,
    harmonic_deviation,
)
from hexsim.smoothness.reversals import (
    CommandDeviation,
    Reversal,
    ReversalBump,
    ReversalPeak,
    deviation_from_command,
    peaks_at_reversals,
    response_delay_s,
    reversal_bumps,
    reversals_of_velocity,
)
from hexsim.smoothness.summary import AxisMotion, TurnAround, parasitic, summary_axes, turn_around_check

__all__ = [
    "AxisMotion",
    "BANDWIDTH_Hz",
    "CommandDeviation",
    "HalfHertzNoise",
    "HarmonicDeviation",
    "Reversal",
    "ReversalBump",
    "ReversalPeak",
    "TurnAround",
    "band_limit",
    "describing_function",
    "deviation_from_command",
    "frequency_below",
    "half_hertz_noise",
    "harmonic_deviation",
    "inner_span_s",
    "parasitic",
    "peaks_at_reversals",
    "response_delay_s",
    "reversal_bumps",
    "reversals_of_velocity",
    "summary_axes",
    "turn_around_check",
]
