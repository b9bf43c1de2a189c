"""A hexapod's log without accelerometers: the platform's balance is formed from the positions, in weak form."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import hexsim as hx
from hexsim import load_scenario, readers
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation import simulate
from hexsim.tracing import balances
from hexsim.tracing.balances import null

MACHINE = load_machine("micro_motion_system")
MORE_KG = 30.0
HIDDEN = changed(MACHINE, {"effects.mass_change.mass_kg": MORE_KG})
IMU = "acceleration"


def logged(place, scenario, name, duration_s, seed):
    """The measured columns of a run of the machine with its hidden mass, written as a log."""
    run = simulate(HIDDEN, load_scenario(scenario, duration_s=duration_s), seed=seed)
    measured = [column for column in run.log.columns if not column.startswith("true_")]
    run.log.select(measured).write_csv(place / f"{name}.csv")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    place = tmp_path_factory.mktemp("hexapod")
    logged(place, "multisine", "fit", 3.0, 1)
    return readers.read_log(place / "fit.csv")


def test_the_balance_needs_no_accelerometer(log):
    """With the hidden mass every residual is zero within twice what the accelerometers leave and 8 N (3 um of noise on the
    positions, twice differentiated, on 600 kg); without it F_z shows its weight, within 2 % of the same log with accelerometers."""
    bare = replace(log, acceleration=None, angular=None)
    balance = balances.balance_named("platform", MACHINE)
    assert balance.measurable(bare, MACHINE) and IMU not in " ".join(bare.columns)
    rms = {
        kind: np.sqrt(np.mean(null.used(own, balance.residual(own, HIDDEN)) ** 2, axis=1)) for kind, own in (("imu", log), ("bare", bare))
    }  # fmt: skip
    assert np.all(rms["bare"] < 2.0 * rms["imu"] + np.repeat([8.0, 1.0], 3))
    found = [null.used(own, balance.residual(own, MACHINE))[2] for own in (log, bare)]
    assert np.mean(found[1]) == pytest.approx(np.mean(found[0]), rel=0.02)
    assert np.mean(found[1]) == pytest.approx(MORE_KG * 9.8, rel=0.05)
    assert np.corrcoef(*found)[0, 1] > 0.99


@pytest.mark.slow
def test_the_same_effect_is_named_without_accelerometers(tmp_path):
    """Two logs of a platform with 30 kg on it, with and without their columns of acceleration: the same name, the same mass
    within three errors, a platform's balance in both."""
    named = {}
    for kind in ("imu", "bare"):
        place = hx.load_machine("micro_motion_system").to_folder(tmp_path / kind)
        for name, scenario, seed in (("fit", "multisine", 1), ("validate", "combined", 2)):
            logged(place, scenario, name, 4.0, seed)
            if kind == "bare":
                table = pl.read_csv(place / f"{name}.csv")
                table.select([c for c in table.columns if IMU not in c]).write_csv(place / f"{name}.csv")
        found = hx.trace(place).report
        named[kind] = found["effects"]
        assert any(line["name"] == "platform" and line["violated"] for line in found["balances"])
    assert [[one["name"] for one in own] for own in named.values()] == [["mass_change"]] * 2
    for [effect] in named.values():
        assert effect["parameters"]["mass_kg"] == pytest.approx(
            MORE_KG, abs=3 * effect["standard_error"]["mass_kg"] + 0.3
        )
