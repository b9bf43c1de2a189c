"""Signals to volts of a scope and back."""

import numpy as np
import polars as pl
import pytest

from hexsim import HexsimError, load_scenario, readers
from hexsim.machine import load_machine
from hexsim.sensors import measurement_chain
from hexsim.simulation import simulate

IDEAL = {"scope": {"bits": 0}}


def chain_with(**changes):
    return measurement_chain.MeasurementChain.model_validate(measurement_chain.load_chain().model_dump() | changes)


def test_characteristic_volts_of_the_report():
    """3.3431 V at rest and 0.826 V more at 1 g; 4 V at 315 bar; the test output of half stroke is 0 V."""
    log = pl.DataFrame(
        {
            "time_s": [0.0, 1.0],
            "acceleration_m_s2": [0.0, 9.81],
            "pressure_bottom_Pa": [0.0, 315e5],
            "position_m": [0.1, 0.2],
        }
    )
    volts = measurement_chain.to_scope_volts(log, chain_with(**IDEAL))
    assert volts["scope_acceleration_V"].to_list() == pytest.approx([3.3431, 3.3431 + 0.826], rel=1e-9)
    assert volts["scope_pressure_bottom_V"].to_list() == pytest.approx([0.0, 4.0], rel=1e-9)
    assert volts["scope_position_V"].to_list() == pytest.approx([0.0, 10.0], abs=1e-12)


def test_the_report_formula_is_off_by_its_sensitivity_squared():
    """(U - 3.3431) 0.826 g, as printed in 2.3.1, reads 0.68 of the acceleration; the chain reads all of it."""
    true = 0.45
    volts = measurement_chain.to_scope_volts(
        pl.DataFrame({"time_s": [0.0], "acceleration_m_s2": [true]}), chain_with(**IDEAL)
    )
    shown = volts["scope_acceleration_V"][0]
    assert (shown - 3.3431) * 0.826 * 9.81 == pytest.approx(0.826**2 * true, rel=1e-8)
    assert measurement_chain.from_scope_volts(volts, measurement_chain.load_chain())["acceleration_m_s2"][
        0
    ] == pytest.approx(true, rel=1e-12)


def random_log(count=200, legs=6):
    random = np.random.default_rng(5)
    columns = {"time_s": np.arange(count) / 1000}
    for i in range(1, legs + 1):
        columns[f"position_{i}_m"] = random.uniform(0.01, 0.19, count)
        columns[f"valve_{i}_V"] = random.uniform(-9, 9, count)
        columns[f"pressure_bottom_{i}_Pa"] = random.uniform(0, 7e6, count)
        columns[f"true_position_{i}_m"] = random.uniform(0.01, 0.19, count)
    columns["pressure_supply_Pa"] = random.uniform(5e6, 7e6, count)
    for axis in "xyz":
        columns[f"acceleration_{axis}_m_s2"] = random.uniform(-5, 5, count)
        columns[f"angular_acceleration_{axis}_rad_s2"] = random.uniform(-5, 5, count)
    return pl.DataFrame(columns)


def test_round_trip_without_a_converter():
    """Volts and back is the identity to rounding, for every leg and axis; truth columns do not reach the scope."""
    log = random_log()
    back = measurement_chain.from_scope_volts(
        measurement_chain.to_scope_volts(log, chain_with(**IDEAL)), chain_with(**IDEAL)
    )
    assert set(log.columns) - set(back.columns) == {
        *(f"true_position_{i}_m" for i in range(1, 7)),
        *(f"angular_acceleration_{axis}_rad_s2" for axis in "xyz"),
    }
    for name in back.columns:
        assert np.allclose(back[name], log[name], rtol=1e-12, atol=1e-12 * np.abs(log[name]).max())


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_resolution_is_half_a_count(bits):
    """With b bits nothing is off by more than half a count, and something is by more than 0.4 of one."""
    chain = chain_with(scope={"bits": bits, "range_V": 5.0})
    log = random_log()
    back = measurement_chain.from_scope_volts(measurement_chain.to_scope_volts(log, chain), chain)
    for name in back.columns[1:]:
        counts = np.abs(back[name] - log[name]).to_numpy() / chain.resolution(chain.kind_of(name))
        assert 0.4 < counts.max() < 0.5 + 1e-6


