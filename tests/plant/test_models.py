"""The MJCF files and what is generated from the same geometry."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

import hexsim as hx
from hexsim.hydraulics import leg, parameters
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant

MODELS = Path(__file__).parents[2] / "models"
NAMES = hx.available()["machines"]


def _generator():
    spec = importlib.util.spec_from_file_location("generate", MODELS / "generate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", NAMES)
def test_model_files_are_what_the_geometry_gives(name):
    """The generated MJCF of a machine are what models/generate.py makes from machine.toml today."""
    for file, text in _generator().files_of(name).items():
        assert (MODELS / name / file).read_text() == text, file


@pytest.mark.parametrize("scene", ["scene.xml", "scene_servo.xml"])
@pytest.mark.parametrize("name", NAMES)
def test_every_element_of_the_scene_is_named(name, scene):
    """No body, joint, geom, site, actuator, equality, material, light, camera or key without a name."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / name / scene))
    for kind in ("body", "joint", "geom", "site", "actuator", "equality", "material", "light", "camera", "key"):
        count = {
            "joint": model.njnt,
            "actuator": model.nu,
            "equality": model.neq,
            "material": model.nmat,
            "light": model.nlight,
            "camera": model.ncam,
        }.get(kind, getattr(model, f"n{kind}", 0))
        code = mujoco.mjtObj.__members__[f"mjOBJ_{kind.upper()}"]
        nameless = [i for i in range(count) if not mujoco.mj_id2name(model, code, i)]
        assert nameless == [], kind


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("model", "timestep"), [("full", 1e-4), ("full", None), ("tendon", 1e-4), ("tendon", None)])
def test_random_volts_bring_no_warning(name, model, timestep):
    """Every model steps 1.2 s under random valve volts, end stops included, without a MuJoCo warning."""
    plant = Plant(load_machine(name), model=model, timestep=timestep)
    random = np.random.default_rng(7)
    lowest, highest = 1.0, 0.0
    for _ in range(60):
        volts = random.uniform(-10, 10, plant.n_legs)
        for _ in range(10):
            plant.tick(volts)
        plant.check()
        positions = plant.piston_positions()
        lowest, highest = min(lowest, positions.min()), max(highest, positions.max())
    # a moving rod enters the cushions; it may not leave the cylinder by more than the cushion's give of 2 mm
    stroke = plant.machine.cylinder.stroke_m
    assert -2e-3 < lowest < stroke / 2 < highest < stroke + 2e-3


@pytest.mark.parametrize("name", NAMES)
def test_raw_scene_steps_without_warning(name):
    """The scene file alone, without hexsim's oil, loads from `home` and steps 4 s under random volts without a warning."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / name / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    random = np.random.default_rng(3)
    for _ in range(8):
        data.ctrl[:] = random.uniform(-10, 10, model.nu)
        mujoco.mj_step(model, data, 1000)
    assert not data.warning.number.any()


ALONE = """
import json, sys
import mujoco

done = {}
for path in sys.argv[1:]:
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    slides = [model.joint(f"slide_{i + 1}").qposadr[0] for i in range(model.nu)]
    steps = round(1 / model.opt.timestep)
    drift = 0.0
    for tenth in range(30):
        mujoco.mj_step(model, data, steps // 10)
        drift = max(drift, abs(data.qpos[slides]).max())
    data.ctrl[:] = 0.1 if path.endswith("scene.xml") else 0.02
    mujoco.mj_step(model, data, steps)
    done[path] = drift, *data.qpos[slides]
    assert not data.warning.number.any()
assert not [name for name in sys.modules if name.startswith(("hexsim", "compensation", "numba"))]
print(json.dumps(done))
"""


def test_machines_stand_and_move_in_mujoco_alone(tmp_path):
    """In a process without hexsim, from MuJoCo's own start: no piston leaves its place by 0.0003 mm in 3 s. Then 0.1 V move
    each at the speed that the declared valve gives at rest, and a servo goes 20 mm, both within 0.1 mm.

    The ball ends give by 0.1 um under the load; the chord of the valve's gain is within 3 % of either direction's.
    """
    paths = [str(MODELS / name / scene) for name in NAMES for scene in ("scene.xml", "scene_servo.xml")]
    ended = subprocess.run(
        [sys.executable, "-I", "-c", ALONE, *paths], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    for path, (drift, *places) in json.loads(ended.stdout).items():
        machine = load_machine(Path(path).parent.name)
        assert drift < 3e-7 and len(places) == machine.n_legs
        target = 0.02
        if path.endswith("scene.xml"):
            rows, valve = parameters.declared_rows(machine), machine.valve
            plant = Plant(machine, model="tendon")
            flows = [
                leg.inflow(
                    rows[0],
                    0.0,
                    0.0,
                    0.0,
                    valve.spool_travel_max_m * way,
                    plant.bottom_pressures()[0],
                    machine.supply.pressure_Pa,
                    0.0,
                )
                for way in (1.0, -1.0)
            ]
            target = 0.1 / valve.voltage_max_V * (flows[0] - flows[1]) / 2 / machine.cylinder.area_bottom_m2
        assert places == pytest.approx([target] * len(places), abs=1e-4), path


def test_end_stop_at_full_speed():
    """10 V held into either end: the piston stops inside the cushion and stays within 2 mm of the cylinder's end."""
    for volts, end in ((10.0, 0.2), (-10.0, 0.0)):
        plant = Plant(changed(load_machine("bench"), {}))
        furthest = []
        plant.prepare(200.0)
        for _ in range(200):
            plant.tick(np.array([volts]))
            furthest.append(plant.piston_positions()[0])
        plant.check()
        assert abs(furthest[-1] - end) < 6e-3
        assert max(furthest) < 0.202 and min(furthest) > -0.002
