"""Tab completion, by the protocol of the shells: the command line so far in the environment, names on stdout."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import hexsim as hx
from hexsim.cli import app

ROOT = Path(__file__).parents[1]


def offered(line: str, code: str = "from hexsim.cli import main; main()") -> subprocess.CompletedProcess:
    """What `hexsim` answers to bash when Tab is pressed at the end of a line."""
    words = line.split(" ")
    asked = {"_HEXSIM_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    code = f"import sys; sys.argv[0] = 'hexsim'; {code}"
    environment = {**os.environ, **asked, "PYTHONPATH": str(ROOT)}
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)


def test_the_names_are_those_of_the_library():
    """Machines, scenarios, compensators with their variants, effects: what the commands list, read without importing them."""
    there = hx.available()
    assert offered("hexsim run ").stdout.split() == sorted(there["scenarios"])
    assert offered("hexsim run heave --machine ").stdout.split() == sorted(there["machines"])
    assert offered("hexsim run heave -c ").stdout.split() == sorted(there["compensators"])
    shown = CliRunner().invoke(app, ["trace", "--list", "--json"])
    assert offered("hexsim trace --explain ").stdout.split() == sorted(row["name"] for row in json.loads(shown.stdout))


BEGUN = {
    "hexsim run he": ["heave"],
    "hexsim live --machine servo": ["servo_bench", "servo_hexapod"],
    "hexsim run heave -c adapt": ["adaptive"],
    "hexsim compare heave -c none,exact,it": [f"none,exact,iterative{end}" for end in ("", "_report_1", "_report_2")],
    "hexsim trace --explain leakage_s": ["leakage_supply_to_chamber"],
    "hexsim test valve ben": ["bench"],
    "hexsim run heave -c none,ex": ["none,exact"],
    "hexsim dem": ["demo"],
}
EACH_IN_TURN = f"""
import os, sys
from hexsim.cli import main
for line in {list(BEGUN)}:
    os.environ.update(COMP_WORDS=line, COMP_CWORD=str(line.count(" ")), _HEXSIM_COMPLETE="complete_bash")
    try:
        main()
    except SystemExit:
        print("--", flush=True)
"""


@pytest.fixture(scope="module")
def answers() -> dict[str, list[str]]:
    """What is offered at each line's end, by one process for all of them."""
    told = offered("", EACH_IN_TURN)
    parts = told.stdout.split("--\n")[:-1]
    assert len(parts) == len(BEGUN), told.stderr
    return {line: part.split() for line, part in zip(BEGUN, parts, strict=True)}


@pytest.mark.parametrize("line", BEGUN)
def test_the_tab_key_offers_real_names(line, answers):
    """In the middle of a word: the names that begin so, and nothing else."""
    assert answers[line] == BEGUN[line]


def test_the_tab_key_does_not_wait_for_libraries():
    """Neither numpy nor scipy, MuJoCo, numba or polars is imported to answer."""
    heavy = "'numpy', 'scipy', 'mujoco', 'numba', 'polars'"
    code = f"import atexit; atexit.register(lambda: print([m for m in ({heavy}) if m in sys.modules])); "
    answer = offered("hexsim trace --explain null_d", code + "from hexsim.cli import main; main()")
    assert answer.stdout.split("\n")[:2] == ["null_drift", "[]"], answer.stderr


def test_completion_can_be_installed(monkeypatch, tmp_path):
    """`hexsim --install-completion bash` writes the shell's script into the home folder and says where."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", "import sys; sys.argv[0] = 'hexsim'; from hexsim.cli import main; main()"]
    done = subprocess.run(
        [*command, "--install-completion", "bash"], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    scripts = [path for path in tmp_path.rglob("*") if path.is_file() and "_HEXSIM_COMPLETE" in path.read_text()]
    assert scripts and "completion installed" in done.stdout
    assert "--install-completion" in CliRunner().invoke(app, ["--help"]).output