def test_counts_of_the_report_chain():
    """16 bit over +-5 V: 1.8 mm/s2 of acceleration, 0.012 bar of pressure; 3 um of position over +-10 V."""
    chain = measurement_chain.load_chain()
    assert chain.resolution("acceleration_m_s2") == pytest.approx(10 / 65536 / 0.826 * 9.81, rel=1e-9)
    assert chain.resolution("pressure_bottom_Pa") / 1e5 == pytest.approx(0.0120, abs=1e-4)
    assert chain.resolution("position_m") == pytest.approx(20 / 65536 / 100, rel=1e-12)


def test_converter_clips_at_its_range():
    """+-5 V, 12 bit: -5 V and one count below +5 V are the ends; not-a-number stays so."""
    scope = measurement_chain.ScopeInput(bits=12, range_V=5.0)
    out = scope.convert(np.array([-7.0, 7.0, np.nan, 0.0]))
    assert out[0] == -5.0 and out[1] == 5.0 - 10 / 4096 and np.isnan(out[2]) and out[3] == 0.0


def test_a_run_exported_in_volts_reads_back(tmp_path):
    """A bench run as a scope would record it: written in volts, read back within half a count of the log."""
    run = simulate(load_machine("bench"), load_scenario("heave", duration_s=1.0), seed=1)
    chain = measurement_chain.load_chain()
    measurement_chain.export_scope(run.log, tmp_path / "scope.csv", chain)
    back = measurement_chain.import_scope(tmp_path / "scope.csv", chain)
    for name in ("position_m", "valve_V", "pressure_bottom_Pa", "pressure_supply_Pa", "acceleration_m_s2"):
        assert np.abs((back[name] - run.log[name]).to_numpy()).max() <= 0.5001 * chain.resolution(name)
    assert "true_position_m" not in back.columns


def test_readers_of_measured_logs_take_the_volts(tmp_path):
    """The mapping file beside the volts lets the tracing reader give SI."""
    run = simulate(load_machine("bench"), load_scenario("heave", duration_s=3.0), seed=1)
    chain = measurement_chain.load_chain()
    measurement_chain.export_scope(run.log, tmp_path / "scope.csv", chain)
    read = readers.read_log(tmp_path / "scope.csv", measurement_chain.mapping_path(tmp_path / "scope.csv"))
    assert read.kind == "bench"
    for name in ("position_m", "pressure_bottom_Pa", "acceleration_m_s2"):
        error = read.columns[name] - run.log[name].to_numpy()[: len(read.columns[name])]
        assert np.abs(error).max() <= 0.51 * chain.resolution(name)


def test_names():
    """Leg numbers and axes stay in the names of the volts."""
    assert measurement_chain.scope_column("pressure_bottom_3_Pa") == "scope_pressure_bottom_3_V"
    assert measurement_chain.scope_column("acceleration_m_s2") == "scope_acceleration_V"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[channels.position_m]\ngain_V = 0.0\n", "gain_V must not be 0"),
        ("[channels.position]\ngain_V = 1.0\n", "channel position has no unit"),
        ("[channels.position_m]\ngain_V = 1.0\ncolour = 3\n", "colour is not a known key"),
    ],
)
def test_a_wrong_chain_is_refused_with_its_reason(tmp_path, text, sentence):
    """File, table and key are named."""
    path = tmp_path / "chain.toml"
    path.write_text(text)
    with pytest.raises(HexsimError, match=f"chain.toml.*{sentence}"):
        measurement_chain.load_chain(path)


def test_columns_without_a_channel_are_refused():
    """A scope column that the chain does not know, and a log with nothing for the scope."""
    with pytest.raises(HexsimError, match="scope column scope_colour_V has no channel in chain report"):
        measurement_chain.from_scope_volts(
            pl.DataFrame({"time_s": [0.0], "scope_colour_V": [1.0]}), measurement_chain.load_chain()
        )
    with pytest.raises(HexsimError, match="no column of the log has a channel"):
        measurement_chain.to_scope_volts(
            pl.DataFrame({"time_s": [0.0], "velocity_m_s": [1.0]}), measurement_chain.load_chain()
        )
