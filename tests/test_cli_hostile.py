"""The command line where disks are full, terminals close, names are odd: one sentence, and what can be kept is kept."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

import hexsim
import hexsim as hx
from hexsim import HexsimError
from hexsim.cli import app
from hexsim.files import run_folder as run_folders

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(hexsim.__file__).parents[1]), "COLUMNS": "120"}
SHORT = ["-m", "bench", "--fast", "--duration", "1"]
PLAIN = ["--no-report", "--no-recording"]


def command(*arguments: str, cwd: Path, before: str = "", environment=None, **options):
    """Run in a process of its own; `before` is Python that runs first."""
    code = f"{before}\nfrom hexsim.cli import main\nmain()"
    options = {"capture_output": True, **options}
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=cwd,
        env=environment or ENVIRONMENT,
        text=True,
        check=False,
        timeout=120,
        **options,
    )


def first_of(*arguments: str) -> str:
    """Python that runs a command before another one in the same process, which takes a second to begin."""
    return f"from hexsim.cli import app\napp({list(arguments)!r}, standalone_mode=False)"


# the compiled code is written to its cache first: here it is the run's own files that do not fit
LIMIT = """
import resource
from hexsim.machine import load_machine
from hexsim import load_scenario
from hexsim.simulation import simulate
for compensator in ("none", "exact"):
    simulate(load_machine("bench"), load_scenario("heave", duration_s=0.1), fast=True, compensator=compensator)
resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0}))
"""


@pytest.mark.parametrize(
    ("most_bytes", "kept"), [(150_000, {"log.parquet"}), pytest.param(20_000, set(), marks=pytest.mark.slow)]
)
def test_a_full_disk_costs_no_more_than_it_must(tmp_path, most_bytes, kept):
    """Where no file may grow beyond a limit, as on a full disk: what fits is kept in -partial, one sentence, code 2."""
    ended = command("run", "heave", *SHORT, "--out", "run", cwd=tmp_path, before=LIMIT.format(most_bytes))
    assert ended.returncode == 2 and len(ended.stderr.strip().splitlines()) == 1, ended.stderr
    assert re.search(r"hexsim: cannot write .*could be kept, in .*run-partial", ended.stderr)
    assert {path.name for path in (tmp_path / "run-partial").iterdir()} == {"config.toml", "summary.json"} | kept
    assert [path.name for path in tmp_path.iterdir()] == ["run-partial"]


@pytest.mark.slow
def test_a_comparison_on_a_full_disk_keeps_its_figures(tmp_path):
    """The numbers are small: compare.json is kept where the logs do not fit."""
    arguments = ("compare", "heave", *SHORT, "-c", "none,exact", "--out", "run")
    ended = command(*arguments, cwd=tmp_path, before=LIMIT.format(20_000))
    assert ended.returncode == 2 and len(ended.stderr.strip().splitlines()) == 1, ended.stderr
    assert set(json.loads((tmp_path / "run-partial" / "compare.json").read_text())["compensators"]) == {"none", "exact"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_output_that_cannot_be_printed_is_a_sentence(tmp_path):
    """stdout on a full device: code 2 and one line, and the run is in its place."""
    with open("/dev/full", "w") as full:
        ended = command(
            "run",
            "heave",
            *SHORT,
            *PLAIN,
            "--out",
            "run",
            cwd=tmp_path,
            capture_output=False,
            stdout=full,
            stderr=subprocess.PIPE,
        )
    assert ended.returncode == 2 and re.fullmatch(r"hexsim: cannot write.*No space left.*\n", ended.stderr), (
        ended.stderr
    )
    assert (tmp_path / "run" / "log.parquet").exists()


def test_an_ascii_locale_prints_what_it_can(tmp_path):
    """Signs that the locale lacks appear as codes; JSON stays JSON."""
    environment = {**ENVIRONMENT, "PYTHONIOENCODING": "ascii"}
    name = ("--set", 'scenario.name="größe"', "--no-report", "--no-recording")
    before = first_of("run", "heave", *SHORT, *name, "--out", "a")
    told = command(
        "run", "heave", *SHORT, *name, "--out", "b", "--json", cwd=tmp_path, before=before, environment=environment
    )
    table, brace, rest = told.stdout.partition("{\n")
    assert told.returncode == 0 and r"gr\xf6\xdfe" in table, told.stderr
    assert json.loads(brace + rest)["scenario"] == "größe"


@pytest.mark.parametrize("name", ["a [/red] b", "[red]", ":smile:"])
def test_brackets_in_names_are_no_markup(tmp_path, monkeypatch, name):
    """A machine and a scenario named like Rich's markup run to their end, and the table shows the names as they are."""
    monkeypatch.chdir(tmp_path)
    names = ("--set", f'scenario.name="{name}"', "--set", f'machine.name="{name}"')
    result = CliRunner().invoke(app, ["run", "heave", *SHORT, *names, "--out", "run", "--no-report", "--no-recording"])
    assert result.exit_code == 0, result.output
    assert f"{name} on {name}, compensator none" in result.stdout


