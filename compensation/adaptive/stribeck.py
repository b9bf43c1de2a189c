"""Stribeck friction near rest, identified from reversals.

The friction that the model lacks is, with P~ and y~ pressure and position less the demanded ones (Eq. 3.8),

    f = P~ - p1 y~''

It is projected on a smooth odd function phi over the reversal, which vanishes with its slope at both ends. The second
derivative goes over to phi, so that no measurement is differentiated (weak form):

    sum phi f = sum phi P~ - p1 sum phi'' y~,      driven to 0:  P_s += rate * (sum phi f) / (sum phi share)

P_s is the Stribeck pressure, `share` the signed share of it that was demanded at each tick. What is even or slow in
time drops out.
"""

from __future__ import annotations

import math

import numpy as np

from ..arithmetic import clip, dot, push
from ..compiled import compiled
from .layout import REACH

MIN_RATE = 0.1  # of the correction taken up at a reversal, from the tenth on
REVERSAL_MODEL_PA, MAX_KNOWN = (
    1e4,
    4.0,
)  # error of P_s from one reversal beside noise; reversals that windows count for at most
USUAL_PROJECTION, MOST_WEIGHT = 3.6, 5.0  # sum phi share [1] at 0.5 m/s2; a slower reversal tells P_s better
MIN_PROJECTION = 1.5  # sum phi share [1] below which a reversal is too quick to tell
MAX_PROJECTION = 0.95  # of that at rest, above which nothing has moved
MOST_MISSING = 3.0  # standard errors: more is not friction


def _test_function() -> tuple[np.ndarray, np.ndarray]:
    """phi and its second difference a tick squared, (2 REACH + 1,) each, newest first (the sign is the direction's)."""
    x = np.arange(-REACH - 1, REACH + 2) / (REACH + 1)
    phi = -np.sin(np.pi * x) * np.cos(0.5 * np.pi * x) ** 2
    return phi[1:-1].copy(), np.diff(phi, 2)


PHI, PHI_SECOND = _test_function()
AT_REST = float(np.abs(PHI).sum())
ROUGHNESS, SIZE = float(np.linalg.norm(PHI_SECOND)), float(np.linalg.norm(PHI))


@compiled
def add_to_stribeck(stribeck, velocity_m_s, deviation_Pa, position_error_m, share):
    """One tick: demanded velocity, pressure and position less the demanded ones, demanded share of P_s.

    True when a reversal lies in the middle of the history.
    """
    push(stribeck.deviation_Pa, deviation_Pa)
    push(stribeck.position_error_m, position_error_m)
    push(stribeck.share, share)
    if velocity_m_s * stribeck.direction < 0.0:
        stribeck.ticks = 0
    if velocity_m_s != 0.0:
        stribeck.direction = velocity_m_s
    stribeck.ticks += 1
    return stribeck.ticks == REACH + 1


@compiled
def begin_stribeck(stribeck, pressure_Pa, error_Pa, highest_Pa):
    """Before a reversal was seen: P_s that windows of slow motion tell, less its standard error. It counts for as many
    reversals as it is surer than one."""
    if stribeck.reversals == 0:
        stribeck.pressure_Pa = min(max(pressure_Pa - error_Pa, 0.0), highest_Pa)
        stribeck.known = min((REVERSAL_MODEL_PA / error_Pa) ** 2, MAX_KNOWN)


@compiled
def hold_step(stribeck, change_Pa, highest_Pa):
    """The half step was found anew, by windows: what reversals told is how much both are together."""
    stribeck.pressure_Pa = clip(stribeck.pressure_Pa - stribeck.at_rest * change_Pa, 0.0, highest_Pa)


@compiled
def _reversal_error_Pa(stribeck, inertia_Pa, projected):
    """Standard error of P_s from one reversal: what else is not modelled there, the position's noise and the pressure's."""
    position_Pa = inertia_Pa * stribeck.noise_m * ROUGHNESS / stribeck.tick_s**2
    return math.hypot(REVERSAL_MODEL_PA, math.hypot(position_Pa, SIZE * stribeck.noise_Pa) / projected)


@compiled
def update_stribeck(stribeck, inertia_Pa, highest_Pa):
    """The reversal in the history corrects P_s; `inertia_Pa` is p1, pressure per m/s2."""
    count = 2 * REACH + 1
    projected = dot(PHI, stribeck.share, count)
    if not MIN_PROJECTION < abs(projected) < MAX_PROJECTION * AT_REST:
        return
    missing = dot(PHI, stribeck.deviation_Pa, count)
    missing -= inertia_Pa * dot(PHI_SECOND, stribeck.position_error_m, count) / stribeck.tick_s**2
    stribeck.reversals, stribeck.at_rest = stribeck.reversals + 1, AT_REST / abs(projected)
    error_Pa, off_Pa = missing / projected, _reversal_error_Pa(stribeck, inertia_Pa, projected)
    weight = clip((projected / USUAL_PROJECTION) ** 2, 1.0, max(stribeck.most_weight, 1.0))
    rate = weight / (weight - 1.0 + stribeck.reversals + stribeck.known)
    if rate < MIN_RATE * weight:  # known already
        rate = MIN_RATE * weight
        error_Pa = clip(error_Pa, -MOST_MISSING * off_Pa, MOST_MISSING * off_Pa)
    stribeck.pressure_Pa += rate * error_Pa
    stribeck.pressure_Pa = min(max(stribeck.pressure_Pa, 0.0), highest_Pa)
