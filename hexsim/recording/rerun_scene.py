"""The machine in 3-D for a Rerun recording: base, cylinders, rods and platform, from the declared geometry and a log.

Shapes are static; only their transforms move, at 100 Hz. The origin is the centre of the base joints.
Cylinder and rod lengths are drawn, not declared: the rod covers the stroke and never leaves the cylinder.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from hexsim.recording import palette
from hexsim.recording.palette import rgb
from hexsim.recording.signals import Signals

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Where the legs are: base (n_legs, 3), platform joints (n, n_legs, 3), centre (n, 3) and rotation (n, 3, 3)."""

    time_s: Array
    base: Array
    joints: Array
    centre: Array
    rotation: Array
    retracted_m: float


def motion_of(signals: Signals) -> Motion | None:
    """Motion of a log at a rate above what a screen shows; None where the log does not tell the pose."""
    rate_Hz = 100.0
    every = max(1, round((len(signals.time_s) - 1) / np.ptp(signals.time_s) / rate_Hz))
    time = signals.time_s[::every]
    pose = signals.pose()
    if pose is None:
        return None
    pose = pose[::every]
    kinematics = signals.kinematics
    rotation = kinematics.rotation(pose)
    centre = pose[:, :3] + np.array([0.0, 0.0, kinematics.neutral_height_m])
    joints = centre[:, None] + np.einsum("nab,ib->nia", rotation, kinematics.platform_joints)
    retracted = float(np.min(kinematics.retracted_length_m))
    return Motion(
        time_s=time, base=kinematics.base_joints, joints=joints, centre=centre, rotation=rotation, retracted_m=retracted
    )


def log_machine(recording: rr.RecordingStream, path: str, signals: Signals, offset_m: Array) -> bool:
    """Send the machine to `path`, moved by `offset_m` (3,); False where the log does not tell the pose."""
    motion = motion_of(signals)
    if motion is None:
        return False
    recording.log(path, rr.Transform3D(translation=offset_m), static=True)
    _log_base(recording, path, motion, signals)
    _log_platform(recording, path, motion, signals)
    for leg in range(len(motion.base)):
        _log_leg(recording, f"{path}/leg_{leg + 1}", motion, leg, signals)
    return True


def _log_base(recording: rr.RecordingStream, path: str, motion: Motion, signals: Signals) -> None:
    size = signals.machine.cylinder.piston_diameter_m
    outline = motion.base if len(motion.base) > 2 else _square(4.0 * size)
    plate = _plate(1.12 * outline, -1.6 * size, -0.8 * size)
    recording.log(f"{path}/base/frame", _mesh(plate, rgb(palette.BASE)), static=True)
    joints = rr.Points3D(motion.base, radii=0.7 * size, colors=rgb(palette.JOINT))
    recording.log(f"{path}/base/joints", joints, static=True)


def _log_platform(recording: rr.RecordingStream, path: str, motion: Motion, signals: Signals) -> None:
    size = signals.machine.cylinder.piston_diameter_m
    joints = signals.kinematics.platform_joints
    if len(joints) > 1:
        plate = _plate(1.1 * joints, 0.5 * size, 1.3 * size)
    else:
        plate = _plate(_square(3.0 * size), 0.3 * size, 4.0 * size)
    recording.log(f"{path}/platform/plate", _mesh(plate, rgb(palette.PLATFORM)), static=True)
    recording.log(
        f"{path}/platform/joints", rr.Points3D(joints, radii=0.6 * size, colors=rgb(palette.JOINT)), static=True
    )
    axes = rr.Arrows3D(
        origins=[[0.0, 0.0, 1.3 * size]] * 3,
        vectors=4.0 * size * np.eye(3),
        colors=[(220, 80, 70), (80, 170, 90), (80, 120, 220)],
        radii=0.12 * size,
    )
    recording.log(f"{path}/platform/axes", axes, static=True)
    _send_transform(recording, f"{path}/platform", motion.time_s, motion.centre, motion.rotation)


