"""Sweeps: all cases once, whatever happens, on any executor."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import polars as pl
import psutil
import pytest
from typer.testing import CliRunner

import hexsim
from hexsim import HexsimError, load_scenario
from hexsim.cli import app
from hexsim.machine import load_machine
from hexsim.studies import inputs
from hexsim.studies import journal as journals
from hexsim.studies import sweep as sweeping

ROOT = Path(hexsim.__file__).parents[1]


class Here(Executor):
    """Runs each case at once, in this process."""

    def submit(self, function, /, *args, **kwargs):
        future = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except BaseException as error:
            future.set_exception(error)
        return future


def short(**options):
    """Half a second on the bench: too short for a period, long enough for figures."""
    return sweeping.cases(load_scenario("heave", duration_s=0.5), load_machine("bench"), **options)


def test_cases_are_the_product_and_bear_stable_keys():
    """2 settings x 2 compensators x 3 seeds; keys differ, and are the same when made again."""
    options = {"settings": {"valve.overlap_m": [0, 5e-6]}, "seeds": range(3), "compensators": ["none", "buffered"]}
    first, again = short(**options), short(**options)
    assert len(first) == 12 == len({case.key for case in first})
    assert [case.key for case in first] == [case.key for case in again]
    assert first[0].key != short(fast=False)[0].key


def test_a_setting_that_cannot_be_is_refused_before_the_first_run():
    """A value out of bounds anywhere in the grid names table, key and value at once."""
    with pytest.raises(HexsimError, match=r"overlap_m"):
        short(settings={"valve.overlap_m": [5e-6, 1.0]})


def test_one_table_with_settings_and_figures(tmp_path):
    """A row a case, in order; settings and figures are columns; the journal is gone."""
    wanted = short(settings={"valve.overlap_m": [0.0, 20e-6], "scenario.fade_s": [0.1]}, seeds=[4, 5])
    seen = []
    ran = sweeping.sweep(wanted, Here(), tmp_path / "t.parquet", progress=lambda *counts: seen.append(counts))
    assert ran == 4 and seen[0] == (0, 4, 0) and seen[-1] == (4, 4, 0)
    table = pl.read_parquet(tmp_path / "t.parquet")
    assert table["key"].to_list() == [case.key for case in wanted]
    assert table["valve.overlap_m"].to_list() == [0.0, 0.0, 20e-6, 20e-6]
    assert table["seed"].to_list() == [4, 5, 4, 5]
    assert table["scenario.fade_s"].to_list() == [0.1] * 4
    assert table["complete"].all() and table["error"].null_count() == 4
    assert (table["leg_peak_band_m_s2"] > 0).all() and (table["duration_s"] - 0.5).abs().max() < 1e-9
    assert [p.name for p in tmp_path.iterdir()] == ["t.parquet"]


def test_a_failed_run_is_a_row_with_its_error(tmp_path):
    """A case that cannot run (pistons asked beyond their stroke) has its sentence in the table; others have figures."""
    good = short(seeds=[0])
    bad = sweeping.cases(load_scenario("heave", amplitude=0.5, duration_s=0.5), load_machine("bench"), seeds=[1])
    sweeping.sweep(good + bad, Here(), tmp_path / "t.parquet")
    first, second = pl.read_parquet(tmp_path / "t.parquet").to_dicts()
    assert first["complete"] and first["error"] is None
    assert not second["complete"] and "HexsimError: scenario heave" in second["error"]
    assert second["leg_peak_band_m_s2"] is None


def test_a_second_sweep_runs_only_what_is_new_and_keeps_the_rest(tmp_path):
    """Seeds 0 and 1, then 1 and 2: one run; three rows; the shared row is the first sweep's to the bit."""
    sweeping.sweep(short(seeds=[0, 1]), Here(), tmp_path / "t.parquet")
    before = {row["key"]: row for row in pl.read_parquet(tmp_path / "t.parquet").to_dicts()}
    assert sweeping.sweep(short(seeds=[1, 2]), Here(), tmp_path / "t.parquet") == 1
    after = pl.read_parquet(tmp_path / "t.parquet")
    assert sorted(after["seed"]) == [0, 1, 2]
    kept = [row for row in after.to_dicts() if row["key"] in before]
    assert len(kept) == 2 and all(row == before[row["key"]] for row in kept)


