"""Write each machine's model.xml from its machine.toml: `python models/generate.py`.

The MJCF is made from the geometry by `hexsim.plant.mjcf`, never typed; tests/plant/test_models.py holds the files to it.
"""

from pathlib import Path

from hexsim.machine import available_machines, load_machine
from hexsim.plant import Plant

HERE = Path(__file__).parent


def model_xml(name: str) -> str:
    """The MJCF of a machine's full-leg model, with its `home` keyframe."""
    plant = Plant(load_machine(HERE / name), model="full")
    plant.add_home_keyframe()
    return plant.spec.to_xml()


if __name__ == "__main__":
    for machine in available_machines():
        (HERE / machine / "model.xml").write_text(model_xml(machine))
        print(f"wrote {machine}/model.xml")
