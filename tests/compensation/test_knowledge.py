"""What a compensator says that it knows of its leg: values, errors, and the bump that is expected."""

import math

import pytest
from leg_plant import Leg, run

import compensation


@pytest.fixture(scope="module")
def leg():
    """A leg of a plant apart with a worn spool edge of 60 mV and 50 kg, 12 s of motion with `adaptive`."""
    made = compensation.create("adaptive")
    record = run(made, Leg(overlap_m=6.6e-6, mass_kg=50.0), duration_s=12.0)
    return made, record.state


def test_values_are_the_legs_within_their_errors(leg) -> None:
    """Edges of 60 mV, a spool of 60 Hz with damping 0.7 (2 zeta/w = 3.71 ms): within four standard errors, and these are a tenth of
    what they were before any motion."""
    made, state = leg
    known = {one.name: one for one in made.knows(state).estimates}
    for name, value in (("edge, extending", 60.0), ("edge, retracting", 60.0), ("valve lag", 3.71)):
        one = known[name]
        assert abs(one.value - value) < 4.0 * one.error, one
        assert 0.0 < one.error < 0.1 * one.before, one
    assert known["hysteresis, half width"].value < 1.0  # mV; it has none


def test_what_is_expected_is_what_engages_it(leg) -> None:
    """Plain control's bump and what is expected instead are bumps of this leg, some tenths of m/s2 and less; it is engaged, for the
    expectation is below the limit that is stated."""
    known = leg[0].knows(leg[1])
    assert 0.2 < known.plain_m_s2 < 1.5
    assert 0.0 < known.expected_m_s2 < known.engages_m_s2
    assert known.share == 1.0


def test_nothing_is_known_before_motion_and_by_plain_control(leg) -> None:
    """A fresh state, and an algorithm without a model."""
    assert leg[0].knows(leg[0].start(compensation.Context())) is None
    plain = compensation.create("none")
    assert plain.knows(plain.start(compensation.Context())) is None


def test_the_page_shows_each_leg_with_bars(leg) -> None:
    """A column a leg, a leg that knows nothing yet as such, values with two digits of their error; nothing known: a sentence."""
    knowledge_table = pytest.importorskip("hexsim.web.knowledge", reason="needs hexsim[web]").knowledge_table
    known = leg[0].knows(leg[1])
    page = knowledge_table([known, None])
    assert page.count("<th") == 3 and page.count("…") == 4 + len(known.estimates)
    edge = known.estimates[0]
    places = max(1 - math.floor(math.log10(edge.error)), 0)
    assert f"{edge.value:.{places}f}" in page and f"±{edge.error:.{places}f}" in page
    assert "No leg says yet" in knowledge_table([None]) and "No leg says yet" in knowledge_table([])
