"""States of the motion computer and the transitions between them.

    off ──start──▶ starting ──ready──▶ neutral ──run_manual──▶ manual
     ▲                │                 ▲ │ ▲ └──run_normal──▶ normal
     │                │   return_neutral┘ │ └────────────────────┘
     └──at_rest── settling ◀──settle──────┘  (also from starting, manual, normal)
     any moving state ──error──▶ fault ──reset (at rest)──▶ off

off        pump stopped, platform down on its stops.
starting   pump runs, supply pressure comes up, then the platform rises smoothly to neutral.
neutral    all actuators at mid stroke, or smoothly on the way there.
manual     the built-in signal generator moves the machine (DOF mode or actuator mode).
normal     the host moves the machine.
settling   smoothly down to the stops.
fault      an error is latched; the platform is braked, brought down smoothly and held there until the reset.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import IntEnum
from types import MappingProxyType

from hexsim.errors import HexsimError


class State(IntEnum):
    """Numbers as they stand in the host's reply."""

    OFF = 0
    STARTING = 1
    NEUTRAL = 2
    MANUAL = 3
    NORMAL = 4
    SETTLING = 5
    FAULT = 6


MOVING = (State.STARTING, State.NEUTRAL, State.MANUAL, State.NORMAL, State.SETTLING)

TRANSITIONS: Mapping[tuple[State, str], State] = MappingProxyType(
    {
        (State.OFF, "start"): State.STARTING,
        (State.STARTING, "ready"): State.NEUTRAL,
        (State.NEUTRAL, "run_manual"): State.MANUAL,
        (State.NEUTRAL, "run_normal"): State.NORMAL,
        (State.MANUAL, "return_neutral"): State.NEUTRAL,
        (State.NORMAL, "return_neutral"): State.NEUTRAL,
        (State.STARTING, "settle"): State.SETTLING,
        (State.NEUTRAL, "settle"): State.SETTLING,
        (State.MANUAL, "settle"): State.SETTLING,
        (State.NORMAL, "settle"): State.SETTLING,
        (State.SETTLING, "at_rest"): State.OFF,
        **{(state, "error"): State.FAULT for state in MOVING},
        (State.FAULT, "reset"): State.OFF,
    }
)
AUTOMATIC = ("at_rest", "error", "ready")  # no host can order them
EVENTS = tuple(sorted({event for _, event in TRANSITIONS}))


class StateMachine:
    """The present state; `event` moves it along `TRANSITIONS` and nowhere else.

    on_change(time_s, before, event, after) is called at each change.
    """

    def __init__(
        self,
        state: State = State.OFF,
        on_change: Callable[[float, State, str, State], None] = lambda time_s, before, event, after: None,
    ) -> None:
        self.state = state
        self.on_change = on_change

    def allows(self, event: str) -> bool:
        return (self.state, event) in TRANSITIONS

    def event(self, event: str, time_s: float = 0.0) -> State:
        """Take the transition. Raises HexsimError for one that is not in the table."""
        if not self.allows(event):
            possible = ", ".join(known for known in EVENTS if self.allows(known) and known not in AUTOMATIC)
            raise HexsimError(
                f"motion computer: {event!r} is not possible in state {self.state.name.lower()}; possible: {possible or 'none'}"
            )
        before, self.state = self.state, TRANSITIONS[self.state, event]
        self.on_change(time_s, before, event, self.state)
        return self.state
