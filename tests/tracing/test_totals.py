"""What an effect makes together with the declared parameters that it adds to: the sum that the logs know, said beside the change."""

from pathlib import Path

import numpy as np
import pytest

from hexsim.hydraulics import effects
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import load_machine
from hexsim.tracing import state
from hexsim.tracing.design import words
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.fitting import parameters
from hexsim.tracing.fitting.fitted_numbers import totals_of
from hexsim.tracing.report import content, readings
from hexsim.tracing.report import tables as report_tables

BENCH = Path(__file__).parents[1] / "data" / "bench_none"
VISCOUS = parameters.named("viscous_friction_change")
ADDING = [effect for effect in effects.library().values() if effect.parameters and effect.parameters[0].adds_to]


def fitted(own: parameters.Candidate, sd: float, correlation: float) -> least_squares.Fit:
    """The bench with 177 N s/m more than declared in both directions. sd: of each declared friction, in half widths of 12 %; the
    effect's error is that of the mean of both, and each sum is off by what the correlation leaves."""
    machine = load_machine(BENCH)
    own_priors = tuple(prior for prior in parameters.priors(machine) if prior.key.startswith("viscous"))
    slopes = np.array([*(prior.half_width * prior.declared for prior in own_priors), 800.0])
    values = np.array([264.0, 216.0, 240.0]) * sd  # errors of the three numbers [N s/m]
    matrix = np.array([[1.0, 0.0, correlation], [0.0, 1.0, correlation], [correlation, correlation, 1.0]])
    return least_squares.Fit(
        machine=machine, priors=own_priors, deviations=np.zeros(2), candidates=(own,),
        values=({"viscous_N_s_m": 177.0},), chi2=0.0, n=0, misfit=[],
        covariance=matrix * (values / slopes) * (values / slopes)[:, None],
    )  # fmt: skip


def effect_of(fit: least_squares.Fit) -> state.NamedEffect:
    return state.NamedEffect(
        candidate=fit.candidates[0], values=fit.values[0], standard_errors=fit.standard_errors()[0], tied_with=(),
        gain_cv=0.5, blocks=4, d_bic=-10.0, single_leg=True,
    )  # fmt: skip


def test_errors_that_cancel_leave_the_sum_sharp() -> None:
    """var(a + b) = var a + var b + 2 cov: of 264 and 240 N s/m 504 with a correlation of 1, 24 of -1, and sqrt(264^2 + 240^2)
    of 0. The sums are the declared 2200 and 1800 N s/m with 177 more."""
    extend, retract = totals_of(fitted(VISCOUS, 1.0, -1.0), VISCOUS)
    assert (extend.key, retract.key) == ("viscous_extend_N_s_m", "viscous_retract_N_s_m")
    assert (extend.value, retract.value) == (pytest.approx(2377.0), pytest.approx(1977.0))
    assert extend.standard_error == pytest.approx(24.0, rel=1e-6)
    assert extend.adds == pytest.approx(240.0)
    assert totals_of(fitted(VISCOUS, 1.0, 1.0), VISCOUS)[0].standard_error == pytest.approx(504.0, rel=1e-6)
    assert totals_of(fitted(VISCOUS, 1.0, 0.0), VISCOUS)[0].standard_error == pytest.approx(np.hypot(264.0, 240.0))


def test_the_report_says_the_sum_where_it_is_known_better() -> None:
    """A change of 177 +- 240 N s/m: the sums, their errors and the declared values stand beside it, in report.json, the page's
    row and the sentence of the console. A sum that is known no better than the change is not said."""
    fit = fitted(VISCOUS, 1.0, -1.0)
    entry = content.effect_entry(effect_of(fit)) | {"in_all": content.total_entries(effect_of(fit), fit)}
    said = readings.total_sentence(entry)
    assert said.startswith("viscous extend 2377 ± 24 N·s/m and viscous retract 1977 ± 24 N·s/m in all")
    assert "what is declared (2200 N·s/m to 12 %, 1800 N·s/m to 12 %) and the viscous friction change together" in said
    assert report_tables.effect_rows({"effects": [entry]})[0]["total"] == said
    loose = fitted(VISCOUS, 1.0, 0.0)
    assert not any(own["known_better"] for own in content.total_entries(effect_of(loose), loose))
    assert (
        readings.total_sentence(
            content.effect_entry(effect_of(loose)) | {"in_all": content.total_entries(effect_of(loose), loose)}
        )
        == ""
    )


def test_a_design_says_the_sum_that_is_known() -> None:
    """Where no motion tells the change better: the sums. Where a motion does, the first line stays as it is."""
    totals = totals_of(fitted(VISCOUS, 1.0, -1.0), VISCOUS)
    said = words.with_the_sums("no motion tells viscous_N_s_m better than 52 %", totals)
    assert "; with what is declared it is known: viscous_extend_N_s_m 2377 +- 24 and " in said
    assert words.with_the_sums("to know viscous_N_s_m better", totals) == "to know viscous_N_s_m better"


def test_a_second_effect_of_the_name_has_no_sum_of_its_own() -> None:
    """All legs and one leg besides: in that leg three numbers add up, and none of the two effects makes the sum alone."""
    fit = fitted(VISCOUS, 1.0, -1.0)
    twice = least_squares.Fit(**(vars(fit) | {"candidates": (VISCOUS, parameters.named("viscous_friction_change", "leg 1")),
                                "values": fit.values * 2, "covariance": np.eye(4)}))  # fmt: skip
    assert totals_of(twice, VISCOUS) == []


@pytest.mark.parametrize("effect", ADDING, ids=lambda effect: effect.name)
def test_what_is_said_to_add_does_add(effect) -> None:
    """The machine with the effect's typical size is the machine whose declared parameters are larger by it, row by row."""
    machine = load_machine(BENCH)
    size = effect.parameters[0]
    tables = machine.model_dump(exclude_none=True)
    there = 0
    for table in (own for name, own in tables.items() if isinstance(own, dict) and name != "uncertainty"):
        for key in set(size.adds_to) & set(table):
            table[key], there = table[key] + size.typical, there + 1
    assert there > 0
    declared = resolve(type(machine).model_validate(tables))
    added = resolve(
        parameters.with_settings(machine, {}, [(parameters.Candidate(effect=effect), {size.name: size.typical})])
    )
    assert added.rows == pytest.approx(declared.rows, rel=1e-12)
    assert added.load.moving_mass_kg == pytest.approx(declared.load.moving_mass_kg)
