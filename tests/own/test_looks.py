"""Formulas looked at to first order: by their values along the motion, and as they are written in a model."""

import numpy as np
import pytest

from hexsim.inference.likelihood import fit
from hexsim.inference.remainder import theta_of
from hexsim.own import looks
from tests.own.test_own_names import machine


def answers(parts, about):
    """title and start -> slopes of the machine's output by each amplitude of the formula."""
    found = {}
    for problem, offered in parts:
        theta, names = theta_of(problem, about), [number.name for number in problem.numbers]
        slopes = np.concatenate(problem.slopes(theta, range(len(problem.stretches))))[:, 0]
        for form, amplitude in offered:
            found[form.title, form.candidate.shape] = slopes[:, [names.index(name) for name in amplitude]]
    return found


@pytest.mark.parametrize("chosen", ["Coulomb friction", "lag of a drive"])
def test_values_along_the_motion_answer_as_the_formula_in_a_model_does(tmp_path, chosen):
    """At a sum and at an output, with a held input, beside friction that holds at rest or a memory: slopes are the same at an output to
    rounding, at a sum within 6 % of their size, and within 15 % where a sign turns within a sample of 40 ms."""
    drive = machine(tmp_path, steps=8, place_damping=0.5)
    plain = fit(drive.problem(()))
    effect = next(one for one in drive.offers((), plain, False) if one.name == chosen)
    problem = drive.problem([effect])
    now = fit(problem)
    every = [form for form in drive.forms([effect], now) if "forwards" not in form.candidate.formulas]
    every = [form for form in every if form.candidate.what != "input"][::5]
    by_place = {place: [one for one in every if one.candidate.place == place] for place in ("sum v", "output x")}
    assert all(len(forms) > 3 for forms in by_place.values())
    declared = drive.declared([effect])
    for forms in by_place.values():
        along = answers(looks.as_columns(drive.folder, drive.columns, declared, forms, now), now)
        written = answers(looks.as_written(drive.folder, drive.columns, declared, forms), now)
        assert along.keys() == written.keys()
        off = [np.linalg.norm(along[key] - written[key]) / np.linalg.norm(written[key]) for key in written]
        jumps = np.array(["sign(" in title or "abs(" in title for title, _ in written])
        off = np.array(off)
        if forms[0].candidate.what == "output":
            assert max(off) < 1e-12
        assert off[~jumps].max() < 0.06
        assert off[jumps].max() < 0.15
