"""The machine live, without its window: sliders, pause, push and reach."""

import os
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hexsim import load_scenario
from hexsim.hydraulics import leg
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation import live as live_machine
from hexsim.simulation import recent_motion, simulate


def heave_m(live):
    return float(live.data.qpos[2] - live.plant.kinematics.neutral_height_m)


@pytest.fixture(scope="module")
def hexapod():
    return live_machine.LiveMachine(load_machine("micro_motion_system"))


@pytest.fixture
def live(hexapod):
    hexapod.reset()
    hexapod.paused = False
    yield hexapod


def slide(live, dof, value):
    """Move a slider to `value` of its own unit."""
    number = mujoco.mj_name2id(live.model, mujoco.mjtObj.mjOBJ_ACTUATOR, live_machine.SLIDERS[dof][0])
    live.data.ctrl[number] = value


def test_every_degree_of_freedom_has_a_slider_within_its_reach(live):
    """Six sliders behind the six valves, symmetric about neutral, each end within the strokes of all legs."""
    names = [live.model.actuator(i).name for i in range(live.model.nu)]
    assert names == [f"leg_{i}" for i in range(1, 7)] + [live_machine.SLIDERS[dof][0] for dof in live.dofs]
    for place, dof in enumerate(live.dofs):
        low, high = live.model.actuator_ctrlrange[6 + place]
        assert -low == pytest.approx(high)
        pose = np.zeros((1, 6))
        pose[0, place] = high * live_machine.SLIDERS[dof][1]
        setpoints = live.setpoints(pose)
        assert np.all((setpoints > 0) & (setpoints < live.machine.cylinder.stroke_m))


def test_the_sliders_do_not_disturb_the_hydraulics(live):
    """At rest with sliders in the middle the platform stays: static equilibrium survives the added actuators."""
    live.advance(0.5)
    assert abs(heave_m(live)) < 2e-5  # sensor noise of 3 um through Kp moves it by microns


def test_the_platform_follows_a_slider(live):
    """30 mm on the slider is 30 mm of heave, but for the valve's dead band: 45 mV / 50 V/m = 0.9 mm of each leg."""
    slide(live, "z", 30.0)
    live.advance(2.0)
    assert heave_m(live) == pytest.approx(0.03, abs=1.3e-3)  # 0.9 mm along legs that stand at 35 deg is 1.1 mm of heave


def test_pause_stands_still_and_push_sinks(live):
    """Paused nothing moves; 981 N on the platform for a second press it down by the oil's give, and it comes back."""
    live.paused = True
    before = live.data.qpos.copy()
    live.advance(0.1)
    assert np.array_equal(live.data.qpos, before)
    live.paused = False
    live.push()
    live.advance(0.5)
    assert live.data.xfrc_applied[live.body, 2] == -live_machine.PUSH_N
    assert heave_m(live) < -1e-5
    live.advance(1.5)
    assert live.data.xfrc_applied[live.body, 2] == 0.0 and abs(heave_m(live)) < 2e-4


def test_sliders_together_stop_at_the_edge_of_the_workspace(live):
    """All sliders at their ends ask too much: the setpoint stands still inside the strokes, and the state says so."""
    for dof in live.dofs:
        slide(live, dof, 1e3)
    live.advance(2.0)
    assert live.out_of_reach
    positions = live.plant.piston_positions()
    assert np.all((positions > 0.0) & (positions < live.machine.cylinder.stroke_m))


def test_a_scenario_runs_beneath_the_sliders():
    """The bench follows the scenario's sine; a slider adds to it."""
    bench = live_machine.LiveMachine(load_machine("bench"), load_scenario("heave"))
    bench.advance(2.5)
    assert bench.plant.piston_positions()[0] == pytest.approx(0.15, abs=0.02)  # top of the sine, 0.16 s late
    slide(bench, "z", -20.0)
    bench.advance(2.0)
    assert bench.plant.piston_positions()[0] == pytest.approx(0.13, abs=0.02)


def test_valve_delay_and_hysteresis_act_in_live():
    """20 ms of delay and 0.2 V of hysteresis: the spool gets the volts of ten ticks ago, through the play."""
    effects = {"effects.valve_delay": {"delay_s": 0.02}, "effects.valve_hysteresis": {"half_width_V": 0.2}}
    bench = live_machine.LiveMachine(changed(load_machine("bench"), effects), load_scenario("heave"))
    commanded, spools = [], []
    for _ in range(400):
        bench.advance(bench.tick_s)
        commanded.append(float(bench.loop.valve[0]))
        spools.append(float(bench.data.ctrl[0]))
    expected = leg.valve_volts(np.array([0.0, *commanded]), 0.2, 10)
    late = np.array(commanded) != spools
    assert late.any()
    np.testing.assert_allclose(spools[20:], expected[21:], atol=1e-12)


def test_the_mouse_pulls_only_at_the_platform(live):
    """A pull at the platform becomes a force on it while it lasts; a pull at another body is none."""
    perturb = mujoco.MjvPerturb()
    perturb.select, perturb.active, perturb.localmass = live.body, int(mujoco.mjtPertBit.mjPERT_TRANSLATE), 600.0
    perturb.refselpos[:] = live.data.xpos[live.body] + [0.0, 0.0, 0.1]
    live.pull(perturb)
    assert live.disturbance[2] > 10.0
    perturb.select = 1 if live.body != 1 else 2
    live.pull(perturb)
    assert not live.disturbance.any()


