"""The site builds without a warning and loads nothing from a network; its notebooks run; its pictures are drawn here."""

import os
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
LOADED = re.compile(r"""<(?:script|img|iframe|link)\b[^>]*?\b(?:src|href)=["']?((?:https?:)?//[^"'\s>]+)""")


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """The site, its notebooks not executed."""
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(out)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "HEXSIM_RUN_NOTEBOOKS": "false"}
    ended = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    return out


def linked(page: Path) -> Iterator[tuple[str, Path]]:
    """Links and pictures of a page that stay within the site, outside of code, and the files that they name."""
    text = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if not link.startswith(("http", "mailto:", "#")):
            yield link, page.parent / link.partition("#")[0]


def test_no_page_is_left_out_and_no_link_is_dead():
    """Every page of docs is in the contents, every file in the contents is there, and every link goes to one that is."""
    contents = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2].partition("\nmarkdown_ext")[0]
    named = set(re.findall(r"[\w/]+\.(?:md|ipynb)$", contents, re.MULTILINE))
    pages = [path for path in (ROOT / "docs").rglob("*") if path.suffix in (".md", ".ipynb")]
    assert {path.relative_to(ROOT / "docs").as_posix() for path in pages} == named
    links = [(page.name, link, file) for page in pages if page.suffix == ".md" for link, file in linked(page)]
    assert len(links) > 100
    assert not [(page, link) for page, link, file in links if not file.is_file()]


@pytest.mark.slow  # pages and links are read off the sources above
def test_every_page_and_equation_is_there(site):
    """The strict build has a page for every page of docs, and the equations stand on theirs."""
    pages = {p.relative_to(ROOT / "docs").with_suffix(".html") for p in (ROOT / "docs").rglob("*.md")}
    assert not [page for page in pages if not (site / page).is_file()]
    assert "Eq. 3.11" in (site / "theory.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_no_page_loads_anything_from_a_network(site):
    """No script, style sheet, picture or frame of any page comes from elsewhere; styles import nothing either."""
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not LOADED.findall(text), page
        assert not re.search(r"""import\(["']https?:""", text), page
    for style in site.rglob("*.css"):
        assert not re.search(r"(@import|url\()\s*[\"']?(https?:)?//", style.read_text(encoding="utf-8")), style


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(notebook, tmp_path):
    """Every cell runs, from the folder of the notebook."""
    command = [sys.executable, "-m", "nbconvert", "--execute", "--to", "notebook", "--output-dir", tmp_path, notebook]
    ended = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert ended.returncode == 0, ended.stderr


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_every_picture_is_drawn_by_the_script(tmp_path):
    """docs/pictures.py draws all pictures of docs/images, and no others."""
    command = [sys.executable, "-W", "error", "docs/pictures.py", "--out", str(tmp_path)]
    environment = {"MUJOCO_GL": "egl", **os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run(command, cwd=ROOT, env=environment, check=True)
    drawn = {path.name for path in tmp_path.iterdir()}
    assert drawn == {path.name for path in (ROOT / "docs" / "images").glob("*.png")}


def test_the_columns_of_a_log_are_those_of_the_table():
    """docs/log_columns.md is what its script writes from the table of signals: python docs/log_columns.py"""
    made = runpy.run_path(str(ROOT / "docs" / "log_columns.py"))["page"]()
    assert (ROOT / "docs" / "log_columns.md").read_text(encoding="utf-8") == made
