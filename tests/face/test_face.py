"""The public face: what `import hexsim as hx` gives, and that it is the same as the commands'."""

import ast
import doctest
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import hexsim as hx
from compensation import create
from hexsim.identification import record
from hexsim.machine import load_machine

ROOT = Path(__file__).parents[2]
SHORT = {"scenario.duration_s": 4.0}
EXAMPLES = [
    test
    for name in ("given", "runs", "measured", "linear", "show")
    for test in doctest.DocTestFinder(exclude_empty=True).find(
        import_module(f"hexsim.face.{name}"), extraglobs={"hx": hx}
    )
    if test.examples and test.name.startswith(f"hexsim.face.{name}")
]


@pytest.fixture(scope="module")
def heave():
    """The bench's heave of 6 s."""
    return hx.run("heave", "bench", set={"scenario.duration_s": 6.0})


@pytest.fixture(scope="module")
def both():
    """Plain control and the exact inverse."""
    return hx.compare("heave", ["none", "exact"], "bench", set={"scenario.duration_s": 6.0})


def test_importing_hexsim_loads_nothing_heavy():
    """`import hexsim` loads neither MuJoCo nor numba nor matplotlib; the first machine needs no simulator."""
    code = (
        "import sys, hexsim as hx; heavy = {'mujoco', 'numba', 'matplotlib', 'numpy', 'polars', 'pydantic'};"
        "print(sorted(heavy & set(sys.modules))); hx.load_machine('bench');"
        "print(sorted({'mujoco', 'matplotlib'} & set(sys.modules)))"
    )
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ended.stdout.split("\n")[:2] == ["[]", "[]"]


