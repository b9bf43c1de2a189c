"""An own compensation algorithm in a few lines: add the dead band's half width, in the direction the setpoint moves.

Run it on the machine, beside plain control and the project's own:

    PYTHONPATH=examples hexsim run heave --compensator none,own_compensator:SetpointDirection,adaptive
    PYTHONPATH=examples hexsim run heave --compensator own_compensator:SetpointDirection

An installed package makes it known by name with an entry point in its pyproject.toml:

    [project.entry-points."hexsim.compensators"]
    setpoint_direction = "own_compensator:SetpointDirection"
"""

from __future__ import annotations

from dataclasses import dataclass

from compensation import Compensator, Context, Parameters, Sample


@dataclass
class State:
    """What the algorithm carries from tick to tick; here, how far it has faded in."""

    context: Context
    gain: float = 0.0


@dataclass(frozen=True, kw_only=True)
class SetpointDirection(Compensator):
    """u_c = half_width_V on the side to which the setpoint moves `preview_s` from now, softly over `soft_m_s`."""

    name: str = "setpoint_direction"
    preview_s: float = 0.004
    half_width_V: float = 0.045
    soft_m_s: float = 0.002

    def start(self, context: Context) -> State:
        return State(context)

    def step(self, state: State, sample: Sample) -> tuple[float, State]:
        ahead = sample.preview_m
        velocity = float(ahead[-1] - ahead[-2]) * state.context.rate_Hz
        side = max(-1.0, min(1.0, velocity / self.soft_m_s))
        state.gain = min(1.0, state.gain + state.context.tick_s)  # one second
        return state.gain * side * self.half_width_V, state

    def parameters(self, state: State) -> Parameters:
        return {"half_width_V": self.half_width_V}

    def restore(self, context: Context, parameters: Parameters) -> State:
        return self.start(context)
