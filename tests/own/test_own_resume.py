"""A trace of a machine of one's own that ends early leaves what is known, and goes on where it stopped with the same result."""

import json
import os
import shutil
import sys

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from hexsim.cli import app
from hexsim.inference import notebook
from hexsim.tracing.own.page import incomplete_page

FILE = "own_trace_state.json"
TANK = """
[runs]
fit = ["one", "two"]
validate = ["three"]
[parameters]
outlet = { start = 0.1, sign = 1 }
[states.level_m]
quantity = "flow"
sum = "inflow - outlet * level_m"
start = "free"
guess = 0.5
[outputs.level_m]
formula = "level_m"
unit = "m"
[simulation]
scheme = "heun"
"""
CART = """
[[balances]]
name = "force"
unit = "N"
target = "force_N"
[[balances.terms]]
name = "damping"
unit = "N s/m"
column = "speed_m_s"
[[balances.candidates]]
name = "dry friction"
unit = "N"
column = "sign(speed_m_s)"
[[balances.candidates]]
name = "drag"
unit = "N s2/m2"
column = "speed_m_s * abs(speed_m_s)"
"""


def tank_run(seed):
    """A tank that spills over 0.9 m, which its model does not know."""
    rng = np.random.default_rng(seed)
    inflow, level, seen = np.repeat(rng.uniform(0.02, 0.14, 10), 40), 0.6, []
    for q in inflow:
        seen.append(level)
        level += q - 0.1 * level - 0.4 * max(level - 0.9, 0.0)
    return pl.DataFrame(
        {"time_s": np.arange(400.0), "inflow": inflow, "level_m": seen + 3e-3 * rng.standard_normal(400)}
    )


def cart_run(seed):
    """A force with dry friction."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 0.01)
    speed = np.sin(time * rng.uniform(0.8, 1.2)) + 0.5 * np.sin(time * rng.uniform(2.5, 3.5))
    force = 3.0 * speed + 2.0 * np.sign(speed) + 0.05 * rng.standard_normal(len(time))
    return pl.DataFrame({"time_s": time, "speed_m_s": speed, "force_N": force})


def written(place, text, name, run):
    (place / name).write_text(text)
    for k, log in enumerate(("one", "two", "three")):
        run(k).write_csv(place / f"{log}.csv")
    return place


@pytest.fixture(params=[pytest.param("states", marks=pytest.mark.slow), "balances"])
def machine(request, tmp_path):
    place = tmp_path / "machine"
    place.mkdir()
    if request.param == "states":
        return written(place, TANK, "model.toml", tank_run)
    columns = "".join(f'[columns.{name}]\nfrom = "{name}"\n' for name in ("time_s", "speed_m_s", "force_N"))
    (place / "mapping.toml").write_text('kind = "own"\n' + columns)
    return written(place, CART, "balances.toml", cart_run)


def hexsim(*arguments):
    return CliRunner().invoke(app, ["trace", *map(str, arguments)])


def report(place):
    return {key: value for key, value in json.loads((place / "report.json").read_text()).items() if key != "seconds"}


@pytest.fixture
def fits(monkeypatch):
    """What is held out, a line each; `fits.stop` is the error that ends the next search after so many."""

    class Fits(list):
        stop: tuple[int, BaseException] | None = None

    made, real = Fits(), notebook.held_out

    def counted(fitted):
        if made.stop is not None and len(made) >= made.stop[0]:
            raise made.stop[1]
        made.append(fitted.names)
        return real(fitted)

    monkeypatch.setattr(notebook, "held_out", counted)
    return made


def test_a_trace_that_failed_and_was_interrupted_ends_as_one_that_was_not(machine, tmp_path, fits, monkeypatch):
    """It fails after a fit, resumed it is interrupted after one more, resumed it ends: no fit is made twice, and the report is
    the same to the last digit. In between every file says that it is incomplete, and the sentence how to go on."""
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert hexsim(machine, "--out", whole).exit_code == 0
    all_fits = len(fits)
    assert all_fits > 2
    fits.clear()
    fits.stop = (1, RuntimeError("a bug"))
    failed = hexsim(machine, "--out", out)
    assert isinstance(failed.exception, RuntimeError)
    assert len(json.loads((out / FILE).read_text())["entries"]) == 1
    monkeypatch.setattr(os, "_exit", sys.exit)  # which would end the tests
    fits.stop = (2, KeyboardInterrupt())
    ended = hexsim("--resume", out)
    assert ended.exit_code == 130 and "interrupted by the user" in ended.stderr
    assert f"hexsim trace --resume {out} goes on there" in " ".join(ended.stderr.split())
    if (machine / "model.toml").is_file():
        assert report(out)["verdict"] == "incomplete: the trace did not come to its end: it was interrupted"
        assert report(out)["numbers"]["outlet"]["value"] > 0
        assert "it was interrupted" in (out / "report.html").read_text()
    fits.stop = None
    ended = hexsim("--resume", out)
    assert ended.exit_code == 0 and len(fits) == all_fits
    assert report(out) == report(whole)
    assert not (out / FILE).exists()


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """A folder with a tank in `machine` and in `out` the state of its trace, which failed after two fits."""
    place, real, made = tmp_path_factory.mktemp("failed"), notebook.held_out, []

    def counted(fitted):
        if len(made) == 2:
            raise RuntimeError("a bug")
        made.append(fitted)
        return real(fitted)

    (place / "machine").mkdir()
    written(place / "machine", TANK, "model.toml", tank_run)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(notebook, "held_out", counted)
        hexsim(place / "machine", "--out", place / "out")
    return place


@pytest.fixture
def begun(failed, tmp_path):
    """A copy of the failed trace's folder."""
    return shutil.copytree(failed / "out", tmp_path / "out")


