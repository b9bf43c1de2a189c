"""Presliding: friction reverses over a travel of the piston, not at once (Dahl, bristles), identified from reversals.

    s' = (S - s) |v| / L,     friction at a reversal = s (half step + Stribeck pressure)

S is the sign of the velocity, L the length of the bristles, Coulomb force over their stiffness: 60 um at 1e6 N/m. With
L = 0 friction follows the sign. L is found at compensated reversals from the friction that is measured,

    f = P~ + step - p1 y~''

P~ and y~ being pressure and position less their demands, step what was demanded. It is projected on smooth functions
phi_k over parts of the reversal; the second derivative goes over to them. For each L of a bank, the Stribeck pressure
and a constant are fitted, and what is left is summed over the reversals: a negative log-likelihood. Without clear
evidence L is 0. With N the mean square that the best L leaves, over its noise, the evidence, 2 log-likelihood ratio / N, must
exceed

    10 + 2 N^2,     60 at most

Other causes (a delay not found yet, soft oil, a slow spool) look like bristles as well, and they leave much: N is 6 and more.
"""

from __future__ import annotations

import math

import numpy as np

from ..arithmetic import copy, push
from ..compiled import compiled
from .layout import LENGTHS, REACH

LENGTHS_M = 1e-6 * np.array([0.0, 6.0, 8.0, 11.0, 15.0, 20.0, 28.0, 38.0, 52.0, 71.0, 98.0, 135.0])  # (LENGTHS,)
CENTRES, HALF_WIDTH = (-10, -6, -2, 2, 6, 10), 6  # ticks, of phi_k about the reversal
MEMORY = 0.93  # of the sums, a reversal
EVIDENCE, EVIDENCE_MISFIT, MOST_EVIDENCE = 10.0, 2.0, 60.0  # from which there are bristles: see above
MISFIT = 10.0  # times the noise that the best L may leave: more is another cause, such as load from the other legs (40 to 170)
USUAL_NOISE_PA = 4e3  # of the pressures of the legs on which other causes were seen
LEAST_WEIGHT = 7.5  # of the sums: two reversals


def _test_functions() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """phi_k and their second differences (K, 2 REACH + 1), newest first; the constant's projection, of unit length."""
    t = np.arange(REACH + 1, -REACH - 2, -1.0)
    x = (t - np.array(CENTRES)[:, None]) / HALF_WIDTH
    phi = np.where(np.abs(x) < 1.0, np.cos(0.5 * np.pi * np.clip(x, -1, 1)) ** 4, 0.0)
    constant = phi.sum(axis=1)
    return phi[:, 1:-1].copy(), np.diff(phi, 2, axis=1), constant / np.linalg.norm(constant)


PHI, PHI_SECOND, CONSTANT = _test_functions()
ROUGHNESS, SIZE = float(np.linalg.norm(PHI_SECOND[0])), float(np.linalg.norm(PHI[0]))


@compiled
def bristle(before, sign, travel_m, length_m):
    """s after a travel, for the sign that it goes to."""
    if length_m == 0.0:
        return sign
    return sign + (before - sign) * math.exp(-travel_m / length_m)


@compiled
def add_to_presliding(p, sign, travel_m, stribeck_share, step_Pa):
    """One tick: what was demanded of now: sign and travel of the velocity, Stribeck share at it, pressure step."""
    push(p.sign, sign)
    push(p.travel_m, travel_m)
    push(p.share, stribeck_share)
    push(p.step_Pa, step_Pa)


@compiled
def update_presliding(p, deviation_Pa, position_error_m, inertia_Pa, half_step_Pa, tick_s):
    """The reversal in the histories corrects the sums of the bank, and L."""
    count, noise = len(CENTRES), math.hypot(inertia_Pa * p.noise_m * ROUGHNESS / tick_s**2, p.noise_Pa * SIZE)
    for i in range(LENGTHS):
        s = p.sign[2 * REACH]
        for k in range(count):
            p.missing[k] = p.profile[k] = 0.0
        for j in range(2 * REACH, -1, -1):
            s = bristle(s, p.sign[j], p.travel_m[j], LENGTHS_M[i])
            f = deviation_Pa[j] + p.step_Pa[j] - half_step_Pa * s
            late = inertia_Pa * position_error_m[j] / tick_s**2
            for k in range(count):
                p.missing[k] += (PHI[k, j] * f - PHI_SECOND[k, j] * late) / noise
                p.profile[k] += PHI[k, j] * s * p.share[j] / noise
        _without_constant(p.missing, count)
        _without_constant(p.profile, count)
        p.squares[i] *= MEMORY
        p.products[i] *= MEMORY
        p.shapes[i] *= MEMORY
        for k in range(count):
            p.squares[i] += p.missing[k] * p.missing[k]
            p.products[i] += p.missing[k] * p.profile[k]
            p.shapes[i] += p.profile[k] * p.profile[k]
    p.weight = MEMORY * p.weight + count - 2.0
    p.length_m = _length_m(p, 2.0 * half_step_Pa)


@compiled
def keep_presliding(p, known):
    """What was identified, in numbers."""
    copy(p.squares, known.squares)
    copy(p.products, known.products)
    copy(p.shapes, known.shapes)
    known.weight = p.weight


@compiled
def restore_presliding(p, known, half_step_Pa):
    """Start with what was identified before."""
    copy(known.squares, p.squares)
    copy(known.products, p.products)
    copy(known.shapes, p.shapes)
    p.weight = known.weight
    p.length_m = _length_m(p, 2.0 * half_step_Pa)


@compiled
def _without_constant(projected, count):
    along = 0.0
    for k in range(count):
        along += CONSTANT[k] * projected[k]
    for k in range(count):
        projected[k] -= along * CONSTANT[k]


@compiled
def _length_m(p, highest_Pa):
    """Mean of L by its likelihood; 0 without evidence, and where no L fits."""
    least = math.inf
    for i in range(LENGTHS):
        best = min(max(p.products[i] / max(p.shapes[i], 1e-12), 0.0), highest_Pa)
        p.left[i] = p.squares[i] - 2.0 * best * p.products[i] + best * best * p.shapes[i]
        least = min(least, p.left[i])
    scale = max(1.0, least / p.weight)
    misfit = 1.0 + (scale - 1.0) * (p.noise_Pa / USUAL_NOISE_PA) ** 2  # what is no noise does not shrink as noise grows
    needed = min(EVIDENCE + EVIDENCE_MISFIT * misfit * misfit, MOST_EVIDENCE)
    if p.weight < LEAST_WEIGHT or misfit > MISFIT or p.left[0] - least < needed * scale:
        return 0.0
    total = length = 0.0
    for i in range(LENGTHS):
        weight = math.exp(-0.5 * (p.left[i] - least) / scale)
        total += weight
        length += weight * LENGTHS_M[i]
    return length / total
