"""The one inference on linear problems of numpy: honest errors under a coloured residual, names by held-out motion, stand-ins seen."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.inference import contract, verdict
from hexsim.inference.held_out import held_out
from hexsim.inference.likelihood import fit
from hexsim.inference.search import search
from hexsim.inference.spectrum import spectrum_of

N, RUNS = 600, 4


class Linear:
    """model less measured = x theta - y, runs of one channel."""

    def __init__(self, names, x, y, prior=None):
        self.channels, self.noises, self.x, self.y = ("y",), (np.nan,), x, y
        known = prior or {}
        self.numbers = [
            contract.Number(
                name=name, start=0.0, scale=1.0, mean=known.get(name, (np.nan,))[0], sd=known.get(name, (0, np.nan))[1]
            )
            for name in names
        ]
        self.stretches = [
            contract.Stretch(name=f"run{k}", group=f"part {k}", dt=0.01, weight=np.ones((len(one), 1)))
            for k, one in enumerate(y)
        ]

    def residuals(self, theta, at):
        return [(self.x[k] @ theta - self.y[k])[:, None] for k in at]

    def slopes(self, theta, at):
        return [self.x[k][:, None, :] for k in at]


def coloured(rng, n=N, pole=0.98):
    """First-order noise of unit size."""
    e, y = rng.standard_normal(n), np.zeros(n)
    for k in range(1, n):
        y[k] = pole * y[k - 1] + np.sqrt(1 - pole**2) * e[k]
    return y


def columns(rng):
    """Two slow signals and a quick one."""
    return np.stack([coloured(rng, pole=0.97), coloured(rng, pole=0.9), rng.standard_normal(N)], axis=1)


def test_errors_cover_where_the_residual_is_coloured():
    """Of 40 draws with a residual correlated over 50 samples nine of ten numbers lie within 2 of their errors; least squares' own errors
    of the slow one are three times too small there."""
    inside, plain = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        x = [columns(rng) for _ in range(RUNS)]
        y = [one @ [1.0, -0.5, 0.2] + 0.5 * coloured(rng) for one in x]
        made = fit(Linear("abc", x, y))
        inside.append(np.abs(made.theta - [1.0, -0.5, 0.2]) < 2.0 * made.errors)
        whole, target = np.vstack(x), np.concatenate(y)
        theta, left = np.linalg.lstsq(whole, target, rcond=None)[:2]
        error = np.sqrt(left[0] / len(target) * np.linalg.inv(whole.T @ whole)[0, 0])
        plain.append((theta[0] - 1.0) / error)
    assert np.mean(inside) > 0.9
    assert np.std(plain) > 3.0


def test_a_prior_holds_a_number_that_the_data_do_not_know():
    """A column of zeros leaves its number at the prior, with the prior's error."""
    rng = np.random.default_rng(1)
    x = [columns(rng) * [1.0, 1.0, 0.0] for _ in range(RUNS)]
    made = fit(Linear("abc", x, [one[:, 0] + 0.1 * coloured(rng) for one in x], prior={"c": (7.0, 0.3)}))
    assert made.value("c") == pytest.approx(7.0, abs=1e-6)
    assert made.error("c") == pytest.approx(0.3, rel=1e-6)


def test_a_number_that_moves_nothing_is_not_known():
    """A limit that no motion reaches: its error is infinite, and the others keep theirs."""
    rng = np.random.default_rng(5)
    x = [np.stack([columns(rng)[:, 0], np.zeros(N)], axis=1) for _ in range(RUNS)]
    found = fit(Linear(("gain", "limit"), x, [one[:, 0] + 0.1 * rng.standard_normal(N) for one in x]))
    assert found.error("limit") == np.inf
    assert found.error("gain") < 0.01


def test_a_number_that_runs_do_not_share_is_spread_and_said():
    """1.0 in two runs and 2.0 in two: its error is their spread, and it is said to change. One that they share is not."""
    rng = np.random.default_rng(2)
    x = [columns(rng) for _ in range(RUNS)]
    y = [one[:, 0] * (1.0 + k % 2) + one[:, 2] + 0.05 * coloured(rng) for k, one in enumerate(x)]
    made = fit(Linear("abc", x, y))
    assert 0.3 < made.error("a") < 1.2
    assert made.error("c") < 0.05
    assert any(text.startswith("a is not the same") for text in verdict.changing(made))


def test_a_spectrum_is_that_of_the_noise():
    """|R|^2 of white noise of size 3 gives 9 in every bin, within four of its errors."""
    rng = np.random.default_rng(3)
    power = 9.0 * rng.exponential(size=2000)
    found = spectrum_of(np.log(np.arange(1, 2001)), power, np.ones(2000), 0)
    assert np.all(np.abs(np.exp(found.log_s) / 9.0 - 1.0) < 4.0 / np.sqrt(found.counts))


