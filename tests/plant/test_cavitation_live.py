"""A machine that runs without an end says what cavitated as a run does, once an event."""

import numpy as np

from hexsim import load_scenario, web
from hexsim.hydraulics.parameters import P
from hexsim.machine import load_machine
from hexsim.simulation import live as live_machine
from hexsim.simulation import run_warnings, serve

PULL_N = 5e3  # tears the bench's piston from its oil


def pulled(plant, tick_s, advance, pulls_s, until_s):
    """Advance tick by tick with the pull on for 50 ms from each of `pulls_s`."""
    for k in range(round(until_s / tick_s)):
        on = any(start <= k * tick_s < start + 0.05 for start in pulls_s)
        plant.change_row(0, P.EXTRA_FORCE, PULL_N if on else 0.0)
        advance()


def test_live_says_it_in_a_runs_sentence():
    """The only sentence is the one that `run` makes of the same states."""
    states = []

    def note(live):
        states.append((live.plant.piston_positions().copy(), live.data.act.copy()))

    live = live_machine.LiveMachine(load_machine("bench"), observe=note)
    note(live)
    pulled(live.plant, live.tick_s, lambda: live.advance(live.tick_s), [0.1], 1.6)
    positions, act = (np.array(values) for values in zip(*states, strict=True))
    wanted = run_warnings.cavitation_warnings(live.plant, live.tick_s / live.steps_a_tick, positions, act)
    assert len(wanted) == 1 and list(live.cavitation.told) == wanted
    assert "bottom chamber cavitated" in wanted[0]


def test_a_void_that_is_open_at_the_end_is_said():
    """The machine begins anew, or stops, while the piston hangs in a void: one sentence each, with the void as it was; none twice."""
    live = live_machine.LiveMachine(load_machine("bench"))
    for _ in range(2):
        pulled(live.plant, live.tick_s, lambda: live.advance(live.tick_s), [0.1], 0.15)
        assert live.cavitation.unsaid() == []
        live.plant.change_row(0, P.EXTRA_FORCE, 0.0)
        live.reset()
        [said] = live.cavitation.unsaid()
        assert "bottom chamber cavitated once at 0.1" in said and live.cavitation.unsaid() == []


def test_the_page_says_it_as_it_closes():
    """A session that stops with a void open gives its sentence to whoever closed it, after those that it gave before."""
    session = web.Session(load_machine("bench"), load_scenario("heave"))
    pulled(session.live.plant, session.live.tick_s, lambda: session.live.advance(session.live.tick_s), [0.1, 2.1], 2.15)
    assert len(session.new_warnings()) == 1
    session.stop()
    [last] = session.new_warnings()
    assert "cavitated" in last and " at 2." in last and session.new_warnings() == []


def test_serve_says_each_event_once():
    """Two pulls two seconds apart are two sentences in the status, the second one only once the run ends; none is said twice."""
    with serve.Server(load_machine("bench"), port=0) as server:
        pulled(server.plant, server.tick_s, server.tick, [0.1, 2.1], 2.5)
        assert server.cavitation.count == 1
        said = server.cavitation.since(0)
        status = server.run(duration_s=server.tick_s)
    assert status.cavitated == 2 and status.warnings[0] == said[0]
    [second] = status.new_warnings(1)
    assert "cavitated" in second and " at 2." in second and status.new_warnings(2) == []
    assert " at 0." in said[0]
