"""Measured logs and mapping files, mutated, through the readers and the checks that go before a trace."""

import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from harness import MORE, fuzz, refused, sandbox
from hypothesis import strategies as st
from mutations import as_toml, leaves, mutated, torn

from hexsim import load_scenario, readers
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation import simulate
from hexsim.tracing.checks import checks

BENCH = load_machine("bench")
MAPPING = tomllib.loads("""
kind = "bench"
[file]
separator = ","
[columns.time_s]
from = "time_s"
unit = "s"
[columns.position_m]
from = "position_m"
factor = 1.0
offset = 0.0
[columns.setpoint_m]
[columns.valve_V]
unit = "V"
[columns.pressure_bottom_Pa]
unit = "Pa"
delay_s = 0.004
[columns.acceleration_m_s2]
""")


@pytest.fixture(scope="module")
def log() -> pl.DataFrame:
    """Two seconds of the bench at 250 Hz."""
    machine = changed(BENCH, {"sensors.log_rate_Hz": 250.0})
    return simulate(machine, load_scenario("heave", duration_s=2.0), fast=True).log


def read_and_check(folder: Path, path: str, mapping: str | None) -> None:
    """The log with its checks, or one sentence."""

    def read() -> None:
        checks.check_log(readers.read_log(folder / path, None if mapping is None else folder / mapping), BENCH)

    refused(read)


@st.composite
def damage(draw, log: pl.DataFrame) -> pl.DataFrame:
    """Columns gone, renamed, doubled, constant, of another type or size; rows gone, doubled, out of order, odd cells."""
    for _ in range(draw(st.integers(1, 4))):
        if log.width == 0:
            break
        column = draw(st.sampled_from(log.columns))
        change = draw(
            st.sampled_from(
                ["drop", "rename", "constant", "scale", "text", "cell", "rows", "order", "empty", "few", "gaps"]
            )
        )
        if change == "drop":
            log = log.drop(column)
        elif change == "rename":
            name = draw(
                st.sampled_from(["t", "position_mm", "pressure_bottom_bar", "p [psi]", "", "x" * 300, "[/red]"])
            )
            log = log.rename({column: name}) if name not in log.columns else log
        elif change == "constant":
            log = log.with_columns(pl.lit(draw(leaves)).alias(column))
        elif change == "scale" and log[column].dtype.is_numeric():
            log = log.with_columns(
                pl.col(column) * draw(st.sampled_from([0.0, -1.0, 1e-300, 1e300, 1e3, float("nan")]))
            )
        elif change == "text":
            log = log.with_columns(pl.col(column).cast(pl.String, strict=False))
        elif change == "cell" and log.height:
            row = draw(st.integers(0, log.height - 1))
            cells = log[column].cast(pl.String, strict=False).to_list()
            cells[row] = str(draw(leaves))
            log = log.with_columns(pl.Series(column, cells))
        elif change == "rows":
            log = log[:: draw(st.sampled_from([2, 7, 100, 600]))]
        elif change == "order":
            places = np.random.default_rng(draw(st.integers(0, 9))).permutation(log.height)
            log = log[places.tolist()]
        elif change == "empty":
            log = log.with_columns(pl.lit(None).alias(column))
        elif change == "few":
            log = log.head(draw(st.integers(0, 12)))
        elif change == "gaps" and log.height > 60:
            first = draw(st.integers(0, log.height - 50))
            log = pl.concat([log[:first], log[first + draw(st.integers(1, 50)) :]])
    return log


@MORE
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_damaged_logs(log, tmp_path, ending, examples):
    """Any table of numbers and texts is read and checked, or refused."""

    def claim(table: pl.DataFrame) -> None:
        with sandbox(tmp_path) as work:
            table.write_csv(work / "log.csv") if ending == "csv" else table.write_parquet(work / "log.parquet")
            read_and_check(work, f"log.{ending}", None)

    fuzz(damage(log), claim, examples)


@MORE
@pytest.mark.parametrize("ending", ["csv", "csv.gz", "parquet", "txt", "mat"])
def test_torn_logs(log, tmp_path, ending, examples):
    """Bytes cut out, doubled or overwritten."""
    text = log.head(200).write_csv()

    def claim(data: bytes) -> None:
        with sandbox(tmp_path) as work:
            (work / f"log.{ending}").write_bytes(data)
            read_and_check(work, f"log.{ending}", None)

    fuzz(torn(text), claim, examples // 5)


@MORE
def test_mapping_files(log, tmp_path, examples):
    """Mapping files of every kind: the log is read so, or the sentence names the mapping."""

    def claim(tables) -> None:
        with sandbox(tmp_path) as work:
            log.write_csv(work / "log.csv")
            (work / "mapping.toml").write_text(as_toml(tables), encoding="utf-8")
            read_and_check(work, "log.csv", "mapping.toml")

    fuzz(mutated([MAPPING]), claim, examples)
