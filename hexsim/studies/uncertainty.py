"""Machines as they may be built: the declared one with its [uncertainty] drawn. The motion computer keeps the declared one.

Relative widths act on the numbers of the file. Joints and leg zero offsets are off in the built machine alone, as the effects
`base_joint_offset`, `platform_joint_offset` and `leg_zero_offset`: what the motion computer does not know.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hexsim.declaration.machine import LENGTHS
from hexsim.machine import Machine
from hexsim.machine.files import number_at

EFFECTS = {
    "base_joints_m": ("base_joint_offset", ("x_m", "y_m", "z_m")),
    "platform_joints_m": ("platform_joint_offset", ("x_m", "y_m", "z_m")),
    "leg_zero_offsets_m": ("leg_zero_offset", ("length_m",)),
}


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
    for key, (name, parameters) in EFFECTS.items():
        if width := widths.get(key, 0.0):
            own = machine.effects.get(name, [])
            tables = [
                {"where": f"leg {leg}"} | {one: width * random.uniform(-1.0, 1.0) for one in parameters}
                for leg in range(1, machine.n_legs + 1)
            ]
            settings[f"effects.{name}"] = [*(own if isinstance(own, list) else [own]), *tables]
    return settings