def test_every_name_of_the_face_is_there_with_a_docstring_and_its_type():
    """Each name of __all__ can be had, says what it does, and is what the stub for type checkers says."""
    stub = ast.parse((ROOT / "hexsim" / "__init__.pyi").read_text())
    typed = {
        alias.asname: node.module for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert sorted([*typed, "__version__"]) == sorted(hx.__all__) and set(hx.__all__) <= set(dir(hx))
    for name, module in typed.items():
        assert getattr(hx, name) is getattr(import_module(str(module)), str(name))
        assert len(getattr(hx, name).__doc__) > 60, name
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = hx.simulat


def test_the_names_stay_functions_whatever_is_imported():
    """No package of hexsim has the name of a function of the face, which importing it would put in its place."""
    assert not {path.stem for path in (ROOT / "hexsim").iterdir()} & set(hx.__all__)


RUN_HERE = [test for test in EXAMPLES if not all(doctest.SKIP in one.options for one in test.examples)]


@pytest.mark.parametrize("example", RUN_HERE, ids=lambda test: test.name.removeprefix("hexsim.face."))
def test_examples_of_the_docstrings_hold(example, monkeypatch):
    """Each example of the face's docstrings gives what stands below it; tests below hold those that take longer."""
    monkeypatch.chdir(ROOT)
    said: list[str] = []
    result = doctest.DocTestRunner().run(example, out=said.append)
    assert result.failed == 0 and result.attempted > 0, "".join(said)


def test_every_function_of_the_face_has_an_example():
    """Functions that load, run, compare, sweep, trace, identify, qualify and linearize show a call."""
    shown = {test.name.rpartition(".")[2] for test in EXAMPLES}
    functions = {name for name in hx.__all__ if name[0].islower()}
    assert functions <= shown and "Machine" in shown


def test_names_and_objects_are_taken_alike():
    """Machine, scenario and compensator by name, by path and as objects give the same log to the bit."""
    by_name = hx.run("heave", "bench", "exact", set=SHORT)
    machine, scenario = hx.load_machine(ROOT / "models" / "bench"), hx.load_scenario("heave", duration_s=4.0)
    by_object = hx.run(scenario, machine, create("exact"))
    assert by_object.log.equals(by_name.log) and by_object.compensator == "exact"
    assert hx.run(scenario, machine, set={"valve.overlap_m": np.float64(0.0)}).machine.valve.overlap_m == 0.0
    table = {"effects": {"null_offset": {"offset_V": 0.01}}}
    assert hx.run(scenario, machine, set=table).machine == machine.with_(table) != machine


def test_a_changed_machine_is_another_one(tmp_path):
    """`with_` leaves the machine as it is; written into a folder and read again it is the same."""
    machine = hx.load_machine("servo_bench")
    changed = machine.with_({"load.moving_mass_kg": 77.0}).with_({"supply.pressure_Pa": np.float64(8e6)})
    assert (changed.load.moving_mass_kg, changed.supply.pressure_Pa) == (77.0, 8e6)
    assert machine == hx.load_machine("servo_bench") != changed
    assert hx.load_machine(changed.to_folder(tmp_path / "mine")) == changed
    assert "77 kg" in repr(changed) and len(repr(changed)) < 120


def test_a_run_shows_itself_and_leaves_what_the_command_leaves(heave, tmp_path):
    """Log and figures as table and dict; repr is short, HTML names the axis, pictures are PNG, the folder is whole."""
    assert isinstance(heave.log, pl.DataFrame) and heave.log.height == 6000 and heave.complete
    assert heave.figures["leg"] == heave.summary["axes"]["leg"]
    assert "heave on bench" in repr(heave) and len(repr(heave)) < 120
    assert "<td>leg</td>" in heave._repr_html_()
    picture = heave.plot("flow_curve")
    assert picture._repr_png_().startswith(b"\x89PNG") and picture.figure.axes
    assert picture.save(tmp_path / "flow.png").read_bytes() == picture.png
    place = heave.to_folder(tmp_path / "run", recording=False, report=False)
    assert {"log.parquet", "summary.json", "config.toml"} <= {path.name for path in place.iterdir()}
    assert hx.load_log(place / "log.parquet")["position_m"].to_list() == heave.log["position_m"].to_list()
    assert hx.load_machine(place) == heave.machine


def test_a_comparison_is_its_runs_side_by_side(both, heave, tmp_path):
    """The run without compensation is that of `run`; the table has a row a compensator, the exact one below."""
    assert both["none"].log.equals(heave.log) and list(both) == ["none", "exact"]
    rows = both.table.select("compensator", "ratio").rows()
    peaks = [both.figures[name]["leg"]["peak_band_m_s2"] for name in both]
    assert rows == [("none", 1.0), ("exact", pytest.approx(peaks[1] / peaks[0]))] and rows[1][1] < 1.0
    assert "none" in both._repr_html_() and "exact" in repr(both)
    assert both.plot()._repr_png_().startswith(b"\x89PNG")
    place = both.to_folder(tmp_path / "both", recording=False)
    assert {"compare.json", "report.html", "logs"} <= {path.name for path in place.iterdir()}


def test_a_row_of_a_sweep_is_the_run_with_its_values(tmp_path):
    """Rows come in the order of the grid with settings and figures; the same call goes on in its table."""
    grid, values, counted = (
        {"valve.overlap_m": np.array([0.0, 2e-5])},
        {"seeds": [3], "out": tmp_path / "t.parquet"},
        [],
    )
    table = hx.sweep("heave", grid, "bench", SHORT, **values)
    one = hx.run("heave", "bench", set={**SHORT, "valve.overlap_m": 2e-5}, seed=3, fast=True)
    assert table["valve.overlap_m"].to_list() == [0.0, 2e-5] and table["error"].null_count() == 2
    assert table["leg_peak_band_m_s2"][1] == one.figures["leg"]["peak_band_m_s2"]
    again = hx.sweep("heave", grid, "bench", SHORT, progress=lambda *now: counted.append(now), **values)
    assert counted == [(2, 2, 0)] and again.equals(table)


MISTAKES = {
    "unknown machine 'bensh': did you mean bench": lambda: hx.load_machine("bensh"),
    "unknown scenario 'heve': did you mean heave": lambda: hx.run("heve"),
    "a scenario is 3: give a name": lambda: hx.run(3),  # type: ignore[arg-type]
    "a machine is 3: give a name": lambda: hx.run("heave", 3),  # type: ignore[arg-type]
    "a compensator is 3: give a name": lambda: hx.run("heave", "bench", 3),  # type: ignore[arg-type]
    "no compensator is called 'adaptiv'": lambda: hx.run("heave", "bench", "adaptiv"),
    "overlap is not a known key: did you mean overlap_m": lambda: hx.run("heave", "bench", set={"valve.overlap": 1.0}),
    "with_: overlap_m names no table|with_: .*overlap_m": lambda: hx.load_machine("bench").with_({"overlap_m": 1.0}),
    "set is 3: give a mapping": lambda: hx.run("heave", "bench", set=3),  # type: ignore[arg-type]
    "seed is -1": lambda: hx.run("heave", "bench", seed=-1),
    "timestep is 1: give 1e-06": lambda: hx.run("heave", "bench", timestep=1),
    "host is 7": lambda: hx.run("heave", "bench", host=7),  # type: ignore[arg-type]
    "host 'often' is none": lambda: hx.run("heave", "bench", host="often"),
    "duration_s is 'long': give a number": lambda: hx.load_scenario("heave", duration_s="long"),  # type: ignore[arg-type]
    "is changed by set": lambda: hx.load_scenario(hx.load_scenario("heave"), duration_s=3.0),
    "compensators is 'none': give a list": lambda: hx.compare("heave", "none"),
    "no compensator is called 'nome'": lambda: hx.compare("heave", ["nome"], "bench"),
    "grid: valve.overlap_m is 3: give a list": lambda: hx.sweep("heave", {"valve.overlap_m": 3}),  # type: ignore[dict-item]
    "workers is 0": lambda: hx.sweep("heave", {}, workers=0),
    "a compensator of a sweep": lambda: hx.sweep("heave", {}, compensators=[create("exact")]),  # type: ignore[list-item]
    "bench has no axis 'x': give one of z": lambda: hx.linearize("bench", {"x": 1.0}),
    "out of reach": lambda: hx.linearize("bench", {"z": 1.0}),
    "six finite numbers": lambda: hx.linearize("bench", [1.0]),
    "no machine file": lambda: hx.trace("nowhere/there"),
    "no log 'nope'": lambda: hx.trace(ROOT / "tests" / "data" / "bench_leakage", "nope"),
    "fit is 3": lambda: hx.trace("bench", 3),  # type: ignore[arg-type]
    "ADDRESS:PORT": lambda: hx.identify("bench", "out", "here"),
    "minutes is 0": lambda: hx.identify("bench", "out", minutes=0),
    "a log is 3": lambda: hx.load_log(3),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("sentence", MISTAKES)
def test_a_mistake_is_a_sentence(sentence):
    """Every mistake raises HexsimError, in one sentence that says what is wrong and what to give."""
    with pytest.raises(hx.HexsimError, match=sentence) as told:
        MISTAKES[sentence]()
    assert "\n" not in str(told.value)


def test_a_picture_that_is_not_there_is_named(heave, both):
    """An unknown picture names those there are; a log too short for any says so."""
    with pytest.raises(hx.HexsimError, match="no picture 'spektrum': did you mean spectrum"):
        heave.plot("spektrum")
    with pytest.raises(hx.HexsimError, match="no picture 'z': give one of leg"):
        both.plot("z")
    with pytest.raises(hx.HexsimError, match="needs a log of 100 rows"):
        hx.run("heave", "bench", set={"scenario.duration_s": 0.05}).plot()


def test_an_identification_is_its_story(monkeypatch, tmp_path):
    """Rounds as a table, why it ended, the machine by name or as an object; the page is written where it belongs."""
    asked = {}

    def told(machine, address, minutes, out, show, **options):
        asked.update(address=address, minutes=minutes, machine=load_machine(machine), **options)
        rounds = [
            record.Round(
                number=1, purpose="rich", log="round_1", verdict="explained", sentences=(), effects=[], error={}
            )
        ]
        return record.Story(machine=load_machine("bench"), folder=out, rounds=rounds, ended="nothing is left")

    monkeypatch.setattr("hexsim.identification.identify", told)
    changed = hx.load_machine("bench").with_({"load.moving_mass_kg": 50.0})
    done = hx.identify(changed, tmp_path, "10.0.0.7:47110", minutes=2, largest=0.5)
    assert asked["machine"] == load_machine(changed.to_folder(tmp_path / "m")) and asked["largest"] == 0.5
    assert asked["address"] == ("10.0.0.7", 47110) and asked["minutes"] == 2
    assert done.rounds.rows() == [(1, "explained", "rich", "")] and "1 rounds; nothing is left" in repr(done)
    assert (done.to_folder() / "report.html").is_file() and "<td>explained</td>" in done._repr_html_()
    with pytest.raises(hx.HexsimError, match="no round was finished"):
        done.plot()


@pytest.mark.slow
def test_a_trace_is_that_of_the_command(tmp_path):
    """The leak of a bench: verdict, effect with its number, pictures, files, and the fitted machine, which runs."""
    done = hx.trace(ROOT / "tests" / "data" / "bench_leakage", ["fit", "sweep"])
    assert repr(done) in str(hx.trace.__doc__)
    row = done.effects.row(0, named=True)
    assert row["value"] == pytest.approx(1.8e-12, rel=1e-3) and row["standard_error"] < 1e-15
    assert "leakage supply to chamber" in done._repr_html_() and done.budget["multiple_of_noise"].min() < 1.1
    assert done.plot("balances")._repr_png_().startswith(b"\x89PNG")
    assert {"report.html", "report.json", "machine.toml"} <= {p.name for p in done.to_folder(tmp_path / "t").iterdir()}
    assert hx.run("heave", done.fitted, set=SHORT).complete
