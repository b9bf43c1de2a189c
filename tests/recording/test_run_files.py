"""The files of a run: what they hold, and that a run can be repeated from them."""

import json
import math
import tomllib

import numpy as np
import polars as pl
import pytest
from made_up_run import made_up_run

from hexsim import HexsimError
from hexsim.files import log_files
from hexsim.machine import machine_from_dict
from hexsim.recording import run_files
from hexsim.scenarios import scenario_from_dict


@pytest.mark.parametrize("ending", ["parquet", "csv", "csv.gz"])
def test_a_log_comes_back_to_the_bit(tmp_path, ending):
    """All three formats keep every float64: shortest decimal text of a double reads back as that double."""
    values = np.random.default_rng(1).standard_normal(1000) * 10.0 ** np.arange(-20, 20).repeat(25)
    log = pl.DataFrame({"time_s": np.arange(1000) * 1e-3, "position_m": values})
    log_files.write_log(log, tmp_path / f"log.{ending}")
    assert log_files.read_log(log_files.find_log(tmp_path)).equals(log)
    assert [p.name for p in tmp_path.iterdir()] == [f"log.{ending}"]


def test_logs_that_cannot_be_read_are_named(tmp_path):
    """A broken, foreign or missing log is one sentence with its path, never another exception."""
    (tmp_path / "log.parquet").write_bytes(b"no parquet")
    (tmp_path / "log.pkl").write_bytes(b"")
    for name in ("log.parquet", "log.pkl", "log.csv"):
        with pytest.raises(HexsimError, match=name.replace(".", r"\.")) as caught:
            log_files.read_log(tmp_path / name)
        assert "\n" not in str(caught.value)
    with pytest.raises(HexsimError, match="holds no log"):
        log_files.find_log(tmp_path / "nowhere")


def test_a_run_leaves_all_its_files(tmp_path):
    """Log, summary, configuration, recording, report and figures; and nothing temporary."""
    written = run_files.write_run(made_up_run(duration_s=4.0), tmp_path)
    names = {str(path.relative_to(tmp_path)) for path in written}
    assert {"log.parquet", "summary.json", "config.toml", "run.rrd", "report.html"} <= names
    assert {
        f"figures/{n}.png" for n in ("motion", "acceleration", "parasitic", "flow_curve", "pressures", "spectrum")
    } <= names
    assert {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()} == names


def test_the_configuration_repeats_the_run(tmp_path):
    """config.toml holds the whole machine and scenario: made again from it they are equal, with seed and versions."""
    run = made_up_run(duration_s=4.0)
    run_files.write_run(run, tmp_path, recording=False, report=False)
    config = tomllib.loads((tmp_path / "config.toml").read_text())
    assert machine_from_dict(config["machine"]) == run.machine
    assert scenario_from_dict(config["scenario"]) == run.scenario
    assert config["run"] == {
        "scenario": "heave",
        "machine": "made_up_hexapod",
        "compensator": "none",
        "seed": 0,
        "model": "full",
        "scheme": "rk4",
        "timestep_s": "chosen",
        "complete": True,
        "reason": "",
    }
    assert {"hexsim", "python", "mujoco", "numpy"} <= set(config["versions"])


def test_a_partial_run_says_so_in_its_summary(tmp_path):
    """summary.json of a whole run has no such key, that of a partial one has it and the reason; its log can be read."""
    run_files.write_run(made_up_run(duration_s=4.0), tmp_path / "whole", recording=False, report=False)
    run_files.write_run(made_up_run(duration_s=4.0, complete=False), tmp_path / "cut", recording=False, report=False)
    whole, cut = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("whole", "cut"))
    assert "partial" not in whole
    assert cut["partial"] is True and cut["reason"] == "interrupted at 3.0 s"
    assert log_files.read_log(tmp_path / "cut" / "log.parquet").height == 4000


def test_a_run_of_a_few_samples_is_kept_without_plots(tmp_path):
    """Interrupted at once, a run still leaves log, summary and configuration."""
    run = made_up_run(duration_s=4.0, complete=False)
    run.log, run.summary = run.log.head(3), {**run.summary, "axes": {}}
    names = {path.name for path in run_files.write_run(run, tmp_path)}
    assert names == {"log.parquet", "summary.json", "config.toml"}


def test_json_is_strict(tmp_path):
    """What is not finite becomes null (JSON has no NaN), numpy values become numbers, keys without value stay; the TOML beside it,
    which has no null, leaves them out."""
    run = made_up_run(duration_s=4.0)
    data = {"a": np.float64("nan"), "b": np.array([1.0, math.inf]), "c": np.int64(3), "d": None, "e": (True, "x")}
    run.summary, run.seed = data, None
    run_files.write_run(run, tmp_path, recording=False, report=False)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary == {"a": None, "b": [1.0, None], "c": 3, "d": None, "e": [True, "x"]}
    assert "seed" not in tomllib.loads((tmp_path / "config.toml").read_text())["run"]
