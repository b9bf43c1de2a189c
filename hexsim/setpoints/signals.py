"""The setpoint signals by name: each is data, a pure function of time, with exact derivatives.

constant, sine, block, triangle, multisine, sweep (`signal_formulas`); constant_acceleration_reversals,
constant_velocity_strokes (`signal_paths`); file (`signal_file`).
`signal_from_dict({"kind": "sine", "amplitude": 0.05, "frequency_Hz": 0.5})` makes one from a scenario's data,
`signal_to_dict` turns it back. Amplitudes are in m or rad.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
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
    "Multisine",
    "SampledSignal",
    "Signal",
    "Sine",
    "Sweep",
    "Triangle",
    "evaluate",
    "faded",
    "read_setpoint_file",
    "signal_from_dict",
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
        SampledSignal,
    )
}


def signal_from_dict(data: Mapping[str, Any], where: str = "signal") -> Signal:
    """A signal from {"kind": ..., its keys ...}; optional "fade_in_s" and "fade_shape" ("linear" or "smooth").

    Raises HexsimError naming `where`, the key, and what is allowed, for an unknown kind or key, a missing key, or a
    value of the wrong type or size.
    """
    keys = dict(data)
    kind = keys.pop("kind", None)
    if kind not in SIGNAL_KINDS:
        raise HexsimError(f"{where}: kind is {kind!r}; allowed are {', '.join(SIGNAL_KINDS)}.")
    fade_in_s, fade_shape = keys.pop("fade_in_s", 0.0), keys.pop("fade_shape", "linear")
    fields = {field.name: field for field in dataclasses.fields(SIGNAL_KINDS[kind])}
    for key in keys:
        if key not in fields:
            raise HexsimError(
                f"{where}: unknown key {key!r} for signal '{kind}'; allowed are "
                f"{', '.join([*fields, 'fade_in_s', 'fade_shape'])}."
            )
    for name, field in fields.items():
        if name not in keys and field.default is dataclasses.MISSING:
            raise HexsimError(f"{where}: signal '{kind}' needs the key {name!r}.")
    arguments = {name: _converted(value, str(fields[name].type), f"{where}: {name}") for name, value in keys.items()}
    try:
        signal = SIGNAL_KINDS[kind](**arguments)
        return faded(signal, _converted(fade_in_s, "float", f"{where}: fade_in_s"), fade_shape)
    except HexsimError as error:
        raise HexsimError(f"{where}: {error}") from None


def signal_to_dict(signal: Signal) -> dict[str, Any]:
    """The data from which `signal_from_dict` makes the same signal."""
    if isinstance(signal, Faded):
        return signal_to_dict(signal.signal) | {"fade_in_s": signal.duration_s, "fade_shape": signal.shape}
    values = {field.name: getattr(signal, field.name) for field in dataclasses.fields(signal)}  # type: ignore[arg-type]
    return {"kind": signal.kind} | {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}


def _converted(value: Any, annotation: str, where: str) -> Any:
    """A plain value as the field's type; HexsimError if it is of another type."""

    def number(item: Any) -> float:
        if isinstance(item, bool) or not isinstance(item, (int, float, np.integer, np.floating)):
            raise HexsimError(f"{where} is {item!r}; give a number.")
        return float(item)

    if annotation == "float":
        return number(value)
    if annotation == "int":
        if not number(value).is_integer():
            raise HexsimError(f"{where} is {value!r}; give a whole number.")
        return int(value)
    if annotation.startswith("tuple"):
        if not isinstance(value, (list, tuple)):
            raise HexsimError(f"{where} is {value!r}; give a list of numbers.")
        return tuple(number(item) for item in value)
    if not isinstance(value, str):
        raise HexsimError(f"{where} is {value!r}; give a text.")
    return value
