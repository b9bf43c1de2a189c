"""The next measurement: motions inside the machine's limits, information that adds up, hypotheses that stay apart."""

import dataclasses
import json
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from other_plant import driven, measured, write_machine
from typer.testing import CliRunner

from hexsim import HexsimError, readers
from hexsim.cli import app
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer import host_limiter
from hexsim.scenarios import scenario_from_dict
from hexsim.signals import channels
from hexsim.tracing import balances
from hexsim.tracing.checks.same_machine import check_same_machine
from hexsim.tracing.design import believed as columns
from hexsim.tracing.design import information, motions, next_measurement, rest
from hexsim.tracing.design import words as design_words
from hexsim.tracing.design.ceiling import ceiling_of
from hexsim.tracing.design.next_measurement import surviving, what_is_open
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.fitting import parameters, rest_evidence, rest_level
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.steps import dominant, logs, shapes, violations

DATA = Path(__file__).parents[1] / "data"
LEAK = 2.5e-12


@pytest.fixture(scope="module")
def bench():
    machine = load_machine(DATA / "bench_leakage")
    log = readers.read_log(DATA / "bench_leakage" / "validate.csv.gz").head(5.0)
    return machine, log, SimulatedProblem(logs=(log,), noise=channels.noise_of(machine, [log]))


@pytest.fixture(scope="module")
def leaking(bench):
    """The declared bench with its leak, refitted to 5 s."""
    machine, _, problem = bench
    leak = parameters.named("leakage_supply_to_chamber")
    start = least_squares.with_effects(
        least_squares.start_fit(machine, parameters.priors(machine), problem), [leak], 0.5, problem
    )
    return least_squares.refine(start, problem, steps=6)


@pytest.mark.parametrize("name", ["bench", "micro_motion_system"])
def test_the_first_motions_use_what_the_machine_may(name):
    """All of them can be made, the first eight are of every kind, with a load and without; the first takes 0.9 of the
    stroke and 0.85 of the speed that are allowed, together, of a leg or of the platform."""
    machine = load_machine(name)
    family = motions.MotionFamily(machine, 20.0, may_load=True)
    points = family.first_points(16)
    low, high = np.transpose(family.bounds)
    assert points.shape == (16, len(low)) and np.all(points >= low) and np.all(points <= high + 1e-6)
    made = [family.scenario(point) for point in points[:14]]
    assert all(tables is not None for tables in made)
    assert {next(iter(tables["axes"].values()))["kind"] for tables in made[:8]} == set(motions.KINDS)
    assert {"machine" in tables for tables in made[:8]} == {True, False}
    found = family.limiter.motion(host_limiter.setpoints_of(machine, made[0]))
    used = [
        max(
            float(np.max(np.abs(derivatives[k]).max(axis=0) / getattr(family.limiter.limits[what], kind)))
            for what, derivatives in found.items()
        )
        for k, kind in enumerate(("excursion", "velocity"))
    ]
    assert used[0] > 0.9 and used[1] > 0.85


def test_a_hypothesis_is_not_apart_from_itself(bench, leaking):
    """The separation of two equal machines is nothing."""
    _, log, problem = bench
    one = information.hypothesis("one", leaking, problem)
    found = information.promise([one, dataclasses.replace(one, label="other")], log, problem.noise)
    assert found.separations["one", "other"] == pytest.approx(0.0, abs=1e-6)


def test_what_a_declared_parameter_takes_up_separates_nothing(bench, leaking):
    """A machine whose discharge coefficient is 0.05 % off is apart by chi2 in the hundreds of the plain difference, and by
    less than a hundredth of it where that parameter is free."""
    _, log, problem = bench
    place = [prior.key for prior in leaking.priors].index("discharge_coefficient")
    off = leaking.deviations.copy()
    off[place] += 5e-4 * np.sign(-off[place])
    moved = dataclasses.replace(leaking, deviations=off)
    pair = [information.hypothesis("one", leaking, problem), information.hypothesis("other", moved, problem)]
    unknown = [dataclasses.replace(one, known=1e-6 * one.known) for one in pair]
    known = [dataclasses.replace(one, known=1e9 * one.known) for one in pair]
    plain = information.promise(known, log, problem.noise).separations["one", "other"]
    assert plain > 100
    assert information.promise(unknown, log, problem.noise).separations["one", "other"] < 0.01 * plain


