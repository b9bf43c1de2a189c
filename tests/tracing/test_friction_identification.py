"""Friction from a log: the parameters that made the data come back, with errors that are honest."""

import json
from pathlib import Path

import numpy as np
import other_plant
import pytest

from hexsim import HexsimError, load_scenario, readers
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.recording import run_files
from hexsim.simulation import simulate
from hexsim.tracing.friction import figure as friction_figures
from hexsim.tracing.friction.identification import identify_friction

DATA = Path(__file__).resolve().parents[1] / "data"
KEYS = [
    f"{kind}_{way}_{unit}"
    for way in ("extend", "retract")
    for kind, unit in (("viscous", "N_s_m"), ("coulomb", "N"), ("static", "N"), ("stribeck_velocity", "m_s"))
]
FIELDS = ("viscous_out", "coulomb_out", "static_out", "stribeck", "viscous_in", "coulomb_in", "static_in", "stribeck")


def truth(plant, leg: int = 0) -> dict[str, float]:
    return {key: float(plant.legs[field][leg]) for key, field in zip(KEYS, FIELDS, strict=True)}


@pytest.fixture(scope="module")
def constant(tmp_path_factory):
    """Strokes of constant velocity, 1 to 110 mm/s, one minute; the moving mass was weighed (0.1 %)."""
    folder = tmp_path_factory.mktemp("constant")
    plant = other_plant.write_machine(folder, 1, {}, runs=["constant"], duration_s=60.0, suffix=".parquet")
    machine = changed(
        load_machine(folder),
        {"load.moving_mass_kg": float(plant.rig["mass"][0]), "uncertainty": {"moving_mass_kg": 1e-3}},
    )
    return plant, machine, identify_friction(readers.read_log(folder / "constant.parquet"), machine)


@pytest.mark.slow  # test_friction_needs_the_machine_of_the_log
def test_constant_velocities_give_the_stribeck_parameters_back(constant):
    """All eight parameters within 5 % of those that made the data (an independent plant, sensor noise)."""
    plant, _, result = constant
    for key, value in truth(plant).items():
        assert result.parameters[key] == pytest.approx(value, rel=0.05), key
    assert result.rest_N < 1.15 * result.noise_N  # nothing but the sensors' noise is left
    assert not any("not determined" in note for note in result.notes)


def test_map_lies_on_the_true_curve(constant):
    """Fig. 2.9: each bin of the map is within 4 standard errors and 1 N of sigma v + F_c + F_s exp(-|v|/c_s)."""
    plant, _, result = constant
    t = truth(plant)
    v = result.map_velocity_m_s
    way = np.where(v > 0, "extend", "retract")
    numbers = [np.array([t[f"{kind}_{w}_{unit}"] for w in way])
               for kind, unit in (("viscous", "N_s_m"), ("coulomb", "N"), ("static", "N"))]  # fmt: skip
    expected = numbers[0] * v + np.sign(v) * (numbers[1] + numbers[2] * np.exp(-np.abs(v) / 0.005))
    assert np.all(np.abs(result.map_friction_N - expected) < 4 * result.map_error_N + 1.0)
    assert v.min() < -0.1 and v.max() > 0.1 and np.abs(v).min() < 2e-3


@pytest.mark.parametrize("run", ["fit", "validate"])
def test_errors_are_honest_on_ordinary_motion(tmp_path, run):
    """Multisine and the report's sine, mass known to 2 %: viscous within 1 %, Coulomb within 3 errors or 5 %."""
    plant = other_plant.write_machine(tmp_path, 5, {}, runs=[run], duration_s=20.0)
    result = identify_friction(readers.read_log(tmp_path / f"{run}.csv.gz"), load_machine(tmp_path))
    true = truth(plant)
    for way in ("extend", "retract"):
        viscous, coulomb = f"viscous_{way}_N_s_m", f"coulomb_{way}_N"
        assert result.parameters[viscous] == pytest.approx(true[viscous], rel=0.01)
        margin = max(3 * result.standard_error[coulomb], 0.05 * true[coulomb])
        assert result.parameters[coulomb] == pytest.approx(true[coulomb], abs=margin)
    assert abs(result.mass_kg - plant.rig["mass"][0]) < 4 * result.mass_error_kg + 0.1


