"""A sensor is one file and its keys of the machine file; the standard ones keep their streams of noise."""

import numpy as np
import polars as pl
import pytest

from hexsim import HexsimError, load_scenario, readers
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.sensors.bank import SensorBank
from hexsim.signals import sensors as sensor_files
from hexsim.signals import table
from hexsim.simulation import simulate

ROD_SIDE = '''"""Pressure transducer of the rod side."""

from hexsim.signals.sensor import Sensor
from hexsim.signals.signal import Signal

SENSOR = Sensor(
    signal=Signal(stem="pressure_rod_side", unit="Pa", label="measured rod side pressure", measured=True),
    source="pressure_top",
)
'''
KEYS = {"gain": 1.02, "offset_Pa": 3e4, "noise_Pa": 2e3, "resolution_Pa": 500.0}
CACHES = (table.sensors, table.table, table.measured_columns, table.places)


@pytest.fixture
def rod_side_sensor(tmp_path, monkeypatch):
    """A file that defines a sensor, in a folder of its own."""
    (tmp_path / "rod_side_pressure.py").write_text(ROD_SIDE)
    monkeypatch.setattr(sensor_files, "__path__", [*sensor_files.__path__, str(tmp_path)])
    for cache in CACHES:
        cache.cache_clear()
    yield "pressure_rod_side"
    monkeypatch.undo()
    for cache in CACHES:
        cache.cache_clear()


@pytest.mark.parametrize("name", ["bench", "micro_motion_system"])
def test_a_sensor_of_ones_own_is_in_the_log_with_its_errors(rod_side_sensor, name, tmp_path):
    """Its columns are 1.02 of the true pressure and 0.3 bar, with 20 mbar of noise, in steps of 5 mbar; readers know them."""
    machine = changed(load_machine(name), {f"extra_sensors.{rod_side_sensor}": KEYS})
    run = simulate(machine, load_scenario("heave", duration_s=0.7), fast=True)
    columns = table.table()[rod_side_sensor].columns(machine.n_legs)
    assert len(columns) == machine.n_legs and set(columns) <= set(run.log.columns)
    for column, true in zip(columns, table.table()["pressure_top"].columns(machine.n_legs), strict=True):
        read = run.log[column].to_numpy()
        assert np.array_equal(np.rint(read / 500.0) * 500.0, read)
        error = read - (1.02 * run.log[true].to_numpy() + 3e4)
        assert np.std(error) == pytest.approx(2e3, rel=0.15) and abs(np.mean(error)) < 300.0  # 700 samples
    run.log.write_csv(tmp_path / "log.csv")
    log = readers.read_log(tmp_path / "log.csv")
    assert np.array_equal(log.columns[columns[0]], run.log[columns[0]].to_numpy())


def test_other_columns_do_not_change(rod_side_sensor):
    """The standard sensors read the same to the bit with a further sensor beside them."""
    machine, scenario = load_machine("bench"), load_scenario("heave", duration_s=0.5)
    with_it = simulate(changed(machine, {f"extra_sensors.{rod_side_sensor}": KEYS}), scenario).log
    without = simulate(machine, scenario).log
    assert set(with_it.columns) - set(without.columns) == {"pressure_rod_side_Pa"}
    assert with_it.select(without.columns).equals(without)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"extra_sensors.thermometer": {}}, "unknown sensor 'thermometer'; known beside the standard ones"),
        ({"extra_sensors.position": {}}, "unknown sensor 'position'"),
        (
            {"extra_sensors.pressure_rod_side": {"noise_bar": 1.0}},
            "noise_bar is not a known key: allowed are gain, offset_Pa",
        ),
        ({"extra_sensors.pressure_rod_side": {"noise_Pa": -1.0}}, "noise_Pa = -1 must not be negative"),
    ],
)
def test_wrong_tables_are_refused(rod_side_sensor, changes, sentence):
    """With the table and the key."""
    with pytest.raises(HexsimError, match=sentence):
        changed(load_machine("bench"), changes)


def test_streams_of_noise():
    """One stream from the seed: positions, chamber pressures, supply, accelerations, angular accelerations, as ever."""
    resolved = resolve(load_machine("micro_motion_system"))
    bank, random, declared = SensorBank(resolved, 50, 1e-3, 7), np.random.default_rng(7), resolved.sensors
    for stem, noise, n in (
        ("position", declared.position_noise_m, 6),
        ("pressure_bottom", declared.pressure_noise_Pa, 6),
        ("pressure_supply", declared.pressure_noise_Pa, 1),
        ("acceleration", declared.acceleration_noise_m_s2, 3),
        ("angular_acceleration", declared.angular_acceleration_noise_rad_s2, 3),
    ):
        assert np.array_equal(bank[stem].noise, noise * random.standard_normal((50, n))), stem


def test_one_tick_reads_as_the_whole_column():
    """Delay, lag, gain, noise and steps of a tick are those of the log's column."""
    changes = {
        "sensors.position_delay_s": 0.0033,
        "sensors.position_gain": 1.1,
        "sensors.position_resolution_m": 1e-5,
        "sensors.position_lag_s": 0.004,
    }
    bank = SensorBank(resolve(changed(load_machine("bench"), changes)), 200, 1e-3, 1)
    true = 0.1 + 0.01 * np.sin(np.arange(200) / 20)[:, None]
    whole = bank.rows("position", true)
    ticks = np.array([bank.position(tick, true[: tick + 1]) for tick in range(200)])
    assert np.allclose(ticks, whole, rtol=0, atol=1.01e-5) and np.mean(ticks == whole) > 0.95  # rounding at a step


def test_the_table_names_every_column_of_a_run():
    """No column of a log without its signal, on a bench, a hexapod and with a power unit."""
    for name in ("bench", "micro_motion_system/power_unit"):
        log: pl.DataFrame = simulate(load_machine(name), load_scenario("heave", duration_s=0.2), fast=True).log
        assert set(log.columns) - {"time_s"} <= set(table.places()), name
