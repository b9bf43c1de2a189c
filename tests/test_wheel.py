"""What is released: a source distribution, and a wheel made from it that works outside the repository."""

import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

import hexsim as hx

ROOT = Path(__file__).parents[1]


def test_the_wheel_has_every_file_of_the_models_and_of_the_packages():
    """What a build would pack: each file of models, hexsim and compensation, and no test."""
    packed = {file.distribution_path for file in WheelBuilder(str(ROOT)).recurse_included_files()}
    for folder, place in (("models", "hexsim/models"), ("hexsim", "hexsim"), ("compensation", "compensation")):
        files = [path for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts]
        assert files and not [path for path in files if f"{place}/{path.relative_to(ROOT / folder)}" not in packed]
    assert not [name for name in packed if name.startswith("tests")]


@pytest.fixture(scope="session")
def distributions(tmp_path_factory):
    """Folder with the source distribution and the wheel built from it."""
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", out, ROOT]
    subprocess.run(command, check=True, capture_output=True)
    return out


@pytest.mark.slow  # builds both
def test_descriptions_are_accepted_by_a_registry(distributions):
    """twine finds no fault with either, warnings counted."""
    files = sorted(distributions.iterdir())
    assert [path.name.split("-")[0] for path in files] == ["hexsim", "hexsim"]
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *files], check=True, capture_output=True)


@pytest.fixture(scope="module")
def installed(distributions, tmp_path_factory):
    """Folder of the programs of a new environment with the wheel.

    The dependencies come from this environment by a path file, which does not carry the editable install along.
    """
    place = tmp_path_factory.mktemp("installed")
    wheel = next(distributions.glob("hexsim-*.whl"))
    venv.create(place / "venv", with_pip=True)
    bin_folder = place / "venv" / "bin"
    subprocess.run(
        [bin_folder / "python", "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", wheel],
        check=True,
        capture_output=True,
    )
    site = next((place / "venv" / "lib").glob("python*/site-packages"))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return bin_folder


@pytest.mark.slow  # makes an environment; what is in the wheel is above
def test_wheel_carries_the_models(installed, tmp_path):
    """Installed as a wheel, hexsim finds every machine of models in an empty folder, and MuJoCo loads each."""
    code = (
        "import hexsim, compensation, mujoco\n"
        "from hexsim.machine import available_machines, load_machine, models_folder\n"
        "for name in available_machines():\n"
        "    load_machine(name)\n"
        "    mujoco.MjModel.from_xml_path(str(models_folder() / name / 'scene.xml'))\n"
        "print(hexsim.__file__, *available_machines())"
    )
    where, *machines = subprocess.run(
        [installed / "python", "-c", code], cwd=tmp_path, check=True, capture_output=True, text=True
    ).stdout.split()
    assert str(installed.parent) in where
    assert machines == hx.available()["machines"]


@pytest.mark.slow
def test_wheel_runs_elsewhere(installed, tmp_path):
    """`hexsim run heave` works in an empty folder; it compiles all equations anew."""
    run = subprocess.run(
        [installed / "hexsim", "run", "heave", "--fast", "--duration", "1", "--out", "here"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "here" / "summary.json").is_file()
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()
