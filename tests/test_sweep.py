"""Sweeps: all cases once, whatever happens, on any executor."""

import json
import os
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

import hexsim
from hexsim.errors import HexsimError
from hexsim.machine import load_machine
from hexsim.scenarios import load_scenario
from hexsim.studies.journal import Journal
from hexsim.studies.sweep import cases, run_case, sweep

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
    return cases(load_scenario("heave", duration_s=0.5), load_machine("bench"), **options)


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
    ran = sweep(wanted, Here(), tmp_path / "t.parquet", progress=lambda *counts: seen.append(counts))
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
    bad = cases(load_scenario("heave", amplitude=0.5, duration_s=0.5), load_machine("bench"), seeds=[1])
    sweep(good + bad, Here(), tmp_path / "t.parquet")
    first, second = pl.read_parquet(tmp_path / "t.parquet").to_dicts()
    assert first["complete"] and first["error"] is None
    assert not second["complete"] and "HexsimError: scenario heave" in second["error"]
    assert second["leg_peak_band_m_s2"] is None


def test_a_second_sweep_runs_only_what_is_new_and_keeps_the_rest(tmp_path):
    """Seeds 0 and 1, then 1 and 2: one run; three rows; the shared row is the first sweep's to the bit."""
    sweep(short(seeds=[0, 1]), Here(), tmp_path / "t.parquet")
    before = {row["key"]: row for row in pl.read_parquet(tmp_path / "t.parquet").to_dicts()}
    assert sweep(short(seeds=[1, 2]), Here(), tmp_path / "t.parquet") == 1
    after = pl.read_parquet(tmp_path / "t.parquet")
    assert sorted(after["seed"]) == [0, 1, 2]
    kept = [row for row in after.to_dicts() if row["key"] in before]
    assert len(kept) == 2 and all(row == before[row["key"]] for row in kept)


def test_a_line_that_was_cut_short_is_run_again_and_no_other(tmp_path):
    """A journal that ends in the middle of a line, as after a power cut, loses that line only."""
    wanted = short(seeds=[0, 1, 2])
    rows = [run_case(case) | {"error": None} for case in wanted[:2]]
    text = json.dumps(rows[0]) + "\n" + json.dumps(rows[1])[:40]
    (tmp_path / "t.parquet.journal").write_text(text)
    assert sweep(wanted, Here(), tmp_path / "t.parquet") == 2
    table = pl.read_parquet(tmp_path / "t.parquet")
    assert table.height == 3 and table["wall_s"][0] == rows[0]["wall_s"]


@pytest.mark.parametrize("damage", [b"[1, 2]", b'{"key": 3}', b"\xff\xfe\x00", b'{"key": "a", "se', b"[" * 5000])
def test_a_damaged_line_is_run_again_and_no_other(tmp_path, damage):
    """A line in the middle of the journal that holds no row costs that row only."""
    wanted = short(seeds=[0, 1, 2])
    rows = [json.dumps(run_case(case) | {"error": None}).encode() for case in wanted[::2]]
    (tmp_path / "t.parquet.journal").write_bytes(rows[0] + b"\n" + damage + b"\n" + rows[1] + b"\n")
    assert sweep(wanted, Here(), tmp_path / "t.parquet") == 1
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
        sweep(short(seeds=[0, 1]), Lost(), tmp_path / "t.parquet")
    assert sweep(short(seeds=[0, 1]), Here(), tmp_path / "t.parquet") == 1


def test_a_journal_that_cannot_be_written_is_a_sentence(tmp_path, monkeypatch):
    """A full disk in the middle of a sweep."""

    def full(number):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hexsim.studies.journal.os.fsync", full)
    with pytest.raises(HexsimError, match=r"cannot write .*journal: No space left on device; .*run it again to go on"):
        sweep(short(), Here(), tmp_path / "t.parquet")


def test_two_sweeps_cannot_write_one_table(tmp_path):
    """The second is told so at once; when the first is done it may."""
    with Journal(tmp_path / "t.parquet"), pytest.raises(HexsimError, match="another sweep is writing"):
        sweep(short(), Here(), tmp_path / "t.parquet")
    assert sweep(short(), Here(), tmp_path / "t.parquet") == 1


def test_a_table_that_is_no_sweep_is_not_overwritten(tmp_path):
    """A foreign Parquet file and a name that is not .parquet are refused."""
    pl.DataFrame({"a": [1]}).write_parquet(tmp_path / "t.parquet")
    with pytest.raises(HexsimError, match="no table of a sweep"):
        sweep(short(), Here(), tmp_path / "t.parquet")
    with pytest.raises(HexsimError, match=r"must be a \.parquet file"):
        sweep(short(), Here(), tmp_path / "t.csv")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes").write_text("mine")
    with pytest.raises(HexsimError, match="no table of a sweep"):
        sweep(short(), Here(), tmp_path / "other")
    (tmp_path / "other" / "notes").unlink()
    (tmp_path / "other").rmdir()
    assert [p.name for p in tmp_path.iterdir()] == ["t.parquet"]


def instant(case):
    """A row as a run would give it, without the run: the size of a bench's."""
    figures = {f"leg_figure_{k}": float(case.seed) for k in range(30)}
    return {"key": case.key, "seed": case.seed, **case.settings, **figures, "complete": True, "error": None}