def test_the_same_run_again_halves_the_variance(bench, leaking):
    """A is X X' of the run and a prior that weighs little: the run once more makes the leak's error smaller by the root of 2."""
    _, log, problem = bench
    calm = [information.hypothesis("leak", leaking, problem)]
    found = information.promise(calm, dataclasses.replace(log, position=log.setpoint), problem.noise)
    assert found.errors[0] == pytest.approx(calm[0].numbers[0].standard_error / np.sqrt(2.0), rel=0.03)


def test_a_column_that_depends_on_its_step_is_no_knowledge():
    """Columns of two steps that are alike but for one stretch of a second are believed outside it, a tenth of a second away;
    where the number is known so well that their difference is far below the noise, everywhere."""
    time = np.arange(4000) * 1e-3
    fine = np.sin(2 * np.pi * 20.0 * time)[None, None]
    coarse = fine * np.where((time >= 1.0) & (time < 2.0), 1.5, 1.01)
    believed = columns.reproduced(fine, coarse, np.array([1.0]), 1000.0)
    assert believed[:900].all() and believed[2100:].all() and not believed[1100:1900].any()
    assert columns.reproduced(fine, coarse, np.array([1e-3]), 1000.0).all()


def test_friction_is_never_known_better_than_it_is_declared(bench, leaking):
    """Coulomb friction that changed by the same out and in trades with both declared numbers, 12 % of 65 and 60 N: however
    often a run is made, +-(65 + 60)/2 0.12/sqrt(6) = 3.06 N remain. A leak is told to a thousandth."""
    machine, log, problem = bench
    problem, effect = problem.with_input_uncertainty(machine), parameters.named("coulomb_friction_change")
    both = dataclasses.replace(
        least_squares.with_effects(leaking, [effect], 0.2, problem),
        values=({"conductance_m3_s_Pa": LEAK}, {"force_N": 1.0}),
    )
    one = information.hypothesis("both", both, problem)
    one = dataclasses.replace(one, fit=dataclasses.replace(both, covariance=np.linalg.inv(one.known)))
    told = information.promise([one], log, problem.noise).told
    assert told is not None
    often = ceiling_of(one, [30.0 * told])
    errors = {
        number.name: (error, why) for number, error, why in zip(one.numbers, often.errors, often.declared, strict=True)
    }
    assert errors["force_N"][0] == pytest.approx(3.06, rel=0.15)
    words = {f"coulomb_{way}_N is declared to 12 %" for way in ("extend", "retract")}
    assert set(errors["force_N"][1].split(" and ")) == words
    assert errors["conductance_m3_s_Pa"][0] < 1e-3 * LEAK


@pytest.mark.parametrize(
    ("effect", "name", "value", "nothing"),
    [
        ("spool_rate_limit", "frequency_Hz", 2000.0, True),  # its range ends there: no lag beside the limit
        ("spool_rate_limit", "frequency_Hz", 150.0, False),
        ("spool_rate_limit", "rate_m_s", 10.0, True),  # vanishes at infinity
        ("spool_rate_limit", "rate_m_s", 1e-5, False),
        ("entrained_air", "volume_fraction", 0.0, True),
        ("entrained_air", "volume_fraction", 0.3, False),  # the end of its range, and anything but nothing
    ],
)
def test_a_number_that_says_nothing_is_not_asked_for(effect, name, value, nothing):
    """It counts as known, whatever its error."""
    assert information.says_nothing(parameters.named(effect).effect, name, value) == nothing
    number = information.Number(effect=effect, name=name, value=value, standard_error=value, place=0, nothing=nothing)
    assert (number.relative == 0.0) == nothing


def test_small_realities_are_not_asked_for(bench, leaking):
    """Of a machine with a leak and a small delay beside it the leak alone is to be sharpened, at its own coordinate."""
    _, _, problem = bench
    beside = dataclasses.replace(
        least_squares.with_effects(leaking, [parameters.named("position_delay")], 0.1, problem), covariance=None
    )
    beside = dataclasses.replace(beside, candidates=beside.candidates[::-1], values=beside.values[::-1])
    k = len(beside.priors)
    asked = information.Hypothesis(
        label="", fit=beside, known=np.eye(k + 2), named=frozenset({"leakage_supply_to_chamber"})
    )
    assert [(number.effect, number.place) for number in asked.numbers] == [("leakage_supply_to_chamber", k + 1)]