def test_a_line_that_was_cut_short_is_run_again_and_no_other(tmp_path):
    """A journal that ends in the middle of a line, as after a power cut, loses that line only."""
    wanted = short(seeds=[0, 1, 2])
    rows = [sweeping.run_case(case) | {"error": None} for case in wanted[:2]]
    (tmp_path / "t.parquet.journal").write_bytes(journals.line_of(rows[0]) + journals.line_of(rows[1])[:40])
    assert sweeping.sweep(wanted, Here(), tmp_path / "t.parquet") == 2
    table = pl.read_parquet(tmp_path / "t.parquet")
    assert table.height == 3 and table["wall_s"][0] == rows[0]["wall_s"]


ODD = journals.line_of({"key": "0" * 20, "error": None, "seed": [1, 2], "duration_s": {"a": 1}}).rstrip()


@pytest.mark.parametrize("damage", [b"[1, 2]", b'{"key": 3}', b"\xff\xfe\x00", b'{"key": "a", "se', b"[" * 5000, ODD])
def test_a_damaged_line_is_run_again_and_no_other(tmp_path, damage):
    """A line in the middle of the journal that holds no row costs that row only."""
    wanted = short(seeds=[0, 1, 2])
    rows = [journals.line_of(sweeping.run_case(case) | {"error": None}) for case in wanted[::2]]
    (tmp_path / "t.parquet.journal").write_bytes(rows[0] + damage + b"\n" + rows[1])
    assert sweeping.sweep(wanted, Here(), tmp_path / "t.parquet") == 1
    assert pl.read_parquet(tmp_path / "t.parquet")["seed"].to_list() == [0, 1, 2]


def test_more_runs_than_fit_are_refused_at_once():
    """A range of a billion seeds is counted and not listed."""
    with pytest.raises(HexsimError, match=r"a sweep of 2000000000 runs: give at most 100000"):
        short(seeds=range(10**9), compensators=["none", "buffered"])


def test_a_scheduler_that_goes_away_keeps_the_rows(tmp_path):
    """Dask cancels what it held when its scheduler dies: a sentence, the rows kept, and the sweep can go on."""

    class Lost(Here):
        def submit(self, function, /, case):
            if case.seed == 0:
                return super().submit(function, case)
            future = Future()
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    with pytest.raises(HexsimError, match=r"workers died \(lost\); 1 rows are kept.*run the same command again"):
        sweeping.sweep(short(seeds=[0, 1]), Lost(), tmp_path / "t.parquet")
    assert sweeping.sweep(short(seeds=[0, 1]), Here(), tmp_path / "t.parquet") == 1


def test_a_journal_that_cannot_be_written_is_a_sentence(tmp_path, monkeypatch):
    """A full disk in the middle of a sweep."""

    def full(number):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hexsim.studies.journal.os.fsync", full)
    with pytest.raises(HexsimError, match=r"cannot write .*journal: No space left on device; .*run it again to go on"):
        sweeping.sweep(short(), Here(), tmp_path / "t.parquet")


def test_two_sweeps_cannot_write_one_table(tmp_path):
    """The second is told so at once; when the first is done it may."""
    with journals.Journal(tmp_path / "t.parquet"), pytest.raises(HexsimError, match="another sweep is writing"):
        sweeping.sweep(short(), Here(), tmp_path / "t.parquet")
    assert sweeping.sweep(short(), Here(), tmp_path / "t.parquet") == 1


def test_a_table_that_is_no_sweep_is_not_overwritten(tmp_path):
    """A foreign Parquet file and a name that is not .parquet are refused."""
    pl.DataFrame({"a": [1]}).write_parquet(tmp_path / "t.parquet")
    with pytest.raises(HexsimError, match="no table of a sweep"):
        sweeping.sweep(short(), Here(), tmp_path / "t.parquet")
    with pytest.raises(HexsimError, match=r"must be a \.parquet file"):
        sweeping.sweep(short(), Here(), tmp_path / "t.csv")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes").write_text("mine")
    with pytest.raises(HexsimError, match="no table of a sweep"):
        sweeping.sweep(short(), Here(), tmp_path / "other")
    (tmp_path / "other" / "notes").unlink()
    (tmp_path / "other").rmdir()
    assert [p.name for p in tmp_path.iterdir()] == ["t.parquet"]


