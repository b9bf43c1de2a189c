"""Errors of transducers, a channel and an error each: y_m = (1 + r) y(t - tau) + y_0, or a lag.

A controller that reads it has them too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from hexsim.hydraulics.effects.effect import Effect, EffectParameter
from hexsim.hydraulics.resolved import Resolved

Error = Literal["gain", "offset", "delay", "lag"]
SHOWS = {
    "gain": "shows too much or too little",
    "offset": "shows a constant too much",
    "delay": "is late",
    "lag": "smooths: a low-pass of first order",
}


@dataclass(frozen=True, kw_only=True)
class Channel:
    """A channel of [sensors]. key: its keys there begin with it; unit: of its offset; per_leg: one transducer a leg."""

    name: str
    key: str
    words: str
    unit: str
    per_leg: bool = True


POSITION = Channel(name="position", key="position", words="the position transducer", unit="m")
PRESSURE = Channel(name="pressure", key="pressure", words="the chamber pressure transducer", unit="Pa")
SUPPLY = Channel(
    name="supply_pressure", key="supply_pressure", words="the supply pressure transducer", unit="Pa", per_leg=False
)
ACCELERATION = Channel(name="accelerometer", key="acceleration", words="the accelerometer", unit="m/s2", per_leg=False)


def change(key: str, scale: bool, per_leg: bool) -> Callable[[Resolved, tuple[int, ...], dict[str, float]], None]:
    """What an error does to a key of [sensors]: scale it by 1 + the number, or add the number."""

    def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
        [value] = values.values()
        if per_leg:
            own, at = resolved.leg_sensors[key], list(legs)
            own[at] = own[at] * (1.0 + value) if scale else own[at] + value
            return
        old = getattr(resolved.sensors, key)
        resolved.sensors = resolved.sensors.model_copy(update={key: old * (1.0 + value) if scale else old + value})

    return apply


def error_of(
    channel: Channel,
    error: Error,
    typical: float,
    source: str,
    bounds: tuple[float, float],
    places: Literal["leg", "one leg"] = "leg",
    kinds: tuple[str, ...] = ("bench", "hexapod"),
) -> Effect:
    """The effect of one error of one channel. typical, bounds: of the number, in its unit."""
    per_unit = f"_{channel.unit.replace('/', '_')}"
    number, unit, key = {
        "gain": ("relative_change", "1", "gain"),
        "offset": (f"offset{per_unit}", channel.unit, f"offset{per_unit}"),
        "delay": ("delay_s", "s", "delay_s"),
        "lag": ("time_constant_s", "s", "lag_s"),
    }[error]
    return Effect(
        name=f"{channel.name}_{error}",
        balance="sensor",
        description=f"{channel.words} {SHOWS[error]}",
        source=source,
        parameters=(EffectParameter(name=number, unit=unit, bounds=bounds, typical=typical),),
        apply=change(f"{channel.key}_{key}", error == "gain", channel.per_leg),
        places=places if channel.per_leg else "machine",
        kinds=kinds,
    )


BUSES, TRANSDUCERS = "filters and buses: 1-400 ms", "transducers: 0.5-2 % of span"
FILTERS = "filters of transducers: 20-100 Hz"
LATE, SMOOTHED = (0.0, 1.0), (0.0, 0.1)  # [s] bounds of a delay and of a low-pass
SCALE = (-0.9, 9.0)  # bounds of a gain's error: a transducer shows something, and not ten times as much
EFFECTS = (
    error_of(
        ACCELERATION, "gain", 0.04, "report 2.3.1: dividing and multiplying by a sensitivity confused", (-0.95, 9.0)
    ),
    error_of(ACCELERATION, "offset", 0.05, "zero drift of accelerometers: 0.01-0.1 g", (-100.0, 100.0)),
    error_of(ACCELERATION, "delay", 3e-3, BUSES, LATE),
    error_of(POSITION, "gain", 0.01, "scale error of transducers: 0.1-1 %", SCALE),
    error_of(POSITION, "offset", 1e-3, "zero of transducers: 0.1-2 mm", (-0.2, 0.2), "one leg", ("hexapod",)),
    error_of(POSITION, "delay", 3e-3, "filters and buses: 1-10 ms", LATE),
    error_of(POSITION, "lag", 4e-3, FILTERS, SMOOTHED),
    error_of(PRESSURE, "gain", 0.02, TRANSDUCERS, SCALE),
    error_of(PRESSURE, "offset", 5e4, f"zero drift of {TRANSDUCERS}", (-1e8, 1e8)),
    error_of(PRESSURE, "delay", 3e-3, BUSES, LATE),
    error_of(PRESSURE, "lag", 4e-3, FILTERS, SMOOTHED),
    error_of(SUPPLY, "gain", 0.02, TRANSDUCERS, SCALE),
)
