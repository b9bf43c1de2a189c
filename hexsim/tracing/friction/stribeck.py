"""Friction against velocity with each direction's own numbers (Eq. 2.4), as the rows that a leg is simulated with."""

from __future__ import annotations

import numpy as np

from hexsim.compiled import compiled
from hexsim.declaration import Machine
from hexsim.hydraulics.leg import friction_force
from hexsim.hydraulics.parameters import P, declared_rows

Array = np.ndarray
KEYS = tuple(
    f"{kind}_{way}_{unit}"
    for way in ("extend", "retract")
    for kind, unit in (("viscous", "N_s_m"), ("coulomb", "N"), ("static", "N"), ("stribeck_velocity", "m_s"))
)
SLOTS = (
    P.VISCOUS_EXTEND,
    P.COULOMB_EXTEND,
    P.STATIC_EXTEND,
    None,
    P.VISCOUS_RETRACT,
    P.COULOMB_RETRACT,
    P.STATIC_RETRACT,
    None,
)


@compiled
def friction_of(rows, v, out):
    """Friction [N] of samples: row 0 while extending, row 1 while retracting."""
    for i in range(v.shape[0]):
        out[i] = friction_force(rows[0] if v[i] >= 0.0 else rows[1], 0.0, v[i], 0.0, 0.0)


def curve(rows: Array, v: Array) -> Array:
    out = np.empty(len(v))
    friction_of(rows, np.ascontiguousarray(v, dtype=float), out)
    return out


def row_with(machine: Machine, values: Array) -> Array:
    """Two rows of the machine (extending, retracting) with the eight values; each row has its own Stribeck velocity."""
    rows = np.repeat(declared_rows(machine)[:1], 2, axis=0)
    for slot, value in zip(SLOTS, values, strict=True):
        if slot is not None:
            rows[:, slot] = value
    rows[0, P.STRIBECK_VELOCITY], rows[1, P.STRIBECK_VELOCITY] = values[3], values[7]
    return rows
