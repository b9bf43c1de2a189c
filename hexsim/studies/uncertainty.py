"""Machines as they may be built: the declared one with its [uncertainty] drawn. The motion computer keeps the declared one.

Relative widths act on the numbers of the file. Joints and leg zero offsets are off in the built machine alone, as the effects
`joint_displacement` and `leg_zero_offset`: what the motion computer does not know.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hexsim.declaration.machine import LENGTHS
from hexsim.machine import Machine
from hexsim.machine.files import number_at

ENDS = {"base_joints_m": "base", "platform_joints_m": "platform"}


def drawn(machine: Machine, seed: int) -> dict[str, Any]:
    """Settings (dotted key -> value) of one machine within the widths, uniform; the same for the same seed.

    Raises HexsimError for a key of [uncertainty] that is nowhere.
    """
    random = np.random.default_rng([seed, 7])
    widths, settings = machine.uncertainty, {}
    for key, width in widths.items():
        if key in LENGTHS or width == 0.0:
            continue
        dotted, value = number_at(machine, key)
        settings[dotted] = float(value * (1.0 + width * random.uniform(-1.0, 1.0)))
    if not machine.is_hexapod:
        return settings
    moved, longer = [], []
    for leg in range(1, machine.n_legs + 1):
        by = {
            f"{end}_{axis}_m": widths.get(key, 0.0) * random.uniform(-1.0, 1.0)
            for key, end in ENDS.items()
            for axis in "xyz"
        }
        moved.append({"where": f"leg {leg}"} | by)
        longer.append({"where": f"leg {leg}", "offset_m": widths.get(LENGTHS[2], 0.0) * random.uniform(-1.0, 1.0)})
    effects: dict[str, list[dict[str, Any]]] = {}
    if any(widths.get(key, 0.0) for key in ENDS):
        effects["joint_displacement"] = moved
    if widths.get(LENGTHS[2], 0.0):
        effects["leg_zero_offset"] = longer
    for name, tables in effects.items():
        own = machine.effects.get(name, [])
        settings[f"effects.{name}"] = [*(own if isinstance(own, list) else [own]), *tables]
    return settings
