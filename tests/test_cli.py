"""The command line as people use it: what it prints, what it leaves, and one clear sentence for every mistake."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Annotated

import polars as pl
import pytest
import typer
from typer.testing import CliRunner

import hexsim
from hexsim.cli import app
from hexsim.files import log_files

ROOT = Path(hexsim.__file__).parents[1]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "120"}
BENCH = ["-m", "bench", "--fast"]


def hexsim_command(*arguments: str, cwd: Path):
    """Run in this process; the result has exit_code, stdout and stderr."""
    before = Path.cwd()
    os.chdir(cwd)
    try:
        return CliRunner().invoke(app, list(arguments))
    finally:
        os.chdir(before)


def sentence(result) -> str:
    """The one line on stderr of a refused command: exit code 2, no traceback, nothing on stdout."""
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("hexsim: ") and "Traceback" not in result.stderr
    return lines[0]


# ---- what works ------------------------------------------------------------------------------------------------------


def test_the_version_is_that_of_the_package():
    """`hexsim --version` prints it and ends with 0."""
    result = CliRunner().invoke(app, ["--version"])
    assert result.exit_code == 0 and result.output == f"hexsim {hexsim.__version__}\n"


def test_the_command_line_without_its_script():
    """`python -m hexsim` is the same command line: a script folder need not be on the path."""
    command = [sys.executable, "-m", "hexsim", "--version"]
    answer = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=60, check=True)
    assert answer.stdout == f"hexsim {hexsim.__version__}\n"


def test_run_leaves_a_folder_and_prints_its_table(tmp_path):
    """`hexsim run heave` on the hexapod: files as documented, every axis in the table, the driven one first."""
    result = hexsim_command("run", "heave", "--fast", "--duration", "3", cwd=tmp_path)
    assert result.exit_code == 0, result.stderr
    (folder,) = (tmp_path / "runs").glob("*/")
    assert (tmp_path / "runs" / "index.html").is_file()
    names = {path.name for path in folder.iterdir()}
    assert names == {"log.parquet", "run.rrd", "summary.json", "config.toml", "report.html", "figures"}
    assert folder.name.endswith("-heave")
    assert re.search(r"heave z +\S+ +\d.*\n *surge x", result.stdout)
    for text in ("peak 50 Hz", "noise rms", "tracking rms", "real-time factor", "tendon model", "0.7 %", folder.name):
        assert text in result.stdout
    summary = json.loads((folder / "summary.json").read_text())
    assert set(summary["axes"]) == {"x", "y", "z", "roll", "pitch", "yaw"}
    assert summary["duration_s"] == pytest.approx(3.0)


def test_json_is_all_that_stands_on_stdout(tmp_path):
    """--json prints summary.json and nothing else; a bench has the one axis `leg`."""
    out = tmp_path / "out"
    result = hexsim_command("run", "heave", *BENCH, "--duration", "1", "--out", str(out), "--json", cwd=tmp_path)
    assert json.loads(result.stdout) == json.loads((out / "summary.json").read_text())
    assert list(json.loads(result.stdout)["axes"]) == ["leg"]


def test_options_reach_the_run(tmp_path):
    """Amplitude, frequency, duration, seed, compensator and --set stand in config.toml as they were given."""
    out = tmp_path / "out"
    result = hexsim_command(
        "run",
        "heave",
        *BENCH,
        "--amplitude",
        "0.02",
        "--frequency",
        "0.8",
        "--duration",
        "1",
        "--seed",
        "7",
        "--compensator",
        "buffered",
        "--set",
        "valve.overlap_m=2e-5",
        "--set",
        "scenario.fade_s=0.5",
        "--out",
        str(out),
        "--no-recording",
        "--no-report",
        "--log-format",
        "csv.gz",
        cwd=tmp_path,
    )
    assert result.exit_code == 0, result.stderr
    assert {path.name for path in out.iterdir()} == {"log.csv.gz", "summary.json", "config.toml", "learned.json"}
    config = tomllib.loads((out / "config.toml").read_text())
    signal_asked = config["scenario"]["axes"]["z"]
    assert (signal_asked["kind"], signal_asked["amplitude"], signal_asked["frequency_Hz"]) == ("sine", 0.02, 0.8)
    assert config["scenario"]["fade_s"] == 0.5 and config["scenario"]["duration_s"] == 1.0
    assert config["machine"]["valve"]["overlap_m"] == 2e-5
    assert (config["run"]["seed"], config["run"]["compensator"]) == (7, "buffered")


def test_same_seed_same_log(tmp_path):
    """Two runs with one seed write the same log to the bit, another seed another one."""
    logs = {}
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        arguments = ("--duration", "0.5", "--seed", seed, "--out", name, "--no-recording", "--no-report")
        assert hexsim_command("run", "heave", *BENCH, *arguments, cwd=tmp_path).exit_code == 0
        logs[name] = log_files.read_log(tmp_path / name / "log.parquet")
    assert logs["a"].equals(logs["b"]) and not logs["a"].equals(logs["c"])


def test_a_scenario_file_is_a_scenario(tmp_path):
    """A TOML file of the user's runs like a name of the list, on the machine it names."""
    text = 'name = "mine"\nmode = "dof"\nduration_s = 0.5\nfade_s = 0.1\nmachine_name = "bench"\n'
    (tmp_path / "mine.toml").write_text(text + '[axes.z]\nkind = "sine"\namplitude = 0.01\nfrequency_Hz = 2.0\n')
    result = hexsim_command("run", "mine.toml", "--fast", "--json", "--out", "out", "--no-report", cwd=tmp_path)
    summary = json.loads(result.stdout)
    assert (summary["scenario"], summary["machine"]) == ("mine", "bench")