def test_without_a_screen_one_sentence(tmp_path):
    """`hexsim live` where no window can open ends with code 2 and a sentence, not with GLFW's exit."""
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    environment["PYTHONPATH"] = str(Path(__file__).parents[1])
    command = [sys.executable, "-m", "hexsim", "live", "-m", "bench", "--seconds", "1"]
    ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith("hexsim: there is no screen") and "Traceback" not in ended.stderr


def test_a_delay_is_linear_between_ticks_and_has_no_gap_where_the_noise_repeats() -> None:
    """3 ms of delay at 2 ms a tick, a piston at 0.1 m/s: 0.3 mm behind, also at the tick where the noise begins anew."""
    ideal = {"sensors.position_noise_m": 0.0, "sensors.position_resolution_m": 0.0, "sensors.position_delay_s": 0.003}
    bench = changed(load_machine("bench"), ideal)
    live = live_machine.LiveMachine(changed(bench, {"sensors.log_rate_Hz": 500.0}))
    sensors, place = live.sensors, np.zeros(1)
    live.plant.piston_positions = lambda: place
    for tick in (*range(8), *range(sensors.noise_ticks - 2, sensors.noise_ticks + 3)):
        place = place + 0.0002
        read, *_ = sensors.read(tick)
        if tick > 1:
            np.testing.assert_allclose(place - read, 0.0003, atol=1e-12)


def figures_of(live, recent, since_s):
    """Figures of the last periods since `since_s`."""
    log = recent.log(live, since_s)
    assert log is not None
    return recent_motion.motion_figures(live.motion.scenario, live.kinematics.axes, log)


def test_a_machine_becomes_another_in_flight_and_its_figures_are_those_of_a_run():
    """Overlap, friction, spool, leak and delay changed while the bench moves: the peak in 50 Hz goes from that of
    `hexsim run` of the one machine to that of the other. 2 %: noise of other seeds, and 2 periods in place of 8."""
    bench, motion = load_machine("bench"), load_scenario("heave", frequency_Hz=1.0)
    other = {
        "valve.overlap_m": 15e-6,
        "valve.spool_frequency_Hz": 40.0,
        "friction.coulomb_extend_N": 100.0,
        "effects.leakage_supply_to_chamber.conductance_m3_s_Pa": 1e-12,
        "effects.valve_delay.delay_s": 0.004,
    }
    recent = recent_motion.RecentMotion()
    live, wanted = live_machine.LiveMachine(bench, motion, observe=recent.note), changed(bench, other)
    for machine in (bench, wanted):
        assert live.become(machine)
        since = live.time_s + 3.0
        live.advance(5.5)
        figures = figures_of(live, recent, since)
        said = simulate(machine, motion).summary["axes"]["leg"]
        assert figures.peak == pytest.approx(said["peak_band_m_s2"], rel=0.02)
        largest = max(np.abs(curve).max() for curve in figures.curves.values())
        assert largest == pytest.approx(figures.peak, rel=0.1)  # the last reversals hold the peak of the last periods
        assert figures.times_threshold == pytest.approx(figures.peak / 0.154)


@pytest.mark.parametrize(
    "changes",
    [
        {"load.moving_mass_kg": 80.0},
        {"effects.mass_change.mass_kg": 4.0},
        {"valve.spool_frequency_Hz": 0.0},
        {"effects.position_delay.delay_s": 0.002},
        {"effects.valve_delay.delay_s": 0.1},
        {"controller.gain_V_per_m": 40.0},
    ],
)
def test_what_is_not_in_the_hydraulics_rows_is_not_taken_over_in_flight(changes):
    """Load, sensors, controller, states that come or go, a delay longer than what is kept: refused, nothing touched."""
    live = live_machine.LiveMachine(load_machine("bench"))
    rows = live.plant.rows.copy()
    assert not live.become(changed(live.machine, changes))
    np.testing.assert_array_equal(live.plant.rows, rows)


def test_one_motion_goes_over_into_the_next_without_a_jump():
    """Heave to surge at its largest excursion: from tick to tick no more than 2 ms at the speed of both together and of
    the fade; heave is gone after it, surge at its full size."""
    motion, fade_s = live_machine.LiveMachine(load_machine("micro_motion_system"), load_scenario("heave")).motion, 2.0
    motion.exchange(load_scenario("surge"), 10.5)
    time_s = np.arange(10.0, 14.5, 0.002)
    poses = np.array([motion.poses(np.array([t]))[0] for t in time_s])
    fastest = 0.05 * np.pi + 0.05 / fade_s
    assert np.abs(np.diff(poses[time_s >= 10.5], axis=0)).max() < 0.002 * fastest * 1.001
    late = time_s > 10.5 + fade_s
    assert not poses[late, 2].any() and np.abs(poses[late, 0]).max() == pytest.approx(0.05, rel=1e-3)
