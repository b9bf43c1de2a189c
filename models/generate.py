"""Write each machine's MJCF files from its machine.toml: `python models/generate.py`.

The MJCF is made from the geometry by `hexsim.plant`, never typed; tests/plant/test_models.py holds the files to it.
"""

from pathlib import Path

from hexsim.machine import available_machines, load_machine
from hexsim.plant import Plant
from hexsim.plant.standing import standing_xml

HERE = Path(__file__).parent


def files_of(name: str) -> dict[str, str]:
    """File -> text: the machine in MuJoCo without hexsim, driven by volts and by positions, and the latter in its room."""
    plant, scene = Plant(load_machine(HERE / name), furnish=lambda spec: None), (HERE / name / "scene.xml").read_text()
    servo_scene = scene.replace("model.xml", "model_servo.xml")
    return {
        "model.xml": standing_xml(plant),
        "model_servo.xml": standing_xml(plant, servo=True),
        "scene_servo.xml": servo_scene.replace("ctrl: valve volts", "ctrl: pistons [m]"),
    }


if __name__ == "__main__":
    for machine in available_machines():
        for file, text in files_of(machine).items():
            (HERE / machine / file).write_text(text)
            print(f"wrote {machine}/{file}")
