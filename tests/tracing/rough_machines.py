"""Rough machines of the second plant: five or six nuisance effects that no model holds, under one large effect or none.

draw(seed)                 -> (effects, dominant): what `other_plant.write_machine` takes, and the large one's name
number_of(dominant, size)  -> the size as the library's effect states it
"""

import numpy as np
from other_effects import EFFECTS

# nuisance effect -> its range; those without a sign of their own get one at random
SMALL = {
    "scale_ripple": (2e-6, 4e-6),
    "small_spool_lag": (120.0, 180.0),
    "small_accelerometer_gain": (0.002, 0.005),
    "small_position_delay": (0.2, 0.5),
    "friction_warm_up": (0.04, 0.08),
    "small_seal_friction": (1e-6, 2e-6),
    "small_air": (0.002, 0.004),
    "small_null_offset": (0.003, 0.006),
    "small_null_drift": (2e-4, 4e-4),
    "worn_bore": (1e-13, 3e-13),
    "small_return_line": (2e7, 8e7),
    "pump_ripple": (5e3, 15e3),
    "small_unequal_ports": (0.002, 0.005),
    "hardening_spring": (3e4, 1e5),
    "small_friction_of_position": (2.0, 6.0),
}
SIGNED = ("small_accelerometer_gain", "small_null_offset", "small_null_drift", "small_unequal_ports")
DECLARED_MASS_KG = 40.0
STRENGTH = (0.8, 1.5)  # of the large effect, in typical sizes
SAME = {  # a nuisance effect that is the same thing as the large effect
    "spool_lag": "small_spool_lag",
    "spool_rate_limit": "small_spool_lag",
    "accelerometer_gain": "small_accelerometer_gain",
    "position_delay": "small_position_delay",
    "seal_friction": "small_seal_friction",
    "entrained_air": "small_air",
    "null_offset": "small_null_offset",
    "null_drift": "small_null_drift",
    "return_line": "small_return_line",
    "unequal_ports": "small_unequal_ports",
    "friction_of_position": "small_friction_of_position",
}
DOMINANT = tuple(name for name, e in EFFECTS.items() if e.in_library and "bench" in e.kinds and name not in SMALL)


def draw(seed: int, dominant: str | None = "any") -> tuple[dict[str, float], str | None]:
    """Effects of a rough bench. dominant: a name, None for a machine without, "any" for one in turn."""
    rng = np.random.default_rng([seed, 77])
    if dominant == "any":
        dominant = DOMINANT[seed % len(DOMINANT)]
    possible = [name for name in SMALL if name != SAME.get(dominant or "")]
    chosen = rng.choice(possible, size=int(rng.integers(5, 7)), replace=False)
    effects = {}
    for name in chosen:
        size = rng.uniform(*SMALL[name])
        effects[str(name)] = float(size * (rng.choice([-1.0, 1.0]) if name in SIGNED else 1.0))
    if dominant is not None:
        strength = rng.uniform(*STRENGTH)
        size = EFFECTS[dominant].typical
        effects[dominant] = float(size / strength if dominant in INVERSE else size * strength)
    return effects, dominant


INVERSE = ("spool_lag", "spool_rate_limit", "pump_limit", "presliding", "supply_accumulator")


def number_of(dominant: str, size: float) -> float:
    """First number of the library's effect for this size of the second plant's."""
    if dominant == "valve_delay":
        return int(size) * 1e-3  # the second plant delays by whole milliseconds
    if EFFECTS[dominant].unit == "ms":
        return size * 1e-3
    if dominant in ("mass", "flexible_payload"):
        return size * DECLARED_MASS_KG
    if dominant == "unequal_ports":
        return (1.0 - size) / (1.0 + size) - 1.0
    return -size if dominant == "underlap" else size
