# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""What the machine looks like: geoms without mass or contact. Colours: steel base, dark cylinders, bright rods."""

from __future__ import annotations

import mujoco
import numpy as np

from hexsim.declaration import Cylinder
from hexsim.mechanics.mechanics import Mechanics

MATERIALS = {
    "base_paint": (0.16, 0.20, 0.26, 1.0),
    "cylinder_paint": (0.10, 0.32, 0.55, 1.0),
    "chrome": (0.82, 0.84, 0.87, 1.0),
    "platform_paint": (0.90, 0.55, 0.13, 1.0),
    "payload_paint": (0.55, 0.57, 0.60, 1.0),
    "joint_paint": (0.30, 0.32, 0.35, 1.0),
}


def add_materials(spec: mujoco.MjSpec) -> None:
    """Paints, and the class `visual`: no contact, no mass."""
    visual = spec.add_default("visual", spec.default)
    visual.geom.contype = visual.geom.conaffinity = 0
    visual.geom.density, visual.geom.group = 0.0, 2
    for name, rgba in MATERIALS.items():
        shine = 0.9 if name == "chrome" else 0.3
        spec.add_material(name=name, rgba=rgba, specular=shine, shininess=shine)


def _geom(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, kind: str, material: str, **placed) -> None:
    """A geom of the class `visual`."""
    visual = spec.find_default("visual")
    body.add_geom(
        visual, name=name, type=getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}"), material=material, **placed
    )


def _beam(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, start, end, radius: float, material: str) -> None:
    _geom(spec, body, name, "capsule", material, fromto=[*start, *end], size=[radius, 0, 0])


def _cylinder(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, start: float, end: float, radius: float, material: str
) -> None:
    _geom(spec, body, name, "cylinder", material, fromto=[0, 0, start, 0, 0, end], size=[radius, 0, 0])


def add_base(spec: mujoco.MjSpec, world: mujoco.MjsBody, kinematics: Mechanics) -> None:
    """Ring of beams between the base joints, with a bracket under each."""
    joints = kinematics.base_joints
    scale = float(np.linalg.norm(joints[0]))
    order = np.argsort(np.arctan2(joints[:, 1], joints[:, 0]))
    drop = np.array([0, 0, -0.09 * scale])
    for k, (i, j) in enumerate(zip(order, np.roll(order, -1), strict=True), start=1):
        _beam(spec, world, f"base_beam_{k}", joints[i] + drop, joints[j] + drop, 0.05 * scale, "base_paint")
    for i, joint in enumerate(joints, start=1):
        _beam(spec, world, f"base_bracket_{i}", joint + drop, joint, 0.04 * scale, "joint_paint")


def add_platform(spec: mujoco.MjSpec, platform: mujoco.MjsBody, kinematics: Mechanics) -> None:
    """Beams between the platform joints, a deck on top, and a payload of the same footprint."""
    joints = kinematics.platform_joints
    scale = float(np.linalg.norm(joints[0]))
    order = np.argsort(np.arctan2(joints[:, 1], joints[:, 0]))
    rise = np.array([0, 0, 0.08 * scale])
    for k, (i, j) in enumerate(zip(order, np.roll(order, -1), strict=True), start=1):
        _beam(spec, platform, f"platform_beam_{k}", joints[i] + rise, joints[j] + rise, 0.05 * scale, "platform_paint")
    for i, joint in enumerate(joints, start=1):
        _beam(spec, platform, f"platform_bracket_{i}", joint, joint + rise, 0.04 * scale, "joint_paint")
    deck = 0.15 * scale
    _geom(
        spec,
        platform,
        "deck",
        "cylinder",
        "platform_paint",
        fromto=[0, 0, deck, 0, 0, deck + 0.04 * scale],
        size=[0.95 * scale, 0, 0],
    )
    _geom(
        spec,
        platform,
        "payload",
        "box",
        "payload_paint",
        pos=[0, 0, deck + 0.28 * scale],
        size=[0.5 * scale, 0.4 * scale, 0.24 * scale],
    )


def add_part(spec: mujoco.MjSpec, body: mujoco.MjsBody, mass: float) -> None:
    """A cube about as large as what is bolted to a platform, 500 kg/m3."""
    _geom(spec, body, f"{body.name}_looks", "box", "payload_paint", size=[0.5 * (mass / 500.0) ** (1 / 3)] * 3)


def add_cylinder(spec: mujoco.MjSpec, body: mujoco.MjsBody, length: float, cylinder: Cylinder, number: int) -> None:
    """Barrel from the base joint, a head, and the valve block at its foot."""
    radius = 0.75 * cylinder.piston_diameter_m
    barrel = length - 1.05 * cylinder.stroke_m / 2 - 0.02
    _cylinder(spec, body, f"barrel_{number}", 0.05 * length, barrel, radius, "cylinder_paint")
    _cylinder(
        spec, body, f"head_{number}", barrel - 0.05 * length, barrel + 0.005 * length, 1.25 * radius, "joint_paint"
    )
    _geom(spec, body, f"universal_joint_{number}", "sphere", "joint_paint", size=[1.1 * radius, 0, 0])
    _geom(
        spec,
        body,
        f"valve_block_{number}",
        "box",
        "payload_paint",
        pos=[1.4 * radius, 0, 0.16 * length],
        size=[0.7 * radius, 0.9 * radius, 0.06 * length],
    )


def add_rod(spec: mujoco.MjSpec, body: mujoco.MjsBody, length: float, cylinder: Cylinder, number: int) -> None:
    """Bright rod down to the piston, ball at the end."""
    reach = min(0.55 * length, cylinder.stroke_m + 0.15 * length)
    _cylinder(spec, body, f"rod_shaft_{number}", -reach, 0.0, cylinder.rod_diameter_m / 2, "chrome")
    _geom(spec, body, f"ball_{number}", "sphere", "joint_paint", size=[0.8 * cylinder.rod_diameter_m, 0, 0])


def bench_load_height(stroke: float) -> float:
    """Height of the load above the floor at half stroke [m]."""
    return 2.6 * stroke


def add_bench_frame(spec: mujoco.MjSpec, world: mujoco.MjsBody, cylinder: Cylinder) -> None:
    """The fixed cylinder of a bench on its foot."""
    stroke, radius = cylinder.stroke_m, 0.75 * cylinder.piston_diameter_m
    _geom(
        spec,
        world,
        "foot",
        "box",
        "base_paint",
        pos=[0, 0, 0.05 * stroke],
        size=[4 * radius, 4 * radius, 0.05 * stroke],
    )
    _cylinder(spec, world, "barrel_1", 0.1 * stroke, 1.5 * stroke, radius, "cylinder_paint")
    _cylinder(spec, world, "head_1", 1.4 * stroke, 1.515 * stroke, 1.25 * radius, "joint_paint")


def add_bench_load(spec: mujoco.MjSpec, body: mujoco.MjsBody, cylinder: Cylinder) -> None:
    """Rod and the mass on it."""
    stroke, side = cylinder.stroke_m, 1.7 * cylinder.piston_diameter_m
    _cylinder(spec, body, "rod_shaft_1", -1.8 * stroke, 0.0, cylinder.rod_diameter_m / 2, "chrome")
    _geom(spec, body, "payload", "box", "platform_paint", pos=[0, 0, side], size=[side, side, side])
