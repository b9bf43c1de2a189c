"""Names of machines of one's own: a form is proven against free forms, a memory against all memories."""

import json
import re
import tomllib
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from hexsim.cli import app
from hexsim.inference.likelihood import fit
from hexsim.inference.search import search
from hexsim.own import effects, folder
from hexsim.own import trace as own_trace
from hexsim.own.declaration import EffectRow, ModelTables
from hexsim.own.forms import forms
from hexsim.own.sizes import waves

DRIVE = """
[runs]
fit = ["one", "two", "three"]
[signals]
command = { quantity = "voltage", hold = true }
[parameters]
damping = { start = 1.2, sign = 1 }
stiffness = { start = 18.0, sign = 1 }
[states.x]
rate = "v"
[states.v]
quantity = "force"
sum = "20 * command - damping * v - stiffness * x"
[outputs.x]
formula = "x"
[simulation]
scheme = "heun"
steps = 2
"""
DT, N = 0.04, 250


def run(seed: int, place_damping: float, play: float, lag: float, slip: float, root: float) -> pl.DataFrame:
    """Written apart: mass 1, damping 1.5 + place_damping x^2, spring 20, play of the drive, which begins at one end, and its lag, which
    begins at 0, springs of stiffness `slip` that slip one after another, friction of `root` times the root of the speed; 20 semi-implicit
    steps a sample."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) * DT
    command = sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in rng.uniform(0.1, 1.2, 5)) / 2
    x, v, held, late = 0.0, 0.0, command[0] + 0.5 * play, 0.0
    ends, slid = np.array([0.05, 0.15, 0.4]), np.zeros(3)
    seen = np.zeros(N)
    for k in range(N):
        seen[k] = x
        held = min(max(held, command[k] - 0.5 * play), command[k] + 0.5 * play)
        for _ in range(20):
            late += (held - late) * (1.0 if lag == 0 else 1 - np.exp(-DT / 20 / lag))
            slid = np.clip(slid, x - ends, x + ends)
            force = 20 * late - slip * float(np.sum(x - slid)) - root * np.sign(v) * np.sqrt(abs(v))
            v += DT / 20 * (force - (1.5 + place_damping * x * x) * v - 20 * x)
            x += DT / 20 * v
    return pl.DataFrame({"time_s": t, "command": command, "x": seen + 0.003 * rng.standard_normal(N)})


def machine(place, steps: int = 2, **missing: float) -> own_trace.Simulated:
    """Three runs of the plant, with the file that lacks this."""
    (place / "model.toml").write_text(DRIVE.replace("steps = 2", f"steps = {steps}"))
    for seed, name in enumerate(("one", "two", "three")):
        run(seed, **dict.fromkeys(("place_damping", "play", "lag", "slip", "root"), 0.0) | missing).write_csv(
            place / f"{name}.csv"
        )
    return own_trace.Simulated(folder.load_simulated(place))


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_damping_over_place_is_no_friction(tmp_path):
    """Where damping grows with the place, which no effect of the library says, an effect gains and nothing is named: a free form beside
    it finds the rest. What gains stays in the model all the same, for with it held-out motion is predicted better, and the verdict says
    what it is."""
    drive = machine(tmp_path, place_damping=4.0)
    found = search(drive)
    assert found.steps == []
    stand_ins = [one.title for one in found.refused if one.why.endswith(("its form is open", "a stand-in"))]
    assert stand_ins and {one.title for one in found.in_model} == set(stand_ins)
    assert f"likely, not proven: {stand_ins[0]} (in the model, a stand-in)" in own_trace.said(found, None)
    assert sum(found.final_held.density) > sum(found.base_held.density)
    assert set(found.in_model[0].numbers) <= set(drive.declared(found.in_model).parameters)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_damping_over_place_gets_its_formula(tmp_path):
    """The formula x^2 v is stated with its coefficient; its file, put to the machine's, is an effect that is named."""
    machine(tmp_path, place_damping=4.0)
    assert CliRunner().invoke(app, ["trace", str(tmp_path), "--out", str(tmp_path / "out")]).exit_code == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert "formula beyond the library: x**2 * v in v" in report["verdict"]
    [own] = [one for one in report["candidates"] if one["verdict"] == "formula"]
    number = own["numbers"]["form_amount_v"]
    assert number["value"] == pytest.approx(4.0, abs=4 * number["standard_error"])
    with (tmp_path / "model.toml").open("a") as file:
        file.write((tmp_path / "out" / "effect.toml").read_text())
    with_it = search(own_trace.Simulated(folder.load_simulated(tmp_path)), most=1)
    assert [step.title for step in with_it.steps] == ["x**2 * v in v"]


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_name_is_tied_with_a_formula_that_is_as_likely(tmp_path):
    """A little friction over the root of the speed, which no effect of the library has, gains as one that it has. No name stands alone,
    for the formula root(v) is as likely, with its odds."""
    machine(tmp_path, root=0.12)
    trace = own_trace.trace_own(folder.load_simulated(tmp_path))
    [step] = trace.steps
    [odds] = [tie.removeprefix("root(v) in v, odds 1 to ") for tie in step.tied if tie.startswith("root(v) in v, odds")]
    assert 1.0 <= float(odds) < 50.0


