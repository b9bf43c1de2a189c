"""The table [load]."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from hexsim.declaration.section import Name, Section, between, zero_or

Moment = Annotated[float, Field(le=1e9)]
OwnMoment = Annotated[float, Field(ge=0.0, le=1e9)]
Offset = Annotated[float, Field(ge=-50.0, le=50.0)]


class Load(Section):
    """What the legs carry. A bench has `moving_mass_kg`, a hexapod the platform's mass and inertia."""

    moving_mass_kg: float | None = between(1e-4, 1e7, "bench: mass on the rod [kg]", default=None)
    platform_mass_kg: float | None = between(1e-2, 1e7, "hexapod: platform with what stands on it [kg]", default=None)
    leg_mass_kg: float = zero_or(1e-4, 1e6, "cylinder and rod together; 0 = counted with the platform [kg]")
    additional_mass_kg: float | None = between(
        1e-3, 1e6, "what people can put on besides, at the centre of mass, for a measurement [kg]", default=None
    )
    rod_mass_fraction: float = between(0.01, 0.99, "share of the leg's mass that moves with the rod [-]", default=0.35)
    platform_inertia_kg_m2: tuple[Moment, Moment, Moment] | None = Field(
        default=None, strict=False, description="hexapod: moments about x, y, z through the centre of mass [kg m2]"
    )
    centre_of_mass_m: tuple[Offset, Offset, Offset] = Field(
        default=(0.0, 0.0, 0.0),
        strict=False,
        description="hexapod: from the origin of the platform's frame [m]",
    )

    @property
    def mass_key(self) -> str:
        """The entry that holds what is carried."""
        return "platform_mass_kg" if self.moving_mass_kg is None else "moving_mass_kg"

    @property
    def carried_mass_kg(self) -> float:
        """Mass on the rod, or the platform with what stands on it [kg]; 0 where none is declared."""
        return getattr(self, self.mass_key) or 0.0

    @field_validator("platform_inertia_kg_m2")
    @classmethod
    def _inertia_is_physical(cls, value: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
        """The smallest moment is that of a micro stage, 0.01 kg within 10 mm."""
        if value is not None and (min(value) < 1e-6 or 2 * max(value) > sum(value) * (1 + 1e-9)):
            raise ValueError(
                "must be three positive moments from 1e-6 to 1e9, none larger than the sum of the other two"
            )
        return value


class Payload(Section):
    """A body that is bolted to a hexapod's platform: a cabin, a seat with its driver, ballast."""

    name: Name = Field("payload", description="as people call it")
    mass_kg: float = between(1e-3, 1e6, "its mass [kg]")
    position_m: tuple[Offset, Offset, Offset] = Field(
        strict=False, description="its centre of mass from the origin of the platform's frame [m]"
    )
    inertia_kg_m2: tuple[OwnMoment, OwnMoment, OwnMoment] = Field(
        (0.0, 0.0, 0.0), strict=False, description="moments about x, y, z through its own centre; 0: a point [kg m2]"
    )

    @field_validator("inertia_kg_m2")
    @classmethod
    def _inertia_is_physical(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if 2 * max(value) > sum(value) * (1 + 1e-9):
            raise ValueError("must be three moments, none larger than the sum of the other two")
        return value