@pytest.mark.parametrize("name", ["x/../../../OUTSIDE", "..", "a\\b", "ä" * 100])
def test_a_scenarios_name_leads_nowhere(tmp_path, monkeypatch, name):
    """Whatever a scenario is called, its run lies in runs/, and nothing lies elsewhere."""
    monkeypatch.chdir(tmp_path)
    quoted = json.dumps(name, ensure_ascii=False)
    arguments = ["run", "heave", *SHORT, "--set", f"scenario.name={quoted}", "--no-report", "--no-recording"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
    assert len(list((tmp_path / "runs").glob("*/log.parquet"))) == 1


LONG_WORDS = """
from compensation import Compensator
from hexsim import HexsimError

class Own(Compensator):
    name = "own"

    def start(self, *given):
        raise HexsimError("x" * 25_000)

    parameters = restore = step = start
"""


def test_sentences_carry_no_control_characters(tmp_path, monkeypatch):
    """An escape sequence in a file's name reaches the terminal as text, and a sentence of 25 kB is cut."""
    refused = CliRunner().invoke(app, ["run", "heave", "--machine", "no \x1b[31mfile\x07.toml"])
    assert refused.exit_code == 2 and r"no \x1b[31mfile\x07.toml" in refused.stderr and "\x1b" not in refused.stderr
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "long_words.py").write_text(LONG_WORDS)
    refused = CliRunner().invoke(app, ["run", "heave", *SHORT, "--compensator", "long_words:Own"])
    assert refused.exit_code == 2 and "xxx" in refused.stderr and len(refused.stderr) < 2100


def test_run_without_a_name_shows_what_there_is(tmp_path, monkeypatch):
    """Scenarios, machines and compensators, each with the option that takes it; code 2, nothing is written."""
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["run"])
    assert result.exit_code == 2
    for text in ("multisine", "micro_motion_system", "buffered", "--machine NAME", "--compensator NAME"):
        assert text in result.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments", [("view",), ("friction",), ("run", "heave", "--out"), ("sweep", "heave", "--out")]
)
def test_a_path_that_is_too_long_is_a_sentence(tmp_path, monkeypatch, arguments):
    """No file system takes 300 characters: one short line, code 2."""
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, [*arguments, "x" * 300 + ".parquet"])
    assert result.exit_code == 2 and len(result.stderr.strip().splitlines()) == 1, result.stderr
    assert re.search(r"File name too long", result.stderr)


def test_a_negative_seed_is_refused():
    """A usage error that names the option."""
    result = CliRunner().invoke(app, ["run", "heave", "--seed", "-1"])
    assert result.exit_code == 2 and "--seed" in result.stderr


def test_an_interrupted_qualification_says_so(tmp_path, monkeypatch):
    """Ctrl-C in a motion test is no word on the machine."""
    monkeypatch.chdir(tmp_path)

    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("hexsim.plant.plant.Plant.check", interrupt)
    result = CliRunner().invoke(app, ["qualify", "-m", "bench", "--quick", "--out", "q"])
    assert result.exit_code == 130 and "interrupted by the user" in result.stderr and "survive" not in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_run_left_is_removed_and_a_living_ones_is_not(tmp_path):
    """A folder whose lock nobody holds goes when the next run begins; one that is being filled stays."""
    killed = tmp_path / f"{run_folders.UNFINISHED}old"
    killed.mkdir()
    (killed / "log.parquet").write_text("")
    with run_folders.run_folder(tmp_path / "a") as living:
        for folder in (killed, living.path):
            os.utime(folder, (0, 0))
        with run_folders.run_folder(tmp_path / "b") as second:
            second.finish()
        assert living.path.is_dir() and not killed.exists()
        living.finish()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_a_run_that_cannot_be_moved_is_not_thrown_away(tmp_path, monkeypatch):
    """When the last step fails the sentence says where the run is whole, and it is there."""
    with pytest.raises(HexsimError, match="it is whole there"), run_folders.run_folder(tmp_path / "run") as folder:
        (folder.path / "log.csv").write_text("")
        monkeypatch.setattr(
            Path, "rename", lambda *paths: (_ for _ in ()).throw(OSError(18, "Invalid cross-device link"))
        )
        folder.finish()
    assert (folder.path / "log.csv").exists()


def test_default_folders_bear_safe_names(tmp_path):
    """Letters, digits, dots and dashes of the scenario's name, at most 150 bytes."""
    assert run_folders.default_folder("a/b\\c d:e", tmp_path).name.endswith("-a_b_c_d_e")
    assert len(run_folders.default_folder("ä" * 300, tmp_path).name.encode()) <= 180


