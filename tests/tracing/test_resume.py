"""A trace that ends early leaves what is known, and goes on where it stopped with the same result."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from hexsim import HexsimError
from hexsim.cli import app
from hexsim.tracing import store
from hexsim.tracing import trace as traces

DATA = Path(__file__).parents[1] / "data" / "bench_leakage"
LENGTH_S = 3.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The leaking bench with the first seconds of its logs."""
    place = tmp_path_factory.mktemp("bench")
    (place / "machine.toml").write_bytes((DATA / "machine.toml").read_bytes())
    for name in ("fit", "validate"):
        [log] = DATA.glob(f"{name}.*")
        table = pl.read_parquet(log) if log.suffix == ".parquet" else pl.read_csv(log)
        table.filter(pl.col("time_s") < LENGTH_S).write_csv(place / f"{name}.csv")
    return place


def failing(name, error):
    """The steps with one that raises."""

    def fail(state, tell):
        raise error

    return tuple(replace(step, run=fail) if step.name == name else step for step in traces.STEPS)


def without_times(report):
    return report | {"steps": [{**step, "seconds": 0.0} for step in report["steps"]]}


def read(place):
    return json.loads((place / "report.json").read_text())


@pytest.mark.slow
def test_a_trace_that_fails_and_is_interrupted_ends_as_one_that_is_not(folder, tmp_path, monkeypatch):
    """Once a step fails, once it is interrupted: each time report.json and report.html say that it is incomplete, and by what;
    resumed, no step is done twice, and the report is the same to the last digit but for the seconds."""
    asked = store.Asked(machine=str(folder), fit=("fit",), validate=("validate",))
    keep = traces.kept_in(tmp_path, asked)
    plain = traces.trace(folder, ["fit"], ["validate"]).report
    monkeypatch.setattr(traces, "STEPS", failing("hypotheses", RuntimeError("a bug")))
    with pytest.raises(RuntimeError, match="a bug"):
        traces.trace(folder, ["fit"], ["validate"], tmp_path, keep=keep)
    known = read(tmp_path)
    assert known["verdict"] == "incomplete" and known["effects"] == []
    assert known["incomplete"]["why"] == "it failed: RuntimeError: a bug"
    assert known["incomplete"]["last_step"] == "declared parameters" == known["steps"][-1]["name"]
    assert known["incomplete"]["steps_left"][0] == "hypotheses"
    assert [b["name"] for b in known["balances"] if b["violated"]] == ["continuity"]
    assert "did not come to its end: it failed" in (tmp_path / "report.html").read_text()
    monkeypatch.undo()
    monkeypatch.setattr(traces, "STEPS", failing("ties", KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        traces.resume(tmp_path, tmp_path, keep=keep)
    assert read(tmp_path)["incomplete"]["why"] == "it was interrupted"
    assert [own["name"] for own in read(tmp_path)["hypothesis"]] == [own["name"] for own in plain["effects"]]
    monkeypatch.undo()
    result = traces.resume(tmp_path, tmp_path, keep=keep)
    assert without_times(result.report) == without_times(plain)
    assert without_times(read(tmp_path)) == without_times(json.loads(json.dumps(plain)))
    assert plain["effects"][0]["name"] == "leakage_supply_to_chamber"
    traces.forget(tmp_path)
    assert not (tmp_path / store.FILE).exists()


@pytest.fixture
def begun(folder, tmp_path, monkeypatch):
    """A folder with the state of a trace that was interrupted in its first step."""
    monkeypatch.setattr(traces, "STEPS", failing("balances", KeyboardInterrupt()))
    asked = store.Asked(machine=str(folder), fit=("fit",), validate=("validate",))
    with pytest.raises(KeyboardInterrupt):
        traces.trace(folder, ["fit"], ["validate"], tmp_path, keep=traces.kept_in(tmp_path, asked))
    return tmp_path


def test_a_log_that_has_changed_is_refused(folder, begun):
    """One byte more in a log, or another machine file: another trace, one sentence."""
    for name in ("fit.csv", "machine.toml"):
        before = (folder / name).read_bytes()
        (folder / name).write_bytes(before + b"\n")
        try:
            with pytest.raises(
                HexsimError, match=rf"{name} has changed since the trace in .* began: start the trace anew"
            ):
                traces.resume(begun)
        finally:
            (folder / name).write_bytes(before)
    store.Stored(begun).check_same_files()


def tampered(place, change):
    with np.load(place / store.FILE) as arrays:
        all_of = {name: arrays[name] for name in arrays.files}
    told = json.loads(bytes(all_of[store.TEXT]))
    change(told)
    all_of[store.TEXT] = np.frombuffer(json.dumps(told).encode(), dtype=np.uint8)
    with (place / store.FILE).open("wb") as file:
        np.savez(file, **all_of)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda told: told["objects"][0].update({"class": "Popen"}), "cannot be read"),
        (lambda told: told["objects"][-1]["fields"].update(shell="ls"), "cannot be read"),
        (lambda told: told.update(state={"array": 9999}), "cannot be read"),
        (lambda told: told.update(state=None), "cannot be read"),
        (lambda told: told.pop("hashes"), "cannot be read"),
        (lambda told: told.update(version="0.0.1"), "was written by hexsim 0.0.1"),
    ],
)
def test_a_state_that_somebody_changed_is_one_sentence(begun, change, sentence):
    """Classes that are none of a trace's, fields and places that are not there, another version: refused, nothing is run."""
    tampered(begun, change)
    with pytest.raises(HexsimError, match=rf"{sentence}.*start the trace anew"):
        traces.resume(begun)


def test_a_file_that_is_cut_off_or_pickled_is_one_sentence(begun):
    """Half of the file; an array of objects, which numpy would unpickle."""
    whole = (begun / store.FILE).read_bytes()
    (begun / store.FILE).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(HexsimError, match="cannot be read"):
        traces.resume(begun)
    with (begun / store.FILE).open("wb") as file:
        np.savez(file, **{store.TEXT: np.array([print], dtype=object)})
    with pytest.raises(HexsimError, match="cannot be read"):
        traces.resume(begun)


def test_resume_stands_alone(tmp_path, folder):
    """--resume takes machine, logs and options from its folder; a folder without a state is said."""
    with_others = CliRunner().invoke(app, ["trace", str(folder), "--resume", str(tmp_path)])
    assert with_others.exit_code == 2 and "give it alone" in with_others.stderr
    empty = CliRunner().invoke(app, ["trace", "--resume", str(tmp_path)])
    assert empty.exit_code == 2 and "holds no unfinished trace" in empty.stderr
    assert not list(tmp_path.iterdir())


def test_bad_logs_leave_nothing(tmp_path, folder):
    """A log that is not there: exit code 2, no folder."""
    result = CliRunner().invoke(app, ["trace", str(folder), "--fit", "nowhere", "--out", str(tmp_path / "out")])
    assert result.exit_code == 2 and not (tmp_path / "out").exists()