@pytest.mark.slow
def test_a_tie_is_answered_by_a_scenario_file(bench, leaking):
    """For two hypotheses the file says which it separates and how far, and `hexsim run` can read it."""
    machine, _, problem = bench
    base = least_squares.refine(least_squares.start_fit(machine, leaking.priors, problem), problem, steps=3)
    rival = least_squares.refine(
        least_squares.with_effects(base, [parameters.named("dead_volume")], 0.3, problem), problem, steps=3
    )
    trace = SimpleNamespace(
        machine=machine, fit_problem=problem, final=leaking, ties=[{"dead_volume": rival}], verdict="explained",
        effects=[], unexplained=[], search=SimpleNamespace(stages=[]), rest=(),
    )  # fmt: skip
    found = next_measurement(trace, duration_s=5.0, first=8, rounds=0)
    text = found.text()
    assert text.startswith("# to separate leakage_supply_to_chamber, dead_volume")
    assert found.promise.separations["leakage_supply_to_chamber", "dead_volume"] > 100
    assert scenario_from_dict(tomllib.loads(text)).duration_s == 5.0
    assert found.numbers[0].value == pytest.approx(LEAK, rel=0.05)


def test_an_error_that_ends_at_a_bound_is_not_made_small_by_it(leaking):
    """A leak known to +-1e6 coordinates is reported to its bound; a thousandth of that is still beyond the bound, and is
    promised as such."""
    loose = dataclasses.replace(leaking, covariance=1e12 * np.eye(len(leaking.priors) + 1))
    one = information.Hypothesis(label="", fit=loose, known=np.eye(len(leaking.priors) + 1))
    share = np.full(len(leaking.priors) + 1, 1e-3)
    assert information.shrunk(one, share)[0] == pytest.approx(one.numbers[0].standard_error)
    calm = dataclasses.replace(one, fit=leaking)
    assert information.shrunk(calm, share)[0] == pytest.approx(1e-3 * calm.numbers[0].standard_error)


def test_what_stands_beside_every_name_is_no_part_of_one():
    """A ripple that is fitted in all hypotheses is in none of their names; what is sure stays, and a rival of it is told whole."""

    def fitted(*effects):
        return SimpleNamespace(fit=SimpleNamespace(candidates=[parameters.named(effect) for effect in effects]))

    ripple = "position_ripple"
    found = [fitted(ripple, "constant_force"), fitted(ripple, "incline"), fitted(ripple)]
    assert rest.labels_of(found, frozenset()) == ["constant_force", "incline", "nuisance effects alone"]
    found = [fitted("spring", ripple, "incline"), fitted("spring", ripple, "mass_change")]
    assert rest.labels_of(found, frozenset({"spring", "incline"})) == ["spring and incline", "spring and mass_change"]
    assert rest.labels_of(found[:1], frozenset({"incline"})) == ["incline"]


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """A bench of the second plant with a valve delay, traced by the balances alone on 10 s."""
    folder = tmp_path_factory.mktemp("late")
    effects = {"valve_delay": 6.0, "scale_ripple": 4e-6, "friction_warm_up": 0.08, "worn_bore": 3e-13}
    write_machine(folder, 3, effects, runs=("fit", "validate"), duration_s=10.0)
    trace = logs.begin(folder, ["fit"], ["validate"])
    for step in (violations.STEP, shapes.STEP, dominant.STEP):
        trace = step.run(trace, lambda doing: None)
    return trace


@pytest.mark.slow
def test_a_tie_of_a_partly_explained_machine_is_asked_about(late):
    """The balances tie the delay with a slow spool: its hypothesis stands in the delay's place, refitted, and is no better by
    the tie's own rule."""
    assert late.verdict == "partly"
    (first, _), (second, rival), *_ = surviving(late)
    assert (first, second) == (late.effects[0].candidate.label, late.effects[0].tied_with[0])
    assert {first, second} == {"valve_delay", "spool_lag"}
    assert second in [candidate.label for candidate in rival.candidates]
    assert first not in [c.label for c in rival.candidates if not rest_level.is_held(c)]
    rows = range(len(late.rest[0].sizes))
    assert not rest_evidence.worse(late.rest[0], late.rest[1], rows)
    assert np.abs(late.rest[1].sizes / late.rest[0].sizes - 1.0).max() < 0.1


