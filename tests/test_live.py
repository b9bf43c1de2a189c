"""The machine live, without its window: sliders, pause, push and reach."""

import os
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hexsim.hydraulics import leg
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant
from hexsim.scenarios import load_scenario
from hexsim.simulation.live import PUSH_N, SLIDERS, LiveMachine
from hexsim.simulation.live_sensors import LiveSensors


def heave_m(live):
    return float(live.data.qpos[2] - live.plant.kinematics.neutral_height_m)


@pytest.fixture(scope="module")
def hexapod():
    return LiveMachine(load_machine("micro_motion_system"))


@pytest.fixture
def live(hexapod):
    hexapod.reset()
    hexapod.paused = False
    yield hexapod


def slide(live, dof, value):
    """Move a slider to `value` of its own unit."""
    number = mujoco.mj_name2id(live.model, mujoco.mjtObj.mjOBJ_ACTUATOR, SLIDERS[dof][0])
    live.data.ctrl[number] = value


def test_every_degree_of_freedom_has_a_slider_within_its_reach(live):
    """Six sliders behind the six valves, symmetric about neutral, each end within the strokes of all legs."""
    names = [live.model.actuator(i).name for i in range(live.model.nu)]
    assert names == [f"leg_{i}" for i in range(1, 7)] + [SLIDERS[dof][0] for dof in live.dofs]
    for place, dof in enumerate(live.dofs):
        low, high = live.model.actuator_ctrlrange[6 + place]
        assert -low == pytest.approx(high)
        pose = np.zeros((1, 6))
        pose[0, place] = high * SLIDERS[dof][1]
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
    assert live.data.xfrc_applied[live.body, 2] == -PUSH_N
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
    bench = LiveMachine(load_machine("bench"), load_scenario("heave"))
    bench.advance(2.5)
    assert bench.plant.piston_positions()[0] == pytest.approx(0.15, abs=0.02)  # top of the sine, 0.16 s late
    slide(bench, "z", -20.0)
    bench.advance(2.0)
    assert bench.plant.piston_positions()[0] == pytest.approx(0.13, abs=0.02)


def test_valve_delay_and_hysteresis_act_in_live():
    """20 ms of delay and 0.2 V of hysteresis: the spool gets the volts of ten ticks ago, through the play."""
    effects = {"effects.valve_delay": {"delay_s": 0.02}, "effects.valve_hysteresis": {"half_width_V": 0.2}}
    bench = LiveMachine(changed(load_machine("bench"), effects), load_scenario("heave"))
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
    command = [sys.executable, "-m", "hexsim.cli", "live", "-m", "bench", "--seconds", "1"]
    ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith("hexsim: there is no screen") and "Traceback" not in ended.stderr


def test_a_delay_is_linear_between_ticks_and_has_no_gap_where_the_noise_repeats() -> None:
    """3 ms of delay at 2 ms a tick, a piston at 0.1 m/s: 0.3 mm behind, also at the tick where the noise begins anew."""
    ideal = {"sensors.position_noise_m": 0.0, "sensors.position_resolution_m": 0.0, "sensors.position_delay_s": 0.003}
    bench = changed(load_machine("bench"), ideal)
    plant = Plant(bench)
    sensors = LiveSensors(plant, 0.002, seed=0)
    place = np.zeros(1)
    plant.piston_positions = lambda: place
    for tick in (*range(8), *range(sensors.noise_ticks - 2, sensors.noise_ticks + 3)):
        place = place + 0.0002
        read, *_ = sensors.read(tick)
        if tick > 1:
            np.testing.assert_allclose(place - read, 0.0003, atol=1e-12)
