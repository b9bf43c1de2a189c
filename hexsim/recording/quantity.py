"""SI values as engineers read them: 253 µm, 70.4 bar, 2.4000 ± 0.0008 ×10⁹ Pa·s/m³."""

from __future__ import annotations

import math

from hexsim.recording.summary_table import NOTHING, number
from hexsim.signals.units import UNITS

MM, BAR, L_MIN, DEG = (
    1.0 / UNITS[unit][0] for unit in ("mm", "bar", "l_min", "deg")
)  # what engineers read, per SI unit
# SI unit: (least size in SI, SI size of one, name), the largest first; the last one also serves what is smaller
SCALES: dict[str, tuple[tuple[float, float, str], ...]] = {
    "m": ((0.5, 1.0, "m"), (1e-3, 1e-3, "mm"), (1e-7, 1e-6, "µm"), (0.0, 1e-9, "nm")),
    "m/s": ((0.5, 1.0, "m/s"), (0.0, 1e-3, "mm/s")),
    "m3": ((1e-3, 1e-3, "l"), (0.0, 1e-6, "cm³")),
    "m3/s": ((1e-6, 1e-3 / 60, "l/min"), (0.0, 1e-9, "mm³/s")),
    "s": ((0.5, 1.0, "s"), (1e-3, 1e-3, "ms"), (0.0, 1e-6, "µs")),
    "Pa": ((1e8, 1e6, "MPa"), (1e4, 1e5, "bar"), (0.0, 1e2, "mbar")),
    "V": ((0.5, 1.0, "V"), (1e-3, 1e-3, "mV"), (0.0, 1e-6, "µV")),
    "V/s": ((0.5, 1.0, "V/s"), (1e-3, 1e-3, "mV/s"), (0.0, 1e-6, "µV/s")),
    "rad": ((0.05, 1.0, "rad"), (0.0, 1e-3, "mrad")),
    "N": ((1e4, 1e3, "kN"), (0.0, 1.0, "N")),
    "1": ((0.1, 1.0, ""), (0.0, 1e-2, "%")),
}
SPELLED = {
    "m/s2": "m/s²",
    "rad/s2": "rad/s²",
    "m2": "m²",
    "m3": "m³",
    "kg m2": "kg·m²",
    "N s/m": "N·s/m",
    "N m": "N·m",
    "Pa s/m3": "Pa·s/m³",
    "m3/Pa": "m³/Pa",
    "m3/s/Pa": "m³/(s·Pa)",
    "m3/s": "m³/s",
    "N, N m": "N or N·m",
}
# endings of keys and columns, the longest first
ENDINGS = {
    "_m3_s_Pa": "m3/s/Pa",
    "_Pa_s_m3": "Pa s/m3",
    "_V_per_m": "V/m",
    "_m3_Pa": "m3/Pa",
    "_N_s_m": "N s/m",
    "_rad_s2": "rad/s2",
    "_kg_m2": "kg m2",
    "_m3_s": "m3/s",
    "_m_s2": "m/s2",
    "_N_Pa": "N/Pa",
    "_N_m": "N/m",
    "_V_s": "V/s",
    "_m_s": "m/s",
    "_rad": "rad",
    "_m2": "m2",
    "_m3": "m3",
    "_Pa": "Pa",
    "_Hz": "Hz",
    "_kg": "kg",
    "_m": "m",
    "_s": "s",
    "_V": "V",
    "_N": "N",
}
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def split_key(key: str) -> tuple[str, str]:
    """Words and unit of a key or column: ("viscous extend", "N s/m"); the unit is "1" where the key has none."""
    ending = next((ending for ending in ENDINGS if key.endswith(ending)), "")
    return key.removesuffix(ending).replace("_", " "), ENDINGS.get(ending, "1")


def spelled(unit: str) -> str:
    """A unit with its powers raised; nothing for a ratio."""
    return "" if unit == "1" else SPELLED.get(unit, unit)


def scale_of(size: float, unit: str) -> tuple[float, str]:
    """(SI size of one, name) of the unit in which a value of this size is read, a power of ten where it has no name."""
    size = abs(size)
    if unit in SCALES:
        return next((one, name) for least, one, name in SCALES[unit] if size >= least)
    power = math.floor(math.log10(size)) if size > 0 and math.isfinite(size) else 0
    if -3 <= power < 5:
        return 1.0, spelled(unit)
    return 10.0**power, f"×10{str(power).translate(RAISED)} {spelled(unit)}".rstrip()


def quantity(value: float | None, unit: str, digits: int = 3, beside: float | None = None) -> str:
    """A value with its unit; in the unit in which the value `beside` it is read, if given: what is compared has one unit."""
    if value is None or not math.isfinite(value):
        return NOTHING
    one, name = scale_of(value if beside is None else beside, unit)
    return joined(plain(value / one, digits), name)


def with_error(value: float | None, error: float | None, unit: str) -> str:
    """A value and its standard error to the error's second place, at most six places of the value."""
    if value is None or error is None or not (math.isfinite(value) and math.isfinite(error)) or error <= 0:
        return quantity(value, unit, 4)
    one, name = scale_of(max(abs(value), error), unit)
    value, error = value / one, error / one
    decimals = max(0, 1 - math.floor(math.log10(error)))
    most = max(0, 5 - math.floor(math.log10(abs(value)))) if value else decimals
    decimals = min(decimals, most)
    least = 10.0**-decimals
    shown = f"± {error:.{decimals}f}" if error >= 0.5 * least else f"± <{least:.{decimals}f}"
    both = f"{minus(f'{value:.{decimals}f}')} {shown}"
    return joined(f"({both})" if name.startswith("×") else both, name)


def joined(number: str, unit: str) -> str:
    """A space before a unit, none before a power of ten."""
    return f"{number}{'' if unit.startswith('×') else ' '}{unit}".rstrip()


def plain(value: float | None, digits: int = 3) -> str:
    """A number to so many places, with a minus sign and a raised power where it needs one."""
    mantissa, _, power = number(value, digits).partition("e")
    return minus(mantissa + (f"×10{str(int(power)).translate(RAISED)}" if power else ""))


def share(value: float | None) -> str:
    """A share as whole per cent; what is below one half is said to be below one."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if 0.0 < value < 0.005:
        return "<1 %"
    return minus(f"{100 * value:.0f} %") if value > 0.0 else "0 %"


def minus(text: str) -> str:
    """A minus sign in place of a hyphen."""
    return text.replace("-", "−") if text != NOTHING else text
