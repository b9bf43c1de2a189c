"""The setpoint signals by name: each is data, a pure function of time, with exact derivatives.

constant, sine, block, triangle, multisine, sweep (`formulas`); constant_acceleration_reversals,
constant_velocity_strokes (`paths`); file (`signal_file`); fmu (`fmu_signal`).
`signal_from_dict({"kind": "sine", "amplitude": 0.05, "frequency_Hz": 0.5})` makes one from a scenario's data,
`signal_to_dict` turns it back. Amplitudes are in m or rad.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from hexsim.declaration import Section, between, section_of, values_of
from hexsim.errors import HexsimError
from hexsim.files.toml_files import validation_sentence
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
    "signal_from_dict",
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
_CHECK = TypeAdapter(SignalTable)


def signal_from_dict(data: Mapping[str, Any], where: str = "signal", *, allow_native: bool = False) -> Signal:
    """A signal from {"kind": ..., its keys ...}; optional "fade_in_s" and "fade_shape" ("linear" or "smooth").

    allow_native: a foreign FMU may run its code.

    Raises HexsimError naming `where`, the key, and what is allowed, for an unknown kind or key, a missing key, or a
    value of the wrong type or size.
    """
    try:
        return signal_from_table(_CHECK.validate_python(data), where, allow_native=allow_native)
    except ValidationError as error:
        raise HexsimError(f"{where}: {validation_sentence(error, SignalTable)}") from None


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
    """The data from which `signal_from_dict` makes the same signal."""
    if isinstance(signal, Faded):
        return signal_to_dict(signal.signal) | {"fade_in_s": signal.duration_s, "fade_shape": signal.shape}
    values = {field.name: getattr(signal, field.name) for field in dataclasses.fields(signal)}  # type: ignore[arg-type]
    return {"kind": signal.kind} | {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}
