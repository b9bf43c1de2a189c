"""The benchmarks' own functions run, and what they compare is comparable. Speeds are measured by hand, not here."""

import importlib
import json
import time
from pathlib import Path

import numpy as np
import pytest

from hexsim import load_scenario
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant

FOLDER = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def benchmark(monkeypatch):
    """A function that imports a benchmark by its name."""
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module


@pytest.fixture
def peer(benchmark):
    """The comparison with Exudyn."""
    pytest.importorskip("exudyn", reason="exudyn is not installed: pip install hexsim[benchmark] to compare with it")
    return benchmark("peer_exudyn")


def test_the_speed_page_is_its_results(benchmark):
    """The tables of docs/results/speed.md are those that the command writes of speed.json."""
    speed = benchmark("command_speed")
    page, kept = speed.PAGE.read_text(encoding="utf-8"), json.loads(speed.RESULT.read_text(encoding="utf-8"))
    assert speed.page(page, kept) == page


def test_speed_takes_the_least_time_of_each_in_turn(benchmark):
    """least() calls the functions in turn and gives the shortest time of each: never less than what they sleep."""
    calls = []
    waits = {"a": iter([0.2, 0.01]), "b": iter([0.03, 0.03])}

    def function(name):
        calls.append(name)
        time.sleep(next(waits[name]))

    a, b = benchmark("speed").least(2, lambda: function("a"), lambda: function("b"), clock=time.perf_counter)
    assert calls == ["a", "b", "a", "b"]
    assert 0.01 <= a < 0.2 and b >= 0.03


def test_speed_runs_whole_and_bare(benchmark):
    """The whole run of 0.3 s ends at 0.3 s with the platform moved by the heave; the bare steps run."""
    speed = benchmark("speed")
    plant = Plant(load_machine("micro_motion_system"), model="tendon")
    neutral = plant.data.qpos[2]
    speed.bare_step(plant, 10)()
    speed.whole_run(plant, 0.3)()
    assert plant.data.time == pytest.approx(0.3)
    assert plant.data.qpos[2] != neutral


def test_speed_runs_a_batch(benchmark):
    """A batch of machines runs on one thread and on two."""
    assert benchmark("speed").batch_ratio(1, machines=2, steps=5) > 0.0


def heave_velocity(peer, bump=0.0, time_shift_s=0.0):
    """4 s of a 0.5 Hz sine with a 3 Hz part of 0.1 m/s2, and a bump of `bump` m/s2 wide enough for the 50 Hz band."""
    t = np.arange(0.0, peer.DURATION_S, peer.LOG_STEP_S) + time_shift_s
    acceleration = 0.5 * np.sin(np.pi * t) + 0.1 * np.sin(6 * np.pi * t) + bump * np.exp(-(((t - 3.0) / 0.03) ** 2))
    return np.cumsum(acceleration) * peer.LOG_STEP_S


def test_error_of_itself_is_zero(peer):
    """A run has no error against itself."""
    error = peer.error_of(heave_velocity(peer), heave_velocity(peer))
    assert error.wave == 0.0 and error.peak == 0.0 and error.good


def test_error_is_the_difference_over_the_peak_deviation(peer):
    """A bump of 10 mm/s2 on a deviation of 0.1 m/s2 is a wave error of 10 % (5 %: band limit, sampling), not good."""
    error = peer.error_of(heave_velocity(peer, bump=0.01), heave_velocity(peer))
    assert error.wave == pytest.approx(0.1, rel=0.05)
    assert not error.good


def test_error_sees_a_late_answer(peer):
    """A delay d leaves the peaks and costs wave error: |da/dt| d / peak, here (0.5 pi + 0.1 6 pi) d / 0.1 at most."""
    delay = 1e-4
    error = peer.error_of(heave_velocity(peer, time_shift_s=delay), heave_velocity(peer))
    assert error.peak < 1e-3
    assert error.wave == pytest.approx((0.5 * np.pi + 0.1 * 6 * np.pi) * delay / 0.1, rel=0.1)


@pytest.mark.parametrize("broken", [np.full(2000, np.nan), np.full(2000, 1e3), np.zeros(1999)])
def test_diverged_run_is_not_good(peer, broken):
    """Not finite, too fast or too short: the error is infinite."""
    assert not peer.error_of(broken, heave_velocity(peer)).good


def test_leaders_are_good_ones(peer):
    """What is timed with care are good settings; a bad one is left out however fast it is."""
    results = [
        peer.Result(setting=peer.Setting(tool=tool, scheme=name, step_s=1e-4), error=peer.Error(wave=wave), speed=10.0)
        for tool in peer.SCHEMES
        for name, wave in (("good", 0.001), ("bad", 0.1))
    ]
    assert {r.setting.scheme for r in peer.leaders(results)} == {"good"}
    assert len(peer.leaders(results)) == 2


def test_fastest_is_the_fastest_good_one(peer):
    """A faster setting with too much error does not count, nor one at another step when a step is asked for."""
    rows = [("bad", 1e-4, 0.02, 50.0), ("good", 1e-4, 0.001, 10.0), ("coarse", 1e-3, 0.0009, 20.0)]
    results = [
        peer.Result(
            setting=peer.Setting(tool="hexsim", scheme=name, step_s=step), error=peer.Error(wave=wave), speed=speed
        )
        for name, step, wave, speed in rows
    ]
    assert peer.fastest(results, "hexsim", 1e-4).setting.scheme == "good"
    assert peer.fastest(results, "hexsim").setting.scheme == "coarse"


def test_both_tools_simulate_the_same_machine(peer):
    """1.5 s of heave, up and down: hexsim and Exudyn, each with RK4 at 200 us, agree in velocity to 1e-6 of its peak.

    At this step both are converged to 7e-7 of the peak deviation. hexsim's valve is smooth within `pressure_width_Pa`
    of no pressure drop and Exudyn's is not, so the width is taken down to 100 Pa.
    """
    machine = changed(peer.common_machine(), {"valve.pressure_width_Pa": 100.0})
    scenario = load_scenario("heave", duration_s=1.5)
    ours = peer.hexsim_run(machine, scenario, 2e-4)()
    theirs = peer.exudyn_run(machine, scenario, "RK44", 2e-4, peer.LOG_STEP_S)()
    assert ours.shape == theirs.shape
    assert np.abs(ours - theirs).max() < 1e-6 * np.abs(ours).max()


def test_speeds_counts_cpu_time(peer):
    """speeds() gives simulated time over CPU time: a sleeping run costs nothing, a working one does."""

    def work():
        until = time.process_time() + 0.02
        while time.process_time() < until:
            pass

    sleeping, working = peer.speeds([lambda: time.sleep(0.02), work], 1.0, 2)
    assert sleeping > 2.0 * working
    assert 25.0 < working <= 50.0