def test_the_band_that_is_more_than_noise_ends_where_the_rest_does():
    """Noise of which the part below 5 Hz is a hundred times as strong: its band ends in the bin of 5 Hz, or with the one before."""
    rng, f = np.random.default_rng(4), 0.05 * np.arange(1, 1001)
    power = np.where(f < 5.0, 100.0, 1.0) * rng.exponential(size=1000)
    assert abs(np.log(spectrum_of(np.log(f), power, np.ones(1000), 0).top_Hz / 5.0)) < np.log(1000.0) / 14


@dataclass(frozen=True)
class One:
    """A candidate: a column."""

    title: str
    place: str = "a"
    has_memory: bool = False
    kind: str = ""
    error: str = ""
    shapes = np.eye(1)

    def shapes_like(self, effect):
        return np.array([self.place == effect.place and self.kind == effect.kind])

    @property
    def amplitude(self):
        return (self.title,)

    @property
    def begin(self):
        return {}


@dataclass(frozen=True)
class Step:
    """What a judgment says of a candidate."""

    candidate: One
    verdict: str = "named"
    why: str = ""


class Columns:
    """a is declared; b and c are offered, and cubic as a free form at their place."""

    def __init__(self, rng, b=0.0, cubic=0.0, form_at="a", kind=""):
        self.x = [columns(rng) for _ in range(RUNS)]
        self.x = [np.column_stack([one, one[:, 1] ** 3]) for one in self.x]
        self.y = [one @ [1.0, b, 0.0, cubic] + 0.3 * coloured(rng) for one in self.x]
        self.offered, self.free = [One("b"), One("c")], [One("cubic", place=form_at, kind=kind)]

    def problem(self, chosen):
        names = ["a", *(one.title for one in chosen)]
        places = [["a", "b", "c", "cubic"].index(name) for name in names]
        return Linear(names, [one[:, places] for one in self.x], self.y)

    def candidates(self, chosen, now):
        return self.problem(self.offered), [(one, [one.title]) for one in self.offered]

    def free_forms(self, chosen, now):
        return [[form] for form in self.free]

    def loosened(self, effect, chosen, now):
        return effect


def test_what_is_missing_is_named_and_nothing_where_nothing_lacks():
    """b is named with its size; of 20 machines that lack nothing at most one gets a name (2 % stated: two have odds of 1 to 16)."""
    found = search(Columns(np.random.default_rng(4), b=0.4))
    assert [step.title for step in found.steps] == ["b"]
    assert found.final.value("b") == pytest.approx(0.4, abs=3 * found.final.error("b"))
    assert sum(bool(search(Columns(np.random.default_rng(seed))).steps) for seed in range(20)) <= 1


class Twins(Columns):
    """As `Columns`, with a twin of b and three signals that are nothing."""

    names = ("a", "b", "c", "cubic", "twin", "none1", "none2", "none3")

    def __init__(self, rng):
        super().__init__(rng, b=0.4)
        self.x = [np.column_stack([one, one[:, 1], rng.standard_normal((N, 3))]) for one in self.x]

    def problem(self, chosen):
        names = ["a", *(one.title for one in chosen)]
        return Linear(names, [one[:, [self.names.index(name) for name in names]] for one in self.x], self.y)


def test_what_promises_more_and_does_not_keep_it_hides_no_tie(monkeypatch):
    """Three signals promise most and are nothing; b and its twin come after them, the last one beyond those that are always fitted: it
    is fitted as well, and the tie is said with its odds."""
    order = [One("none1"), One("none2"), One("none3"), One("twin"), One("b")]
    looked = iter([[(60.0 - 10.0 * min(k, 3) - 0.1 * k, one) for k, one in enumerate(order)]])
    monkeypatch.setattr("hexsim.inference.search.screened", lambda *_: next(looked, []))
    [step] = search(Twins(np.random.default_rng(4))).steps
    assert {step.title, *(one.split(",")[0] for one in step.tied)} == {"b", "twin"}
    assert step.tied[0].endswith("odds 1 to 1.0")


class Instead(Columns):
    """b, which is not below 0, was found first; c, its like, and a little less than no b are what is missing."""

    def __init__(self, rng):
        super().__init__(rng)
        self.free = []
        for x in self.x:
            x[:, 2] = x[:, 1] + x[:, 2]
        self.y = [y + x @ [0.0, -0.1, 1.0, 0.0] for x, y in zip(self.x, self.y, strict=True)]

    def problem(self, chosen):
        made = super().problem(chosen)
        made.numbers = [replace(one, low=0.0) if one.name == "b" else one for one in made.numbers]
        return made


