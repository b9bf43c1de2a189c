"""The page docs/bring_your_own_machine.md works as printed: its mapping reads a foreign log, its Python runs."""

import re
import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from hexsim import readers
from hexsim.machine import load_machine
from hexsim.signals import table as signal_table
from hexsim.tracing.checks import checks

DATA = Path(__file__).resolve().parents[1] / "data"
PAGE = Path(__file__).resolve().parents[2] / "docs" / "bring_your_own_machine.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.fixture
def my_machine(tmp_path) -> Path:
    """A bench log in the foreign form that the page's mapping describes: ms, mm about mid stroke, bar, g, 4 ms late."""
    folder = tmp_path / "my_machine"
    folder.mkdir()
    log = pl.read_csv(DATA / "bench_none" / "fit.csv.gz").head(10_000)
    acceleration = log["acceleration_m_s2"].to_numpy()
    foreign = {
        "Time": log["time_s"] * 1e3,
        "Cyl pos": (log["position_m"] - 0.1) * 1e3,
        "Ref": (log["setpoint_m"] - 0.1) * 1e3,
        "U valve": log["valve_V"],
        "p1": log["pressure_bottom_Pa"] / 1e5,
        "ps": log["pressure_supply_Pa"] / 1e5,
        "acc": np.concatenate([np.full(4, acceleration[0]), acceleration[:-4]]) / 9.80665,
    }
    pl.DataFrame(foreign).write_csv(folder / "fit.csv")
    mapping = next(block for block in blocks("toml") if "[columns.time_s]" in block)
    (folder / "mapping.toml").write_text(mapping)
    (folder / "machine.toml").write_bytes((DATA / "bench_none" / "machine.toml").read_bytes())
    return folder


def test_the_mapping_of_the_page_reads_a_foreign_log(my_machine):
    """Step 3: mapping.toml beside the log gives the measured-log columns, and the checks are silent."""
    log = readers.read_log(my_machine / "fit.csv")
    raw = pl.read_csv(DATA / "bench_none" / "fit.csv.gz")
    n = len(log.time)
    assert n == 10_000 - 4  # the late channel ends 4 samples early
    for name in ("position_m", "setpoint_m", "valve_V", "pressure_bottom_Pa", "acceleration_m_s2"):
        np.testing.assert_allclose(log.columns[name], raw[name].to_numpy()[:n], rtol=1e-9, atol=1e-9, err_msg=name)
    assert checks.check_log(log, load_machine(my_machine)) == []


def test_the_python_of_the_page_runs(my_machine, monkeypatch, capsys):
    """Step 4 as printed, in the folder above the machine; steps 7 and 8 compile and define what they say."""
    monkeypatch.chdir(my_machine.parent)
    look, effect, sensor = blocks("python")
    exec(compile(look, "step 4", "exec"), {})
    assert capsys.readouterr().out.startswith("1000.0\n")
    names: dict = {}
    exec(compile(effect, "step 7", "exec"), names)
    assert names["EFFECT"].name == "hose_compliance"
    exec(compile(sensor, "step 8", "exec"), names)
    assert names["SENSOR"].source in signal_table.table()


def test_every_toml_block_is_valid(tmp_path):
    for i, block in enumerate(blocks("toml")):
        tables = tomllib.loads(block)
        if "file" in tables or "columns" in tables:
            (tmp_path / f"{i}.toml").write_text(block)
            readers.load_mapping(tmp_path / f"{i}.toml")
