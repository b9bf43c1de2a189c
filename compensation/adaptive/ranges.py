"""What a learned number may be: bounds that the estimators keep themselves to, or that the data sheet sets.

`refused_parameter` is compiled, so that a library without Python refuses what Python refuses.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import compiled
from ..records import Record, kinds
from .delay import MAX_SUM, MEMORY
from .edge_rounding import MAX_ROUNDING_V, PAIR
from .friction import MAX_HALF_STEP_MPA, MIN_WINDOWS
from .layout import LEARNED
from .leak import MAX_LEAK_M_S
from .spool import LAG_MAX_S
from .valve_edge import MAX_BACKLASH_V, MAX_DEAD_BAND_V, MAX_GAIN, MIN_GAIN

UNREADY = 1e3  # of a fit that is not ready and acts on nothing: the size of its prior at most
MOST = 1e9  # of sums and counts, which weigh and do not act
ROUGH = 1e-6  # relative, of a square that sums were rounded in
MAX_UNDERLAP_V = 0.5  # of an edge of a four-way valve
MAX_BUMP_M_S2 = 1e3
HALF_STEPS = 2.0  # Stribeck pressure over the half step, MAX_HALF_STEP_MPA


def _names(layout: np.dtype, before: str = "") -> list[str]:
    """Place of each double by name, as in JSON."""
    found: list[str] = []
    for name in layout.names or ():
        inner = layout[name]
        if inner.names:
            found += _names(inner, f"{before}{name}.")
        else:
            count = len(kinds(inner))
            found += [f"{before}{name}"] if inner.shape == () else [f"{before}{name}[{i}]" for i in range(count)]
    return found


NAMES = _names(LEARNED)
BOUNDS = {  # by the last part of a name, or the whole; lowest and highest
    "null_V": (-MAX_DEAD_BAND_V, MAX_DEAD_BAND_V), "leak_m_s": (-MAX_LEAK_M_S, MAX_LEAK_M_S), "windows": (0.0, MOST), "ready": (0.0, 1.0),
    "gain_m_s_V": (MIN_GAIN, MAX_GAIN), "dead_band_V": (-MAX_UNDERLAP_V, MAX_DEAD_BAND_V), "backlash_V": (0.0, MAX_BACKLASH_V),
    "lag_s": (0.0, LAG_MAX_S), "theta": (-UNREADY, UNREADY), "theta_backlash": (-UNREADY, UNREADY),
    "rounding_V": (0.0, PAIR * MAX_ROUNDING_V), "theta_MPa": (-UNREADY, UNREADY), "half_step_Pa": (0.0, 1e6 * MAX_HALF_STEP_MPA),
    "stribeck_Pa": (0.0, HALF_STEPS * 1e6 * MAX_HALF_STEP_MPA), "sums": (0.0, MAX_SUM / (1.0 - MEMORY) + MAX_SUM),
    "reversals": (0.0, MOST),
    "late_s": (0.0, LAG_MAX_S), "told_s": (0.0, LAG_MAX_S), "oil": (-1e18, 1e18), "squares": (0.0, MOST), "shapes": (0.0, MOST),
    "products": (-MOST, MOST), "weight": (0.0, MOST), "baseline_m_s2": (0.0, MAX_BUMP_M_S2), "reversal_m_s2": (0.0, MAX_BUMP_M_S2),
    "follows_V": (0.0, MAX_BUMP_M_S2),
}  # fmt: skip
LOWEST, HIGHEST = (np.array([BOUNDS[n.split("[")[0].split(".")[-1]][side] for n in NAMES]) for side in range(2))
EDGES = tuple(NAMES.index(f"flow.{edge}.theta[0]") for edge in ("retract", "extend"))
READY, DEAD_BAND, GAIN = (NAMES.index(f"flow.retract.{n}") - EDGES[0] for n in ("ready", "dead_band_V", "gain_m_s_V"))
THETA_MPA, WINDOWS = NAMES.index("friction.theta_MPa[0]"), NAMES.index("friction.windows[0]")
SQUARES, PRODUCTS, SHAPES = (NAMES.index(f"presliding.{name}[0]") for name in ("squares", "products", "shapes"))
OIL, TOLD = NAMES.index("delay.oil[0]"), NAMES.index("delay.told_s[0]")
LENGTHS = sum(name.startswith("presliding.squares") for name in NAMES)
GAIN_TOLERANCE = 0.5  # of an edge that is ready: gain that is in use over the fit's; it is read from it


@compiled
def refused_parameter(known, settings):
    """0, or 1 + the place of the first number out of its range, or that contradicts another one. known: (n,) doubles of LEARNED;
    settings: a record SETTINGS."""
    for i in range(len(LOWEST)):
        if not LOWEST[i] <= known[i] <= HIGHEST[i]:  # nor a NaN
            return 1 + i
    for first in EDGES:
        if known[first + READY] != 0.0:
            k = known[first]
            if not MIN_GAIN <= k <= MAX_GAIN:
                return 1 + first
            if abs(k - known[first + GAIN]) > GAIN_TOLERANCE * k:
                return 1 + first + GAIN
        if settings.rod_ratio == 0.0 and known[first + DEAD_BAND] < 0.0:
            return 1 + first + DEAD_BAND
    supply_MPa = 1e-6 * settings.supply_pressure_Pa
    known_friction = min(known[WINDOWS], known[WINDOWS + 1]) >= MIN_WINDOWS
    for i in range(
        6 if known_friction else 0
    ):  # MPa: a load, or one at 1 m/s2, 1 dm/s or 1 dm, that the supply pressure holds
        if abs(known[THETA_MPA + i]) > supply_MPa:
            return 1 + THETA_MPA + i
    if known[OIL] < 0.0:
        return 1 + OIL
    for i in range(LENGTHS):
        if known[PRODUCTS + i] ** 2 > (1.0 + ROUGH) * known[SQUARES + i] * known[SHAPES + i] + ROUGH:
            return 1 + PRODUCTS + i
    return 1 + TOLD + 1 if known[TOLD + 1] > known[TOLD] else 0


def refusal(known: Record, settings: Record) -> str:
    """The same in words; empty where nothing is refused."""
    numbers = np.frombuffer(known.tobytes(), np.float64)
    place = refused_parameter(numbers, settings) - 1
    if place < 0:
        return ""
    name, value, low, high = NAMES[place], numbers[place], LOWEST[place], HIGHEST[place]
    if not low <= value <= high:
        return f"{name} is {value:g}; it must lie within {low:g} and {high:g}"
    if place in EDGES:
        return f"{name} is {value:g}; of an edge that is ready it is a gain, within {MIN_GAIN:g} and {MAX_GAIN:g} m/s/V"
    if name.endswith("gain_m_s_V"):
        return f"{name} is {value:g}; the fit that it was read from has {numbers[place - GAIN]:g} m/s/V"
    if name.endswith("dead_band_V"):
        return f"{name} is {value:g}; a three-way valve has no negative overlap"
    if name.startswith("friction"):
        limit = 1e-6 * settings.supply_pressure_Pa
        return f"{name} is {value:g}; the supply pressure holds no load beyond {limit:g} MPa"
    if name.startswith("presliding"):
        return f"{name} is {value:g}; with its square and its shape it is no positive covariance"
    if math.isclose(value, 0.0) or value < 0.0:
        return f"{name} is {value:g}; a square cannot be negative"
    return f"{name} is {value:g}; a position's share of a delay cannot be longer than the delay, {numbers[TOLD]:g} s"
