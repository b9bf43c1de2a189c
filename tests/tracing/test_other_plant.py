"""The second plant is itself checked: against its own steps, its volumes, and measured logs whose truth is known."""

import json
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import other_plant
import polars as pl
import pytest
from other_equations import integrate

DATA = Path(__file__).resolve().parents[1] / "data"
TRUE_NAMES = {
    "discharge_coefficient": "discharge",
    "bulk_modulus": "modulus",
    "viscous_pos": "viscous_out",
    "coulomb_pos": "coulomb_out",
    "static_pos": "static_out",
    "viscous_neg": "viscous_in",
    "coulomb_neg": "coulomb_in",
    "static_neg": "static_in",
}


def plant_of(folder: Path) -> other_plant.Plant:
    true = json.loads((folder / "truth.json").read_text())["parameters"]
    plant = other_plant.declared_plant("bench")
    for theirs, mine in TRUE_NAMES.items():
        plant.legs[mine] = true[theirs]
    plant.rig["supply_pressure"], plant.rig["mass"] = true["supply_pressure"], true["moving_mass"]
    return plant


@pytest.mark.parametrize(
    "name, effects",
    [
        ("bench_none", {}),
        ("bench_leakage", {"leakage_supply_to_chamber": 1.8e-12}),
        ("bench_hysteresis", {"valve_hysteresis": 0.04}),
    ],
)
@pytest.mark.parametrize(
    "run", ["fit", *(pytest.param(name, marks=pytest.mark.slow) for name in ("sweep", "validate"))]
)
def test_measured_bench_is_reproduced_to_its_sensor_noise(name, effects, run):
    """With the true parameters the difference to the measured log is white noise as declared: within 3 %, mean zero.

    20,000 samples determine a standard deviation to 0.5 %; 3 % leaves room for the valve log's 0.3 mV count.
    """
    plant = plant_of(DATA / name)
    for effect, value in effects.items():
        other_plant.EFFECTS[effect].change(plant, [0], value)
    log = pl.read_csv(DATA / name / f"{run}.csv.gz")
    setpoint = log["setpoint_m"].to_numpy()[:, None]
    y, _, P, Ps, a = integrate(
        plant.rig,
        plant.legs,
        plant.base,
        plant.joints,
        other_plant.state_at_rest(plant),
        setpoint,
        np.zeros(len(log)),
        20,
    )
    noise = {
        "position_m": (y[:, 0], np.hypot(3e-6, 3e-6 / np.sqrt(12))),
        "pressure_bottom_Pa": (P[:, 0], 4e3),
        "pressure_supply_Pa": (Ps, 4e3),
        "acceleration_m_s2": (a[:, 0], 0.02),
    }
    for column, (simulated, sigma) in noise.items():
        rest = log[column].to_numpy() - simulated
        assert np.std(rest) == pytest.approx(sigma, rel=0.03), column
        assert abs(np.mean(rest)) < 5 * sigma / np.sqrt(len(rest)) + 1e-9, column


def test_steps_are_small_enough_for_the_acceleration():
    """Halving the step cuts the error of the acceleration at least fourfold; in use it errs < 1e-5 m/s2 rms."""
    plant, _ = other_plant.true_machine("bench", 1, {})
    runs = {n: other_plant.simulate(plant, "sweep", 1, 3.0, substeps=n)["acceleration"] for n in (10, 20, 160)}
    error = {n: np.sqrt(np.mean((runs[n] - runs[160]) ** 2)) for n in (10, 20)}
    assert error[20] < 1e-5
    assert error[20] < error[10] / 4  # 1/16 where smooth; the corners of friction cost some


@lru_cache(maxsize=8)  # what all effects of a kind are held against is made once
def measured_with(kind, effect=None):
    """3 s of the machine with an effect at its typical strength, as measured."""
    plant, _ = other_plant.true_machine(kind, 1, {} if effect is None else {effect: None})
    true = other_plant.simulate(plant, "sweep" if kind == "bench" else "fit", 1, 3.0)
    return other_plant.measured(plant, true, np.random.default_rng(0))


usual_of = cache(measured_with)  # without an effect, of which there is one a kind


@pytest.mark.parametrize(
    "name",
    [
        name if "bench" in effect.kinds else pytest.param(name, marks=pytest.mark.slow)  # six legs each
        for name, effect in sorted(other_plant.EFFECTS.items())
    ],
)
def test_every_effect_changes_a_signal_beyond_its_noise(name):
    """At typical strength each effect moves at least one signal by more than a third of its noise (rms)."""
    effect = other_plant.EFFECTS[name]
    kind = effect.kinds[0]
    sigma = {"position": 3e-6, "pressure": 4e3, "acceleration": 0.02, "angular": 0.03}
    usual, seen = usual_of(kind), {}
    for column, values in measured_with(kind, name).items():
        scale = sigma.get(column.split("_")[0])
        if scale is not None:
            assert np.all(np.isfinite(values)), column
            seen[column] = np.sqrt(np.mean((values - usual[column]) ** 2)) / scale
    assert max(seen.values()) > 0.33, seen


def test_oil_is_neither_made_nor_lost():
    """Over a period of the settled sine the oil in the chamber returns to what it was."""
    plant, _ = other_plant.true_machine("bench", 2, {})
    true = other_plant.simulate(plant, "validate", 2, 12.0)
    y, P = true["position"][:, 0], true["pressure"][:, 0]
    leg = plant.legs[0]
    oil = (leg["area1"] * y + leg["pipe_volume"]) * np.exp(P / leg["modulus"])  # mass over density at zero pressure
    assert oil[10000] == pytest.approx(oil[8000], rel=2e-5)  # 2 s = one period of the report's sine, after settling
    assert np.ptp(oil[8000:10000]) > 0.5 * np.mean(oil)


def test_same_seed_same_log_to_the_bit_and_files_are_complete(tmp_path):
    """write_machine is a function of its arguments, and its folder has the format of the measured ones."""
    for place in ("one", "two"):
        other_plant.write_machine(tmp_path / place, 5, {"overlap": None}, runs=["fit"], duration_s=1.0)
    one, two = (pl.read_csv(tmp_path / place / "fit.csv.gz") for place in ("one", "two"))
    assert one.equals(two)
    assert one.columns == pl.read_csv(DATA / "bench_none" / "fit.csv.gz", n_rows=1).columns
    truth = json.loads((tmp_path / "one" / "truth.json").read_text())
    assert truth["undeclared"] == {"overlap": 8e-6}
    declared = (tmp_path / "one" / "machine.toml").read_text()
    assert declared.replace('"one"', '"two"') == (tmp_path / "two" / "machine.toml").read_text()


def test_hexapod_carries_its_weight_and_moves_as_asked(tmp_path):
    """At rest the platform does not accelerate; in roll the legs follow the setpoints within the loop's lag."""
    plant = other_plant.write_machine(tmp_path / "hex", 3, {}, "hexapod", runs=["validate_roll"], duration_s=4.0)
    log = pl.read_csv(tmp_path / "hex" / "validate_roll.csv.gz")
    still = log.head(2)
    for axis in "xyz":
        assert abs(still[f"acceleration_{axis}_m_s2"][0]) < 5 * 0.02
    lag_m = 0.1 / 0.15 * 0.07 * 0.55  # v / K at the largest leg speed, with a margin
    for i in range(1, 7):
        assert np.max(np.abs((log[f"setpoint_{i}_m"] - log[f"position_{i}_m"]).to_numpy())) < lag_m
    assert len(plant.legs) == 6
