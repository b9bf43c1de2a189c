# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""The machine as a MuJoCo model, made from its geometry: full legs, and the fast tendon model of the same geometry.

full    universal joint, cylinder, rod on a slide joint, ball end closed by `connect`: the machine that people see.
tendon  one spatial tendon a leg between two sites; the legs' masses are generic at the platform joints.

Frames and numbering as in `hexsim.mechanics.kinematics`. Actuators `leg_1`..`leg_6` (bench: `leg_1`): ctrl = valve volts,
act = the leg's states; then `supply` where it has states: ctrl = pump on, act = its states (places: `plant.states`).
"""

from __future__ import annotations

import math
from typing import Literal

import mujoco
import numpy as np

from hexsim.declaration import Cylinder
from hexsim.errors import HexsimError
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import PayloadMode, Resolved
from hexsim.machine.geometry import leg_bodies
from hexsim.mechanics.leg_inertia import LegBodies, lumped_legs
from hexsim.mechanics.mechanics import Mechanics
from hexsim.plant import looks
from hexsim.plant.states import ROW, A, actuator_rows

ModelKind = Literal["full", "tendon"]


def build_spec(
    resolved: Resolved, kinematics: Mechanics, kind: ModelKind, timestep: float, layout: np.ndarray, is_shown: bool
) -> tuple[mujoco.MjSpec, np.ndarray]:
    """The editable model of a bench or a hexapod, and its actuators' rows for `actuator_user`.

    layout: where the states stand (`plant.states`), which also says the integrator. The rows are kept out of the
    model's XML: they are the hydraulics' numbers, which stand in the machine file. is_shown: with geoms, whose frames
    cost 7 % of a step; the tendon model has none.
    """
    spec = mujoco.MjSpec()
    spec.modelname = resolved.machine.name
    spec.compiler.degree = False
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = resolved.gravity_m_s2
    off = mujoco.mjtDisableBit
    # no silent reset: a bad state stays, so that `Plant.check` and the log can say when and where it began
    spec.option.disableflags = off.mjDSBL_CONTACT | off.mjDSBL_EULERDAMP | off.mjDSBL_AUTORESET
    spec.option.tolerance = 1e-12
    looks.add_materials(spec)
    if kinematics.has_platform:
        _add_hexapod(spec, resolved, kinematics, kind)
    else:
        _add_bench(spec, resolved)
    tendon = kind == "tendon"  # a slide is 0 at the neutral pose
    for geom in [] if is_shown and not tendon else list(spec.geoms):
        spec.delete(geom)
    offset = kinematics.retracted_length_m if tendon else -kinematics.neutral_positions
    _add_actuators(spec, resolved, layout, "tendon_" if tendon else "slide_", np.asarray(offset))
    return spec, actuator_rows(resolved, layout)


def _add_bench(spec: mujoco.MjSpec, resolved: Resolved) -> None:
    """One vertical cylinder with the moving mass on its rod."""
    cylinder = resolved.machine.legs[0].cylinder
    mass = resolved.load.moving_mass_kg or 0.0
    looks.add_bench_frame(spec, spec.worldbody, cylinder)
    load = spec.worldbody.add_body(name="load", pos=[0, 0, looks.bench_load_height(cylinder.stroke_m)])
    load.add_joint(name="slide_1", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    load.mass, load.ipos, load.inertia, load.explicitinertial = mass, [0, 0, 0], [mass * 0.01] * 3, True
    looks.add_bench_load(spec, load, cylinder)
    load.add_site(name="accelerometer", pos=[0, 0, 0])
    for mode_number, mode in enumerate(resolved.payload_modes, start=1):
        _add_payload_mode(load, mode, mode_number, resolved.gravity_m_s2)


def _add_hexapod(spec: mujoco.MjSpec, resolved: Resolved, kinematics: Mechanics, kind: ModelKind) -> None:
    """Platform with a free joint on six legs."""
    load = resolved.load
    neutral_length = float(kinematics.leg_lengths(np.zeros(6))[0])
    bodies = leg_bodies(resolved, neutral_length)
    full = kind == "full"
    looks.add_base(spec, spec.worldbody, kinematics)
    platform = spec.worldbody.add_body(name="platform", pos=[0, 0, kinematics.neutral_height_m])
    platform.add_freejoint(name="platform_free")
    mass = (load.platform_mass_kg or 0.0) - (
        math.fsum(leg.rod_mass for leg in bodies) if full and load.leg_mass_kg == 0.0 else 0.0
    )
    platform.mass, platform.ipos, platform.inertia = mass, load.centre_of_mass_m, load.platform_inertia_kg_m2
    platform.explicitinertial = True
    looks.add_platform(spec, platform, kinematics)
    for number, part in enumerate(resolved.machine.payload, start=1):
        body = platform.add_body(name=f"payload_{number}", pos=part.position_m)
        body.mass, body.ipos, body.inertia, body.explicitinertial = part.mass_kg, [0, 0, 0], part.inertia_kg_m2, True
        looks.add_part(spec, body, part.mass_kg)
    platform.add_site(name="accelerometer", pos=[0, 0, 0])
    for mode_number, mode in enumerate(resolved.payload_modes, start=1):
        _add_payload_mode(platform, mode, mode_number, resolved.gravity_m_s2)
    for i in range(6):
        platform.add_site(name=f"platform_joint_{i + 1}", pos=kinematics.platform_joints[i], size=[0.012] * 3)
        spec.worldbody.add_site(name=f"base_joint_{i + 1}", pos=kinematics.base_joints[i], size=[0.012] * 3)
        if full:
            _add_full_leg(spec, kinematics, bodies[i], i, resolved.machine.legs[i].cylinder)
        else:
            tendon = spec.add_tendon(name=f"tendon_{i + 1}", width=0.015)
            tendon.wrap_site(f"base_joint_{i + 1}")
            tendon.wrap_site(f"platform_joint_{i + 1}")
    if not full and load.leg_mass_kg > 0:
        _add_lumped_legs(platform, kinematics, bodies)


def _add_full_leg(
    spec: mujoco.MjSpec,
    kinematics: Mechanics,
    bodies: LegBodies,
    i: int,
    declared: Cylinder,
    *,
    ball_rad_s: float = 1.6e3,
    ball_damping: float = 0.3,
) -> None:
    """Universal joint at the base, cylinder, rod on a slide joint, ball end on the platform.

    A ball end yields by r'' + b r' + k r = -R f, R = 1e-4 over the mass that it holds (solimp): beside the oil spring K it is a
    damper that takes K omega b R/k^2 of the ring. Light rods make R large; k as large as RK4 bears at its longest step
    (h sqrt(k) = 1.6 of 2.8) and a damping ratio of 0.3 keep it below 2 % of what friction takes
    from 1 kg a leg on, 6 % at 0.1 kg (tests/plant/test_ball_ends.py).
    """
    number = i + 1
    base = kinematics.base_joints[i]
    top = kinematics.platform_joints[i] + np.array([0, 0, kinematics.neutral_height_m])
    length = float(np.linalg.norm(top - base))
    cylinder = spec.worldbody.add_body(name=f"cylinder_{number}", pos=base, quat=_turn_z_to((top - base) / length))
    cylinder.add_joint(name=f"universal_{number}_a", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1, 0, 0])
    cylinder.add_joint(name=f"universal_{number}_b", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    across, along = bodies.cylinder_inertia
    cylinder.mass, cylinder.ipos = bodies.cylinder_mass, [0, 0, bodies.cylinder_centre]
    cylinder.inertia, cylinder.explicitinertial = [across, across, along], True
    looks.add_cylinder(spec, cylinder, length, declared, number)
    rod = cylinder.add_body(name=f"rod_{number}", pos=[0, 0, length])
    rod.add_joint(name=f"slide_{number}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    across, along = bodies.rod_inertia
    rod.mass, rod.ipos = bodies.rod_mass, [0, 0, -bodies.rod_centre]
    rod.inertia, rod.explicitinertial = [across, across, along], True
    looks.add_rod(spec, rod, length, declared, number)
    ball = spec.add_equality(
        name=f"ball_{number}",
        type=mujoco.mjtEq.mjEQ_CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=f"rod_{number}",
        name2="platform",
        solref=[-(ball_rad_s**2), -2.0 * ball_damping * ball_rad_s],  # negative: k and b themselves
        solimp=[0.9999, 0.9999, 0.001, 0.5, 2.0],  # R = 1e-4 at any depth; the rest as MuJoCo has it
    )
    ball.data[:3] = 0.0  # the anchor is the rod's end


def _add_lumped_legs(
    platform: mujoco.MjsBody,
    kinematics: Mechanics,
    bodies: list[LegBodies],
    *,
    gravcomp_switch: float = 1e-15,  # MuJoCo 4.0 looks at gravcomp only when some body has a positive one
) -> None:
    """The legs of the tendon model as one body, see `lumped_legs`."""
    legs = lumped_legs(kinematics, bodies)
    inertia = np.diag(legs.inertia).copy()
    axis, excess = int(inertia.argmax()), 2 * inertia.max() - inertia.sum()
    if excess > 0.0:  # no body has such moments alone; what is too much about one axis turns with the platform as well
        inertia[axis] -= excess
        platform.inertia[axis] += excess
    if 2 * platform.inertia.max() > platform.inertia.sum():
        moments = ", ".join(f"{moment:.4g}" for moment in platform.inertia)
        raise HexsimError(
            "no rigid body can represent platform and legs in the tendon model, its moments of inertia would be "
            f"impossible ({moments} kg m2): give load.rod_mass_fraction a share of 0.3 or more, or take full legs "
            "(without --fast)"
        )
    lump = platform.add_body(name="legs_lump", pos=legs.centre)
    lump.mass, lump.ipos, lump.inertia, lump.explicitinertial = legs.mass, [0, 0, 0], inertia, True
    lump.gravcomp = 1.0 - legs.carried / legs.mass  # negative: the platform carries more than moves with it in heave
    platform.gravcomp = gravcomp_switch


def _add_payload_mode(platform: mujoco.MjsBody, mode: PayloadMode, number: int, gravity: np.ndarray) -> None:
    """A mass on a spring and damper along one axis of the platform, in its place when the platform stands level at rest."""
    body = platform.add_body(name=f"payload_mode_{number}", pos=mode.position_m)
    omega = 2 * np.pi * mode.frequency_Hz
    body.add_joint(
        name=f"payload_mode_{number}",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=mode.axis,
        stiffness=mode.mass_kg * omega**2,
        springref=-float(gravity @ mode.axis) / omega**2,
        damping=2 * mode.damping_ratio * omega * mode.mass_kg,
    )
    body.mass, body.ipos, body.explicitinertial = mode.mass_kg, [0, 0, 0], True
    body.inertia = [1e-3 * mode.mass_kg] * 3


def _turn_z_to(direction: np.ndarray) -> np.ndarray:
    """Quaternion that turns the z axis to `direction` (3,) by the shortest way."""
    quat = np.array([1.0 + direction[2], -direction[1], direction[0], 0.0])
    return quat / np.linalg.norm(quat)


def _add_actuators(
    spec: mujoco.MjSpec, resolved: Resolved, layout: np.ndarray, target: str, length_offset: np.ndarray
) -> None:
    """One prismatic actuator a leg on joint or tendon `target`1.., and one for the supply when it has states."""
    resolved.rows[:, P.LENGTH_OFFSET] = length_offset
    transmission = mujoco.mjtTrn.mjTRN_JOINT if target == "slide_" else mujoco.mjtTrn.mjTRN_TENDON
    volts = resolved.machine.of_legs("valve", "voltage_max_V")
    for i, place in enumerate(layout[:, A.PRESSURE]):
        is_leg = i < resolved.machine.n_legs
        actuator = spec.add_actuator(
            name=f"leg_{i + 1}" if is_leg else "supply",
            trntype=transmission,
            target=f"{target}{i + 1 if is_leg else 1}",
            dyntype=mujoco.mjtDyn.mjDYN_USER,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_USER,
            ctrllimited=True,
            ctrlrange=[-volts[i], volts[i]] if is_leg else [0, 1],
        )
        actuator.actdim = int(place - (layout[i - 1, A.PRESSURE] if i else -1))
        gain = np.zeros(10)
        gain[0] = resolved.rows[i, P.AREA_BOTTOM] * 1e6 if is_leg else 0.0  # act is in MPa
        actuator.gainprm = gain
    spec.nuser_actuator = ROW
    spec.nuserdata = 2 * len(layout)  # demand and heat of each leg
