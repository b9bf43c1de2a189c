"""A trace says the same whatever format its logs came in."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import scipy.io

import hexsim as hx

DATA = Path(__file__).resolve().parents[1] / "data"
RUNS = ("fit", "sweep", "validate")


def parquet(table: pl.DataFrame, path: Path) -> None:
    table.write_parquet(path.with_suffix(".parquet"))


def structs(table: pl.DataFrame, path: Path) -> None:
    """{Time, Data} for each signal."""
    time = table["time_s"].to_numpy()
    signals = {name: {"Time": time, name: table[name].to_numpy()} for name in table.columns if name != "time_s"}
    scipy.io.savemat(path.with_suffix(".mat"), signals)


def mdf(table: pl.DataFrame, path: Path) -> None:
    """The pressures in a group of their own, which is silent for 0.4 s."""
    asammdf = pytest.importorskip("asammdf", reason="MDF needs the extra hexsim[mdf]")
    time = table["time_s"].to_numpy()
    heard = (time < 7.0) | (time > 7.4)
    with asammdf.MDF(version="4.10") as file:
        for pressures, rows in ((False, np.full(len(time), True)), (True, heard)):
            names = [name for name in table.columns[1:] if name.startswith("pressure") == pressures]
            file.append(
                [
                    asammdf.Signal(samples=table[name].to_numpy()[rows], timestamps=time[rows], name=name)
                    for name in names
                ]
            )
        file.save(path.with_suffix(".mf4"), overwrite=True)


def mcap(table: pl.DataFrame, path: Path) -> None:
    """A topic a signal."""
    writer_of = pytest.importorskip("mcap.writer", reason="pip install hexsim[ros]")
    with open(path.with_suffix(".mcap"), "wb") as file:
        writer = writer_of.Writer(file)
        writer.start()
        schema = writer.register_schema(name="a", encoding="jsonschema", data=b"{}")
        for name in table.columns[1:]:
            channel = writer.register_channel(topic=f"/{name}", message_encoding="json", schema_id=schema)
            for t, x in zip(table["time_s"], table[name], strict=True):
                stamp = round(1e9 * t) + 1
                writer.add_message(channel, log_time=stamp, publish_time=stamp, data=json.dumps({name: x}).encode())
        writer.finish()


@pytest.mark.slow
@pytest.mark.parametrize("write", [parquet, structs, mdf, mcap])
@pytest.mark.parametrize("name, verdict", [("bench_none", "nothing missing"), ("bench_leakage", "explained")])
def test_the_verdict_is_that_of_the_text(tmp_path, write: Callable[[pl.DataFrame, Path], None], name, verdict):
    """Clean: nothing missing. With a leak: within 1 %, and its error is stated."""
    shutil.copy(DATA / name / "machine.toml", tmp_path)
    for run in RUNS:
        write(pl.read_csv(DATA / name / f"{run}.csv.gz"), tmp_path / run)
    result = hx.trace(tmp_path, fit=RUNS[:2], validate=RUNS[2:])
    assert result.verdict == verdict
    for effect in result.report["effects"]:
        assert effect["name"] == "leakage_supply_to_chamber"
        assert effect["parameters"]["conductance_m3_s_Pa"] == pytest.approx(1.8e-12, rel=1e-2)
        assert 0.0 < effect["standard_error"]["conductance_m3_s_Pa"] < 1e-2 * 1.8e-12