def instant(case):
    """A row as a run would give it, without the run: the size of a bench's."""
    figures = {f"leg_figure_{k}": float(case.seed) for k in range(30)}
    return {
        "key": case.key,
        "values_key": case.values_key,
        "seed": case.seed,
        **case.settings,
        **figures,
        "complete": True,
        "error": None,
    }


def test_a_folder_takes_rows_in_parts_of_one_schema(tmp_path, monkeypatch):
    """Parts of two rows, failed runs alone in the first, whole and broken numbers in one setting: every case is there once,
    all files have the same columns and types, and polars scans them as one."""
    monkeypatch.setattr("hexsim.studies.sweep_table.Parts.most", 2)
    bad = sweeping.cases(load_scenario("heave", amplitude=0.5, duration_s=0.5), load_machine("bench"), seeds=[8, 9])
    good = short(settings={"valve.overlap_m": [0, 5e-6]}, seeds=[0, 1])
    assert sweeping.sweep(bad + good, Here(), tmp_path / "table") == 6
    parts = sorted((tmp_path / "table").iterdir())
    assert [path.name for path in parts] == [f"part-{k:06d}.parquet" for k in range(3)]
    assert len({tuple(pl.read_parquet_schema(path).items()) for path in parts}) == 1
    table = pl.scan_parquet(tmp_path / "table" / "*.parquet").collect()
    assert sorted(table["key"]) == sorted(case.key for case in bad + good)
    assert table.filter(pl.col("error").is_null())["valve.overlap_m"].to_list() == [0.0, 0.0, 5e-6, 5e-6]
    assert sweeping.sweep(bad + good + short(seeds=[5]), Here(), tmp_path / "table") == 1
    assert pl.read_parquet(tmp_path / "table" / "*.parquet").height == 7


def test_a_kill_between_a_part_and_its_journal_costs_and_doubles_nothing(tmp_path, monkeypatch):
    """The part is written, the journal still holds its rows: they count once, and nothing runs again."""
    wanted = short(seeds=range(4))
    monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)
    with journals.Journal(tmp_path / "table") as journal:
        for case in wanted:
            journal.add(instant(case))
        journal.table.take(journal.rows)
    assert sweeping.sweep(wanted, Here(), tmp_path / "table") == 0
    assert pl.read_parquet(tmp_path / "table" / "*.parquet")["seed"].to_list() == [0, 1, 2, 3]


def test_memory_holds_one_part_of_the_rows(tmp_path, monkeypatch):
    """3,000 rows in parts of 500: never more than 500 of them in memory."""
    monkeypatch.setattr("hexsim.studies.sweep_table.Parts.most", 500)
    monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)
    monkeypatch.setattr("hexsim.studies.journal.os.fsync", lambda number: None)
    held = []
    add = journals.Journal.add
    monkeypatch.setattr(journals.Journal, "add", lambda self, row: (add(self, row), held.append(len(self.rows))))
    sweeping.sweep(short(seeds=range(3000)), Here(), tmp_path / "table")
    assert max(held) < 500 and len(held) == 3000
    assert pl.scan_parquet(tmp_path / "table" / "*.parquet").select(pl.len()).collect().item() == 3000


@pytest.mark.slow
def test_dead_workers_keep_the_finished_rows(tmp_path):
    """When a worker process dies the sweep ends with a sentence, and the journal holds what was done."""
    wanted = short(seeds=[0, 1])
    with journals.Journal(tmp_path / "t.parquet") as journal:
        journal.add(sweeping.run_case(wanted[0]) | {"error": None})
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=os._exit, initargs=(1,)) as pool,
        pytest.raises(HexsimError, match=r"workers died.*1 rows are kept.*run the same command again"),
    ):
        sweeping.sweep(wanted, pool, tmp_path / "t.parquet")
    assert sweeping.sweep(wanted, Here(), tmp_path / "t.parquet") == 1