def test_half_waves_end_with_the_band_of_what_is_left():
    """A signal that goes once a second over its range passes ten half waves at 5 Hz, however long and finely it is recorded."""
    for dt, n in ((0.01, 1001), (0.005, 4001)):
        there = np.abs((np.arange(n) * dt + 1.0) % 2.0 - 1.0)
        assert waves([there], 2.0 * 5.0 * dt) == pytest.approx(10.0)


def test_a_signal_that_jumps_or_rests_passes_no_more_half_waves_for_it() -> None:
    """A jump between two rests passes all half waves at once, and there is no finer sine than one of a single half wave; rests beside a
    motion, and one that never moves, add none."""
    dt, jump = 0.01, np.repeat([0.0, 1.0], 3000)
    assert waves([jump], 2.0 * 5.0 * dt) == 1.0 == waves([np.zeros(100)], 2.0 * 5.0 * dt)
    there = np.abs((np.arange(1001) * dt + 1.0) % 2.0 - 1.0)
    assert waves([np.r_[there, np.full(20000, there[-1])]], 2.0 * 5.0 * dt) == pytest.approx(10.0)


def test_formulas_have_the_unit_of_their_sum(tmp_path):
    """A coefficient has the unit that makes its term a force; a product of two signals is longer than one signal, so that it must
    predict better."""
    units = '[states.x]\nunit = "m"\n', '[states.v]\nunit = "m/s"\n'
    text = DRIVE.replace("[states.x]\n", units[0]).replace("[states.v]\n", units[1])
    (tmp_path / "model.toml").write_text(text)
    every = {
        form.title: form for form in forms(folder.declared(tmp_path), ["command"], lambda what, name: effects.Sizes())
    }
    unit = lambda title: every[title].row.parameters["form_amount"].unit  # noqa: E731
    assert unit("x**2 * v in v") == "N/(m2 m/s)"
    assert unit("v * abs(v) in v") == "N/((m/s)2)"
    assert unit("x * command in v") == "N/(m V)"
    assert unit("tanh(v / w) in v") == "N"
    assert every["x**2 * v in v"].length > every["x**2 in v"].length
    assert "command**2 in v" not in every and "command * abs(command) in command" in every


def test_formulas_over_signals_with_long_names_are_offered(tmp_path):
    """The longest names that a file may have make the longest units and titles: each is a number and an effect that a file may hold."""
    long = "v".ljust(80, "v")
    text = re.sub(r"\bv\b", long, DRIVE).replace("command", "c".ljust(80, "c"))
    (tmp_path / "model.toml").write_text(text)
    names = ["c".ljust(80, "c")]
    every = forms(folder.declared(tmp_path), names, lambda what, name: effects.Sizes())
    assert max(len(form.row.name) for form in every) > 240
    assert max(len(form.row.parameters["form_amount"].unit) for form in every) > 80
    for form in every:
        EffectRow.model_validate(form.row.model_dump(exclude_none=True))


@pytest.mark.timeout(300)
@pytest.mark.slow
def test_play_is_backlash_and_no_lag(tmp_path):
    """Play of a drive is named as such, alone and with its width, wherever in it a run begins: every memory is fitted, whatever a linear
    look foretells."""
    found = search(machine(tmp_path, play=0.15))
    assert [step.candidate.name for step in found.steps] == ["backlash of a drive"]
    assert found.steps[0].tied == []
    width = next(name for name in found.final.names if name.startswith("play"))
    assert found.final.value(width) == pytest.approx(0.15, abs=4 * found.final.error(width))


@pytest.mark.timeout(300)
@pytest.mark.slow
def test_a_lag_before_a_linear_machine_is_tied_with_one_behind_it(tmp_path):
    """A lag of the drive and one of the sensor give one motion but for how they begin, which nobody knows: each is tied with the other at
    odds near 1, whichever of the beginnings the plant has."""
    found = search(machine(tmp_path, steps=8, lag=0.1), most=1)
    [step] = found.steps
    assert {step.candidate.name, step.rivals[0].name} == {"lag of a drive", "lag of a sensor"}
    assert float(step.tied[0].rsplit(" ", 1)[1]) < 10.0


@pytest.mark.timeout(300)
@pytest.mark.slow
def test_springs_that_slip_are_no_named_hysteresis(tmp_path):
    """Three springs that slip one after another gain as a hysteresis of the library, which takes nothing beside play over the place: it
    is not named, stays in the model as a stand-in, for with it held-out motion is predicted better, and the verdict says what it is."""
    drive = machine(tmp_path, slip=4.0)
    found = search(drive, most=1)
    assert found.steps == []
    [stand_in] = [one for one in found.refused if "play" in one.why and one.why.endswith("a stand-in")]
    assert [one.title for one in found.in_model] == [stand_in.title]
    assert f"likely, not proven: {stand_in.title} (in the model, a stand-in)" in own_trace.said(found, None)
    assert sum(found.final_held.density) > sum(found.base_held.density)
    assert set(found.in_model[0].numbers) <= set(drive.declared(found.in_model).parameters)


