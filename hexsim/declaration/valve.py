"""The table [valve] of a leg."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from hexsim.declaration.section import Section, between, zero_or

Gain = Annotated[float, Field(ge=0.0, le=100.0)]
Length = Annotated[float, Field(ge=-0.1, le=0.1)]
Rounding = Annotated[float, Field(ge=0.0, le=1e-2)]
FourEdges = tuple[float, float, float, float]
FLOW_POINTS = 24  # of a flow curve with both signs
EDGES = ("PA", "AT", "PB", "BT")
LARGE_SIGNAL = 8 / math.pi**2 * math.sqrt(2) / 4  # a slewing spool is a triangle; its first harmonic is down by 3 dB


class FlowCurve(Section):
    """Flow over signal as a valve's sheet draws it, at the rated pressure drop; linear between its points.

    It holds the lap and the bends of the openings. Points of one sign are mirrored.
    """

    signal: tuple[float, ...] = Field(min_length=2, strict=False, description="rising")
    flow: tuple[float, ...] = Field(min_length=2, strict=False, description="rising or level")
    signal_unit: str = Field("%", description="% or 1 of full signal, or V")
    flow_unit: str = Field("l_min", description="of a flow, or % or 1 of the rated flow")

    @model_validator(mode="after")
    def _rises(self) -> FlowCurve:
        steps = [[b - a for a, b in pairwise(values)] for values in (self.signal, self.flow)]
        if len(self.signal) != len(self.flow) or min(steps[0]) <= 0 or min(steps[1]) < 0:
            raise ValueError("signal must rise, flow must not fall, and both must have as many points")
        if self.signal[0] >= 0 and (self.signal[0] > 0 or self.flow[0] != 0):
            raise ValueError("a curve of one sign begins at signal 0 with flow 0; else give both signs")
        if len(self.signal) > FLOW_POINTS // (2 if self.signal[0] >= 0 else 1):
            raise ValueError(f"a curve has at most {FLOW_POINTS} points of both signs, {FLOW_POINTS // 2} of one")
        return self


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
    overlap_percent: float | None = between(
        -99.0, 99.0, "overlap of all edges in place of overlap_m [% of full travel]", default=None
    )
    overlap_edges_m: tuple[Length, Length, Length, Length] | None = Field(
        None, strict=False, description="overlaps of the edges P-A, A-T, P-B, B-T in place of overlap_m [m]"
    )
    edge_gains: tuple[Gain, Gain, Gain, Gain] = Field(
        (1.0, 1.0, 1.0, 1.0), strict=False, description="openings P-A, A-T, P-B, B-T over the declared one; 1: matched"
    )
    edge_rounding_m: float = zero_or(1e-9, 1e-2, "rounding of the metering edges; 0 = sharp (report) [m]")
    edge_roundings_m: tuple[Rounding, Rounding, Rounding, Rounding] | None = Field(
        None, strict=False, description="roundings of the edges P-A, A-T, P-B, B-T in place of edge_rounding_m [m]"
    )
    discharge_coefficient: float = between(
        0.05, 1.0, "discharge coefficient; of no effect where the rated flow is given [-]", default=0.611
    )
    quadratic_gain: float = between(1e-3, 1e7, "gain of a(x) = gain x^2, Eq. 3.11 [-]", default=300.0)
    pressure_width_Pa: float = between(1.0, 1e7, "sqrt(dp) is smooth within this of dp = 0 [Pa]", default=1.0e4)
    laminar_reynolds: float = zero_or(
        0.1, 1000.0, "an edge is laminar below this Reynolds number, 15 of a sharp slot; 0: at no opening (report) [-]"
    )
    flow_at_10_percent_m3_s: float | None = between(
        1e-12,
        1.0,
        "through one edge at 10 % signal and rated pressure drop; in place of laminar_reynolds [m3/s]",
        default=None,
    )
    sheet_viscosity_mm2_s: float = between(
        1.0,
        5000.0,
        "of the oil with which the sheet's flows were measured; ISO 10770: VG 32 at 40 degC [mm2/s]",
        default=32.0,
    )
    spool_frequency_Hz: float = zero_or(0.1, 1e4, "bandwidth of the spool; 0 = it follows at once (report) [Hz]")
    spool_damping: float = between(0.01, 100.0, "damping ratio of the spool [-]", default=0.7)
    flow_curve: FlowCurve | None = Field(None, description="flow over signal in place of the lap")
    hysteresis_percent: float = between(0.0, 50.0, "width of the flow curve's loop [% of full signal]", default=0.0)
    threshold_percent: float | None = between(
        0.0,
        50.0,
        "reversal of the signal that moves the flow; not given: the hysteresis [% of full signal]",
        default=None,
    )
    null_shift_percent: float = between(-50.0, 50.0, "signal at which no flow passes [% of full signal]", default=0.0)
    small_signal_minus_90deg_Hz: float | None = between(
        0.1, 1e4, "90 deg behind at small amplitude; in place of spool_frequency_Hz [Hz]", default=None
    )
    small_signal_minus_3dB_Hz: float | None = between(
        0.1, 1e4, "down by 3 dB at small amplitude; in place of spool_damping [Hz]", default=None
    )
    large_signal_minus_3dB_Hz: float | None = between(
        0.1, 1e4, "down by 3 dB at large_signal_percent, where the spool slews [Hz]", default=None
    )
    large_signal_percent: float = between(1.0, 100.0, "amplitude of the large signal [% of full signal]", default=100.0)
    slew_time_s: float | None = between(
        1e-5, 100.0, "from 0 to full travel at the greatest speed; in place of the large signal [s]", default=None
    )

    @property
    def overlaps_m(self) -> FourEdges:
        """Overlaps of the edges P-A, A-T, P-B, B-T [m]; a three-way valve has the first two."""
        if self.overlap_edges_m is not None:
            return self.overlap_edges_m
        overlap = self.overlap_m or (self.overlap_percent or 0.0) / 100 * self.spool_travel_max_m
        return (overlap, overlap, overlap, overlap)

    @property
    def roundings_m(self) -> FourEdges:
        """Roundings of the edges P-A, A-T, P-B, B-T [m]; a three-way valve has the first two."""
        size = self.edge_rounding_m
        return self.edge_roundings_m or (size, size, size, size)

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

    def reynolds(self, density_kg_m3: float) -> float:
        """Reynolds number below which an edge is laminar (0: at no opening), declared or of the flow at 10 % signal.

        A flow of r times the root law's at the opening o and the rated drop: p_cr = dp_r sqrt(1 - r^4)/r^2 (`valve`).
        """
        opening, share = self._small_opening()
        if share is None:
            return self.laminar_reynolds
        transition = self.rated_pressure_drop_Pa * math.sqrt(1.0 - share**4) / share**2  # type: ignore[operator]
        speed = math.sqrt(2.0 * transition / density_kg_m3)
        return 2.0 * self.discharge_coefficient * opening * speed / (1e-6 * self.sheet_viscosity_mm2_s)

    def _small_opening(self) -> tuple[float, float | None]:
        """Opening at 10 % signal [m], and the sheet's flow there over that of the root law; None: the sheet has none."""
        opening = 0.1 * self.spool_travel_max_m - self.overlaps_m[0]
        if self.flow_at_10_percent_m3_s is None or self.rated_flow_m3_s is None:
            return opening, None
        turbulent = self.rated_flow_m3_s * opening / (self.spool_travel_max_m - self.overlaps_m[0])
        return opening, self.flow_at_10_percent_m3_s / turbulent if turbulent > 0.0 else math.inf

    @model_validator(mode="after")
    def _flow_at_10_percent_is_laminar(self) -> Valve:
        if self.flow_at_10_percent_m3_s is None:
            return self
        if self.laminar_reynolds > 0 or self.rated_flow_m3_s is None or self.flow_curve is not None:
            raise ValueError(
                "flow_at_10_percent_m3_s stands in place of laminar_reynolds and needs rated_flow_m3_s, "
                "rated_pressure_drop_Pa and an overlap"
            )
        opening, share = self._small_opening()
        if not 0 < (share or 0) < 1:
            raise ValueError(
                f"flow_at_10_percent_m3_s = {self.flow_at_10_percent_m3_s:g} must be below what the rated flow and the overlap "
                f"give at an opening of {1e6 * opening:.3g} um: else the edge is not laminar there; leave it out"
            )
        return self

    @property
    def spool(self) -> tuple[float, float, float]:
        """Natural frequency [rad/s] and damping ratio of the spool, and its greatest speed [m/s], 0 = no limit.

        A second-order spool is 90 deg behind at its natural frequency; at r times it, |H| = -3 dB needs
        4 zeta^2 r^2 = 2 - (1 - r^2)^2. At the greatest speed s a sine of amplitude a and frequency f comes out as a
        triangle of height s/(4 f), whose first harmonic is 8/pi^2 of that: -3 dB gives s = a f/0.2866.
        """
        frequency, damping, speed = self.spool_frequency_Hz, self.spool_damping, 0.0
        if self.small_signal_minus_90deg_Hz is not None:
            frequency = self.small_signal_minus_90deg_Hz
        if self.small_signal_minus_3dB_Hz is not None:
            r = self.small_signal_minus_3dB_Hz / frequency
            damping = math.sqrt(2.0 - (1.0 - r * r) ** 2) / (2.0 * r)
        if self.slew_time_s is not None:
            speed = self.spool_travel_max_m / self.slew_time_s
        elif self.large_signal_minus_3dB_Hz is not None:
            amplitude = self.large_signal_percent / 100 * self.spool_travel_max_m
            speed = amplitude * self.large_signal_minus_3dB_Hz / LARGE_SIGNAL
        return 2 * math.pi * frequency, damping, speed

    @model_validator(mode="after")
    def _dynamics_are_given_once(self) -> Valve:
        small = (self.small_signal_minus_90deg_Hz, self.small_signal_minus_3dB_Hz)
        if small[0] is not None and self.spool_frequency_Hz > 0:
            raise ValueError("give spool_frequency_Hz or small_signal_minus_90deg_Hz, and not both: they say the same")
        frequency = small[0] or self.spool_frequency_Hz
        if small[1] is not None and not (0 < small[1] < 1.55 * frequency):
            raise ValueError(
                f"small_signal_minus_3dB_Hz = {small[1]:g} must be below 1.55 times the frequency at -90 deg, "
                f"{frequency:g}: no second-order spool does more"
            )
        if self.large_signal_minus_3dB_Hz is not None and self.slew_time_s is not None:
            raise ValueError("give large_signal_minus_3dB_Hz or slew_time_s, and not both: they say the same")
        if (self.large_signal_minus_3dB_Hz or self.slew_time_s) and frequency <= 0:
            raise ValueError("a spool that slews needs spool_frequency_Hz or small_signal_minus_90deg_Hz")
        return self

    @property
    def threshold(self) -> float:
        """Reversal of the signal that moves the flow [% of full signal]."""
        return self.hysteresis_percent if self.threshold_percent is None else self.threshold_percent

    @model_validator(mode="after")
    def _threshold_within_hysteresis(self) -> Valve:
        if self.threshold > self.hysteresis_percent:
            raise ValueError(
                f"threshold_percent = {self.threshold:g} must not exceed hysteresis_percent = {self.hysteresis_percent:g}: "
                "a full cycle's loop holds the reversal"
            )
        return self

    @model_validator(mode="after")
    def _flow_curve_has_a_size(self) -> Valve:
        if self.flow_curve is not None and (self.rated_flow_m3_s is None or any(self.overlaps_m)):
            raise ValueError(
                "flow_curve needs rated_flow_m3_s and rated_pressure_drop_Pa, and no overlap: it holds the lap itself"
            )
        return self

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
        if self.edge_roundings_m is not None and self.edge_rounding_m > 0:
            raise ValueError(
                "give edge_rounding_m or edge_roundings_m = [PA, AT, PB, BT], and not both: they say the same"
            )
        given = [v is not None for v in (self.overlap_m, self.overlap_percent, self.overlap_edges_m)]
        if sum(given) != 1 and not (self.flow_curve is not None and not any(given)):
            raise ValueError(
                "give overlap_m, or overlap_percent, or overlap_edges_m = [PA, AT, PB, BT], and not two of them"
            )
        for name, overlap in zip(EDGES, self.overlaps_m, strict=True):
            if abs(overlap) >= self.spool_travel_max_m:
                key = "overlap_m" if self.overlap_edges_m is None else f"overlap_edges_m of {name}"
                raise ValueError(
                    f"{key} = {overlap:g} must be smaller than spool_travel_max_m = {self.spool_travel_max_m:g}"
                )
        return self