def command(table: Path, *more: str) -> list[str]:
    arguments = [
        "sweep",
        "heave",
        "-m",
        "bench",
        "--duration",
        "2",
        "--seeds",
        "0:6",
        "--workers",
        "1",
        "--out",
        str(table),
    ]
    return [sys.executable, "-m", "hexsim", *arguments, *more]


@pytest.mark.slow
def test_a_killed_sweep_goes_on_where_it_was(tmp_path):
    """SIGKILL in the middle, the same command again: every case is there once, and finished ones were not run again."""
    table = tmp_path / "t.parquet"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(command(table), cwd=tmp_path, env=environment, start_new_session=True)
    journal = tmp_path / "t.parquet.journal"
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and not (journal.exists() and journal.read_bytes().count(b"\n") >= 2):
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    finished = [
        json.loads(line.split(b" ", 1)[1])
        for line in journal.read_bytes().splitlines(keepends=True)
        if line.endswith(b"\n")
    ]
    assert 2 <= len(finished) <= 6 and not table.exists()
    ended = subprocess.run(
        command(table, "--json"), cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    said = json.loads(ended.stdout)
    assert said["runs"] == 6 and said["run_now"] == 6 - len(finished) and said["failed"] == 0
    rows = {row["key"]: row for row in pl.read_parquet(table).to_dicts()}
    assert sorted(row["seed"] for row in rows.values()) == [0, 1, 2, 3, 4, 5]
    assert all(rows[row["key"]]["wall_s"] == row["wall_s"] for row in finished)


def test_workers_end_with_their_sweep(tmp_path):
    """kill -9 of the parent alone: its workers are gone within seconds, not for ever."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(command(tmp_path / "t.parquet"), cwd=tmp_path, env=environment)
    journal = tmp_path / "t.parquet.journal"
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and not (journal.exists() and journal.read_bytes().count(b"\n") >= 1):
        time.sleep(0.02)
    workers = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.wait()
    gone, alive = psutil.wait_procs(workers, timeout=20)
    assert len(gone) >= 1 and alive == []


@pytest.mark.slow  # a real cluster; executors and a scheduler that is not there are in this file
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # sockets of Dask's own shutdown
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Dask's own use of asyncio and tornado
def test_the_same_sweep_runs_on_a_dask_cluster(tmp_path, monkeypatch):
    """A real scheduler and worker on the loopback interface give the same figures to the bit as this process."""
    from distributed import LocalCluster

    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    wanted = short(seeds=[0, 1], compensators=["none", "buffered"])
    options = {
        "n_workers": 1,
        "threads_per_worker": 2,
        "processes": True,
        "dashboard_address": None,
        "host": "127.0.0.1",
    }
    asked = "sweep heave -m bench --duration 0.5 --seeds 0,1 -c none,buffered --json --scheduler"
    with LocalCluster(**options) as cluster:
        out = ["--out", str(tmp_path / "dask.parquet")]
        done = CliRunner().invoke(app, [*asked.split(), cluster.scheduler_address, *out])
    assert done.exit_code == 0 and json.loads(done.stdout)["run_now"] == 4, done.output
    sweeping.sweep(wanted, Here(), tmp_path / "here.parquet")
    there, here = (
        pl.read_parquet(tmp_path / f"{name}.parquet").drop("wall_s", "realtime_factor") for name in ("dask", "here")
    )
    assert there.equals(here) and there["complete"].all()


def test_a_scheduler_that_is_not_there_is_said(monkeypatch, tmp_path):
    """No answer within the time limit is one sentence with the address."""
    pytest.importorskip("distributed")
    monkeypatch.setattr("hexsim.cli.sweep.CONNECT_TIMEOUT_S", 0.5)
    asked = ["sweep", "heave", "-m", "bench", "--out", str(tmp_path / "t.parquet"), "--scheduler", "tcp://127.0.0.1:9"]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 2 and "no Dask scheduler answers at tcp://127.0.0.1:9" in done.stderr


# whatever ends
OWN = """
import os, sys, time
import numpy as np
from compensation import Compensator
from own_help import VOLTS

class Own(Compensator):
    name = "own"
    def start(self, context): pass
    def parameters(self): return {}
    def restore(self, parameters): pass
    def step(self, sample, ahead): return VOLTS

class Exits(Own):
    name = "exits"
    def start(self, context): sys.exit(0)

class Dies(Own):
    name = "dies"
    def start(self, context): os._exit(0)

class Killed(Own):
    name = "killed"
    def start(self, context): os.kill(os.getpid(), 9)
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A module of the user's with compensators, and one that it imports."""
    folder = tmp_path / "mods"
    folder.mkdir()
    (folder / "own_mod.py").write_text(OWN)
    (folder / "own_help.py").write_text("VOLTS = 0.0\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(folder), str(ROOT)]))
    monkeypatch.syspath_prepend(str(folder))
    yield folder
    for name in ("own_mod", "own_help"):
        sys.modules.pop(name, None)


DEATHS = {
    "own_mod:Exits": "SystemExit",
    "own_mod:Dies": "WorkerDied: .*exit code 0",
    "own_mod:Killed": "WorkerDied: .*SIGKILL",
}


@pytest.mark.parametrize("dying", [[*DEATHS][-1:], pytest.param([*DEATHS], marks=pytest.mark.slow)])
def test_a_worker_that_dies_is_a_row_and_no_end(own, tmp_path, dying):
    """sys.exit, os._exit and SIGKILL in a compensator, two processes: each such case is a failed row that says how, all
    others have their figures, and the same call again runs none."""
    names = [*dying, "none"]
    table = tmp_path / "t.parquet"
    asked = f"sweep heave -m bench --duration 0.5 --workers 2 --json --out {table} -c {','.join(names)}".split()
    for now in (len(names), 0):
        done = CliRunner().invoke(app, asked)
        assert done.exit_code == 1, done.output
        assert json.loads(done.stdout)["run_now"] == now
    rows = pl.read_parquet(table)
    assert rows["compensator"].to_list() == names
    assert rows["complete"].to_list() == [False] * len(dying) + [True]
    for name, error in zip(dying, rows["error"], strict=False):
        assert re.search(DEATHS[name], error), error
    assert rows["leg_peak_band_m_s2"].null_count() == len(dying)


def test_rows_of_other_inputs_are_not_served(own, tmp_path, monkeypatch):
    """A setpoint file edited in place, a compensator's module and one that it imports: each is another case, whose old row is
    gone from the table; so is a setpoint file that a setting names. With the old bytes back, the same key is back."""
    path = tmp_path / "sp.csv"

    def motion(size):
        path.write_text("time_s,z_m\n" + "".join(f"{k / 100},{size * (k / 100) ** 2}\n" for k in range(101)))

    def rows():
        for name in ("own_mod", "own_help"):
            sys.modules.pop(name, None)
        for cached in (inputs._own_code_digest, inputs._hexsim_digest):  # what a new process does
            cached.cache_clear()
        wanted = sweeping.cases(load_scenario(path), load_machine("bench"), compensators=["own_mod:Own"])
        monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)
        count = sweeping.sweep(wanted, Here(), tmp_path / "t.parquet")
        assert pl.read_parquet(tmp_path / "t.parquet")["key"].to_list() == [wanted[0].key]
        return count, wanted[0].key

    motion(0.01)
    assert rows()[0] == 1
    first = rows()
    assert first[0] == 0
    motion(0.03)
    assert rows()[0] == 1
    motion(0.01)
    assert rows() == (1, first[1])
    (own / "own_help.py").write_text("VOLTS = 1.5\n")
    assert rows()[0] == 1 and rows()[1] != first[1]
    (own / "own_mod.py").write_text(OWN + "# other\n")
    assert rows()[0] == 1
    tables = {"kind": "file", "path": str(path), "column": "z_m"}
    by_setting = [short(settings={"scenario.axes.z": [tables]})[0].key]
    motion(0.02)
    assert short(settings={"scenario.axes.z": [tables]})[0].key not in by_setting


def test_inputs_that_change_while_a_sweep_runs_are_said(tmp_path):
    """The case was taken with other bytes than those that the worker found: the row is none, and says so."""
    path = tmp_path / "sp.csv"
    path.write_text("time_s,z_m\n0,0\n0.5,0.001\n")
    case = sweeping.cases(load_scenario(path), load_machine("bench"))[0]
    path.write_text("time_s,z_m\n0,0\n0.5,0.002\n")
    row = sweeping.run_case(case)
    assert not row["complete"] and "are others than when the sweep began" in row["error"]


@pytest.mark.parametrize("place", ["t.parquet", pytest.param("parts", marks=pytest.mark.slow)])
def test_a_journal_cut_at_any_byte_costs_the_rows_behind_it(tmp_path, monkeypatch, place):
    """Cut at each byte of the last two lines, and each of these bytes overwritten: the next call completes the table,
    runs no case twice whose line is whole, and believes none whose line is not."""
    monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)
    monkeypatch.setattr("hexsim.studies.journal.os.fsync", lambda number: None)
    wanted = short(seeds=range(3))
    lines = [journals.line_of(instant(case)) for case in wanted]
    whole, first = b"".join(lines), len(lines[0])
    for at in [*range(first, len(whole), 13), len(whole) - 2, len(whole) - 1]:
        for damaged in (whole[:at], whole[:at] + bytes([whole[at] ^ 4]) + whole[at + 1 :]):
            table = tmp_path / place
            with journals.Journal(table) as journal:
                pass
            journal.path.parent.mkdir(exist_ok=True)
            journal.path.write_bytes(damaged)
            intact = sum(line + b"\n" in lines for line in damaged.split(b"\n")[:-1])
            assert sweeping.sweep(wanted, Here(), table) == 3 - intact
            found = pl.read_parquet(table if place.endswith("parquet") else table / "*.parquet")
            assert sorted(found["seed"]) == [0, 1, 2] and (found["leg_figure_3"] == found["seed"]).all()
            shutil.rmtree(table) if table.is_dir() else table.unlink()


