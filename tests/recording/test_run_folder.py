"""Run folders appear whole, or say that they are partial."""

import os
import subprocess
import sys
import time

import polars as pl
import pytest

from hexsim import HexsimError
from hexsim.files import log_files, runs_index
from hexsim.files import run_folder as run_folders


def fill(folder, names=("log.csv", "summary.json")):
    for name in names:
        (folder.path / name).write_text(name)


def test_nothing_bears_the_name_before_it_is_whole(tmp_path):
    """While files are written the target does not exist; afterwards nothing else is left."""
    with run_folders.run_folder(tmp_path / "out" / "run") as folder:
        fill(folder)
        assert not (tmp_path / "out" / "run").exists()
        place = folder.finish()
    assert place == tmp_path / "out" / "run"
    assert sorted(p.name for p in place.iterdir()) == ["log.csv", "summary.json"]
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["run"]


def test_nothing_is_left_of_a_run_that_raises(tmp_path):
    """An error between opening and finishing leaves no folder behind."""
    with pytest.raises(HexsimError, match="refused"), run_folders.run_folder(tmp_path / "run") as folder:
        fill(folder)
        raise HexsimError("refused")
    assert list(tmp_path.iterdir()) == []


def test_an_earlier_run_in_the_folder_is_replaced_and_other_files_stay(tmp_path):
    """No file of an earlier run survives beside the new one's (a log.parquet beside a log.csv would mislead)."""
    (tmp_path / "figures").mkdir()
    for name in ("log.parquet", "run.rrd", "figures/old.png", "notes.txt"):
        (tmp_path / name).write_text("old")
    with run_folders.run_folder(tmp_path) as folder:
        fill(folder)
        assert folder.finish() == tmp_path
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "notes.txt", "summary.json"]


def test_a_partial_run_says_so_in_its_name(tmp_path):
    """A run that ended early gets the ending -partial, a second one another number; nothing is overwritten."""
    names = []
    for _ in range(2):
        with run_folders.run_folder(tmp_path / "run") as folder:
            fill(folder)
            names.append(folder.finish(complete=False).name)
    assert names == ["run-partial", "run-partial-2"]
    assert not (tmp_path / "run").exists()


def test_a_place_that_cannot_be_written_is_refused_before_the_run(tmp_path):
    """Opening the folder fails at once with a sentence that names it; so does a file in its place."""
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file" / "run", tmp_path / "file"):
        with pytest.raises(HexsimError, match=rf"cannot write .*{out.name}.*give"), run_folders.run_folder(out):
            raise AssertionError("the block must not be entered")


def test_default_names_do_not_collide(tmp_path):
    """Two runs of one second get two folders."""
    first = run_folders.default_folder("heave", tmp_path)
    first.mkdir()
    second = run_folders.default_folder("heave", tmp_path)
    assert second != first and first.name.endswith("-heave")


def test_a_second_run_for_the_same_place_is_refused(tmp_path):
    """While one run gathers, another one for its folder, there already or not, is refused at once; later it may. Nothing but
    the folder stays."""
    for out in (tmp_path / "new", tmp_path / "there"):
        if out.name == "there":
            out.mkdir()
        with run_folders.run_folder(out) as first:
            fill(first)
            with pytest.raises(HexsimError, match=r"another run is writing .*: wait for it, or give another --out"):
                run_folders.RunFolder(out)
            first.finish()
        with run_folders.run_folder(out) as second:
            fill(second)
            second.finish()
    assert sorted(path.name for path in tmp_path.rglob("*")) == sorted(
        2 * ["log.csv", "summary.json"] + ["new", "there"]
    )


def test_default_names_of_runs_that_have_not_begun_do_not_collide(tmp_path):
    """Two commands that choose their names in the same second, before either has written: two places."""
    names = [run_folders.default_folder("heave", tmp_path) for _ in range(3)]
    assert len(set(names)) == 3
    for name in names:
        with run_folders.run_folder(name) as folder:
            fill(folder)
            folder.finish()
    assert sorted(tmp_path.iterdir()) == sorted([*names, tmp_path / "index.html"])


