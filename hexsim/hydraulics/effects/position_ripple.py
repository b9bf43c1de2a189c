"""The scale of a position transducer errs from line to line: it reads y + A sin(2 pi y/L + phase). A controller reads it too.

L is the pitch of the reading: beside a position gain g the wave is L/g long on the machine (`hydraulics.resolve`)."""

from __future__ import annotations

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
    """One wave in the scale of these legs; amplitudes of several of one pitch add up."""
    own = list(legs)
    resolved.position_ripple[own, 0] += values["amplitude_m"]
    resolved.position_ripple[own, 1:] = values["pitch_m"], values["phase_rad"]


EFFECT = Effect(
    name="position_ripple",
    balance="sensor",
    description="the scale of the position transducer has a cyclic error: a wave along the stroke",
    source="interpolation errors of scales: 0.1-2 % of the pitch; pitches of 0.2-10 mm",
    parameters=(
        EffectParameter(name="amplitude_m", unit="m", bounds=(-1e-3, 1e-3), typical=2.0e-5),
        EffectParameter(name="pitch_m", unit="m", bounds=(1e-4, 0.02), typical=1.0e-3, default=1.0e-3, step_share=0.03),
        EffectParameter(name="phase_rad", unit="rad", bounds=(-6.3, 6.3), typical=0.0, default=0.0),
    ),
    apply=apply,
)
