"""The machine behind the page, without a browser."""

import shlex
import sys
import time
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import hexsim as hx
from hexsim import load_scenario
from hexsim.cli import app
from hexsim.machine import load_machine, machine_from_dict
from hexsim.scenarios import scenario_from_dict

pytest.importorskip("mjviser", reason="the page needs the extra: pip install 'hexsim[web]'")
from hexsim import web
from hexsim.web import knobs as sliders

PATIENCE_S = 60.0  # of a test on a computer that is busy


def wait_until(condition):
    """Until it holds; fails after a minute."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.parametrize("name", hx.available()["machines"])
def test_the_command_on_the_page_is_the_machine_of_its_sliders(name, tmp_path):
    """Every slider of every machine at its far end: the command line that the page shows runs the machine and the motion that
    run on the page."""
    machine, scenario = load_machine(name), load_scenario("heave")
    session = web.Session(machine, scenario)
    far = {knob.name: knob.high for knob in sliders.knobs(machine)}
    asked = web.Asked(knobs=far, motion="heave", amplitude=30.0, frequency_Hz=0.4)
    words = shlex.split(session.command(asked, name, "heave"))
    assert words[:5] == ["hexsim", "run", "heave", "--machine", name]
    short = ["--fast", "--duration", "0.01", "--no-report", "--no-recording", "--out", str(tmp_path / "run")]
    ended = CliRunner().invoke(app, [*words[1:], *short])
    assert ended.exit_code == 0, ended.output
    config = tomllib.loads((tmp_path / "run" / "config.toml").read_text())
    assert machine_from_dict(config["machine"]) == sliders.machine_with(machine, far) != machine
    assert scenario_from_dict(config["scenario"]) == replace(session.motion_of(asked), duration_s=0.01)


def test_what_cannot_be_is_refused_and_the_machine_stays():
    """A load that the supply cannot hold: one sentence, the machine as before; a load that it can: the machine has it."""
    session = web.Session(load_machine("bench"), load_scenario("heave"))
    session.start()
    try:
        session.ask(web.Asked(knobs={"load": 1e5}, motion="heave", amplitude=50.0, frequency_Hz=0.5))
        wait_until(lambda: session.shown().error)
        assert "outside" in session.shown().error and session.live.machine == session.declared
        assert session.shown().asked.knobs == {}
        session.ask(web.Asked(knobs={"load": 60.0}, motion="heave", amplitude=50.0, frequency_Hz=0.5))
        wait_until(lambda: session.live.machine.load.moving_mass_kg == 60.0)
        assert session.shown().error == ""
    finally:
        session.stop()


def test_the_motions_are_sines_of_axes_that_the_machine_has():
    """Six for a hexapod, heave for a bench; each within the strokes at the largest amplitude of its slider."""
    hexapod = load_machine("micro_motion_system")
    assert sorted(sliders.waves(hexapod)) == ["heave", "pitch", "roll", "surge", "sway", "yaw"]
    assert list(sliders.waves(load_machine("bench"))) == ["heave"]
    for wave in sliders.waves(hexapod).values():
        motion = replace(wave, amplitude=wave.largest_amplitude(hexapod)).built()
        ends = motion.evaluate(motion.duration_s + np.array([0.25, 0.75]) * motion.period_s)[0]
        reached = hexapod.mechanics.piston_positions(ends)
        assert ((reached > 0.0) & (reached < hexapod.cylinder.stroke_m)).all()


def test_without_a_page_there_is_a_sentence(monkeypatch):
    """`hexsim live --web` where viser is missing names the extra."""
    for name in [name for name in sys.modules if name.startswith("hexsim.web")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "viser", None)
    done = CliRunner().invoke(app, ["live", "heave", "--web", "--seconds", "1"])
    assert done.exit_code == 2 and "pip install 'hexsim[web]'" in done.stderr
