"""The table [geometry] of a hexapod."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag, model_validator

from hexsim.declaration.section import Section, between
from hexsim.mechanics.kinematics import joints_on_circles

Coordinate = Annotated[float, Field(ge=-100.0, le=100.0)]
Joint = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)]
Joints = tuple[Joint, Joint, Joint, Joint, Joint, Joint]
Offset = Annotated[float, Field(ge=-0.1, le=0.1)]
Offsets = tuple[Offset, Offset, Offset, Offset, Offset, Offset]


class Geometry(Section):
    """What both forms of [geometry] say. Legs 1..6 go from base joint to platform joint of the same place."""

    neutral_leg_length_m: float = between(
        5e-3, 100.0, "joint to joint with the piston at half stroke: mean length of the legs in the neutral pose [m]"
    )
    leg_zero_offsets_m: Offsets = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), strict=False, description="how much longer each leg is than its piston says [m]"
    )

    @model_validator(mode="before")
    @classmethod
    def _joints_are_given_once(cls, data: Any) -> Any:
        given = [[key for key in form.own_keys() if key in data] for form in FORMS] if isinstance(data, dict) else []
        if given and all(given):
            raise ValueError(
                f"{given[1][0]} and {given[0][0]} both say where joints are: give radii and angles of two circles, or "
                "base_joints_m and platform_joints_m"
            )
        return data

    @classmethod
    def own_keys(cls) -> list[str]:
        """Keys that the other form has not."""
        return [key for key in cls.model_fields if key not in Geometry.model_fields]


class JointCircles(Geometry):
    """Joints in pairs on two circles; legs 1..6 in pairs at base angles 0, 120, 240 deg."""

    base_radius_m: float = between(1e-3, 100.0, "circle of the base joints [m]")
    base_half_angle_deg: float = Field(
        ge=0.01, lt=60.0, description="half the angle between the joints of a pair [deg]"
    )
    platform_radius_m: float = between(1e-3, 100.0, "circle of the platform joints [m]")
    platform_half_angle_deg: float = Field(ge=0.01, lt=60.0, description="half the angle between a pair's joints [deg]")

    @property
    def joints(self) -> tuple[Any, Any]:
        """Base and platform joints (6, 3) [m]."""
        return joints_on_circles(
            self.base_radius_m, self.base_half_angle_deg, self.platform_radius_m, self.platform_half_angle_deg
        )


class JointTables(Geometry):
    """Each joint where it was measured, in the frames of base and platform: z up, x forward, origins of the maker's choice."""

    base_joints_m: Joints = Field(strict=False, description="[x, y, z] of legs 1..6 in the base's frame [m]")
    platform_joints_m: Joints = Field(strict=False, description="[x, y, z] of legs 1..6 in the platform's frame [m]")

    @property
    def joints(self) -> tuple[Any, Any]:
        """Base and platform joints (6, 3) [m]."""
        return self.base_joints_m, self.platform_joints_m


FORMS = (JointCircles, JointTables)


def _form(given: Any) -> str:
    """Name of the form that a table has."""
    if isinstance(given, Geometry):
        return type(given).__name__
    is_table = isinstance(given, dict) and any(key in given for key in JointTables.own_keys())
    return (JointTables if is_table else JointCircles).__name__


AnyGeometry = Annotated[
    Annotated[JointCircles, Tag("JointCircles")] | Annotated[JointTables, Tag("JointTables")], Discriminator(_form)
]
