"""The MJCF files and what is generated from the same geometry."""

import importlib.util

import mujoco
import numpy as np
import pytest

from hexsim.machine import available_machines, load_machine, models_folder
from hexsim.machine.files import changed
from hexsim.plant import Plant

NAMES = available_machines()


def _generator():
    spec = importlib.util.spec_from_file_location("generate", models_folder() / "generate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", NAMES)
def test_model_file_is_what_the_geometry_gives(name):
    """models/<name>/model.xml is what models/generate.py makes from machine.toml today."""
    assert (models_folder() / name / "model.xml").read_text() == _generator().model_xml(name)


@pytest.mark.parametrize("name", NAMES)
def test_every_element_of_the_scene_is_named(name):
    """No body, joint, geom, site, actuator, equality, material, light, camera or key without a name."""
    model = mujoco.MjModel.from_xml_path(str(models_folder() / name / "scene.xml"))
    for kind in ("body", "joint", "geom", "site", "actuator", "equality", "material", "light", "camera", "key"):
        count = {"joint": model.njnt, "actuator": model.nu, "equality": model.neq, "material": model.nmat,
                 "light": model.nlight, "camera": model.ncam}.get(kind, getattr(model, f"n{kind}", 0))  # fmt: skip
        code = mujoco.mjtObj.__members__[f"mjOBJ_{kind.upper()}"]
        nameless = [i for i in range(count) if not mujoco.mj_id2name(model, code, i)]
        assert nameless == [], kind


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("model", "timestep"), [("full", 1e-4), ("full", None), ("tendon", 1e-4), ("tendon", None)])
def test_random_volts_bring_no_warning(name, model, timestep):
    """Every model steps 2 s under random valve volts, end stops included, without a MuJoCo warning."""
    plant = Plant(load_machine(name), model=model, timestep=timestep)
    random = np.random.default_rng(7)
    lowest, highest = 1.0, 0.0
    for _ in range(100):
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
    """The scene file alone, without hexsim's oil, loads from `home` and steps 2 s under random volts without a warning."""
    model = mujoco.MjModel.from_xml_path(str(models_folder() / name / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    random = np.random.default_rng(3)
    for _ in range(20):
        data.ctrl[:] = random.uniform(-10, 10, model.nu)
        mujoco.mj_step(model, data, 1000)
    assert not data.warning.number.any()


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