@pytest.mark.parametrize("place", ["t.parquet", "parts"])
def test_a_sweep_killed_while_it_writes_its_table_goes_on(tmp_path, monkeypatch, place):
    """Killed inside of polars' writing: half a file lies there; the next call runs nothing, completes, and removes it."""
    monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)
    wanted = short(seeds=range(3))
    with journals.Journal(tmp_path / place) as journal:
        for case in wanted:
            journal.add(instant(case))
    folder = tmp_path if place.endswith("parquet") else tmp_path / place
    name = place if place.endswith("parquet") else "part-000000.parquet"
    (folder / f".partial-{name}-abc.parquet").write_bytes(b"PAR1 half")
    assert sweeping.sweep(wanted, Here(), tmp_path / place) == 0
    assert [path.name for path in folder.iterdir()] == [name]


def test_a_full_disk_at_the_end_loses_nothing(tmp_path, monkeypatch):
    """Writing the table fails, as polars tells it: one sentence; with room again nothing is run twice."""
    monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)

    def full(self, file):
        Path(file).write_bytes(b"half")
        raise pl.exceptions.ComputeError("No space left on device (os error 28)")

    wanted = short(seeds=range(3))
    with monkeypatch.context() as patch:
        patch.setattr(pl.DataFrame, "write_parquet", full)
        with pytest.raises(
            HexsimError, match=r"cannot write .*No space left.*3 rows are kept in .*journal, run the same"
        ):
            sweeping.sweep(wanted, Here(), tmp_path / "t.parquet")
    assert sweeping.sweep(wanted, Here(), tmp_path / "t.parquet") == 0


