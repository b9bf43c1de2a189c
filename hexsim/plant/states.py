"""Where a plant keeps the states of legs and supply in MuJoCo's `act`: the layout behind each row of `actuator_user`.

The row is physics (`hydraulics.parameters.P`, `hydraulics.supply.S`), the layout is the plant's own. A leg's states stand
together, [spool, spool velocity, bristle, memory, rod side [MPa], bottom chamber [MPa]] as far as it has them; chambers as in
`hydraulics.chamber`. The supply's stand behind all legs.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from hexsim.hydraulics.parameters import N_PARAMETERS, P
from hexsim.hydraulics.resolved import Resolved
from hexsim.hydraulics.supply import N_STATES, S


class A(IntEnum):
    """Places in the layout of an actuator; -1 = no such state."""

    OWNER = 0  # LEG or SUPPLY; anything else is an actuator of another model
    SPOOL = 1  # first of two
    BRISTLE = 2
    ROD_SIDE = 3
    PRESSURE = 4  # last state of the actuator
    SUPPLY = 5  # of a leg: where Ps stands; of the supply: its first state
    MEMORY = 6  # of a learned term


LEG, SUPPLY = 6.0e6 + 61, 6.0e6 + 62  # no number that another model would keep in its user data by chance
ROW = N_PARAMETERS + len(A)  # width of `actuator_user`


def lay_out_states(resolved: Resolved) -> np.ndarray:
    """Layout (n_actuators, len(A)) of all legs, and of the supply where it has states.

    resolved: the machine with all effects that it will have; a state that has no rate yet stands still.
    """
    supply_states = N_STATES[int(resolved.supply[S.MODEL])]
    layout = np.full((len(resolved.rows) + (supply_states > 0), len(A)), -1.0)
    place = 0
    for leg, row in zip(layout, resolved.rows, strict=False):
        leg[A.OWNER] = LEG
        if row[P.SPOOL_OMEGA] > 0:
            leg[A.SPOOL], place = place, place + 2
        if row[P.BRISTLE_STIFFNESS] > 0:
            leg[A.BRISTLE], place = place, place + 1
        if row[P.LEARNED_MEMORY] > 0:
            leg[A.MEMORY], place = place, place + 1
        if row[P.ROD_SIDE_CHAMBER] > 0:
            leg[A.ROD_SIDE], place = place, place + 1
        leg[A.PRESSURE], place = place, place + 1
    if supply_states:
        layout[:-1, A.SUPPLY] = layout[-1, A.PRESSURE] = place + supply_states - 1
        layout[-1, A.OWNER], layout[-1, A.SUPPLY] = SUPPLY, place
    return layout


def actuator_rows(resolved: Resolved, layout: np.ndarray) -> np.ndarray:
    """Rows (n_actuators, ROW) for `actuator_user`: the legs' numbers and the supply's, each with its layout behind."""
    rows = np.zeros((len(layout), ROW))
    n = len(resolved.rows)
    rows[:n, :N_PARAMETERS] = resolved.rows
    rows[n:, : len(resolved.supply)] = resolved.supply
    rows[:, N_PARAMETERS:] = layout
    return rows
