"""The setpoint signals by name: each is data, a pure function of time, with exact derivatives.

constant, sine, block, triangle, multisine, sweep (`formulas`); constant_acceleration_reversals,
constant_velocity_strokes (`paths`); file (`signal_file`); fmu (`fmu_signal`).
A scenario's [axes.z] with kind = "sine", amplitude = 0.05, frequency_Hz = 0.5 is one; `signal_to_dict` turns it back into such data.
Amplitudes are in m or rad.
"""

from __future__ import annotations

import dataclasses
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from hexsim.declaration import Section, between, section_of, values_of
from hexsim.errors import HexsimError
from hexsim.setpoints.fmu_signal import FmuSignal
from hexsim.setpoints.formulas import Block, Constant, Multisine, Sine, Sweep, Triangle
from hexsim.setpoints.paths import ConstantAccelerationReversals, ConstantVelocityStrokes
from hexsim.setpoints.signal import Faded, FadeShape, Signal, evaluate, faded
from hexsim.setpoints.signal_file import SampledSignal, read_setpoint_file

__all__ = [
    "SIGNAL_KINDS",
    "Block",
    "Constant",
    "ConstantAccelerationReversals",
    "ConstantVelocityStrokes",
    "FadeShape",
    "Faded",
    "FmuSignal",
    "Multisine",
    "SampledSignal",
    "Signal",
    "SignalTable",
    "Sine",
    "Sweep",
    "Triangle",
    "evaluate",
    "faded",
    "read_setpoint_file",
    "signal_from_table",
    "signal_to_dict",
]

SIGNAL_KINDS: dict[str, type[Any]] = {
    signal.kind: signal
    for signal in (
        Constant,
        Sine,
        Block,
        Triangle,
        Multisine,
        Sweep,
        ConstantAccelerationReversals,
        ConstantVelocityStrokes,
        FmuSignal,
        SampledSignal,
    )
}


FADE: tuple[tuple[str, Any, Any], ...] = (
    ("fade_in_s", Annotated[float, between(0.0, 1e5, "from nothing to full size; 0 = at once [s]")], 0.0),
    ("fade_shape", FadeShape, "linear"),
)
if TYPE_CHECKING:
    SignalTable = Section
else:
    SignalTable = Annotated[
        reduce(or_, (section_of(signal, *FADE) for signal in SIGNAL_KINDS.values())), Field(discriminator="kind")
    ]


def signal_from_table(table: Section, where: str, *, allow_native: bool = False) -> Signal:
    """The signal of a checked table."""
    values = values_of(table)
    duration_s, shape = values.pop("fade_in_s"), values.pop("fade_shape")
    kind = SIGNAL_KINDS[dict(table)["kind"]]
    if kind is FmuSignal:
        values["allow_native"] = allow_native
    try:
        return faded(kind(**values), duration_s, shape)
    except HexsimError as error:
        raise HexsimError(f"{where}: {error}") from None


def signal_to_dict(signal: Signal) -> dict[str, Any]:
    """The data of a scenario's axis from which the same signal is made."""
    if isinstance(signal, Faded):
        return signal_to_dict(signal.signal) | {"fade_in_s": signal.duration_s, "fade_shape": signal.shape}
    values = {field.name: getattr(signal, field.name) for field in dataclasses.fields(signal)}  # type: ignore[arg-type]
    return {"kind": signal.kind} | {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}