def test_a_run_killed_while_it_fills_a_folder_leaves_no_figures_of_another(tmp_path):
    """Killed after each step of the filling of a folder with an earlier run: where figures (any *.json) stand, all data are
    theirs."""
    names = ("config.toml", "compare.json", "log.parquet", "report.html", "summary.json")
    code = """
import os, sys
from pathlib import Path
from hexsim.files.run_folder import RunFolder
count = [0]
def counted(old):
    def step(self, *a, **k):
        done = old(self, *a, **k)
        count[0] += armed and ".lock" not in str(self)
        if count[0] == int(sys.argv[1]):
            os.kill(os.getpid(), 9)
        return done
    return step
armed = False
Path.rename, Path.unlink = counted(Path.rename), counted(Path.unlink)
folder = RunFolder(Path(sys.argv[2]))
for name in sys.argv[3:]:
    (folder.path / name).write_text("new")
armed = True
folder.finish()
"""
    for step in range(1, 18, 2):
        out = tmp_path / f"out{step}"
        out.mkdir()
        for name in names:
            (out / name).write_text("old")
        subprocess.run([sys.executable, "-c", code, str(step), str(out), *names], check=False)
        found = {path.name: path.read_text() for path in out.iterdir() if path.is_file() and path.name in names}
        assert len(set(found.values())) <= 1, (step, found)
        if any(name.endswith(".json") for name in found):
            assert found.keys() >= {"config.toml", "log.parquet", "report.html"}, (step, found)


def report(place, title, sentence=""):
    place.mkdir()
    (place / "report.html").write_text(
        f'<html><title>{title} · hexsim</title><p class="lead">{sentence}</p>{runs_index.PLACE}'
    )


def test_the_page_of_all_runs_has_the_newest_first(tmp_path, monkeypatch):
    """Runs under default names: each leads to the page, which has their titles and first sentences; a finished report is not written
    again, and a run with a place of its own is no part of it."""
    monkeypatch.chdir(tmp_path)
    places = []
    for title in ("one &amp; first", "two"):
        with run_folders.run_folder(run_folders.default_folder("heave")) as folder:
            (folder.path / "report.html").write_text(
                f'<title>{title}</title><p class="lead">0.03 <b>m/s2</b></p>{runs_index.PLACE}'
            )
            places.append(folder.finish())
        os.utime(places[-1] / "report.html", (1e9 + len(places),) * 2)
    before = [(place / "report.html").stat().st_mtime_ns for place in places]
    with run_folders.run_folder(tmp_path / "own" / "here") as folder:
        (folder.path / "report.html").write_text(runs_index.PLACE)
        own = folder.finish()
    with run_folders.run_folder(run_folders.default_folder("roll")) as folder:
        (folder.path / "report.html").write_text("<title>three</title>")
        folder.finish()
    page = (tmp_path / "runs" / "index.html").read_text()
    assert page.index(">three<") < page.index(">two<") < page.index(">one &amp; first<")
    assert page.count("<td>0.03 m/s2</td>") == 2
    assert [(place / "report.html").stat().st_mtime_ns for place in places] == before
    assert '<a href="../index.html">all runs</a>' in (places[0] / "report.html").read_text()
    assert (own / "report.html").read_text() == runs_index.PLACE and not (tmp_path / "own" / "index.html").exists()


def test_a_report_of_somebody_else_is_shown_as_text(tmp_path):
    """Title, sentence and the folder's name: no script of theirs runs on the page."""
    report(tmp_path / "received", "<script>alert(1)</script>", "<img src=x>&lt;img src=y&gt;")
    report(tmp_path / "x'y\"<b>", "&lt;img src=x&gt;")
    (tmp_path / "no_page").mkdir()
    (tmp_path / "bytes").mkdir()
    (tmp_path / "bytes" / "report.html").write_bytes(b"\xff\xfe")
    body = runs_index.page_of(tmp_path).split("<body>")[1]
    assert "<script" not in body and "<img" not in body and "<b>" not in body
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in body and ">bytes</a>" in body and "no_page" not in body


def test_an_index_of_somebodys_own_stays(tmp_path):
    """An index.html without the mark is not replaced; one with it is."""
    (tmp_path / "index.html").write_text("mine")
    runs_index.write_index(tmp_path)
    assert (tmp_path / "index.html").read_text() == "mine"
    (tmp_path / "index.html").unlink()
    runs_index.write_index(tmp_path)
    report(tmp_path / "run", "later")
    runs_index.write_index(tmp_path)
    assert ">later</a>" in (tmp_path / "index.html").read_text()


def test_half_written_files_of_killed_runs_go_with_the_next_writing(tmp_path):
    """What a killed process left of a file an hour ago goes when the file is written; a younger one, maybe at work, stays."""
    old, young = tmp_path / ".partial-log.csv-a.csv", tmp_path / ".partial-log.csv-b.csv"
    for path in (old, young):
        path.write_text("half")
    os.utime(old, (time.time() - 4000, time.time() - 4000))
    log_files.write_log(pl.DataFrame({"time_s": [0.0]}), tmp_path / "log.csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == [young.name, "log.csv"]