def test_a_folder_takes_rows_in_parts_of_one_schema(tmp_path, monkeypatch):
    """Parts of two rows, failed runs alone in the first, whole and broken numbers in one setting: every case is there once,
    all files have the same columns and types, and polars scans them as one."""
    monkeypatch.setattr("hexsim.studies.sweep_table.Parts.most", 2)
    bad = cases(load_scenario("heave", amplitude=0.5, duration_s=0.5), load_machine("bench"), seeds=[8, 9])
    good = short(settings={"valve.overlap_m": [0, 5e-6]}, seeds=[0, 1])
    assert sweep(bad + good, Here(), tmp_path / "table") == 6
    parts = sorted((tmp_path / "table").iterdir())
    assert [path.name for path in parts] == [f"part-{k:06d}.parquet" for k in range(3)]
    assert len({tuple(pl.read_parquet_schema(path).items()) for path in parts}) == 1
    table = pl.scan_parquet(tmp_path / "table" / "*.parquet").collect()
    assert sorted(table["key"]) == sorted(case.key for case in bad + good)
    assert table.filter(pl.col("error").is_null())["valve.overlap_m"].to_list() == [0.0, 0.0, 5e-6, 5e-6]
    assert sweep(bad + good + short(seeds=[5]), Here(), tmp_path / "table") == 1
    assert pl.read_parquet(tmp_path / "table" / "*.parquet").height == 7


def test_a_kill_between_a_part_and_its_journal_costs_and_doubles_nothing(tmp_path, monkeypatch):
    """The part is written, the journal still holds its rows: they count once, and nothing runs again."""
    wanted = short(seeds=range(4))
    monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)
    with Journal(tmp_path / "table") as journal:
        for case in wanted:
            journal.add(instant(case))
        journal.table.take(journal.rows)
    assert sweep(wanted, Here(), tmp_path / "table") == 0
    assert pl.read_parquet(tmp_path / "table" / "*.parquet")["seed"].to_list() == [0, 1, 2, 3]


def test_memory_holds_one_part_of_the_rows(tmp_path, monkeypatch):
    """3,000 rows in parts of 500: never more than 500 of them in memory."""
    monkeypatch.setattr("hexsim.studies.sweep_table.Parts.most", 500)
    monkeypatch.setattr("hexsim.studies.sweep.run_case", instant)
    monkeypatch.setattr("hexsim.studies.journal.os.fsync", lambda number: None)
    held = []
    add = Journal.add
    monkeypatch.setattr(Journal, "add", lambda self, row: (add(self, row), held.append(len(self.rows))))
    sweep(short(seeds=range(3000)), Here(), tmp_path / "table")
    assert max(held) < 500 and len(held) == 3000
    assert pl.scan_parquet(tmp_path / "table" / "*.parquet").select(pl.len()).collect().item() == 3000


def test_dead_workers_keep_the_finished_rows(tmp_path):
    """When a worker process dies the sweep ends with a sentence, and the journal holds what was done."""
    wanted = short(seeds=[0, 1])
    with Journal(tmp_path / "t.parquet") as journal:
        journal.add(run_case(wanted[0]) | {"error": None})
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=os._exit, initargs=(1,)) as pool,
        pytest.raises(HexsimError, match=r"workers died.*1 rows are kept.*run the same command again"),
    ):
        sweep(wanted, pool, tmp_path / "t.parquet")
    assert sweep(wanted, Here(), tmp_path / "t.parquet") == 1


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
    finished = [json.loads(line) for line in journal.read_bytes().splitlines(keepends=True) if line.endswith(b"\n")]
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


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # sockets of Dask's own shutdown
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Dask's own use of asyncio and tornado
def test_the_same_sweep_runs_on_a_dask_cluster(tmp_path, monkeypatch):
    """A real scheduler and worker on the loopback interface give the same figures to the bit as this process."""
    from distributed import LocalCluster

    from hexsim.cli.sweep import executor_of

    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    wanted = short(seeds=[0, 1], compensators=["none", "buffered"])
    options = {
        "n_workers": 1,
        "threads_per_worker": 2,
        "processes": True,
        "dashboard_address": None,
        "host": "127.0.0.1",
    }
    with LocalCluster(**options) as cluster, executor_of(cluster.scheduler_address, None) as (executor, count):
        assert count == 2
        assert sweep(wanted, executor, tmp_path / "dask.parquet", workers=count) == 4
    sweep(wanted, Here(), tmp_path / "here.parquet")
    there, here = (
        pl.read_parquet(tmp_path / f"{name}.parquet").drop("wall_s", "realtime_factor") for name in ("dask", "here")
    )
    assert there.equals(here) and there["complete"].all()


def test_a_scheduler_that_is_not_there_is_said(monkeypatch):
    """No answer within the time limit is one sentence with the address."""
    pytest.importorskip("distributed")
    from hexsim.cli import sweep as command_line

    monkeypatch.setattr(command_line, "CONNECT_TIMEOUT_S", 0.5)
    with pytest.raises(HexsimError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        command_line.executor_of("tcp://127.0.0.1:9", None).__enter__()
