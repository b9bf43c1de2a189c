"""`hexsim map`: proposals for foreign logs, against the columns that were renamed, scaled and shuffled."""

import random
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from hexsim import load_scenario, readers
from hexsim.cli import app
from hexsim.machine import load_machine
from hexsim.simulation import simulate

CLEAN = Path(__file__).resolve().parents[1] / "data" / "bench_none" / "fit.csv.gz"
STYLES = {  # column of the format: (name, factor to the file's unit)
    "german": {
        "time_s": ("Zeit [ms]", 1e3),
        "setpoint_m": ("Sollweg [mm]", 1e3),
        "position_m": ("Istweg [mm]", 1e3),
        "valve_V": ("Ventil [V]", 1.0),
        "pressure_bottom_Pa": ("Druck A [bar]", 1e-5),
        "pressure_supply_Pa": ("Druck P System [bar]", 1e-5),
        "acceleration_m_s2": ("Beschleunigung [g]", 1 / 9.80665),
    },
    "plc": {
        "time_s": ("timestamp_us", 1e6),
        "setpoint_m": ("MAIN.fbAxis.fTargetPosition", 1e3),
        "position_m": ("MAIN.fbAxis.fActualPosition", 1e3),
        "valve_V": ("MAIN.fbValve.fOutput", 1.0),
        "pressure_bottom_Pa": ("GVL.fPressureA", 1e-5),
        "pressure_supply_Pa": ("GVL.fPressureSupply", 1e-5),
        "acceleration_m_s2": ("GVL.fAccelZ", 1.0),
    },
    "psi": {
        "time_s": ("t", 1.0),
        "setpoint_m": ("cmd_in", 1 / 0.0254),
        "position_m": ("lvdt_in", 1 / 0.0254),
        "valve_V": ("servo_V", 1.0),
        "pressure_bottom_Pa": ("bore_psi", 1 / 6894.757),
        "pressure_supply_Pa": ("supply_psi", 1 / 6894.757),
        "acceleration_m_s2": ("accel_m_s2", 1.0),
    },
    "nameless": {
        "time_s": ("ch0", 1.0),
        "position_m": ("ch1", 1.0),
        "setpoint_m": ("ch2", 1.0),
        "valve_V": ("ch3", 1.0),
        "pressure_supply_Pa": ("ch4", 1.0),
        "pressure_bottom_Pa": ("ch5", 1.0),
        "acceleration_m_s2": ("ch6", 1.0),
    },
}


def run(*arguments):
    return CliRunner().invoke(app, ["map", *map(str, arguments)])


@pytest.mark.parametrize(("style", "seed"), [(style, seed) for seed, style in enumerate(STYLES)])
def test_a_foreign_bench_log_is_understood(tmp_path, style, seed):
    """Four ways to name and scale, columns shuffled, two more columns beside them: the file that is written reads back every
    signal within 1e-6 of its size, and a picture stands beside it."""
    source = pl.read_csv(CLEAN).head(8000)
    columns = {name: source[column] * factor for column, (name, factor) in STYLES[style].items()}
    columns |= {"state": pl.Series([3.0] * 8000), "temperature [degC]": pl.Series(np.linspace(30.0, 31.0, 8000))}
    names = list(columns)
    random.Random(seed).shuffle(names)
    pl.DataFrame({name: columns[name] for name in names}).write_csv(tmp_path / "rig.csv")
    done = run(tmp_path / "rig.csv", "--machine", "bench")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "mapping.png").stat().st_size > 10_000
    log = readers.read_log(tmp_path / "rig.csv")
    for column in STYLES[style]:
        if column != "time_s":
            want = source[column].to_numpy()[: log.n]
            assert np.abs(log.columns[column] - want).max() < 1e-6 * np.abs(want).max(), column


def test_six_legs_are_twelve_lines_at_most(tmp_path):
    """A hexapod's 31 columns under names that count legs from 0, in mm and bar: all found, legs in one line each."""
    machine = load_machine("micro_motion_system")
    log = simulate(machine, load_scenario("combined", duration_s=2.0), fast=True).log
    renamed = {"time_s": log["time_s"]}
    for leg in range(6):
        renamed |= {
            f"soll[{leg}]": 1e3 * log[f"setpoint_{leg + 1}_m"],
            f"ist[{leg}]": 1e3 * log[f"position_{leg + 1}_m"],
            f"u[{leg}]": log[f"valve_{leg + 1}_V"],
            f"p[{leg}]": 1e-5 * log[f"pressure_bottom_{leg + 1}_Pa"],
        }
    renamed |= {"p supply": 1e-5 * log["pressure_supply_Pa"]}
    renamed |= {f"acc {axis}": log[f"acceleration_{axis}_m_s2"] for axis in "xyz"}
    pl.DataFrame(renamed).write_csv(tmp_path / "rig.csv")
    done = run(tmp_path / "rig.csv", "-m", "micro_motion_system")
    assert done.exit_code == 0, done.output
    text = (tmp_path / "mapping.toml").read_text()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert len(lines) <= 12 and '"position_{leg}_m" = {from = "ist[{leg0}]"' in text
    read = readers.read_log(tmp_path / "rig.csv")
    for column in ("position_3_m", "setpoint_6_m", "valve_1_V", "pressure_bottom_4_Pa", "pressure_supply_Pa"):
        want = log[column].to_numpy()[: read.n]
        np.testing.assert_allclose(read.columns[column], want, rtol=1e-6, atol=1e-6 * np.abs(want).max())


def test_what_cannot_be_proposed_is_one_sentence(tmp_path):
    """A mapping that is there is kept; a log of other things names its columns."""
    (tmp_path / "rig.csv").write_text("time_s,weather\n" + "\n".join(f"{k},{1e9 * k}" for k in range(50)))
    done = run(tmp_path / "rig.csv", "-m", "bench")
    assert done.exit_code == 2 and "it has time_s, weather" in done.output
    (tmp_path / "mapping.toml").write_text("kind = 'bench'\n")
    done = run(tmp_path / "rig.csv", "-m", "bench")
    assert done.exit_code == 2 and "is there already" in done.output
    assert (tmp_path / "mapping.toml").read_text() == "kind = 'bench'\n"
