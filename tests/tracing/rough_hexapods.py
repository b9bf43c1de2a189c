"""Rough hexapods of the second plant: nuisance effects, each leg's own, under one large effect in one leg or in the machine.

draw(seed) -> (effects, dominant, leg): what `other_plant.write_machine` takes; the large one's name, and its leg or None
"""

import numpy as np
from other_effects import EFFECTS
from rough_machines import INVERSE, SAME, SIGNED, SMALL, STRENGTH

MACHINE_WIDE = ("small_accelerometer_gain", "pump_ripple")
# of one leg, or of the machine
IN_A_LEG = (
    "leakage_supply_to_chamber", "leakage_chamber_to_tank", "leakage_clearance", "overlap", "null_offset", "null_drift",
    "unequal_ports", "valve_hysteresis", "valve_delay", "coulomb_friction", "viscous_friction", "seal_friction", "spring",
    "pressure_gain", "pressure_offset", "leg_differs",
)  # fmt: skip
IN_THE_MACHINE = ("supply_droop", "mass", "accelerometer_gain", "centre_of_mass")
DOMINANT = tuple(name for k in range(4) for name in (*IN_A_LEG[4 * k : 4 * k + 4], IN_THE_MACHINE[k]))


def draw(seed: int, dominant: str | None = "any") -> tuple[dict[str, float], str | None, int | None]:
    """Effects of a rough hexapod, "name@3" that of leg 3. dominant: a name, None for none, "any" for one in turn."""
    rng = np.random.default_rng([seed, 78])
    if dominant == "any":
        dominant = DOMINANT[seed % len(DOMINANT)]
    possible = [name for name in SMALL if name != SAME.get(dominant or "")]
    effects = {}
    for name in rng.choice(possible, size=int(rng.integers(4, 6)), replace=False):
        for leg in (None,) if name in MACHINE_WIDE else range(1, 7):
            size = rng.uniform(*SMALL[name]) * (rng.choice([-1.0, 1.0]) if name in SIGNED else 1.0)
            effects[str(name) if leg is None else f"{name}@{leg}"] = float(size)
    if dominant is None:
        return effects, None, None
    strength, leg = rng.uniform(*STRENGTH), int(rng.integers(1, 7)) if dominant in IN_A_LEG else None
    size = EFFECTS[dominant].size("hexapod")
    effects[dominant if leg is None else f"{dominant}@{leg}"] = float(
        size / strength if dominant in INVERSE else size * strength
    )
    return effects, dominant, leg
