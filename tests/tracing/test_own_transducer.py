"""A loop whose position transducer is not the logged one: what is logged errs, and the machine moves as if it did not."""

from dataclasses import replace

import numpy as np
import pytest
from other_plant import write_machine

from hexsim import load_scenario
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.signals import channels
from hexsim.simulation import simulate
from hexsim.tracing.simulation import rig as rigs
from hexsim.tracing.steps import logs

ERRORS = [  # of the second plant's log, whose loop reads the piston itself: its size, and hexsim's key with the same error
    ("position_gain", 0.005, "sensors.position_gain", 1.005),
    ("position_delay", 0.45, "sensors.position_delay_s", 0.45e-3),
    ("position_delay", 6.0, "sensors.position_delay_s", 6e-3),
    ("scale_ripple", 3e-5, "effects.position_ripple", {"amplitude_m": 3e-5, "pitch_m": 1e-3, "phase_rad": 0.0}),
]
TRUE = {  # the second plant's fields of the parameters that are drawn
    "valve.discharge_coefficient": "discharge", "oil.bulk_modulus_Pa": "modulus",
    "friction.viscous_extend_N_s_m": "viscous_out", "friction.viscous_retract_N_s_m": "viscous_in",
    "friction.coulomb_extend_N": "coulomb_out", "friction.coulomb_retract_N": "coulomb_in",
    "friction.static_extend_N": "static_out", "friction.static_retract_N": "static_in",
}  # fmt: skip


@pytest.fixture(params=ERRORS)
def erring(request, tmp_path):
    """A first state of a trace, and the machine with all its true numbers."""
    name, size, key, value = request.param
    plant = write_machine(tmp_path, 3117, {name: size}, runs=("fit", "validate"), duration_s=8.0, suffix=".csv")
    state = logs.begin(tmp_path, ["fit"], ["validate"])
    own = {dotted: float(plant.legs[field][0]) for dotted, field in TRUE.items()}
    rig = {"supply.pressure_Pa": "supply_pressure", "load.moving_mass_kg": "mass"}
    own |= {dotted: float(plant.rig[field][0]) for dotted, field in rig.items()}
    return state, changed(state.machine, own | {key: value})


def test_true_numbers_leave_noise_only_where_the_loop_reads_its_own_transducer(erring):
    """Seen by the volts alone. Position: chi2 a sample 1 within 5 % (6,000 samples of noise: 2 %), and means of 0.4 s at theirs;
    with the error in the loop it is off by more than ten times those 2 %."""
    state, machine = erring
    assert state.fit_problem.feedback == rigs.OWN_TRANSDUCER
    left = {
        feedback: replace(state.fit_problem, feedback=feedback).residual(machine, 0)[0]
        for feedback in (rigs.DECLARED_LOOP, rigs.OWN_TRANSDUCER)
    }
    assert np.mean(left[rigs.OWN_TRANSDUCER] ** 2) == pytest.approx(1.0, abs=0.05)
    assert np.mean(left[rigs.DECLARED_LOOP] ** 2) > 1.2
    slow = left[rigs.OWN_TRANSDUCER][:6000].reshape(-1, 400).mean(axis=1) * 20.0
    assert np.sqrt(np.mean(slow**2)) < 2.0


@pytest.mark.parametrize("error", [{}, {"sensors.position_gain": 1.005}, {"sensors.position_delay_s": 0.45e-3}])
def test_an_error_that_the_loop_reads_itself_is_in_the_declared_loop(error, tmp_path):
    """hexsim's own machine regulates what it logs: nothing is between volts and log, whatever the transducer's error."""
    bench = load_machine("bench")
    simulate(changed(bench, error), load_scenario("multisine", duration_s=4.0), seed=3).log.write_parquet(
        tmp_path / "run.parquet"
    )
    [log], _ = logs.read_runs(tmp_path, ["run"], bench)
    assert logs.feedback_of(bench, [log], channels.declared_noise(bench)) == rigs.DECLARED_LOOP


def test_volts_that_no_transducer_explains_drive_the_model(tmp_path):
    """A feed-forward in the volts beside a transducer's error: the logged volts drive."""
    bench = load_machine("bench")
    built = changed(bench, {"controller.velocity_feed_forward_V_s_per_m": 3.0, "sensors.position_gain": 1.005})
    simulate(built, load_scenario("multisine", duration_s=4.0), seed=3).log.write_parquet(tmp_path / "run.parquet")
    [log], _ = logs.read_runs(tmp_path, ["run"], bench)
    assert logs.feedback_of(bench, [log], channels.declared_noise(bench)) == rigs.LOGGED_VOLTS
