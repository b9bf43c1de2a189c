"""The table [valve] of a leg."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from hexsim.declaration.section import Section, between, zero_or

Gain = Annotated[float, Field(ge=0.0, le=100.0)]
Length = Annotated[float, Field(ge=-0.1, le=0.1)]
FourEdges = tuple[float, float, float, float]
EDGES = ("PA", "AT", "PB", "BT")


class Valve(Section):
    """Proportional or servo valve, three-way (Eq. 3.2-3.4 and 3.11) or four-way with the edges P-A, A-T, P-B, B-T.

    The size of the edges is spool diameter and discharge coefficient, or what a data sheet says: the flow through one
    edge at full signal and at the rated pressure drop across that edge.
    """

    kind: Literal["three_way", "four_way"] = Field("three_way", description="ports: P, A, T, or P, A, B, T")
    flow_area: Literal["overlap", "quadratic"] = Field("overlap", description="law of the opening, Eq. 3.3 or 3.11")
    voltage_max_V: float = between(1e-2, 1e3, "command at full spool travel [V]")
    spool_travel_max_m: float = between(1e-5, 0.1, "full spool travel [m]")
    spool_diameter_m: float | None = between(1e-4, 0.5, "spool diameter [m]", default=None)
    rated_flow_m3_s: float | None = between(
        1e-9, 1.0, "through one edge at full signal and rated pressure drop [m3/s]", default=None
    )
    rated_pressure_drop_Pa: float | None = between(1e3, 1e8, "across that edge [Pa]", default=None)
    overlap_m: float | None = Field(
        None, description="overlap of all edges, shorter than the travel; negative: underlap [m]"
    )
    overlap_edges_m: tuple[Length, Length, Length, Length] | None = Field(
        None, strict=False, description="overlaps of the edges P-A, A-T, P-B, B-T in place of overlap_m [m]"
    )
    edge_gains: tuple[Gain, Gain, Gain, Gain] = Field(
        (1.0, 1.0, 1.0, 1.0), strict=False, description="openings P-A, A-T, P-B, B-T over the declared one; 1: matched"
    )
    edge_rounding_m: float = zero_or(1e-9, 1e-2, "rounding of the metering edges; 0 = sharp (report) [m]")
    discharge_coefficient: float = between(
        0.05, 1.0, "discharge coefficient; of no effect where the rated flow is given [-]", default=0.611
    )
    quadratic_gain: float = between(1e-3, 1e7, "gain of a(x) = gain x^2, Eq. 3.11 [-]", default=300.0)
    pressure_width_Pa: float = between(1.0, 1e7, "sqrt(dp) is smooth within this of dp = 0 [Pa]", default=1.0e4)
    spool_frequency_Hz: float = zero_or(0.1, 1e4, "bandwidth of the spool; 0 = it follows at once (report) [Hz]")
    spool_damping: float = between(0.01, 100.0, "damping ratio of the spool [-]", default=0.7)

    @property
    def overlaps_m(self) -> FourEdges:
        """Overlaps of the edges P-A, A-T, P-B, B-T [m]; a three-way valve has the first two."""
        if self.overlap_edges_m is not None:
            return self.overlap_edges_m
        overlap = self.overlap_m or 0.0
        return (overlap, overlap, overlap, overlap)

    def area_gradients_m(self, density_kg_m3: float) -> FourEdges:
        """Area over opening of the edges P-A, A-T, P-B, B-T [m].

        pi d, Eq. 3.3; or of the rated flow, Q_r = C_d g (x_max - O) sqrt(2 dp_r/rho): the opening at full signal is the
        travel less the overlap. Times the edge's gain.
        """
        if self.rated_flow_m3_s is None or self.rated_pressure_drop_Pa is None:
            around = math.pi * (self.spool_diameter_m or 0.0)
            gradients = [around] * 4
        else:
            speed = self.discharge_coefficient * math.sqrt(2.0 * self.rated_pressure_drop_Pa / density_kg_m3)
            gradients = [self.rated_flow_m3_s / (speed * (self.spool_travel_max_m - o)) for o in self.overlaps_m]
        pa, at, pb, bt = (g * gain for g, gain in zip(gradients, self.edge_gains, strict=True))
        return pa, at, pb, bt

    @model_validator(mode="after")
    def _size_is_given_once(self) -> Valve:
        rated = (self.rated_flow_m3_s, self.rated_pressure_drop_Pa)
        if (self.spool_diameter_m is None) == (rated == (None, None)) or rated.count(None) == 1:
            raise ValueError(
                "give spool_diameter_m, or rated_flow_m3_s and rated_pressure_drop_Pa, and not both: they say the same"
            )
        if self.spool_diameter_m is None and self.flow_area == "quadratic":
            raise ValueError('flow_area = "quadratic" has its own gain: give spool_diameter_m in place of a rated flow')
        return self

    @model_validator(mode="after")
    def _overlap_within_travel(self) -> Valve:
        if (self.overlap_m is None) == (self.overlap_edges_m is None):
            raise ValueError("give overlap_m, or overlap_edges_m = [PA, AT, PB, BT], and not both")
        for name, overlap in zip(EDGES, self.overlaps_m, strict=True):
            if abs(overlap) >= self.spool_travel_max_m:
                key = "overlap_m" if self.overlap_edges_m is None else f"overlap_edges_m of {name}"
                raise ValueError(
                    f"{key} = {overlap:g} must be smaller than spool_travel_max_m = {self.spool_travel_max_m:g}"
                )
        return self
