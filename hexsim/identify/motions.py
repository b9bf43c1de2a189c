"""A scenario as setpoints of a host's packets."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.identify.host import PERIOD_s
from hexsim.scenarios.scenario import DOF_NAMES, scenario_from_dict

Array = NDArray[np.float64]


def setpoints_of(machine: Machine, tables: dict[str, Any]) -> Array:
    """A scenario as setpoints (m, 6) of packets that begin and end at neutral; a bench moves in z."""
    scenario = scenario_from_dict(tables)
    time = np.arange(0.0, scenario.duration_s, PERIOD_s)
    values = scenario.evaluate(time)[0]
    if not machine.is_hexapod:
        along = np.zeros_like(values)
        along[:, DOF_NAMES.index("z")] = values[:, 0]
        values = along
    left = np.clip((scenario.duration_s - time) / scenario.fade_s, 0.0, 1.0) if scenario.fade_s else np.ones(len(time))
    return values * (left**3 * (10.0 - 15.0 * left + 6.0 * left**2))[:, None]
