"""The compiled simulations that fits use: the same trajectories as the plant of the simulator, and of the writer of the logs."""

from pathlib import Path

import numpy as np
import pytest

from hexsim import readers
from hexsim.hydraulics import chamber
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import scenario_from_dict
from hexsim.signals import channels
from hexsim.simulation import simulate
from hexsim.tracing.design import motions
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.simulation.closed_loop import answer
from hexsim.tracing.simulation.rig import rig_of
from hexsim.tracing.simulation.simulator import inputs_of
from hexsim.tracing.simulation.start import start_state

DATA = Path(__file__).parents[1] / "data"
NOISE = {
    "position_m": 3e-6,
    "pressure_bottom_Pa": 4e3,
    "pressure_top_Pa": 4e3,
    "pressure_supply_Pa": 4e3,
    "acceleration_m_s2": 0.02,
    "angular_acceleration_rad_s2": 0.03,
}


def quiet(machine):
    """The machine with ideal sensors and a constant supply."""
    tables = machine.model_dump(exclude_none=True)
    tables.pop("power_unit", None)
    tables["sensors"] = {}
    return type(machine).model_validate(tables)


REMEMBERED = {
    "balance": "force", "signal": "speed_m_s", "start": 0.0, "step": 0.004, "memory_s": 0.4, "form": "direction",
    "values": [-4.0 * k for k in range(16)] + [5.0 * k for k in range(16)],
}  # fmt: skip


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"leakage_supply_to_chamber": {"conductance_m3_s_Pa": 1.8e-12}},
        {"supply_droop": {"line_resistance_Pa_s_m3": 2.4e9, "accumulator_m3_Pa": 6e-12}},
        {"valve_hysteresis": {"half_width_V": 0.04}},
        {"spool_lag": {"frequency_Hz": 40.0}},
        {"spool_rate_limit": {"rate_m_s": 8e-4}},
        {"position_lag": {"time_constant_s": 4e-3}, "pressure_lag": {"time_constant_s": 8e-3}},
        {"learned_term": {"curve": REMEMBERED}},
        {
            "friction_warm_up": {"share_at_start": 0.3, "time_constant_s": 2.0},
            "worn_bore": {"conductance_m3_s_Pa": 2e-12},
            "position_ripple": {"amplitude_m": 2e-5, "phase_rad": 0.5},
        },
    ],
    ids=lambda effects: next(iter(effects), "declared"),
)
def test_a_bench_moves_as_in_the_plant(effects):
    """Same setpoint, same machine: the fit's simulation and the plant's RK4 agree within a third of the sensors' noise.

    Both integrate the same functions; what is left is the step (0.17 ms against 0.1 ms) and where a held sample acts.
    """
    moves_as_in_the_plant(changed(load_machine(DATA / "bench_none"), {"effects": effects}))


def test_a_rod_side_of_its_own_moves_as_in_the_plant():
    """A rod side that is a chamber behind a port is a state of the fit's simulation too: within a third of the noise."""
    moves_as_in_the_plant(changed(load_machine(DATA / "bench_none"), {"cylinder.rod_side": "chamber"}))


def test_chambers_that_cavitate_move_as_in_the_plant():
    """Blocks of 10 cm without a spool's lag tear the oil at every jump: within the noise of what the plant gives, or a
    fiftieth of the signal: a collapse lasts less than the steps of a fit, which go by a rule, the plant's by their error.
    """
    machine = quiet(changed(load_machine(DATA / "bench_none"), {"valve.spool_frequency_Hz": 0.0}))
    block = {"kind": "block", "amplitude": 0.05, "frequency_Hz": 4.0}
    tables = {"name": "blocks", "mode": "actuator", "duration_s": 2.0, "fade_s": 0.5, "axes": {"leg_1": block}}
    run = simulate(machine, scenario_from_dict(tables))
    assert any("cavitated" in text for text in run.warnings)
    answer = channels.channel_arrays(
        SimulatedProblem(logs=(motions.setpoint_log(machine, tables),), noise=NOISE).simulated(machine, 0)
    )
    for name, own in answer.items():
        theirs = run.log[name].to_numpy()[: len(own)]
        assert np.std(theirs - own[: len(theirs)]) < max(NOISE[channels.kind_of(name)], 0.02 * np.std(theirs)), name
        if "pressure" in name:
            assert own.min() >= chamber.VAPOUR


