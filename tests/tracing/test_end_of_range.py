"""Numbers that a fit could not follow further: what the report, the console and the page say in the place of an error."""

import math

import pytest

from hexsim.cli.trace import print_trace
from hexsim.hydraulics import effects
from hexsim.tracing import state
from hexsim.tracing.fitting import parameters
from hexsim.tracing.report import content, tables
from hexsim.tracing.report import readings as said


def effect(name: str, values: dict[str, float], errors: dict[str, float], readings: tuple[state.Reading, ...] = ()):
    return state.NamedEffect(
        candidate=parameters.named(name), values=values, standard_errors=errors, tied_with=(), gain_cv=0.5, blocks=4,
        d_bic=-10.0, single_leg=True, readings=readings,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("frequency_Hz", "key", "words"),
    [
        (2000.0, "at_bound", "the upper end of its range"),  # a limit of the spool's speed alone, and no lag beside it
        (2.0, "at_bound", "the lower end of its range"),
        # where it began: the declared spool has a frequency of its own
        (250.0, "unmoved", "nothing in these logs depends on it"),
    ],
)
def test_a_number_without_an_error_is_not_said_to_have_none(frequency_Hz, key, words, tmp_path, capsys) -> None:
    """At an end of its range, or where nothing in the logs moves with it, a number has no error: report.json, the page
    and the console say so, and nothing prints it as exact. The number beside it keeps its error, and so do the old keys."""
    errors = {"rate_m_s": 1e-5, "frequency_Hz": 0.0}
    entry = content.effect_entry(effect("spool_rate_limit", {"rate_m_s": 5e-4, "frequency_Hz": frequency_Hz}, errors))
    assert entry["parameters"] == {"rate_m_s": 5e-4, "frequency_Hz": frequency_Hz}
    assert entry["standard_error"] == errors
    assert "frequency_Hz" in entry[key]
    assert "rate_m_s" not in entry["at_bound"] and "rate_m_s" not in entry["unmoved"]
    rate, frequency = (value for _, value in tables.effect_rows({"effects": [entry]})[0]["values"])
    assert words in frequency and "±" not in frequency
    assert "±" in rate
    print_trace({"verdict": "partly", "effects": [entry]}, tmp_path)
    printed = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert words in printed
    assert "± 0" not in printed
    assert "0.0005 ± 1e-05" in printed


def test_an_error_at_the_end_of_a_range_is_no_error() -> None:
    """A fit that stands at a bound gives an error as well: of how the number would move inside. It is not said; of a term
    with two names the error of the name that is inside its range counts."""
    hose = state.Reading(
        candidate=parameters.named("dead_volume"), values={"volume_m3": 4.8e-5}, standard_errors={"volume_m3": 9.6e-7}
    )
    told = effect("hose_compliance", {"compliance_m3_Pa": 1e-9}, {"compliance_m3_Pa": 1e-13}, (hose,))
    entry = content.effect_entry(told)
    assert entry["at_bound"] == {"compliance_m3_Pa": "upper"}
    assert entry["one_term_with"][0]["at_bound"] == {}
    assert "known to 2.0 %" in said.term_sentence(entry)
    assert "1.00×10⁻⁹ m³/Pa, the upper end of its range" in said.term_sentence(entry)


def test_what_the_file_means_has_no_range() -> None:
    """Whether the declared friction is that of the cold machine is 0 or 1: no end of anything."""
    numbers = {"share_at_start": 0.25, "time_constant_s": 8.0, "declared_cold": 1.0}
    entry = content.effect_entry(effect("friction_warm_up", numbers, dict.fromkeys(numbers, 0.1)))
    assert entry["at_bound"] == {}


def test_no_effect_begins_at_an_end_of_its_range() -> None:
    """A typical number of the library is no bound; what vanishes at 0 and cannot be negative is at its lower end there."""
    for own in effects.library().values():
        for number in own.parameters:
            if number.typical and math.isfinite(number.typical):
                assert parameters.end_of_range(number, number.typical) == "", (own.name, number.name)
    assert parameters.end_of_range(effects.effect_named("entrained_air").parameters[0], 0.0) == "lower"