def test_compare_prints_a_row_a_compensator(tmp_path):
    """`hexsim compare`: table, compare.json, figure, report and one recording."""
    out = tmp_path / "out"
    arguments = ("compare", "heave", *BENCH, "--compensators", "none,exact", "--duration", "1", "--out", str(out))
    result = hexsim_command(*arguments, cwd=tmp_path)
    assert result.exit_code == 0, result.stderr
    assert re.search(r"^none .*\n *exact ", result.stdout, re.MULTILINE)
    names = {path.name for path in out.iterdir()}
    assert names == {"compare.json", "config.toml", "figures", "logs", "report.html", "run.rrd"}


@pytest.mark.parametrize("what", ["machines", "scenarios", "compensators", "effects"])
def test_lists_say_what_there_is(tmp_path, what):
    """Each list names what it has, as a table and as JSON."""
    known = {"machines": "bench", "scenarios": "heave", "compensators": "buffered", "effects": "entrained_air"}[what]
    assert known in hexsim_command("list", what, cwd=tmp_path).stdout
    rows = json.loads(hexsim_command("list", what, "--json", cwd=tmp_path).stdout)
    assert known in [row["name"] for row in rows]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        *((name, f"list {name}") for name in ("machines", "scenarios", "compensators", "effects")),
        ("measure", "test log"),
        ("valve", "test valve"),
        ("schema", "export schema"),
    ],
)
def test_an_old_command_is_refused_with_the_new_one(tmp_path, old, new):
    """Exit code 2 and one sentence with a command that there is."""
    refused = hexsim_command(old, "bench", cwd=tmp_path)
    (line,) = refused.stderr.splitlines()
    assert refused.exit_code == 2 and not refused.stdout and line == f"hexsim: hexsim {old} is now hexsim {new}"
    assert hexsim_command(*new.split(), "--help", cwd=tmp_path).exit_code == 0


def test_run_takes_many(tmp_path):
    """Compensators with commas: what `compare` writes; values with commas: the table of `sweep`; options of one run are refused."""
    short = (*BENCH, "--duration", "0.5")
    several = hexsim_command(
        "run", "heave", *short, "-c", "none,exact", "--no-recording", "--out", "several", cwd=tmp_path
    )
    assert several.exit_code == 0, several.stderr
    table = json.loads((tmp_path / "several" / "compare.json").read_text())
    assert list(table["compensators"]) == ["none", "exact"]
    grid = hexsim_command(
        "run",
        "heave",
        *short,
        "-c",
        "none,exact",
        "--set",
        "valve.overlap_m=0,5e-6",
        "--seed",
        "3",
        "--json",
        cwd=tmp_path,
    )
    rows = pl.read_parquet(tmp_path / json.loads(grid.stdout)["table"])
    assert rows.height == 4 and set(rows["valve.overlap_m"]) == {0.0, 5e-6} and set(rows["seed"]) == {3}
    for many in (("-c", "none,exact"), ("--set", "valve.overlap_m=0,5e-6")):
        refused = hexsim_command("run", "heave", *short, *many, "--mcap", cwd=tmp_path)
        assert refused.exit_code == 2 and "--mcap: of one run" in refused.stderr


