"""Machines of one's own are fitted and traced in simulation: numbers come back, what lacks is named, nothing where nothing lacks."""

import json
import tomllib

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from hexsim import HexsimError
from hexsim.cli import app
from hexsim.own import effects, problem, simulate
from hexsim.own import folder as own_folder
from hexsim.own import run as own_run
from hexsim.own import trace as own_trace
from hexsim.own.declaration import ModelTables
from hexsim.own.model import model_of
from hexsim.signals.log import Log

TANK = """
name = "tank"
[runs]
fit = ["one", "two"]
validate = ["three"]
[signals]
level_m = { quantity = "level" }
[parameters]
outlet = { start = 0.05, sign = 1 }
inlet = { start = 0.8, sign = 1 }
[states.level_m]
quantity = "flow"
sum = "inlet * inflow - outlet * sqrt(level_m)"
start = "free"
guess = 0.5
[outputs.level_m]
formula = "level_m"
unit = "m"
[simulation]
scheme = "heun"
steps = 1
"""
OUTLET, INLET, WEIR, TOP, NOISE = 0.08, 1.0, 0.5, 1.2, 3e-3


def tank_run(seed: int, weir: float, n: int = 350) -> pl.DataFrame:
    """A tank written apart: midpoint steps of 0.1 s, its own noise; the inflow goes straight from sample to sample."""
    rng = np.random.default_rng(seed)
    inflow = np.repeat(rng.uniform(0.02, 0.15, n // 50), 50)
    level, seen = 0.6, []

    def rate(x: float, q: float) -> float:
        return INLET * q - OUTLET * np.sqrt(x) - weir * max(x - TOP, 0.0)

    for k in range(n):
        seen.append(level)
        ahead = inflow[min(k + 1, n - 1)]
        for j in range(10):
            q = inflow[k] + (ahead - inflow[k]) * (j + 0.5) / 10
            level += 0.1 * rate(level + 0.05 * rate(level, q), q)
    seen = np.array(seen) + NOISE * rng.standard_normal(n)
    return pl.DataFrame({"time_s": np.arange(n) * 1.0, "inflow": inflow, "level_m": seen})


def folder_of(place, weir: float, text: str = TANK):
    place.mkdir(exist_ok=True)
    (place / "model.toml").write_text(text)
    for k, name in enumerate(("one", "two", "three")):
        tank_run(k + (7 if weir else 70), weir).write_csv(place / f"{name}.csv")
    return place


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    return folder_of(tmp_path_factory.mktemp("tanks") / "clean", 0.0)


@pytest.fixture(scope="module")
def spilling(tmp_path_factory):
    return folder_of(tmp_path_factory.mktemp("tanks") / "spilling", WEIR)


def test_numbers_come_back_within_their_errors(clean):
    """Outlet and inlet of a tank that was simulated apart, within four of their errors, and these below 1 %; the rest is noise."""
    folder = own_folder.load_simulated(clean)
    fitted = problem.fit_own(problem.problem_of(folder.model, folder.fit, "here"))
    for name, truth in (("outlet", OUTLET), ("inlet", INLET)):
        error = fitted.errors[fitted.names.index(name)]
        assert abs(fitted.value(name) - truth) < 4 * error
        assert error < 0.01 * truth
    assert own_run.simulated(fitted, folder.fit[0], "here")[1]["level_m"] == pytest.approx(NOISE, rel=0.15)


def test_the_error_of_a_long_run_can_be_what_is_fitted(spilling):
    """fit_by = "error" leaves less of a model that is not quite right than the likelihood does, with honest errors either way."""
    folder, left = own_folder.load_simulated(spilling), {}
    for how in ("likelihood", "error"):
        text = TANK.replace("steps = 1", f'steps = 1\nfit_by = "{how}"')
        model = model_of(
            ModelTables.model_validate({k: v for k, v in tomllib.loads(text).items() if k not in ("name", "runs")}),
            "here",
        )
        made = problem.fit_own(problem.problem_of(model, folder.fit, "here"))
        left[how] = sum(own_run.simulated(made, log, "here")[1]["level_m"] ** 2 for log in folder.fit)
        assert np.all(made.errors > 0)
    assert left["error"] < left["likelihood"]


def test_overflow_is_named_and_the_unseen_run_gets_better(spilling, tmp_path):
    """A tank that spills over 1.2 m names an overflow at this level, and the error on the third run falls to the noise. Where this run is
    of a tank that does not spill, the same search names nothing."""
    trace = own_trace.trace_own(own_folder.load_simulated(spilling))
    assert trace.steps[0].candidate.name == "overflow"
    top = next(name for name in trace.steps[0].fitted.names if name.startswith("top"))
    assert trace.steps[0].fitted.value(top) == pytest.approx(TOP, abs=0.03)
    before, *_, after = [step["three"]["level_m"] for step in trace.errors.values()]
    assert before > 3 * NOISE
    assert after < 1.3 * NOISE
    other = folder_of(tmp_path / "other", WEIR)
    tank_run(9, 0.0).write_csv(other / "three.csv")
    judged = own_trace.proven_untouched(own_folder.load_simulated(other), trace.found)
    assert judged.steps == []
    assert judged.refused[0].title == trace.steps[0].title and "no fit or choice has seen" in judged.refused[0].why


@pytest.mark.slow  # the search names nothing where nothing lacks in inference/test_one_inference.py
def test_nothing_is_named_where_nothing_lacks(clean):
    """On the tank as declared no effect of the library is named."""
    trace = own_trace.trace_own(own_folder.load_simulated(clean))
    assert trace.steps == []
    assert trace.verdict.startswith(("nothing", "unexplained"))


EVERY_QUANTITY = """
[signals]
u = { quantity = "voltage" }
[states.x]
rate = "v"
[states.v]
quantity = "force"
sum = "u - 2.0 * v - 5.0 * x"
[states.pressure]
quantity = "flow"
sum = "u - pressure"
[states.level]
quantity = "flow"
sum = "u - level + pressure"
[states.current]
quantity = "voltage"
sum = "u - current"
[outputs.x]
formula = "x"
[outputs.both]
formula = "pressure + level + current"
[simulation]
scheme = "euler"
steps = 1
"""


def test_every_general_effect_vanishes_at_its_neutral_value():
    """A drive with a tank, with all effects of the library in it at once (free forms one by one) and amplitudes 0, moves as without them:
    to 1e-4 of its motion, for a dry friction of 0 still takes a step with a change of sign in two parts, and to 1e-12 until velocity
    first changes its sign."""
    plain = ModelTables.model_validate(tomllib.loads(EVERY_QUANTITY))
    found = effects.offered(plain, ("u",), lambda what, name: effects.Sizes(T=0.01, D=3.0))
    assert {one.name for one in found} == {row.name for row in effects.library()}
    full = plain
    for k, one in enumerate(one for one in found if not one.rival):
        full = effects.joined(full, effects.distinct(one, k), neutral=True)
    free = [effects.joined(plain, one, neutral=True) for one in found if one.rival]
    t = np.arange(300) * 0.01
    log = Log(name="run", kind="own", time=t, columns={"u": np.sin(5 * t), "x": 0 * t, "both": 0 * t})
    runs = []
    for tables in (plain, full, *free):
        made = model_of(tables, "here")
        p = np.array([number.start for number in made.numbers])
        runs.append(simulate.Simulator(made).run(simulate.record_of(made, log, "here"), p).outputs)
    assert runs[1][:70] == pytest.approx(runs[0][:70], abs=1e-12)
    for run in runs[1:]:
        assert run == pytest.approx(runs[0], abs=1e-4 * np.abs(runs[0]).max())


def test_an_effect_that_is_offered_beside_one_of_an_input_stands_without_it():
    """What is made while a lag of the drive is in the model is, joined to the model without it, what would have been made there."""
    plain, columns = ModelTables.model_validate(tomllib.loads(EVERY_QUANTITY)), {"u", "x", "both"}

    def made(tables):
        return {one.title: one for one in effects.offered(tables, ("u",), lambda what, name: effects.Sizes())}

    alone = made(plain)
    [lag] = [one for title, one in alone.items() if title.startswith("lag of a drive")]
    beside = made(effects.joined(plain, lag))
    assert any("u__1" in text for one in beside.values() for text in one.formulas.values())
    for title, one in alone.items():
        if one.what == "sum":
            with_it, without = (effects.joined(plain, same) for same in (beside[title], one))
            assert model_of(with_it, "here", columns).rates == model_of(without, "here", columns).rates


def test_the_commands_take_the_folder(clean, tmp_path):
    """`hexsim run FOLDER` writes logs with simulated columns, a report and its page; a folder without a model is one sentence, exit 2."""
    done = CliRunner().invoke(app, ["run", str(clean), "--out", str(tmp_path / "out"), "--json"])
    assert done.exit_code == 0, done.output
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["runs"]["three"]["held_out"] is True
    assert report["runs"]["three"]["rms"]["level_m"] == pytest.approx(NOISE, rel=0.3)
    assert "simulated_level_m" in pl.read_parquet(tmp_path / "out" / "three.parquet").columns
    assert "data:image/png" in (tmp_path / "out" / "report.html").read_text()
    refused = CliRunner().invoke(app, ["run", str(tmp_path)])
    assert refused.exit_code == 2
    assert "model.toml" in refused.output


def test_a_run_without_its_input_is_refused(clean, tmp_path):
    """The sentence names the column and the columns that are there."""
    place = folder_of(tmp_path / "other", 0.0, TANK.replace("inlet * inflow", "inlet * pumped"))
    with pytest.raises(HexsimError, match="no column 'pumped'"):
        own_folder.load_simulated(place)
