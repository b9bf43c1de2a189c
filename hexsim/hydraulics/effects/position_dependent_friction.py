"""Friction varies along the stroke: Coulomb force + F sin(2 pi y/L + phase)."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """One wave in the Coulomb force."""
    rows = resolved.rows
    rows[list(legs), P.RIPPLE_FORCE] = values["amplitude_N"]
    rows[list(legs), P.RIPPLE_LENGTH] = values["wavelength_m"]
    rows[list(legs), P.RIPPLE_PHASE] = values["phase_rad"]


EFFECT = Effect(
    name="position_dependent_friction",
    balance="force",
    description="friction varies with the piston's position",
    source="bore and rod straightness: waves of 10-100 mm",
    parameters=(
        EffectParameter(name="amplitude_N", unit="N", bounds=(-1e6, 1e6), typical=20.0),
        EffectParameter(
            name="wavelength_m",
            unit="m",
            bounds=(1e-3, 10.0),
            typical=0.05,
            default=0.05,
        ),
        EffectParameter(
            name="phase_rad",
            unit="rad",
            bounds=(-6.3, 6.3),
            typical=0.0,
            default=0.0,
            grid=(0.0, 1.5707963),
        ),
    ),
    apply=apply,
    once=True,
)