def test_a_free_form_opens_what_is_of_its_kind(tmp_path):
    """Over velocity it is of any friction's kind, of asymmetric friction's with its even shapes alone; over place of a spring's, and
    of no friction's; over place and velocity of friction that both decide. At the place of a memory any is of its kind."""
    drive = machine(tmp_path)
    now = fit(drive.problem(()))
    known = {one.name: one for one in drive.offers((), now, False)}
    [form] = [one for one in drive.offers((), now, True) if one.name == "some force over velocity"]
    ends = np.append(form.shapes, [-form.shapes.sum(axis=0)], axis=0)  # the last corner makes the mean 0
    even = np.abs(ends - ends[::-1]).max(axis=0) < 1e-9
    assert list(form.shapes_like(known["asymmetric friction"])) == list(even) and 0 < even.sum() < len(even)
    share = {
        (name, rival.name): rival.shapes_like(known[name]).mean()
        for name in (
            "Coulomb friction",
            "spring",
            "place-dependent friction",
            "presliding friction (Dahl)",
            "offset of a drive",
        )
        for rival in drive.offers((), now, True)
    }
    assert share["Coulomb friction", "some force over velocity"] == share["spring", "some force over place"] == 1.0
    assert share["Coulomb friction", "some force over place"] == share["spring", "some force over velocity"] == 0.0
    assert share["Coulomb friction", "some damping over place"] == 0.0
    assert 0.0 < share["Coulomb friction", "some force over place and velocity"] < 0.3
    assert share["place-dependent friction", "some damping over place"] == 1.0
    assert share["presliding friction (Dahl)", "some force over place"] == 1.0
    assert share["presliding friction (Dahl)", "some gain of a drive"] == 0.0
    assert share["offset of a drive", "some gain of a drive"] == 1.0


def test_a_formula_that_a_chosen_effect_is_is_not_offered(tmp_path):
    """Beside quadratic friction v abs(v) is no formula of its own; before, and beside another effect, it is one."""
    drive = machine(tmp_path)
    now = fit(drive.problem(()))
    known = {one.name: one for one in drive.offers((), now, False)}
    offered = lambda *names: {form.title for form in drive.forms([known[name] for name in names], now)}  # noqa: E731
    assert offered() - offered("quadratic friction") == {"v * abs(v) in v"}
    assert "v * abs(v) in v" in offered("Coulomb friction")


def test_a_chance_follows_what_it_is_about(monkeypatch):
    """Names, ties and a formula are each followed by the chance of their own kind; what is likely, and no form, have none."""
    monkeypatch.setattr("hexsim.own.trace.stated", lambda kind: f"chance of a {kind}")

    def one(title: str, *tied: str, verdict: str = "named") -> Any:
        return SimpleNamespace(title=title, tied=tied, verdict=verdict)

    steps, refused = [one("a"), one("b", "c, odds 1 to 2.0"), one("d")], [one("e", verdict="likely")]
    found: Any = SimpleNamespace(steps=steps, refused=refused, in_model=[], left="left beside it: some force")
    formula: Any = SimpleNamespace(proven=True, why="", best=one("x**2"))
    names = "named: a + d (chance of a name) + b (tied with c, odds 1 to 2.0) (chance of a tie)"
    likely = "likely, not proven: e"
    assert own_trace.said(found, None) == f"{names}; left beside it: some force; {likely}"
    assert (
        own_trace.said(found, formula) == f"{names}; formula beyond the library: x**2 (chance of a formula); {likely}"
    )
    assert "left beside it" not in own_trace.said(found, formula)  # the formula is what is left
    open_form: Any = SimpleNamespace(proven=False, why="two are as likely", best=one("x**2"))
    found.steps = []
    assert own_trace.said(found, open_form) == f"unexplained; no form: two are as likely; {likely}"


def test_numbers_of_the_library_have_the_places_units():
    """An overflow of a tank: its edge in m, what spills in m3/s per m. Without a declared unit: none."""
    for quantity, units in (('quantity = "flow"', ["(m3/s)/m", "m"]), ("", ["", "m"])):
        tables = ModelTables.model_validate(
            tomllib.loads(
                f'signals.u = {{}}\n[states.h]\n{quantity}\nsum = "u - h"\n[outputs.h]\nformula = "h"\nunit = "m"'
            )
        )
        row = next(row for row in effects.library() if row.name == "overflow")
        made = effects.candidates(row, "h", None, tables, effects.Sizes())[0]
        assert [number.unit for number in made.numbers.values()] == units


def test_units_that_are_declared_stay():
    """Neither the P of Pa nor a signal's name in brackets is taken for a size; a size with an exponent is one."""
    tables = ModelTables.model_validate(tomllib.loads('[states.v]\nquantity = "force"\nunit = "m/s"\nsum = "-v"'))
    for unit, expected in (("N/Pa", "N/Pa"), ("1/[P]", "1/[P]"), ("S/X2", "N/(m/s)2"), ("rad/s", "rad/s")):
        assert effects.with_units(unit, tables, "v", "sum") == expected
