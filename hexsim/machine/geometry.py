"""The kinematics of a declared hexapod."""

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.mechanics.kinematics import HexapodKinematics


def machine_kinematics(machine: Machine) -> HexapodKinematics:
    """Joints, lengths and limits from the [geometry] and [cylinder] tables. Raises HexsimError for a bench."""
    geometry = machine.geometry
    if geometry is None:
        raise HexsimError(f"machine {machine.name} is a bench and has no hexapod geometry: use a hexapod machine")
    return HexapodKinematics.from_geometry(
        base_radius_m=geometry.base_radius_m,
        base_half_angle_deg=geometry.base_half_angle_deg,
        platform_radius_m=geometry.platform_radius_m,
        platform_half_angle_deg=geometry.platform_half_angle_deg,
        neutral_leg_length_m=geometry.neutral_leg_length_m,
        stroke_m=machine.cylinder.stroke_m,
    )