def test_an_effect_that_was_chosen_first_gives_way(monkeypatch):
    """With c the number of b goes to 0, where its interval ends: c is the name, and b is none any more."""
    looked = iter([[(60.0, One("b"))], [(60.0, One("c"))]])
    monkeypatch.setattr("hexsim.inference.search.screened", lambda *_: next(looked, []))
    assert [step.title for step in search(Instead(np.random.default_rng(4))).steps] == ["c"]


def test_a_name_beside_which_something_is_left_is_no_name():
    """Where the cube of b's signal is missing b gains and is not named, for a free form finds more at its place, or takes its own gain
    from another one. Where b itself is missing beside a cube at another place, b stands: with the form it still earns its place."""
    for place, why in (("a", "its form is open"), ("elsewhere", "stand-in")):
        found = search(Columns(np.random.default_rng(5), cubic=0.2, form_at=place))
        assert found.steps == []
        assert any(why in one.why for one in found.refused if one.title == "b")
    both = search(Columns(np.random.default_rng(5), b=1.0, cubic=0.2, form_at="elsewhere"))
    assert [step.title for step in both.steps] == ["b"]


def test_what_is_of_another_kind_is_left_beside_a_name():
    """A cube of another kind than b, at its place: b is named, and what is left is said with its held-out error. Where b is not in the
    machine it takes nothing beside the cube, and is a stand-in."""
    both = search(Columns(np.random.default_rng(5), b=1.0, cubic=0.2, kind="other"))
    assert [step.title for step in both.steps] == ["b"]
    assert both.left.startswith("left beside it: cubic, ") and "held-out error of y" in both.left
    cube = search(Columns(np.random.default_rng(5), cubic=0.2, kind="other"))
    assert cube.steps == []
    assert any(one.why.endswith("a stand-in") for one in cube.refused if one.title == "b")
    assert search(Columns(np.random.default_rng(4), b=0.4)).left == ""


class Loose(Columns):
    """As `Columns`; c is missing, too, and is what an error of b's form would leave, known to a third of b."""

    def __init__(self, rng, c):
        super().__init__(rng, b=1.0)
        self.free, self.y = [], [y + c * x[:, 2] for x, y in zip(self.x, self.y, strict=True)]

    def loosened(self, effect, chosen, now):
        return replace(effect, error="c") if effect.title == "b" else effect

    def problem(self, chosen):
        errors = [one.error for one in chosen if one.error]
        places = ["abc".index(name) for name in ("a", *(one.title for one in chosen), *errors)]
        names = ["a", *(one.title for one in chosen), *(f"error {name}" for name in errors)]
        x = [one[:, places] for one in self.x]
        return Linear(names, x, self.y, prior={f"error {name}": (0.0, 1.0 / 3.0) for name in errors})


def test_what_a_slightly_other_form_of_a_name_would_leave_is_no_second_name():
    """c of a fifth of b is in all motion and certain, and may be an error of b's form: b alone is named. c of twice b is none."""
    found = search(Loose(np.random.default_rng(8), c=0.2))
    assert [step.title for step in found.steps] == ["b"]
    assert any(
        "beside a slightly other form of b" in one.why and one.nats > 20.0 for one in found.refused if one.title == "c"
    )
    assert {one.title for one in found.in_model} == {"b", "c"}  # motion is predicted better with it
    assert {step.title for step in search(Loose(np.random.default_rng(8), c=2.0)).steps} == {"b", "c"}


def test_a_size_that_cannot_be_told_from_nothing_is_no_name():
    """1.0 in three quarters of the runs and -1.2 in one: held-out motion gains, and in the final model the number is within two of its
    errors from 0. One that all runs share is a name."""
    rng = np.random.default_rng(7)
    x = [columns(rng) for _ in range(8)]
    y = [one @ [1.0, -1.2 if k % 4 == 3 else 1.0, 0.0] + 0.3 * coloured(rng) for k, one in enumerate(x)]
    made = fit(Linear("abc", x, y))
    assert made.value("b") < 2.0 * made.error("b")
    steps: Any = [Step(candidate=One(name)) for name in "ab"]
    [none] = verdict.without_size(steps, made)
    assert none.candidate.title == "b" and none.why.startswith("b cannot be told from 0")


def test_one_group_cannot_be_held_out():
    """A sentence, no fit."""
    rng = np.random.default_rng(6)
    x = [columns(rng)]
    with pytest.raises(HexsimError, match="too short to hold a part"):
        held_out(fit(Linear("abc", x, [x[0][:, 0]])))