def _log_leg(recording: rr.RecordingStream, path: str, motion: Motion, leg: int, signals: Signals) -> None:
    cylinder = signals.machine.legs[leg].cylinder
    body = 0.9 * motion.retracted_m
    rod = 0.1 * motion.retracted_m + 1.02 * cylinder.stroke_m
    shapes = {
        "cylinder": (body, 0.5 * body, 0.65 * cylinder.piston_diameter_m, rgb(palette.CYLINDER)),
        "rod": (
            rod,
            -0.5 * rod,
            max(0.5 * cylinder.rod_diameter_m, 0.2 * cylinder.piston_diameter_m),
            rgb(palette.ROD),
        ),
    }
    for name, (length, middle, radius, color) in shapes.items():
        shape = rr.Cylinders3D(
            lengths=[length], radii=[radius], centers=[[0.0, 0.0, middle]], colors=[color], fill_mode="solid"
        )
        recording.log(f"{path}/{name}", shape, static=True)
    rotation = _turn_z_to(motion.joints[:, leg] - motion.base[leg])
    base = np.broadcast_to(motion.base[leg], motion.centre.shape)
    _send_transform(recording, f"{path}/cylinder", motion.time_s, base, rotation)
    _send_transform(recording, f"{path}/rod", motion.time_s, motion.joints[:, leg], rotation)


def _send_transform(
    recording: rr.RecordingStream, path: str, time_s: Array, translation: Array, rotation: Array
) -> None:
    """One bulk message for the whole motion."""
    columns = rr.Transform3D.columns(translation=translation.astype(np.float32), quaternion=_quaternions(rotation))
    recording.send_columns(path, indexes=[time_column(time_s)], columns=columns)


def _quaternions(rotation: Array) -> NDArray[np.float32]:
    """(x, y, z, w) of rotations (n, 3, 3) by less than half a turn; to load SciPy's takes longer than the whole recording."""
    (a, f, e), (d, b, g), (h, i, c) = rotation.transpose(1, 2, 0)
    squares = np.stack([1 + a - b - c, 1 - a + b - c, 1 - a - b + c, 1 + a + b + c], axis=1)
    signs = np.stack([i - g, e - h, d - f, np.ones_like(a)], axis=1)
    return np.copysign(0.5 * np.sqrt(np.maximum(squares, 0.0)), signs).astype(np.float32)


def time_column(time_s: Array) -> rr.TimeColumn:
    """The common time line; seconds as whole nanoseconds, so that 1.009 s does not read 1.008999999 s."""
    return rr.TimeColumn("time", duration=np.rint(1e9 * np.asarray(time_s)).astype("timedelta64[ns]"))


def _turn_z_to(vectors: Array) -> Array:
    """Rotations (n, 3, 3) whose third column points along each vector; the first stays as near to x as it can."""
    z = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    x = np.array([1.0, 0.0, 0.0]) - z[:, :1] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _square(side: float) -> Array:
    half = 0.5 * side
    return np.array([[half, half, 0.0], [-half, half, 0.0], [-half, -half, 0.0], [half, -half, 0.0]])


def _plate(outline: Array, bottom: float, top: float) -> tuple[Array, NDArray[np.int_], Array]:
    """A flat plate over the convex outline (n, 3): vertices, triangles and one normal a vertex (edges stay sharp)."""
    angle = np.arctan2(outline[:, 1], outline[:, 0])
    ring = outline[np.argsort(angle)]
    lower, upper = ring + np.array([0.0, 0.0, bottom]), ring + np.array([0.0, 0.0, top])
    vertices, triangles, normals = [], [], []

    def face(corners: Array, normal: Array) -> None:
        first = len(vertices)
        vertices.extend(corners)
        normals.extend([normal] * len(corners))
        triangles.extend([first, first + k, first + k + 1] for k in range(1, len(corners) - 1))

    face(upper, np.array([0.0, 0.0, 1.0]))
    face(lower[::-1], np.array([0.0, 0.0, -1.0]))
    for i in range(len(ring)):
        j = (i + 1) % len(ring)
        corners = np.array([lower[i], lower[j], upper[j], upper[i]])
        normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
        face(corners, normal / np.linalg.norm(normal))
    return np.array(vertices), np.array(triangles), np.array(normals)


def _mesh(plate: tuple[Array, NDArray[np.int_], Array], color: tuple[int, int, int]) -> rr.Mesh3D:
    vertices, triangles, normals = plate
    return rr.Mesh3D(
        vertex_positions=vertices,
        triangle_indices=triangles,
        vertex_normals=normals,
        vertex_colors=np.tile(np.array(color, dtype=np.uint8), (len(vertices), 1)),
    )
