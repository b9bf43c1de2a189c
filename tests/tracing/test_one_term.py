"""A term with two names, a hose or a dead volume: what is said of it, and that nothing tries to tell the two apart."""

from types import SimpleNamespace

import pytest

from hexsim.hydraulics import effects
from hexsim.identification import rounds
from hexsim.tracing import state
from hexsim.tracing.design import words
from hexsim.tracing.design.next_measurement import surviving
from hexsim.tracing.fitting import parameters
from hexsim.tracing.report import content, page, readings, tables


@pytest.fixture
def hose() -> state.NamedEffect:
    """3.0e-14 m3/Pa to 1 %, or 48 cm3 to 2 %; and tied with air, which is another term."""
    volume = state.Reading(
        candidate=parameters.named("dead_volume"), values={"volume_m3": 4.8e-5}, standard_errors={"volume_m3": 9.6e-7}
    )
    return state.NamedEffect(
        candidate=parameters.named("hose_compliance"), values={"compliance_m3_Pa": 3e-14},
        standard_errors={"compliance_m3_Pa": 3e-16}, tied_with=("dead_volume", "entrained_air"), gain_cv=0.5,
        blocks=4, d_bic=-10.0, single_leg=True, readings=(volume,),
    )  # fmt: skip


def test_what_is_known_is_said_under_both_names(hose) -> None:
    """The compliance, how well it is known, and both numbers with their errors; what to check on the machine for both. The other name
    stays in `tied_with`. An effect of one name has no such sentence."""
    entry = content.effect_entry(hose)
    said = readings.term_sentence(entry)
    assert said.startswith(
        "added compliance of the chamber, known to 1.0 %: a hose compliance of (3.000 ± 0.030)×10⁻¹⁴ m³/Pa"
    )
    assert "or a dead volume of 48.00 ± 0.96 cm³" in said
    assert entry["tied_with"] == ["dead_volume", "entrained_air"]
    assert entry["one_term_with"][0]["parameters"] == {"volume_m3": 4.8e-5}
    assert [name for name, _ in tables.checks_of(entry)] == ["hose_compliance", "dead_volume"]
    assert readings.names_of(entry) == ["hose compliance", "dead volume"]
    assert [name for name, _ in tables.effect_rows({"effects": [entry]})[0]["values"]] == [
        "compliance",
        "or, as dead volume: volume",
    ]
    assert "48.0 cm³" in page.effect_words(hose)
    assert readings.term_sentence(entry | {"one_term_with": []}) == ""


def test_only_effects_with_the_same_term_have_two_names() -> None:
    """A hose and a dead volume; an incline and a constant force, alike at one load, are two: another load takes them apart."""
    assert effects.effect_named("hose_compliance").term == effects.effect_named("dead_volume").term != ""
    assert effects.effect_named("incline").term == effects.effect_named("constant_force").term == ""


def test_a_design_does_not_try_to_tell_two_names_apart(hose) -> None:
    """The other name is no hypothesis, air stays one. The first line says so beside what the motion is for; alone where all is
    known."""
    trace = SimpleNamespace(
        verdict="explained", rest=(), predicted=(), effects=[hose], final="hose", search=None,
        ties=[{"dead_volume": "volume", "entrained_air": "air"}],
    )  # fmt: skip
    assert surviving(trace) == [("hose_compliance", "hose"), ("entrained_air", "air")]
    term = "no motion separates hose_compliance, dead_volume; they are one term, that no log takes apart"
    assert words.beside_one_term("to know it better", [hose]) == f"to know it better; {term}"
    assert words.beside_one_term(f"{words.ALL_KNOWN}: nothing is left", [hose]) == f"{term}: look at the machine"
    assert words.beside_one_term("to know it better", []) == "to know it better"


def test_two_names_are_nothing_left_open(hose) -> None:
    """An identification goes on for the air, not for the dead volume."""
    trace = SimpleNamespace(verdict="explained", predicted=(), effects=[hose])
    assert rounds.open_points(trace) == ["hose_compliance or entrained_air"]
