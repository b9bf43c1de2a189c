"""What a machine cannot have: a logger's marker of an invalid sample, not a measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hexsim.declaration import ATMOSPHERE_Pa
from hexsim.machine import Machine
from hexsim.readers.clock_group import runs

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Limits:
    """low .. high: what the machine can have. margin: further outside nothing is a measurement."""

    low: float
    high: float
    margin: float


def possible_values(
    machine: Machine | None,
    *,
    beyond_share: float = 0.5,  # of a range, on either side of it: a transducer's zero may be off, its scale wrong; checks judge that
    surge: float = 2.5,  # of the supply pressure: oil that is stopped rises above it
    hardest_m_s2: float = 1e3,  # no platform: a hundred times that of gravity
) -> dict[str, Limits]:
    """Signal's stem -> its limits in SI units. Without a machine: of any machine."""
    pressures = ("pressure_bottom", "pressure_top", "pressure_supply")
    found = {stem: Limits(low=-ATMOSPHERE_Pa, high=np.inf, margin=ATMOSPHERE_Pa) for stem in pressures}
    found["acceleration"] = Limits(low=-hardest_m_s2, high=hardest_m_s2, margin=0.0)
    if machine is None:
        return found
    stroke, volts = max(machine.of_legs("cylinder", "stroke_m")), max(machine.of_legs("valve", "voltage_max_V"))
    for stem, low, high in (("position", 0.0, stroke), ("setpoint", 0.0, stroke), ("valve", -volts, volts)):
        found[stem] = Limits(low=low, high=high, margin=beyond_share * (high - low))
    highest = surge * machine.supply.pressure_Pa
    return found | {stem: Limits(low=-ATMOSPHERE_Pa, high=highest, margin=ATMOSPHERE_Pa) for stem in pressures}


def impossible(
    x: Array,
    limits: Limits,
    *,
    most_share: float = 0.5,  # share of samples: more of them are no markers but another unit or zero, which the checks name
    jump_share: float = 0.1,  # of the range: a marker is reached and left by more in one sample, a measurement is not
) -> Array:
    """Samples (n,) bool that the machine cannot have: far outside, or outside and reached and left by a jump. None where
    that is most of them."""
    found = (x < limits.low - limits.margin) | (x > limits.high + limits.margin)
    jump = jump_share * (limits.high - limits.low)
    for start, stop in zip(*runs((x < limits.low) | (x > limits.high)), strict=True):
        into = abs(x[start] - x[start - 1]) if start > 0 else np.inf
        out_of = abs(x[stop] - x[stop - 1]) if stop < len(x) else np.inf
        if min(into, out_of) > jump:
            found[start:stop] = True
    return found if found.mean() <= most_share else np.zeros(len(x), dtype=bool)


def marker(
    x: Array,
    *,
    far_spans: float = 3.0,  # spans of the rest: so far no signal jumps in a sample, and stays at one value
    most_markers: int = 3,  # values of a logger's markers, at most
) -> Array:
    """Samples (n,) bool of values that no machine of any size jumps to: few different ones, far from all others."""
    low, middle, high = np.quantile(x, [0.25, 0.5, 0.75])
    inner = x[(x >= low - 2.0 * (high - low)) & (x <= high + 2.0 * (high - low))]
    far = np.abs(x - middle) > far_spans * max(float(np.ptp(inner)), 1e-300)
    values, counts = np.unique(x[far], return_counts=True)
    few = 0 < len(values) <= most_markers and counts.max() > 1  # a value that stands once is a spike
    return far if few and np.ptp(inner) > 0 else np.zeros(len(x), dtype=bool)
