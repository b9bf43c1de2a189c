"""Run folders appear whole, or say that they are partial."""

import pytest

from hexsim.errors import HexsimError
from hexsim.files.run_folder import default_folder, run_folder


def fill(folder, names=("log.csv", "summary.json")):
    for name in names:
        (folder.path / name).write_text(name)


def test_nothing_bears_the_name_before_it_is_whole(tmp_path):
    """While files are written the target does not exist; afterwards nothing else is left."""
    with run_folder(tmp_path / "out" / "run") as folder:
        fill(folder)
        assert not (tmp_path / "out" / "run").exists()
        place = folder.finish()
    assert place == tmp_path / "out" / "run"
    assert sorted(p.name for p in place.iterdir()) == ["log.csv", "summary.json"]
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["run"]


def test_nothing_is_left_of_a_run_that_raises(tmp_path):
    """An error between opening and finishing leaves no folder behind."""
    with pytest.raises(HexsimError, match="refused"), run_folder(tmp_path / "run") as folder:
        fill(folder)
        raise HexsimError("refused")
    assert list(tmp_path.iterdir()) == []


def test_an_earlier_run_in_the_folder_is_replaced_and_other_files_stay(tmp_path):
    """No file of an earlier run survives beside the new one's (a log.parquet beside a log.csv would mislead)."""
    (tmp_path / "figures").mkdir()
    for name in ("log.parquet", "run.rrd", "figures/old.png", "notes.txt"):
        (tmp_path / name).write_text("old")
    with run_folder(tmp_path) as folder:
        fill(folder)
        assert folder.finish() == tmp_path
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "notes.txt", "summary.json"]


def test_a_partial_run_says_so_in_its_name(tmp_path):
    """A run that ended early gets the ending -partial, a second one another number; nothing is overwritten."""
    names = []
    for _ in range(2):
        with run_folder(tmp_path / "run") as folder:
            fill(folder)
            names.append(folder.finish(complete=False).name)
    assert names == ["run-partial", "run-partial-2"]
    assert not (tmp_path / "run").exists()


def test_a_place_that_cannot_be_written_is_refused_before_the_run(tmp_path):
    """Opening the folder fails at once with a sentence that names it; so does a file in its place."""
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file" / "run", tmp_path / "file"):
        with pytest.raises(HexsimError, match=rf"cannot write .*{out.name}.*give"), run_folder(out):
            raise AssertionError("the block must not be entered")


def test_default_names_do_not_collide(tmp_path):
    """Two runs of one second get two folders."""
    first = default_folder("heave", tmp_path)
    first.mkdir()
    second = default_folder("heave", tmp_path)
    assert second != first and first.name.endswith("-heave")