@pytest.mark.slow
def test_what_a_motion_promises_of_a_rest_is_what_its_trace_finds(late):
    """Blocks that jump would separate the delay from the spool, the same within the limits and slow strokes do not; the refits
    of the trace itself say the same, and that the first number's error shrinks with the jumps."""
    asked = what_is_open(late)
    family = motions.MotionFamily(late.machine, 10.0)
    pair = asked.labels[:2]
    found = {}
    block = family.scenario(np.array((4, 0, 1.0, 0.3, 0.6, 0.5, 3)))
    slow = family.scenario(np.array((3, 0, 0.2, 0.0, 0.0, 0.5, 3)))
    jump = block | {"axes": {"leg_1": block["axes"]["leg_1"] | {"transition_s": 0.0}}}  # a host would not let it out
    assert family.beyond(jump) > 50.0
    for name, tables in {"jump": jump, "block": block, "slow": slow}.items():
        log = motions.setpoint_log(late.machine, tables)
        promised = asked.promise(log)
        found[name] = promised, asked.checked(log, promised)
    assert all(pair not in own.tied for own in found["jump"])
    assert all(pair in own.tied for name in ("block", "slow") for own in found[name])
    assert all(own.errors[0] < asked.first.numbers[0].standard_error for own in found["jump"])
    assert found["jump"][0].words(np.log(1.25)) == "the second leaves 25 % more mean square than the rest"


def test_an_error_that_hangs_on_a_small_reality_is_promised_with_that():
    """A delay of 6.9 +- 0.9 ms, promised to 0.1 ms beside a small spool that does nearly the same: the line says what else may be.
    Alone, or where little is promised, it says no more than the numbers."""
    delay = information.Number(effect="valve_delay", name="delay_s", value=6.9e-3, standard_error=9e-4, place=0)
    alone = "valve_delay delay_s = 0.0069: error 0.0009 now, 0.0001 expected"
    assert design_words.expected_words(delay, 1e-4, "") == alone
    assert design_words.expected_words(delay, 1e-4, "spool_lag").startswith(
        f"{alone}, about as now where a little spool_lag "
    )
    assert design_words.expected_words(delay, 8.9e-4, "spool_lag").endswith("0.00089 expected")


@pytest.mark.slow
def test_what_the_logs_show_is_nothing_that_an_error_hangs_on(late):
    """Two coordinates that go together after a motion: a number hangs on a nuisance effect where that is within its error of
    nothing now, and not where the logs show it."""
    asked = what_is_open(late)
    fit, own = asked.first.fit, asked.first.numbers[0].place
    held = [""] * len(fit.priors) + [c.label if rest_level.is_held(c) else "" for c in fit.candidates for _ in c.free()]
    here = np.abs(least_squares.coordinates_of(fit))
    small = max((k for k, label in enumerate(held) if label), key=lambda k: here[k])
    assert 1e-3 < here[small] < 1.0
    sizes, together = np.ones(len(held)), np.eye(len(held))
    together[own, small] = together[small, own] = -0.99
    for size, said in {1.0: held[small], 1e-3: ""}.items():
        sizes[small] = size
        now = dataclasses.replace(fit, covariance=np.diag(sizes**2))
        assert columns.hangs_on(now, dataclasses.replace(fit, covariance=together), [own]) == (said,)