def test_help_is_quick_and_loads_no_simulator():
    """`hexsim --help` imports neither MuJoCo, numba, matplotlib nor Rerun: people wait for it."""
    heavy = "{'mujoco', 'numba', 'matplotlib', 'rerun', 'scipy', 'polars'}"
    code = (
        f"import sys; import hexsim.cli; sys.exit(str({heavy} & set(sys.modules)) if {heavy} & set(sys.modules) else 0)"
    )
    ended = subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


def test_tracing_loads_no_simulator_of_platforms():
    """A trace answers its logs by its own simulation: it waits neither for MuJoCo nor, before it records, for Rerun."""
    code = "import sys; import hexsim.tracing.trace; sys.exit(', '.join({'mujoco', 'rerun'} & set(sys.modules)) or 0)"
    ended = subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


def test_a_run_loads_what_it_uses(tmp_path):
    """A run without recording and report loads neither Rerun nor matplotlib nor the parts of scipy that take long. One with a recording
    loads no pandas, which pyarrow, below Rerun, would load where it is installed (0.3 s); asked for a frame, pyarrow still finds it."""
    heavy = ["matplotlib", "rerun", "jinja2", "pandas", "sympy"]
    heavy += [f"scipy.{part}" for part in ("signal", "stats", "optimize", "interpolate", "ndimage", "spatial")]
    arguments = ["run", "heave", "--machine", "bench", "--set", "scenario.duration_s=3", "--no-report", "--out"]
    code = (
        "import sys; from hexsim.cli import app; "
        f"app({[*arguments, str(tmp_path / 'plain'), '--no-recording']}, standalone_mode=False); "
        f"loaded = [name for name in {heavy} if name in sys.modules]; assert not loaded, loaded; "
        f"app({[*arguments, str(tmp_path / 'recorded')]}, standalone_mode=False); "
        "assert 'pandas' not in sys.modules, 'loaded'; "
        "import pyarrow; assert pyarrow.table({'a': [1.0]}).to_pandas().shape == (1, 1)"
    )
    ended = subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr[-300:]
    assert (tmp_path / "plain" / "summary.json").is_file() and (tmp_path / "recorded" / "run.rrd").is_file()


def test_help_says_units():
    """Units stand in the help of the options that have one; brackets would be taken for markup and dropped."""
    shown = " ".join(CliRunner(env={"COLUMNS": "200"}).invoke(app, ["run", "--help"]).stdout.split())
    for text in ("driven axes (m, or degrees for rotations)", "driven axes (Hz)", "Simulated time (s)"):
        assert text in shown


