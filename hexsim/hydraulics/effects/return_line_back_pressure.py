"""Return line: the tank edge works against R q, the pressure that its own flow raises."""

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="return_line_back_pressure",
    balance="continuity",
    description="the return line has a laminar resistance that raises the pressure behind the valve's tank edge",
    source="Merritt 1967; 1 bar at 10 l/min",
    parameters=(
        EffectParameter(
            name="line_resistance_Pa_s_m3",
            unit="Pa s/m3",
            bounds=(0.0, 1e12),
            typical=1.0e9,
            slot=P.RETURN_RESISTANCE,
        ),
    ),
)