def test_a_journal_that_takes_half_a_line_keeps_the_lines_before(tmp_path, monkeypatch):
    """A disk that is full in the middle of a line: the sweep ends in a sentence, and later the line's case alone is run."""
    monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)
    wanted = short(seeds=range(2))
    with journals.Journal(tmp_path / "t.parquet") as journal:
        journal.add(instant(wanted[0]))
        file = journal._file

        class Full:
            def __getattr__(self, name):
                return getattr(file, name)

            def write(self, data):
                if len(data) < 30:
                    raise OSError(28, "No space left on device")
                return file.write(data[: len(data) // 2])

        journal._file = Full()
        with pytest.raises(HexsimError, match=r"No space left on device; 1 rows are kept"):
            journal.add(instant(wanted[1]))
        journal._file = file
    assert (tmp_path / "t.parquet.journal").read_bytes().endswith(b"\n")
    assert sweeping.sweep(wanted, Here(), tmp_path / "t.parquet") == 1


def test_failed_rows_of_a_table_in_parts_are_replaced(tmp_path, monkeypatch):
    """Parts of two rows; on request the failed runs alone are tried again, and one that succeeds stands once, with the new result."""
    monkeypatch.setattr("hexsim.studies.sweep_table.Parts.most", 2)
    wanted = short(seeds=range(5))

    def failing(case):
        return instant(case) | ({"error": "X: no", "complete": False} if case.seed in (1, 2) else {})

    monkeypatch.setattr("hexsim.studies.sweep.run_case", failing)
    assert sweeping.sweep(wanted, Here(), tmp_path / "parts") == 5
    monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)
    assert sweeping.sweep(wanted, Here(), tmp_path / "parts") == 0
    assert sweeping.sweep(wanted, Here(), tmp_path / "parts", retry_failed=True) == 2
    found = pl.read_parquet(tmp_path / "parts" / "*.parquet")
    assert sorted(found["seed"]) == list(range(5)) and found["error"].null_count() == 5


def test_the_exit_code_says_that_runs_failed(tmp_path):
    """1, and a sentence with the count and what to do; 0 without a failure."""
    runner = CliRunner()
    base = [
        "sweep",
        "heave",
        "-m",
        "bench",
        "--duration",
        "0.3",
        "--workers",
        "1",
        "--out",
        str(tmp_path / "t.parquet"),
    ]
    ended = runner.invoke(app, [*base, "--set", "scenario.axes.z.amplitude=0.01,2"])
    assert ended.exit_code == 1, ended.output
    assert "1 of 2 runs failed" in ended.stderr and "--retry-failed" in ended.stderr
    assert runner.invoke(app, [*base, "--set", "scenario.axes.z.amplitude=0.01"]).exit_code == 0


class KilledWorker(Exception):
    """As Dask's: the worker died several times while this and other cases were at it."""


def test_a_case_that_kills_its_dask_worker_is_found_and_recorded(tmp_path, monkeypatch):
    """Dask blames every case that a dying worker held: those that are innocent have their figures, the one that kills alone is
    a failed row. Where no worker comes back from it, the sweep ends in a sentence, and the next call gets past it."""
    monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)
    wanted, alone = short(seeds=range(3)), []

    class Cluster(Here):
        """Its first tasks all die with the worker; later a case dies that kills it."""

        def submit(self, function, /, case):
            alone.append(case.seed)
            future = super().submit(function, case)
            if len(alone) <= 3 or case.seed == 1:
                future = Future()
                future.set_exception(KilledWorker())
            return future

    assert sweeping.sweep(wanted, Cluster(), tmp_path / "t.parquet") == 3
    rows = pl.read_parquet(tmp_path / "t.parquet")
    assert rows["error"].is_null().to_list() == [True, False, True]
    assert "WorkerDied" in rows["error"][1]

    class Gone(Here):
        """A worker that is lost for good with the case that runs alone."""

        def submit(self, function, /, case):
            future = Future()
            if not first:
                first.append(case)
                future.set_exception(KilledWorker())
            return future

    def check():
        if first:
            raise HexsimError("no worker is left")

    first = []
    monkeypatch.setattr("hexsim.studies.sweep.CHECK_EVERY_s", 0.05)
    checks = iter([None])

    def late_check():
        if next(checks, "over") == "over":
            check()

    with pytest.raises(HexsimError, match="no worker is left"):
        sweeping.sweep(short(seeds=[7]), Gone(), tmp_path / "u.parquet", check=late_check)
    assert sweeping.sweep(short(seeds=[7]), Here(), tmp_path / "u.parquet") == 0
    assert "WorkerDied" in pl.read_parquet(tmp_path / "u.parquet")["error"][0]
