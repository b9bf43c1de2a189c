"""What is released: a source distribution, and a wheel made from it that works outside the repository."""

import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def distributions(tmp_path_factory):
    """Folder with the source distribution and the wheel built from it."""
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", out, ROOT]
    subprocess.run(command, check=True, capture_output=True)
    return out


def test_descriptions_are_accepted_by_a_registry(distributions):
    """twine finds no fault with either, warnings counted."""
    files = sorted(distributions.iterdir())
    assert [path.name.split("-")[0] for path in files] == ["hexsim", "hexsim"]
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *files], check=True, capture_output=True)


def test_wheel_carries_the_models_and_runs_elsewhere(distributions, tmp_path):
    """Built as a wheel and installed into a new environment, `hexsim run heave` works in an empty folder.

    The dependencies come from this environment by a path file, which does not carry the editable install along.
    """
    wheel = next(distributions.glob("hexsim-*.whl"))
    venv.create(tmp_path / "venv", with_pip=True)
    bin_folder = tmp_path / "venv" / "bin"
    subprocess.run(
        [bin_folder / "python", "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", wheel],
        check=True,
        capture_output=True,
    )
    site = next((tmp_path / "venv" / "lib").glob("python*/site-packages"))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    empty = tmp_path / "empty"
    empty.mkdir()
    where = subprocess.run(
        [bin_folder / "python", "-c", "import hexsim, compensation; print(hexsim.__file__)"],
        cwd=empty, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    assert str(tmp_path) in where
    run = subprocess.run(
        [bin_folder / "hexsim", "run", "heave", "--fast", "--duration", "1", "--out", "here"],
        cwd=empty, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert (empty / "here" / "summary.json").is_file()
    assert not (empty / "MUJOCO_LOG.TXT").exists()
