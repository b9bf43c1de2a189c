"""One run: what is refused before it, how it starts, what interrupts it, what its log holds."""

from dataclasses import replace

import mujoco
import numpy as np
import polars as pl
import pytest
from scipy.signal import cont2discrete, dlsim

import hexsim as hx
from hexsim import HexsimError, load_scenario, smoothness
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import replay_scenario, scenario_from_dict
from hexsim.simulation import simulate

BENCH_COLUMNS = [
    "time_s",
    "setpoint_m",
    "position_m",
    "valve_V",
    "pressure_bottom_Pa",
    "pressure_supply_Pa",
    "acceleration_m_s2",
]


@pytest.fixture(scope="module")
def machine():
    return load_machine("micro_motion_system")


@pytest.mark.parametrize("name", hx.available()["scenarios"])
def test_every_scenario_starts(name):
    """Each scenario that travels with hexsim runs for half a second and gives figures for all axes."""
    scenario = load_scenario(name, duration_s=0.5)
    run = simulate(load_machine(scenario.machine_name), scenario, fast=True)
    assert run.complete and len(run.summary["axes"]) in (1, 6)


def test_log_has_the_columns_of_a_measured_log(machine):
    """The log begins with the columns of the shared log format, in its order, for bench and hexapod."""
    bench = simulate(load_machine("bench"), load_scenario("heave", duration_s=0.2), fast=True).log
    assert bench.columns[:7] == BENCH_COLUMNS
    log = simulate(machine, load_scenario("heave", duration_s=0.2), fast=True).log
    groups = ["setpoint_{}_m", "position_{}_m", "valve_{}_V", "pressure_bottom_{}_Pa"]
    expected = ["time_s", *(group.format(i) for group in groups for i in range(1, 7)), "pressure_supply_Pa"]
    expected += [f"acceleration_{a}_m_s2" for a in "xyz"] + [f"angular_acceleration_{a}_rad_s2" for a in "xyz"]
    assert log.columns[: len(expected)] == expected
    assert np.isfinite(log.to_numpy()).all()


def test_motion_starts_from_neutral(machine):
    """At the start all actuators stand at half stroke and the first setpoint is there."""
    log = simulate(machine, load_scenario("combined", duration_s=0.1), fast=True).log
    for leg in range(1, 7):
        assert log[f"true_position_{leg}_m"][0] == pytest.approx(0.1, abs=1e-9)
        assert log[f"setpoint_{leg}_m"][0] == pytest.approx(0.1, abs=1e-9)


def test_platform_follows_its_degrees_of_freedom(machine):
    """A slow motion in each axis moves the platform in that axis by that much, and in no other.

    Within 10 %: the dead band alone leaves 45 mV / 50 V/m = 0.9 mm of each leg, the loop's lag 0.5 mm more.
    """
    for axis, amplitude in (("x", 0.02), ("y", 0.02), ("z", 0.02), ("roll", 0.03), ("pitch", 0.03), ("yaw", 0.03)):
        signal = {"kind": "sine", "amplitude": amplitude, "frequency_Hz": 0.1}
        scenario = scenario_from_dict({"name": axis, "duration_s": 3.0, "fade_s": 0.0, "axes": {axis: signal}})
        log = simulate(machine, scenario, fast=True).log
        for other, unit in zip(
            ("x", "y", "z", "roll", "pitch", "yaw"), ("m", "m", "m", "rad", "rad", "rad"), strict=True
        ):
            final = log[f"platform_{other}_{unit}"][-1]
            wanted = amplitude * np.sin(2 * np.pi * 0.1 * 3.0) if other == axis else 0.0
            assert final == pytest.approx(wanted, abs=0.1 * amplitude), (axis, other)


def test_workspace_is_checked_before_the_run(machine):
    """A setpoint out of reach is refused before the run, naming time, leg and length."""
    with pytest.raises(HexsimError, match=r"(?i)leg \d.*\d\.\d+.* m"):
        simulate(machine, load_scenario("heave", amplitude=0.15))