@pytest.mark.slow  # legs with mass, and a bench, are in this file
def test_a_leg_of_a_hexapod(tmp_path):
    """Leg loads from the platform's motion: viscous within 3 %, Coulomb within 10 % on the multisine."""
    plant = other_plant.write_machine(tmp_path, 6, {}, "hexapod", runs=["fit"], duration_s=12.0)
    result = identify_friction(readers.read_log(tmp_path / "fit.csv.gz"), load_machine(tmp_path), leg=3)
    true = truth(plant, 2)
    for way in ("extend", "retract"):
        for key, share in ((f"viscous_{way}_N_s_m", 0.03), (f"coulomb_{way}_N", 0.10)):
            assert result.parameters[key] == pytest.approx(true[key], rel=share), key


@pytest.mark.parametrize("motion", ["multisine", pytest.param("heave", marks=pytest.mark.slow)])
def test_legs_with_mass_do_not_look_like_friction(tmp_path, motion):
    """The simulator's full legs (12 kg each): their weight, 37 N a leg, is the load's; Coulomb within 4 N and its error.

    4 N: how the legs' inertia changes away from neutral is not in the load. The error holds the platform's mass, 1.7 kg,
    3 N a leg: a mass fitted to a heave sine was 3.6 kg off, and both Coulomb frictions 8 N, seven of their errors.
    """
    machine = load_machine("micro_motion_system")
    run = simulate(machine, load_scenario(motion, duration_s=12.0))
    (tmp_path / "run").mkdir()
    run_files.write_essentials(run, tmp_path / "run", "parquet")
    result = identify_friction(readers.read_log(tmp_path / "run"), load_machine(tmp_path / "run"), leg=2)
    for way in ("extend", "retract"):
        declared = getattr(machine.friction, f"coulomb_{way}_N")
        assert result.parameters[f"coulomb_{way}_N"] == pytest.approx(declared, abs=4.0)
        assert 3.0 < result.standard_error[f"coulomb_{way}_N"] < 6.0


def test_measured_bench(tmp_path):
    """On the measured bench log, whose truth is known, viscous friction within 1 % and Coulomb within 6 %."""
    parameters = json.loads((DATA / "bench_none" / "truth.json").read_text())["parameters"]
    result = identify_friction(readers.read_log(DATA / "bench_none" / "fit.csv.gz"), load_machine(DATA / "bench_none"))
    for way, mark in (("extend", "pos"), ("retract", "neg")):
        assert result.parameters[f"viscous_{way}_N_s_m"] == pytest.approx(parameters[f"viscous_{mark}"], rel=0.01)
        assert result.parameters[f"coulomb_{way}_N"] == pytest.approx(parameters[f"coulomb_{mark}"], rel=0.06)


def test_what_is_printed_written_and_drawn(constant, tmp_path):
    """Table, JSON and figure carry the same numbers; the fitted machine runs through the file's checks."""
    _, machine, result = constant
    content = json.loads(json.dumps(result.to_json()))
    assert content["parameters"].keys() == set(KEYS)
    assert len(content["map"]["velocity_m_s"]) == len(result.map_velocity_m_s) > 20
    assert friction_figures.friction_table(result).row_count == len(KEYS) + 2
    figure = friction_figures.friction_figure(result)
    figure.savefig(tmp_path / "friction.png")
    assert (tmp_path / "friction.png").stat().st_size > 20_000
    fitted = result.fitted_machine()
    assert fitted.friction.coulomb_extend_N == pytest.approx(result.parameters["coulomb_extend_N"])
    assert fitted.valve == machine.valve


def test_what_cannot_be_told_is_refused(tmp_path):
    """No pressure, no motion, no such leg: a sentence each."""
    other_plant.write_machine(tmp_path, 2, {}, runs=["fit", "rest"], duration_s=3.0)
    machine, log = load_machine(tmp_path), readers.read_log(tmp_path / "fit.csv.gz")
    with pytest.raises(HexsimError, match="hardly moves"):
        identify_friction(readers.read_log(tmp_path / "rest.csv.gz"), machine)
    with pytest.raises(HexsimError, match="leg 2 does not exist"):
        identify_friction(log, machine, leg=2)
    log.columns.pop("pressure_bottom_Pa")
    with pytest.raises(HexsimError, match="has no column pressure_bottom_Pa"):
        identify_friction(log, machine)