def test_steps_of_a_fit_err_far_below_the_noise():
    """A measured motion with many reversals, simulated as fits do and with twenty steps a sample: less than a tenth of the noise in
    every channel, and what a twentieth more Coulomb friction does to it within a fiftieth."""
    declared = load_machine(DATA / "bench_leakage")
    log = readers.read_log(readers.log_files(DATA / "bench_leakage", "fit")).head(6.0)
    rougher = changed(declared, {"friction.coulomb_extend_N": 68.0})
    answers = {}
    for machine in (declared, rougher):
        rig, resolved = rig_of(machine, rate_Hz=log.rate)
        inputs, start = inputs_of(log, rig), start_state(rig, resolved, log)
        for fine in (rig, rig._replace(rule=rig.rule._replace(steady=20.0 * log.rate))):
            answers[machine is rougher, fine is rig] = answer(fine, inputs, start)
    for row, noise in ((0, NOISE["position_m"]), (2, NOISE["pressure_bottom_Pa"]), (5, NOISE["acceleration_m_s2"])):
        own, other = answers[False, True][row], answers[False, False][row]
        assert np.std(own - other) < 0.1 * noise
        does, did = answers[True, True][row] - own, answers[True, False][row] - other
        assert np.std(does - did) < 0.02 * np.std(did)


def moves_as_in_the_plant(machine):
    machine = quiet(machine)
    tables = {
        "name": "sine", "mode": "actuator", "duration_s": 4.0, "fade_s": 1.0,
        "axes": {"leg_1": {"kind": "sine", "amplitude": 0.04, "frequency_Hz": 0.5}},
    }  # fmt: skip
    run = simulate(machine, scenario_from_dict(tables))
    log = motions.setpoint_log(machine, tables)
    answer = channels.channel_arrays(SimulatedProblem(logs=(log,), noise=NOISE).simulated(machine, 0))
    for name, own in answer.items():
        theirs = run.log[name].to_numpy()[: len(own)]
        assert np.std(theirs - own[: len(theirs)]) < 0.33 * NOISE[channels.kind_of(name)], name


@pytest.mark.parametrize(
    ("spring", "axis"),
    [
        ({"mass_kg": 120.0, "frequency_Hz": 6.0}, "z"),
        ({"mass_kg": 60.0, "frequency_Hz": 4.5, "tilt_rad": 1.2, "azimuth_rad": 0.3, "height_m": 0.3}, "x"),
    ],
)
def test_a_payload_on_a_spring_rides_as_in_the_plant(spring, axis):
    """A hexapod that moves and rolls with a mass on a spring, along z or another axis: the fit's simulation and MuJoCo's bodies
    agree within the noise.

    Roll sets the suspension's axis off the vertical, so that its weight and the turning of the platform count. Legs
    without mass, as in the measured sets: what a leg's mass does has a test of its own.
    """
    effects = {"flexible_payload": spring}
    declared = load_machine("micro_motion_system")
    load = declared.load.model_dump(exclude_none=True) | {"leg_mass_kg": 0.0}
    machine = quiet(changed(declared, {"effects": effects, "load": load}))
    tables = {
        "name": "heave and roll", "mode": "dof", "duration_s": 4.0, "fade_s": 1.0,
        "axes": {
            axis: {"kind": "sine", "amplitude": 0.02, "frequency_Hz": 1.0},
            "roll": {"kind": "sine", "amplitude": 0.06, "frequency_Hz": 0.7},
        },
    }  # fmt: skip
    run = simulate(machine, scenario_from_dict(tables))
    log = motions.setpoint_log(machine, tables)
    answer = channels.channel_arrays(SimulatedProblem(logs=(log,), noise=NOISE).simulated(machine, 0))
    assert np.std(answer[f"acceleration_{axis}_m_s2"]) > 0.3
    for name, own in answer.items():
        theirs = run.log[name].to_numpy()[: len(own)]
        assert np.std(theirs - own[: len(theirs)]) < NOISE[channels.kind_of(name)], name


