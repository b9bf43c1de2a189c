"""What a release needs agrees with itself: version, dependencies, workflows, the paper's length, data sheets."""

import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ON_CONDA_FORGE = {"mujoco": "mujoco-python", "matplotlib": "matplotlib-base"}


def test_one_version():
    """pyproject.toml, CITATION.cff, the conda recipe and the top section of the changelog have the same version."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    top = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert top
    assert {str(citation["version"]), recipe["context"]["version"], top[1]} == {PROJECT["version"]}


def test_conda_recipe_has_the_dependencies():
    """The recipe requires what pyproject.toml requires, with the same bounds, and starts the same programs."""
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    wanted = [re.fullmatch(r"([A-Za-z0-9-]+)(.*)", line) for line in PROJECT["dependencies"]]
    wanted = {f"{ON_CONDA_FORGE.get(one[1], one[1])} {one[2]}" for one in wanted if one}
    assert set(recipe["requirements"]["run"]) == wanted | {f"python {PROJECT['requires-python']}"}
    assert recipe["build"]["python"]["entry_points"] == [f"{k} = {v}" for k, v in PROJECT["scripts"].items()]


def test_every_declared_python_is_tested():
    """The workflow runs the tests with every Python version that the package declares, on three systems in all."""
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "test.yml").read_text(encoding="utf-8"))["jobs"]
    declared = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r"Python :: 3\.\d+$", line)]
    assert jobs["test"]["strategy"]["matrix"]["python"] == declared and declared[-1] == "3.14"
    assert {jobs["test"]["runs-on"], *jobs["systems"]["strategy"]["matrix"]["system"]} == {
        "ubuntu-latest",
        "windows-latest",
        "macos-latest",
    }


def test_the_paper_has_the_journals_length_and_sections():
    """750 to 1,750 words, the sections that the journal asks for, and no citation without an entry."""
    text = (ROOT / "paper.md").read_text(encoding="utf-8")
    body = text.split("---", 2)[2]
    assert 750 <= len(body.split()) <= 1750
    wanted = {"Summary", "Statement of need", "State of the field", "Software design", "References"}
    assert wanted <= set(re.findall(r"^# (.+)$", body, re.MULTILINE))
    entries = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "paper.bib").read_text(encoding="utf-8"), re.MULTILINE))
    assert set(re.findall(r"@(\w+)", body)) == entries