# ---- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "description"),
    [
        (("run", "heavy"), r"unknown scenario 'heavy'.*combined.*heave.*yaw"),
        (("run", "heave", "-m", "nowhere"), r"unknown machine 'nowhere'.*bench, micro_motion_system"),
        (("run", "heave", "-c", "magic"), r"'magic'.*none.*buffered.*package\.module:Class"),
        (("run", "heave", "-c", "json:JSONDecoder"), r"'json:JSONDecoder'.*lacks start, step, parameters, restore"),
        (("compare", "heave", "-c", "none,magic"), r"'magic'.*none.*buffered"),
        (("run", "heave", "--set", "valve.overlap_m"), r"not key=value.*valve\.overlap_m=20e-6"),
        (("run", "heave", "--set", "valve.overlap=1"), r"overlap.*not a known key.*overlap_m"),
        (("run", "heave", "--set", "valve.overlap_m=1"), r"overlap"),
        (("run", "heave", "--set", "scenario.colour=1"), r"colour is not a known key: allowed are"),
        (("run", "heave", "--amplitude", "0.5"), r"t = .* s.*leg \d.* m long, allowed is"),
        (("run", "heave", "--duration", "-1"), r"duration_s = -1\.0: .*greater than 0"),
        (
            ("run", "heave", "-m", "bench", "--amplitude", "0.11"),
            r"t = .* leg 1 has the setpoint .* outside 0\.\.0\.2 m",
        ),
        (("view", "nowhere"), r"nowhere is no folder"),
        (("run", "x" * 300), r"unknown scenario 'x+\.\.\. \(302 characters\): give one of combined"),
        (("run", "heave", "-m", "x" * 300), r"unknown machine 'x+\.\.\. \(302 characters\): give one of bench"),
        (("run", "heave", "--duration", "86400", "-m", "bench", "--set", "sensors.log_rate_Hz=10000"), r"GB are free"),
        (("run", "heave", "--duration", "0.5", "-m", "bench", "--set", "sensors.log_rate_Hz=1"), r"two samples of the"),
        (("run", "heave", "--set", "valve.overlap_m=" + "[" * 5000), r"\[valve\] overlap_m = '\[+\.\.\. "),
        (("run", "heave", "--set", "valve.overlap_m=" + "9" * 5000), r"\[valve\] overlap_m = '9+\.\.\. "),
        (("sweep", "heave", "--seeds", "-1:3", "--out", "t.parquet"), r"--seeds '-1:3' is neither .* from 0 on"),
        (
            ("sweep", "heave", "--seeds", "0:1000000000", "--out", "t.parquet"),
            r"a sweep of 1000000000 runs: give at most",
        ),
        (("sweep", "heave", "--seeds", "a", "--out", "t.parquet"), r"--seeds 'a' is neither"),
        (("sweep", "heave", "--seeds", "3:3", "--out", "t.parquet"), r"holds no seed"),
    ],
)
def test_mistakes_end_in_one_sentence(tmp_path, arguments, description):
    """Unknown names list what there is, wrong values say what is allowed; exit code 2 and nothing is left behind."""
    assert re.search(description, sentence(hexsim_command(*arguments, cwd=tmp_path)))
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_folder_with_a_scenarios_name_does_not_hide_the_scenario(tmp_path):
    """Beside a folder heave, as `--out heave` leaves it, heave is still the scenario; another folder is told what it lacks."""
    (tmp_path / "heave").mkdir()
    (tmp_path / "mine").mkdir()
    said = sentence(hexsim_command("run", "heave", "--duration", "-1", cwd=tmp_path))
    assert "duration" in said and "folder" not in said
    assert "mine is a folder" in sentence(hexsim_command("run", "mine", cwd=tmp_path))


def test_usage_errors_end_with_code_2(tmp_path):
    """A wrong option is named on stderr."""
    result = hexsim_command("run", "heave", "--colour", "red", cwd=tmp_path)
    assert result.exit_code == 2 and "--colour" in result.stderr and "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("old", "new", "description"),
    [
        ("stroke_m = ", "stroke_mm = ", r"\[cylinder\].*stroke_m"),  # a missing key, and one in a wrong unit
        ("discharge_coefficient = ", "discharge_coefficient = -", r"\[valve\] discharge_coefficient"),
        ("piston_diameter_m = ", "piston_diameter_m = 1e-3 # ", r"rod_diameter_m.*piston_diameter_m"),
        ("[valve]", "[valve", r"not valid TOML"),
    ],
)
def test_bad_machine_files_name_table_and_key(tmp_path, old, new, description):
    """A machine file with a missing key, impossible value or broken TOML: one sentence with file, table and key."""
    text = (ROOT / "models" / "bench" / "machine.toml").read_text()
    assert old in text
    (tmp_path / "machine.toml").write_text(text.replace(old, new))
    said = sentence(hexsim_command("run", "heave", "-m", "machine.toml", cwd=tmp_path))
    assert re.search(description, said) and "machine.toml" in said


@pytest.mark.parametrize(
    ("rows", "description"),
    [("0,0\n0.1,nan\n0.2,0\n", r"(?i)nan|finite"), ("0,0\n0.2,0\n0.1,0\n", r"(?i)order|rise|increas|before|after")],
)
def test_bad_setpoint_files_name_the_place(tmp_path, rows, description):
    """A user's setpoints with a NaN or out of order are refused, naming the file."""
    (tmp_path / "mine.csv").write_text("time_s,z_m\n" + rows)
    said = sentence(hexsim_command("run", "mine.csv", cwd=tmp_path))
    assert re.search(description, said) and "mine.csv" in said