def test_a_run_beyond_the_memory_is_refused_with_what_it_needs(monkeypatch):
    """A day of the hexapod under 8 GB; a twentieth of a second is let through."""
    monkeypatch.setattr("hexsim.scenarios.resources.available_memory", lambda: 8e9)
    said = {86_400.0: "86400 s needs about .* GB of memory, and 8 GB are free: make", 1e-3: "two samples of the log"}
    for duration_s, words in said.items():
        with pytest.raises(HexsimError, match=words):
            hx.run("heave", "micro_motion_system", set={"scenario.duration_s": duration_s})
    assert hx.run("heave", "micro_motion_system", set={"scenario.duration_s": 0.05}, fast=True).complete


def test_a_limit_of_the_process_counts(tmp_path):
    """`ulimit -v`: the run is refused before it takes the memory."""
    before = "import resource; resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))"
    ended = command("run", "heave", "--duration", "86400", "--fast", "--out", "run", cwd=tmp_path, before=before)
    assert ended.returncode == 2 and re.search(r"GB of memory, and \d\S* GB are free", ended.stderr), ended.stderr


def test_the_viewer_is_started_without_usage_statistics(tmp_path, monkeypatch):
    """`rerun analytics disable` goes before the viewer."""
    asked = []

    def run(arguments, **options):
        asked.append(arguments[3:])
        return subprocess.CompletedProcess(arguments, 0)

    monkeypatch.setattr("hexsim.cli.view.subprocess.run", run)
    (tmp_path / "run.rrd").write_text("")
    assert CliRunner().invoke(app, ["view", str(tmp_path)]).exit_code == 0
    assert asked[0] == ["analytics", "disable"] and asked[1][0].endswith("run.rrd")


def test_estimates_are_above_what_runs_take(tmp_path, monkeypatch):
    """The disk that a refusal asks for, for two seconds with report and recording, is more than these take."""
    run = ["run", "heave", "-m", "bench", "--fast", "--duration", "2", "--out", str(tmp_path / "run")]
    with monkeypatch.context() as full:
        full.setattr("hexsim.scenarios.resources.shutil.disk_usage", lambda folder: SimpleNamespace(free=0.0))
        refused = CliRunner().invoke(app, run)
    needed = re.search(r"needs about (\S+) GB of disk", refused.stderr)
    assert refused.exit_code == 2 and needed, refused.output
    assert CliRunner().invoke(app, run).exit_code == 0
    taken = sum(path.stat().st_size for path in (tmp_path / "run").rglob("*") if path.is_file())
    assert taken < 1e9 * float(needed[1])


@pytest.mark.parametrize("arguments", [("run", "heave", "-m", ""), ("trace", "."), ("list", "machines", "--out=")])
def test_a_variable_of_the_shell_that_is_not_set_is_no_default(tmp_path, monkeypatch, arguments):
    """An empty text in the place of a name is refused, with the word before it; nothing runs with another machine."""
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, [*arguments, *([] if arguments[-1] != "." else ["--fit", ""])])
    assert result.exit_code == 2 and "a variable of the shell that is not set" in result.stderr, result.output
    assert list(tmp_path.iterdir()) == []


def test_without_stdout_a_command_works(tmp_path):
    """`>&-`, as a daemon or a program without a console calls it: code 0, and no traceback."""
    before = "import sys; sys.stdout = None"
    ended = command("list", "machines", cwd=tmp_path, before=before)
    assert ended.returncode == 0 and ended.stderr == ""


@pytest.mark.slow  # an ASCII locale is in this file
def test_a_log_is_written_whatever_the_locale(tmp_path):
    """A folder with letters beyond the locale: libraries get an open file, not a name that they encode otherwise."""
    environment = {**ENVIRONMENT, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    folder = tmp_path / "größe"
    folder.mkdir()
    one, other = (
        ("run", "heave", *SHORT, *PLAIN, "--out", ending, "--log-format", ending) for ending in ("parquet", "csv")
    )
    ended = command(*other, cwd=folder, before=first_of(*one), environment=environment)
    assert ended.returncode == 0, ended.stderr
    for ending in ("parquet", "csv"):
        assert (folder / ending / f"log.{ending}").stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("serve", "--duration", "nan"), "--duration"),
        (("serve", "-m", "bench", "--out", "file", "--duration", "0.01"), "it is a file"),
        (("live", "heave", "--web", "--seconds", "-1"), "--duration"),
        (("run", "heave", "--connect", "force_z_N=f"), "give --payload too"),
        (("run", "heave", "-m", "utf16.toml"), "no text in UTF-8"),
    ],
)
def test_what_cannot_be_done_is_said_before_the_work(tmp_path, monkeypatch, arguments, sentence):
    """Code 2 and the cause at once: a session at the machine is not lost because it could not be written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    (tmp_path / "utf16.toml").write_text("[machine]", encoding="utf-16")
    monkeypatch.setattr("hexsim.simulation.serve.Server", None)
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2 and sentence in result.stderr, result.output