def test_another_file_or_log_is_refused(begun, failed):
    """A declared number, or a sample of a log, has changed since: one sentence that names it, and nothing is lost."""
    before = (begun / FILE).read_bytes()
    for name, change in (
        ("model.toml", lambda text: text.replace("0.1", "0.2")),
        ("two.csv", lambda text: f"{text[:-2]}\n"),
    ):
        path = failed / "machine" / name
        text = path.read_text()
        path.write_text(change(text))
        refused = hexsim("--resume", begun)
        path.write_text(text)
        assert refused.exit_code == 2
        assert "has changed since the trace" in refused.stderr and path.stem in refused.stderr
    assert (begun / FILE).read_bytes() == before


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda told: told.update(entries="x"), "cannot be read"),
        (lambda told: told.update(entries=[{"asked": [], "fits": [], "refused": ""}]), "cannot be read"),
        (lambda told: told["entries"][0]["fits"][0].update(covariance=[[1.0]] * 7), "cannot be read"),
        (lambda told: told["entries"][0]["fits"][0]["spectra"][0].update(edges=[]), "cannot be read"),
        (lambda told: told["asked"].update(fit=[1]), "cannot be read"),
        (lambda told: told.pop("hashes"), "cannot be read"),
        (lambda told: told.update(version="0.0.1"), "was written by hexsim 0.0.1"),
    ],
)
def test_a_state_that_somebody_changed_is_one_sentence(begun, change, sentence):
    """Other kinds of entries, numbers of another size, another version: exit code 2."""
    told = json.loads((begun / FILE).read_text())
    change(told)
    (begun / FILE).write_text(json.dumps(told))
    refused = hexsim("--resume", begun)
    assert refused.exit_code == 2
    assert sentence in refused.stderr and "start the trace anew" in refused.stderr


def test_a_state_that_is_cut_off_is_one_sentence(begun):
    """Half of the file; bytes that are no text."""
    whole = (begun / FILE).read_bytes()
    for damaged in (whole[: len(whole) // 2], b"\xff\xfe" + whole):
        (begun / FILE).write_bytes(damaged)
        refused = hexsim("--resume", begun)
        assert refused.exit_code == 2 and "cannot be read" in refused.stderr


@pytest.mark.slow
def test_what_was_fitted_is_not_believed_where_it_does_not_fit(begun, fits):
    """Entries of other effects are left out from there on: the trace ends, and these fits are made again."""
    told = json.loads((begun / FILE).read_text())
    told["entries"][1]["asked"] = ["an effect that nobody knows"]
    (begun / FILE).write_text(json.dumps(told))
    fits.clear()
    assert hexsim("--resume", begun).exit_code == 0
    assert len(fits) > 1
    assert report(begun)["named"][0] == "overflow in level_m"


def test_an_incomplete_page_of_balances_has_what_was_traced():
    """Each verdict so far, why it ended, and how to go on; markup in a name stays text."""
    known = {"machine": "cart", "verdict": {"<b>force</b>": "explained in part by dry friction: 0.9 -> 0.1 N held out"}}
    page = incomplete_page(known, "it was interrupted")
    assert "did not come to its end: it was interrupted" in page and ">--resume</span>" in page
    assert "explained in part by dry friction: 0.9 → 0.1 N held out" in page and "<b>" not in page