def test_an_unwritable_folder_is_refused_before_the_run(tmp_path, monkeypatch):
    """Nothing is simulated for a folder that cannot be written."""
    (tmp_path / "file").write_text("")

    def simulate(*arguments, **options):
        raise AssertionError("the run must not begin")

    monkeypatch.setattr("hexsim.simulation.simulate", simulate)
    monkeypatch.setattr("hexsim.studies.compare.simulate", simulate)
    for command in (("run",), ("compare",)):
        said = sentence(hexsim_command(*command, "heave", "--out", "file/run", cwd=tmp_path))
        assert re.search(r"cannot write the folder file/run: .*give --out", said)


# ---- what ends early -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "number", [signal.SIGINT, *(pytest.param(one, marks=pytest.mark.slow) for one in (signal.SIGTERM, signal.SIGHUP))]
)
def test_an_interrupted_run_keeps_its_log(tmp_path, number):
    """Ctrl-C (SIGTERM, a closed terminal) in the middle: exit code 130, as a shell gives it, one sentence, a folder -partial
    whose log can be read."""
    arguments = ["run", "heave", *BENCH, "--duration", "400", "--out", "run", "--no-recording", "--no-report"]
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE, *arguments],
        cwd=tmp_path,
        env=ENVIRONMENT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "simulating\n"
        time.sleep(0.2)
        process.send_signal(number)
        _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    said = r"hexsim: interrupted by the user at t = \S+ s; the log so far is in \S*run-partial"
    assert re.fullmatch(said, stderr.strip().splitlines()[-1]), stderr  # before it: progress
    folder = tmp_path / "run-partial"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["partial"] is True and summary["reason"].startswith("interrupted by the user at t = ")
    log = pl.read_parquet(folder / "log.parquet")
    assert 0 < log["time_s"][-1] < 400 and log["position_m"].is_finite().all()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run-partial"]


# says when the first tenth of a second is simulated: the signal must not come while Python imports or numba compiles
INTERRUPTIBLE = """
from hexsim.cli import main
from hexsim.plant.plant import Plant
once = []
def said(self, inner=Plant.check):
    inner(self)
    if not once:
        once.append(print("simulating", flush=True))
Plant.check = said
main()
"""


def test_a_diverged_run_says_when_and_keeps_its_log(tmp_path):
    """One gram on the oil's spring is too quick for the time step: exit code 2, time and leg, and the log so far."""
    result = hexsim_command(
        "run", "heave", *BENCH, "--set", "load.moving_mass_kg=0.001", "--out", "run", "--duration", "2", cwd=tmp_path
    )
    assert result.exit_code == 2 and "Traceback" not in result.stderr
    assert re.search(r"diverged at t = 0\.\d+ s in leg 1.*the log so far is in .*run-partial", result.stderr)
    assert len(result.stderr.strip().splitlines()) == 1
    summary = json.loads((tmp_path / "run-partial" / "summary.json").read_text())
    assert summary["partial"] is True and "diverged" in summary["reason"]
    assert pl.read_parquet(tmp_path / "run-partial" / "log.parquet")["position_m"].is_finite().all()


def test_a_plot_that_fails_does_not_cost_the_run(tmp_path, monkeypatch):
    """A bug in a figure shows itself, after log, summary and configuration are in their place."""

    def broken(signals):
        raise RuntimeError("a bug")

    monkeypatch.setattr("hexsim.recording.figures.run_figures", broken)
    result = hexsim_command("run", "heave", *BENCH, "--duration", "0.5", "--out", "run", cwd=tmp_path)
    assert isinstance(result.exception, RuntimeError)
    assert {path.name for path in (tmp_path / "run").iterdir()} == {"log.parquet", "summary.json", "config.toml"}


def test_brackets_in_help_texts_are_shown():
    """[uncertainty], [kg] and any other word in brackets stand in the help of the command that says them."""
    runner = CliRunner()
    assert "[uncertainty]" in runner.invoke(app, ["sweep", "--help"], env={"COLUMNS": "200"}).output

    probe = typer.Typer(cls=app.info.cls, rich_markup_mode="rich")

    @probe.callback()
    def group() -> None:
        """All of [these]."""

    @probe.command()
    def weigh(mass: Annotated[float, typer.Option(help="Mass [kg], of [/it] too.")] = 1.0) -> None:
        """In [kg]."""

    shown = runner.invoke(probe, ["weigh", "--help"], env={"COLUMNS": "200"}).output
    assert "In [kg]." in shown and "Mass [kg], of [/it] too." in shown
    assert "In [kg]." in runner.invoke(probe, ["--help"], env={"COLUMNS": "200"}).output