@pytest.mark.parametrize("folder", ["bench_none", "bench_hysteresis"])
def test_the_true_machine_answers_the_log(folder):
    """With the parameters and the effect of truth.json, what is left of each channel is the sensors' noise within 3 %."""
    import json

    from hexsim.tracing.fitting import parameters

    machine = load_machine(DATA / folder)
    truth = json.loads((DATA / folder / "truth.json").read_text())
    keys = {
        "discharge_coefficient": "discharge_coefficient", "bulk_modulus_Pa": "bulk_modulus", "moving_mass_kg": "moving_mass",
        "viscous_extend_N_s_m": "viscous_pos", "viscous_retract_N_s_m": "viscous_neg", "coulomb_extend_N": "coulomb_pos",
        "coulomb_retract_N": "coulomb_neg", "static_extend_N": "static_pos", "static_retract_N": "static_neg",
        "supply_pressure_Pa": "supply_pressure",
    }  # fmt: skip
    off = {p: truth["parameters"][keys[p.key]] / p.declared - 1 for p in parameters.priors(machine)}
    width = truth["undeclared"].get("valve_hysteresis")
    effects = [(parameters.named("valve_hysteresis"), {"half_width_V": width})] if width else []
    log = readers.read_log(DATA / folder / "validate.csv.gz")
    problem = SimulatedProblem(logs=(log,), noise=channels.noise_of(machine, [log]))
    misfit = problem.misfit([parameters.with_settings(machine, off, effects)])[0][0]
    assert np.sqrt(np.mean(misfit**2, axis=1)) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("folder", ["servo_none", "servo_leakage"])
def test_two_chambers_answer_the_log(folder):
    """Four-way valve, both chambers: with the true parameters what is left of each channel is the sensors' noise within 3 %.

    Of the position within 12 %: its writer's integrator lags by 13 us, 1.3 um at 0.1 m/s.
    """
    import json

    from hexsim.tracing.fitting import parameters

    source = Path(__file__).parents[2] / ".." / "shared" / "measured" / folder
    if not source.is_dir():
        pytest.skip(f"{source} is not there")
    machine = load_machine(source)
    truth = json.loads((source / "truth.json").read_text())
    true, leak = truth["parameters"], truth["undeclared"].get("cross_leak")
    keys = {
        "rated_flow_m3_s": "rated_flow", "bulk_modulus_Pa": "bulk_modulus", "moving_mass_kg": "moving_mass",
        "viscous_extend_N_s_m": "viscous_pos", "viscous_retract_N_s_m": "viscous_neg", "coulomb_extend_N": "coulomb_pos",
        "coulomb_retract_N": "coulomb_neg", "static_extend_N": "static_pos", "static_retract_N": "static_neg",
        "supply_pressure_Pa": "supply_pressure", "spool_frequency_Hz": "spool_frequency",
    }  # fmt: skip
    off = {p: true[keys[p.key]] / p.declared - 1 for p in parameters.priors(machine)}
    effects = [(parameters.named("leakage_across_piston"), {"conductance_m3_s_Pa": leak})] if leak else []
    log = readers.read_log(source / "validate.csv.gz").head(6.0)
    problem = SimulatedProblem(logs=(log,), noise=channels.noise_of(machine, [log]))
    misfit = problem.misfit([parameters.with_settings(machine, off, effects)])[0][0]
    assert len(misfit) == 5
    assert np.sqrt(np.mean(misfit[1:] ** 2, axis=1)) == pytest.approx(1.0, abs=0.03)
    assert np.sqrt(np.mean(misfit[0] ** 2)) < 1.12


def test_a_four_way_bench_moves_as_in_the_plant():
    """Both chambers on the valve: the fit's simulation and the plant agree within a third of the noise, rod side and all."""
    moves_as_in_the_plant(load_machine("servo_bench"))
