"""States of the motion computer: the table of transitions is the whole of what can happen."""

from itertools import product

import pytest

from hexsim import HexsimError
from hexsim.motion_computer import states


def test_only_the_table_is_legal() -> None:
    """Every pair of state and event either leads where the table says or is refused, and then nothing changes."""
    refused = 0
    for state, event in product(states.State, states.EVENTS):
        machine = states.StateMachine(state)
        if (state, event) in states.TRANSITIONS:
            assert machine.event(event) == states.TRANSITIONS[state, event] == machine.state
        else:
            refused += 1
            with pytest.raises(HexsimError, match=f"'{event}' is not possible in state {state.name.lower()}"):
                machine.event(event)
            assert machine.state == state
    assert refused == len(states.State) * len(states.EVENTS) - len(states.TRANSITIONS)


def test_the_table_cannot_be_changed() -> None:
    """The table is frozen: no part of the program can add a way out of fault."""
    with pytest.raises(TypeError):
        states.TRANSITIONS[states.State.FAULT, "start"] = states.State.STARTING  # type: ignore[index]


def test_every_state_is_reached_and_left() -> None:
    """No state is a dead end, and all but off are reached from off."""
    reached, frontier = {states.State.OFF}, [states.State.OFF]
    while frontier:
        state = frontier.pop()
        for (before, _), after in states.TRANSITIONS.items():
            if before == state and after not in reached:
                reached.add(after)
                frontier.append(after)
    assert reached == set(states.State)
    assert {before for before, _ in states.TRANSITIONS} == set(states.State)


def test_an_error_leads_to_fault_from_every_moving_state() -> None:
    """Whatever moves can fail; fault is left only by a reset, to off."""
    assert all(states.TRANSITIONS[state, "error"] == states.State.FAULT for state in states.MOVING)
    assert [
        (event, after) for (before, event), after in states.TRANSITIONS.items() if before == states.State.FAULT
    ] == [("reset", states.State.OFF)]


def test_each_change_is_heard() -> None:
    """The listener gets time, before, event and after of each change, and of nothing else."""
    heard = []
    machine = states.StateMachine(states.State.OFF, lambda *change: heard.append(change))
    machine.event("start", 1.5)
    with pytest.raises(HexsimError):
        machine.event("start", 2.0)
    assert heard == [(1.5, states.State.OFF, "start", states.State.STARTING)]