def test_bench_rolls_as_leg_1_of_the_hexapod_does(machine):
    """A motion other than heave asks of a bench what it asks of leg 1 of the report's machine, derivatives too."""
    scenario = load_scenario("roll", duration_s=1.0)
    bench = simulate(load_machine("bench"), scenario, fast=True).log
    hexapod = simulate(machine, scenario, fast=True).log
    np.testing.assert_allclose(bench["setpoint_m"].to_numpy(), hexapod["setpoint_1_m"].to_numpy(), atol=1e-12)
    time, position, velocity, acceleration = (
        bench[name].to_numpy()
        for name in ("time_s", "setpoint_m", "commanded_velocity_m_s", "commanded_acceleration_m_s2")
    )
    held = np.diff(position, prepend=np.nan) != 0.0  # a tick of the controller begins
    np.testing.assert_allclose(np.gradient(position[held], time[held])[1:-1], velocity[held][1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(velocity, time)[1:-1], acceleration[1:-1], atol=1e-4)


def test_bench_refuses_legs_it_has_not():
    """Leg 2 on a bench is refused with what it takes."""
    signal = {"kind": "sine", "amplitude": 0.01, "frequency_Hz": 0.5}
    scenario = scenario_from_dict({"name": "two", "mode": "actuator", "axes": {"leg_2": signal}})
    with pytest.raises(HexsimError, match=r"drives leg_2, which bench bench has not"):
        simulate(load_machine("bench"), scenario)


def test_actuator_mode_moves_one_leg(machine):
    """In actuator mode only the selected actuator gets a setpoint."""
    scenario = scenario_from_dict(
        {
            "name": "one",
            "mode": "actuator",
            "duration_s": 1.0,
            "fade_s": 0.0,
            "axes": {"leg_3": {"kind": "sine", "amplitude": 0.01, "frequency_Hz": 0.5}},
        }
    )
    log = simulate(machine, scenario, fast=True).log
    spans = [log[f"setpoint_{i}_m"].max() - log[f"setpoint_{i}_m"].min() for i in range(1, 7)]
    assert spans[2] == pytest.approx(0.01, rel=0.01)
    assert max(spans[:2] + spans[3:]) == 0.0


def test_replay_gives_the_measured_setpoints_back():
    """A log's setpoints played back reach the actuators sample by sample."""
    bench = load_machine("bench")
    first = simulate(bench, load_scenario("multisine", duration_s=1.0), fast=True).log
    again = simulate(
        bench, replay_scenario("again", first["time_s"].to_numpy(), first["setpoint_m"].to_numpy(), 0.2), fast=True
    )
    np.testing.assert_array_equal(again.log["setpoint_m"].to_numpy(), first["setpoint_m"].to_numpy())
    np.testing.assert_allclose(again.log["position_m"].to_numpy(), first["position_m"].to_numpy(), atol=1e-12)


def test_python_and_compiled_ticks_are_the_same(machine):
    """The loop with the motion computer in Python and the compiled one give the same log in every bit."""

    class Nothing:
        def before_step(self, time_s, plant, volts):
            return volts

    scenario = load_scenario("heave", duration_s=1.0)
    compiled = simulate(machine, scenario, fast=True).log
    assert compiled.equals(simulate(machine, scenario, fast=True, interventions=[Nothing()]).log)


def test_divergence_says_when_and_which_leg():
    """A run that leaves the real numbers ends with time and leg, keeps its partial log and is marked incomplete."""

    class Bomb:
        def before_step(self, time_s, plant, volts):
            if time_s > 0.05:
                plant.data.act[-1] = np.nan
            return volts

    run = simulate(load_machine("bench"), load_scenario("heave", duration_s=1.0), fast=True, interventions=[Bomb()])
    assert not run.complete
    assert "diverged at t = 0." in run.reason and "leg 1" in run.reason
    assert 10 < run.log.height < 1000


def test_interrupted_run_keeps_its_log():
    """Ctrl-C ends the run with what was recorded until then."""

    class Finger:
        def before_step(self, time_s, plant, volts):
            if time_s > 0.3:
                raise KeyboardInterrupt
            return volts

    run = simulate(load_machine("bench"), load_scenario("heave", duration_s=1.0), fast=True, interventions=[Finger()])
    assert not run.complete and "interrupted" in run.reason
    assert run.log["time_s"][-1] == pytest.approx(0.3, abs=0.002)


def test_sensors_do_what_they_declare():
    """Noise, quantisation, gain, offset and delay of the log's channels are those declared."""
    changes = {
        "sensors.position_delay_s": 0.003,
        "sensors.pressure_gain": 1.02,
        "sensors.pressure_offset_Pa": 1e4,
        "sensors.acceleration_resolution_m_s2": 0.01,
    }
    log = simulate(changed(load_machine("bench"), changes), load_scenario("heave", duration_s=4.0), fast=True).log
    position, true = log["position_m"].to_numpy(), log["true_position_m"].to_numpy()
    steps = position / 3e-6
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    error = position[3:] - true[:-3]
    assert np.std(error) == pytest.approx(np.hypot(3e-6, 3e-6 / np.sqrt(12)), rel=0.05)
    pressure, true_pressure = log["pressure_bottom_Pa"].to_numpy(), log["true_pressure_bottom_Pa"].to_numpy()
    noise = pressure - (1.02 * true_pressure + 1e4)
    assert np.std(noise) == pytest.approx(4e3, rel=0.05) and abs(noise.mean()) < 5 * 4e3 / np.sqrt(4000)
    ticks = log["acceleration_m_s2"].to_numpy() / 0.01
    np.testing.assert_allclose(ticks, np.rint(ticks), atol=1e-6)


@pytest.mark.parametrize("rate_Hz", (50.0, 125.0, 500.0))
def test_a_slow_log_changes_no_figure_and_no_reading(rate_Hz):
    """Figures, and what transducers with filter, lag and delay read, are those of the log at 1 kHz: a tone of 60 Hz behind a
    filter of 30 Hz reads the same in every row that both logs have."""
    keys = {
        "sensors.acceleration_filter_Hz": 30.0,
        "sensors.acceleration_delay_s": 0.004,
        "sensors.position_lag_s": 0.01,
        "effects": {"outside_force_tone": {"amplitude_N": 100.0, "frequency_Hz": 60.0}},
    }
    bench, scenario = changed(load_machine("bench"), keys), load_scenario("heave", duration_s=4.0)
    quick = simulate(bench, scenario)
    slow = simulate(changed(bench, {"sensors.log_rate_Hz": rate_Hz}), scenario)
    assert slow.log.height == round(4.0 * rate_Hz)
    assert slow.summary["axes"] == quick.summary["axes"]
    every = round(1000.0 / rate_Hz)
    for column in ("time_s", "position_m", "pressure_bottom_Pa", "acceleration_m_s2", "true_position_m"):
        np.testing.assert_array_equal(slow.log[column], quick.log[column].gather_every(every))


def test_a_slow_log_holds_means_of_the_true_acceleration():
    """A row of a 100 Hz log is the mean over the 10 ms about it, of the means over a tick that the log at 1 kHz holds; where
    nothing jolts (2 % of the rows about the reversals left out), the change of velocity over those 10 ms within 1 %."""
    bench = load_machine("bench")
    quick, slow = (
        simulate(changed(bench, {"sensors.log_rate_Hz": rate}), load_scenario("heave", duration_s=3.0)).log
        for rate in (1000.0, 100.0)
    )
    ticks, rows = (log["true_acceleration_m_s2"].to_numpy() for log in (quick, slow))
    for row in (1, 57, 150, 298):
        part = ticks[10 * row - 5 : 10 * row + 6]
        assert rows[row] == pytest.approx((part[1:] + part[:-1]).sum() / 20.0, abs=1e-12)
    rate = np.diff(quick["velocity_m_s"].to_numpy()[5::10]) / 0.01
    off = np.abs(rows[1 : 1 + len(rate)] - rate)
    assert np.quantile(off, 0.98) < 0.01 * np.abs(rate).max()


def test_noise_in_the_felt_band_does_not_depend_on_the_rate_of_the_log():
    """Noise of the position below 50 Hz: 3 um sqrt(50/500) = 0.95 um at 1 kHz and at 10 kHz, within four standard errors of
    400 degrees of freedom; and 3 um a reading at either."""
    for rate_Hz in (1000.0, 10_000.0):
        bench = changed(load_machine("bench"), {"sensors.log_rate_Hz": rate_Hz, "sensors.position_resolution_m": 0.0})
        log = simulate(bench, load_scenario("heave", duration_s=4.0)).log
        noise = (log["position_m"] - log["true_position_m"]).to_numpy()
        declared = bench.sensors.position_noise_m
        assert noise.std() == pytest.approx(declared, rel=4 / np.sqrt(2 * 4000))
        felt = smoothness.band_limit(log["time_s"].to_numpy(), noise).std()
        assert felt == pytest.approx(declared * np.sqrt(0.1), rel=4 / np.sqrt(2 * 400))


@pytest.mark.parametrize("frequency_Hz", (60.0, 250.0, 1000.0))
def test_a_lagging_spool_is_the_exact_filter_of_its_volts(frequency_Hz):
    """Fault `spool_lag` at any frequency: the second-order filter of volts held over a tick, to 1e-9 of the largest."""
    fault = {"kind": "spool_lag", "time_s": 1.0, "leg": 1, "frequency_Hz": frequency_Hz, "damping": 0.7}
    bench = changed(load_machine("bench"), {"valve.spool_frequency_Hz": 0.0})
    log = simulate(bench, replace(load_scenario("heave", duration_s=2.0), faults=(fault,))).log
    late = log["time_s"].to_numpy() >= 1.0 - 1e-9
    volts, spool = log["valve_V"].to_numpy()[late], log["spool_m"].to_numpy()[late]
    omega = 2 * np.pi * frequency_Hz
    A, B = np.array([[0.0, 1.0], [-(omega**2), -1.4 * omega]]), np.array([[0.0], [omega**2]])
    filter_of = cont2discrete((A, B, np.array([[1.0, 0.0]]), np.zeros((1, 1))), 1e-3)
    filtered = dlsim(filter_of, volts, x0=[volts[0], 0.0])[1][:, 0]
    gain = (spool @ filtered) / (filtered @ filtered)
    assert gain == pytest.approx(bench.valve.spool_travel_max_m / bench.valve.voltage_max_V, rel=1e-6)
    assert np.abs(spool - gain * filtered).max() < 1e-9 * np.abs(spool).max()


def test_rates_that_do_not_fit_are_refused():
    """A log rate that is no multiple of the control rate is refused."""
    with pytest.raises(HexsimError, match="not a whole multiple"):
        simulate(changed(load_machine("bench"), {"sensors.log_rate_Hz": 700.0}), load_scenario("heave", duration_s=0.1))


def test_user_file_drives_the_platform(tmp_path, machine):
    """Setpoints from a user's CSV move the platform; its scenario is known by the file's name."""
    time = np.linspace(0, 1, 101)
    path = tmp_path / "push.csv"
    pl.DataFrame({"time_s": time, "x_m": 0.01 * np.sin(np.pi * time) ** 2}).write_csv(path)
    run = simulate(machine, load_scenario(path), fast=True)
    assert run.summary["scenario"] == "push"
    assert run.log["commanded_x_m"].max() == pytest.approx(0.01, rel=1e-3)


class _Onlooker:
    """Changes nothing, but keeps a run out of the compiled loop. Keeps what it saw of MuJoCo's timer of positions."""

    def __init__(self):
        self.readings = set()

    def before_step(self, time_s, plant, volts):
        self.readings.add(plant.data.timer[mujoco.mjtTimer.mjTIMER_POSITION].duration)
        return volts


@pytest.mark.parametrize("model", ["tendon", "full"])
def test_the_compiled_loop_and_the_one_in_python_are_equal(machine, model):
    """Positions taken from the evaluation that the step begins with are those sensed beforehand: logs equal to the bit."""
    scenario = load_scenario("heave", duration_s=0.4)
    compiled, python = (simulate(machine, scenario, model=model, interventions=i).log for i in ([], [_Onlooker()]))
    assert compiled.equals(python)


def test_mujoco_reads_no_clock_during_a_run_and_has_it_back_afterwards(machine):
    """MuJoCo's timers stand still in a run, and count again in the same process after it, also after one that ends early."""
    onlooker = _Onlooker()

    def interrupt(fraction):
        raise KeyboardInterrupt

    stopped = simulate(machine, load_scenario("heave", duration_s=0.4), progress=interrupt, interventions=[onlooker])
    assert not stopped.complete and len(onlooker.readings) == 1
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 10)
    assert data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration > 0.0