@pytest.mark.slow  # the trace before it takes ten seconds; test_a_hypothesis_is_not_apart_from_itself
def test_the_motion_of_the_best_hypothesis_leaves_it_nothing(late):
    """As it would be measured, without its rest, every row of the best hypothesis is 0, and a copy is not apart from it. 1e-9 of
    the noise: the rest is taken at all samples and asked for at some, two orders of one sum."""
    asked = what_is_open(late)
    twice = dataclasses.replace(
        asked, labels=("one", "other"), found=(asked.best, asked.best), known=(asked.known[0], asked.known[0])
    )
    log = motions.setpoint_log(
        late.machine, motions.MotionFamily(late.machine, 10.0).scenario(np.array([4, 0, 1.0, 0.3, 0.6, 0.5, 3]))
    )
    seen = rest.as_measured(asked.best.fit, asked.problem, asked.simulated, log)
    assert np.abs(seen.residual(asked.best.fit.fitted_machine(), 0)).max() < 1e-9
    assert twice.promise(log).separations["one", "other"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow  # the same trace
def test_a_motion_into_a_cushion_is_not_asked_for(late):
    """Setpoints inside the stroke promise something; the same, stretched until the piston comes into a cushion, promise nothing."""
    asked = what_is_open(late)
    log = motions.setpoint_log(
        late.machine, motions.MotionFamily(late.machine, 10.0).scenario(np.array([4, 0, 1.0, 0.3, 0.6, 0.5, 3]))
    )
    mid = 0.5 * late.machine.cylinder.stroke_m
    reach = np.abs(log.setpoint - mid).max()
    stretched = dataclasses.replace(log, setpoint=mid + (log.setpoint - mid) * 2.0 * mid / reach)
    assert asked.promise(log).information > 0.0
    assert asked.promise(stretched).information == -np.inf


def test_a_tie_that_no_motion_separates_is_said_first():
    """The first line says so, and what would; with a motion that does it says what it is for."""
    pair = ("incline", "constant_force")
    stays = information.Promise(separations={pair: 5.0}, errors=(), information=0.0)
    assert design_words.purpose_of({}, pair, stays, (), None, 60.0) == (
        "no motion separates incline, constant_force; a load of 60 kg would"
    )
    assert design_words.purpose_of({}, pair, stays, (), None, None).startswith(
        "no motion separates incline, constant_force; another load"
    )
    assert design_words.purpose_of({}, pair, stays, (), None, None, alike=True).endswith(
        "separates incline, constant_force; they are one term, that no log takes apart: look at the machine"
    )
    goes = dataclasses.replace(stays, separations={pair: 500.0})
    assert design_words.purpose_of({}, pair, goes, (), None, None) == "to separate incline, constant_force"


@pytest.fixture(scope="module")
def carrying(bench):
    """The bench on which people can put 60 kg, with its log as the machine would write it with them."""
    machine, log, problem = bench
    able = changed(machine, {"load.additional_mass_kg": 60.0, "uncertainty.additional_mass_kg": 0.005})
    heavy = changed(machine, {"load.moving_mass_kg": 60.0 + machine.load.moving_mass_kg})
    return able, heavy, dataclasses.replace(problem, logs=(dataclasses.replace(log, loaded=True),))


def test_a_log_with_a_load_is_that_of_a_heavier_machine(bench, carrying):
    """Simulation and force balance of a log with the load on are those of the heavier machine, to the bit; without it they are
    those of the machine as declared."""
    machine, log, problem = bench
    able, heavy, loaded = carrying
    for own, there, one in ((heavy, problem, loaded), (machine, problem, problem)):
        assert np.array_equal(one.answer(able, 0), there.answer(own, 0))
        force = balances.balance_named("force", machine)
        assert np.array_equal(force.residual(one.logs[0], able), force.residual(log, own))


def test_a_load_that_is_said_is_no_other_machine(bench, carrying):
    """A log with 60 kg on and one without come from one machine where that is said, and from two where it is not."""
    machine, _, problem = bench
    able, _, loaded = carrying
    light, heavy = problem.simulated(machine, 0), loaded.simulated(able, 0)
    assert check_same_machine([light, heavy], able) == []
    found = check_same_machine([light, dataclasses.replace(heavy, loaded=False)], able)
    assert [one.severity for one in found] == ["refuse"]


def test_what_a_load_separates_is_designed_with_it(bench):
    """An incline of 0.3 rad and the constant force that does the same: no motion separates them, and 60 kg, which people can put
    on, do. The scenario says so, runs with the heavier machine, and says how its log is traced."""
    machine, _, problem = bench
    problem = problem.head(3.0)
    able = changed(machine, {"load.additional_mass_kg": 60.0})
    tilted = problem.simulated(changed(able, {"effects.incline.angle_rad": 0.3}), 0)
    seen = SimulatedProblem(logs=(tilted,), noise=problem.noise)
    bare, force = least_squares.start_fit(able, (), seen), 0.3**2 / 2 * machine.load.moving_mass_kg * 9.8
    fits = [
        least_squares.refine(
            dataclasses.replace(
                least_squares.with_effects(bare, [parameters.named(name)], 0.5, seen), values=(values,)
            ),
            seen,
            steps=4,
        )
        for name, values in (("incline", {"angle_rad": 0.3}), ("constant_force", {"force_N": force}))
    ]
    trace = SimpleNamespace(
        machine=able, fit_problem=seen, final=fits[0], ties=[{"constant_force": fits[1]}], verdict="explained",
        effects=[], unexplained=[], search=SimpleNamespace(stages=[]), rest=(),
    )  # fmt: skip
    found = next_measurement(trace, duration_s=3.0, first=8, rounds=0)
    assert found.purpose == "to separate incline, constant_force, with a load of 60 kg on it"
    assert found.tables["machine"] == {"load.moving_mass_kg": 60.0 + machine.load.moving_mass_kg}
    assert "put 60 kg on it; its log: hexsim trace ... --load 60 --loaded NAME" in found.lines()
    without = next_measurement(trace, duration_s=3.0, first=8, rounds=0, may_load=False)
    assert without.purpose == "no motion separates incline, constant_force; a load of 60 kg would"


def test_a_number_at_its_bound_does_not_end_a_design():
    """A coordinate that no log shows, in no motion, adds nothing to what a motion tells; the others count as they would alone."""
    before, after = np.diag([4.0, 0.0]), np.diag([16.0, 0.0])
    assert information.growth(before, after) == pytest.approx(0.5 * np.log(4.0), rel=1e-6)
    at_bound = information.Promise(separations={}, errors=(0.0, 1.0), information=1.0)
    assert at_bound.worth(0) == at_bound.worth(1) == 1.0


def test_a_load_is_said_of_a_log_that_is_there():
    """A load on a log that is not traced, and one that nobody has weighed, are one sentence each."""
    folder = DATA / "bench_leakage"
    with pytest.raises(HexsimError, match="log sweep is said to have a load on and is not traced"):
        logs.begin(folder, ["fit"], ["validate"], 60.0, ["sweep"])
    with pytest.raises(HexsimError, match="log fit has a load on: say what it weighs"):
        logs.begin(folder, ["fit"], ["validate"], None, ["fit"])


@pytest.mark.slow
def test_from_a_tie_to_the_load_that_resolves_it(tmp_path):
    """From the command line: a bench of the second plant, inclined by 0.3 rad, whose first trace ties the incline with a constant
    force. `--next` asks for the 60 kg; people put them on, 0.3 % more than they say; both logs name the incline alone. The
    0.18 kg are 4 % of what 100 kg lose by it, and so 2 % of the angle."""
    plant = write_machine(tmp_path, 11, {"incline": 0.3}, runs=("fit", "validate"), suffix=".csv")
    place = tmp_path / "next.toml"
    common = ["trace", str(tmp_path), "--fit", "fit", "--load", "60", "--no-recording", "--json", "--out"]
    first = CliRunner().invoke(app, [*common, str(tmp_path / "one"), "--next", str(place)])
    assert first.exit_code == 0
    (effect,) = json.loads(first.stdout)["effects"]
    assert {effect["name"], *effect["tied_with"]} >= {"incline", "constant_force"}
    assert place.read_text().startswith("# to separate ")
    assert "with a load of 60 kg on it" in place.read_text().partition("\n")[0]
    scenario = scenario_from_dict(tomllib.loads(place.read_text()))
    held = np.floor(np.arange(round(scenario.duration_s * 1000)) / 2 + 1e-6) / 500
    plant.rig["mass"] += 60.0 * 1.003
    setpoint = scenario.evaluate(held)[0][:, :1] + 0.5 * plant.legs["stroke"][0]
    log = measured(plant, driven(plant, setpoint), np.random.default_rng(5))
    pl.DataFrame(log).write_csv(tmp_path / "loaded.csv")
    second = CliRunner().invoke(app, [*common, str(tmp_path / "two"), "--fit", "loaded", "--loaded", "loaded"])
    assert second.exit_code == 0
    (effect,) = json.loads(second.stdout)["effects"]
    assert (effect["name"], effect["tied_with"]) == ("incline", [])
    assert effect["parameters"]["angle_rad"] == pytest.approx(0.3, rel=0.02)
