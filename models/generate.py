# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""Write each machine's MJCF files from its machine.toml: `python models/generate.py`.

The MJCF is made from the geometry by `hexsim.plant`, never typed; tests/plant/test_models.py holds the files to it. It is for
MuJoCo without hexsim, with legs of linear actuators in place of the hydraulics:

    model   ctrl = valve volts u:     F = F_0 + k (int k_v u dt - y) - d y'
    servo   ctrl = displacement [m]:  F = F_0 + k (ctrl - y) - d_s y',  within what the oil can push

y: piston from neutral; F_0: force at rest; k: the oil spring of the leg with its valve shut; k_v: speed for a volt; d: its
viscous friction. Both stand at neutral from MuJoCo's own start on, and stop at the ends of the stroke. They have neither
overlap nor dry friction, so no reversal bump: for that a model needs hexsim, or the plugin of `hexsim export plugin`.
"""

from pathlib import Path

import mujoco
import numpy as np

from hexsim.hydraulics.oil_spring import oil_stiffness, speed_per_volt
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P
from hexsim.machine import available_machines, load_machine
from hexsim.plant import Plant

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


def standing_xml(
    plant: Plant,
    servo: bool = False,
    *,
    servo_damping: float = 0.7,  # of the servo: a step without a ring to be seen
    step_s: float = 5e-4,  # the stiffest modes, of the ball ends, have 1.6e3 rad/s: RK4 bears 2.8 over the step
) -> str:
    """The MJCF of a machine of full legs, with keyframe `home`. The plant is left as it is."""
    plant.reset()
    spec = plant.spec.copy()
    spec.option.timestep = step_s
    spec.nuser_actuator = spec.nuserdata = 0
    compliance = np.diag(plant.compliance)
    for i in range(plant.n_legs):
        actuator, p = spec.actuator(f"leg_{i + 1}"), plant.rows[i]
        k, rest = oil_stiffness(p), float(plant.data.actuator_force[i])
        ends = np.array([0.0, p[P.STROKE]]) - plant.kinematics.neutral_positions[i]
        actuator.biastype, actuator.dyntype = mujoco.mjtBias.mjBIAS_AFFINE, mujoco.mjtDyn.mjDYN_NONE
        gain, bias = np.zeros(10), np.zeros(10)
        if servo:
            gain[0], bias[:3] = k, (rest, -k, -2.0 * servo_damping * np.sqrt(k / compliance[i]))
            actuator.actdim, actuator.ctrlrange = 0, ends
            actuator.forcelimited, actuator.forcerange = True, forces(p)
        else:
            speed = speed_per_volt(p, plant.bottom_pressures()[i])
            viscous = 0.5 * (p[P.VISCOUS_EXTEND] + p[P.VISCOUS_RETRACT])
            gain[0], bias[:3] = k * speed, (rest, -k, -viscous)
            actuator.dyntype, actuator.actdim = mujoco.mjtDyn.mjDYN_INTEGRATOR, 1
            actuator.actlimited, actuator.actrange = True, ends / speed
        actuator.gainprm, actuator.biasprm = gain, bias
        joint = spec.joint(f"slide_{i + 1}")
        joint.limited, joint.range = True, ends
    if plant.has_supply_states:
        spec.delete(spec.actuator("supply"))
    spec.add_key(name="home")
    return spec.to_xml()


def forces(p: np.ndarray) -> list[float]:
    """Least and largest force of a leg's oil [N]."""
    supply, tank, bottom, top = p[P.SUPPLY_PRESSURE], p[P.TANK_PRESSURE], p[P.AREA_BOTTOM], p[P.AREA_TOP]
    most = tank if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE else supply  # the rod side while the leg extends
    return [float(tank * bottom - supply * top), float(supply * bottom - most * top)]


if __name__ == "__main__":
    for machine in available_machines():
        for file, text in files_of(machine).items():
            (HERE / machine / file).write_text(text)
            print(f"wrote {machine}/{file}")
