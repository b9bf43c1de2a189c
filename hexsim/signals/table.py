"""The table of all signals: columns, checks, figures, recordings, noise and reports read it."""

from __future__ import annotations

import re
from functools import cache

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.files.plugins import found_parts
from hexsim.signals import sensors as sensor_files
from hexsim.signals.sensor import Sensor
from hexsim.signals.signal import HEXAPOD_AXES, ROTATIONS, TRANSLATIONS, Scope, Signal

# Sensors that every machine has: they draw their noise from one stream of random numbers in this order, and a fit
# compares what they measure with the model.
STANDARD = ("position", "pressure_bottom", "pressure_supply", "acceleration", "angular_acceleration")

SETPOINT = Signal(stem="setpoint", unit="m", label="setpoint", measured=True, held=True)
VALVE = Signal(stem="valve", unit="V", label="valve voltage", measured=True, held=True)


def _truth(scope: Scope, **named: tuple[str, str]) -> tuple[Signal, ...]:
    return tuple(Signal(stem=stem, unit=unit, label=label, scope=scope) for stem, (unit, label) in named.items())


# What only a simulation knows.
TRUTH = (
    *_truth(
        "leg",
        true_position=("m", "position"),
        velocity=("m_s", "velocity"),
        true_pressure_bottom=("Pa", "chamber pressure"),
        true_pressure_top=("Pa", "rod side pressure"),
        spool=("m", "spool position"),
        flow=("m3_s", "flow"),
        friction=("N", "friction"),
        leg_force=("N", "leg force"),
        compensation=("V", "compensation"),
    ),
    *_truth(
        "translation",
        true_acceleration=("m_s2", "acceleration"),
        commanded_velocity=("m_s", "commanded velocity"),
        commanded_acceleration=("m_s2", "commanded acceleration"),
    ),
    *_truth(
        "rotation",
        true_angular_acceleration=("rad_s2", "angular acceleration"),
        commanded_angular_velocity=("rad_s", "commanded angular velocity"),
        commanded_angular_acceleration=("rad_s2", "commanded angular acceleration"),
    ),
    *_truth("pose", platform=("", "platform"), commanded=("", "commanded")),
    *_truth(
        "machine",
        true_pressure_supply=("Pa", "supply pressure"),
        motor_speed=("", "motor speed over its rated speed"),
        pump_flow=("m3_s", "flow of the pump"),
        line_flow=("m3_s", "flow in the supply line"),
        pump_pressure=("Pa", "pressure at the pump"),
        oil_temperature=("degC", "oil temperature"),
        relief_flow=("m3_s", "flow of the relief valve"),
        accumulator_oil=("m3", "oil in the accumulator"),
        accumulator_energy=("J", "energy in the accumulator"),
        supply_demand=("m3_s", "flow that the legs take"),
        motor_power=("W", "motor power"),
        heat=("W", "heat into the oil"),
        platform_power=("W", "power to the platform"),
    ),
)


@cache
def sensors() -> dict[str, Sensor]:
    """All sensors by stem: the standard ones in their order, then those that were added, by name."""
    found = {one.signal.stem: one for one in found_parts(sensor_files, "SENSOR", "hexsim.sensors").values()}
    return {stem: found[stem] for stem in (*STANDARD, *sorted(set(found) - set(STANDARD)))}


@cache
def table() -> dict[str, Signal]:
    """All signals by stem, measured ones first."""
    measured = [SETPOINT, VALVE, *(sensor.signal for sensor in sensors().values())]
    known = {signal.stem: signal for signal in TRUTH}
    for signal in measured:
        if known.setdefault(signal.stem, signal) is not signal:
            raise HexsimError(f"two signals are called {signal.stem}: name the sensor's signal otherwise")
    return {signal.stem: signal for signal in (*measured, *TRUTH)}


@cache
def measured_columns(n_legs: int) -> tuple[str, ...]:
    """Columns of a measured log of such a machine that standard sensors and the motion computer write."""
    standard = ("setpoint", "position", "valve", *STANDARD[1:])
    return tuple(name for stem in standard for name in table()[stem].columns(n_legs))


def accelerations_of(n_legs: int) -> tuple[str, ...]:
    """Columns of the accelerometers."""
    return tuple(n for stem in ("acceleration", "angular_acceleration") for n in table()[stem].columns(n_legs))


def point_signal(point: str) -> Signal:
    """Acceleration at a point that a machine declares under [points], along the platform's axes."""
    return Signal(stem=f"acceleration_at_{point}", unit="m_s2", label=f"acceleration at {point}", scope="translation")


class Places(dict[str, tuple[Signal, int]]):
    """Column -> its signal and its place among the legs or axes. Asked for one, it knows those of any point too."""

    def __missing__(self, column: str) -> tuple[Signal, int]:
        match = re.fullmatch(r"acceleration_at_(.+)_([xyz])_m_s2", column)
        if match is None:
            raise KeyError(column)
        return point_signal(match[1]), TRANSLATIONS.index(match[2])


@cache
def places() -> Places:
    """Of benches and hexapods."""
    return Places(
        {
            name: (signal, place)
            for signal in table().values()
            for n_legs in (1, 6)
            for place, name in enumerate(signal.columns(n_legs))
        }
    )


def kind_of(column: str) -> str:
    """position_3_m -> position_m: stem and unit. Raises KeyError for a column of no signal."""
    return places()[column][0].kind


def label_of(column: str) -> str:
    """pressure_bottom_3_Pa -> chamber pressure of leg 3; acceleration_x_m_s2 -> acceleration x."""
    signal, place = places()[column]
    if column == signal.kind:
        return signal.label
    return f"{signal.label} of leg {place + 1}" if signal.scope == "leg" else f"{signal.label} {HEXAPOD_AXES[place]}"


def motion_column(stem: str, axis: str) -> str:
    """A velocity or acceleration along or about an axis x .. yaw, or along the "leg" of a bench.

    ("true_acceleration", "roll") -> true_angular_acceleration_x_rad_s2.
    """
    if axis in ROTATIONS:
        head, what = stem[: stem.rfind("_") + 1], stem[stem.rfind("_") + 1 :]
        return table()[f"{head}angular_{what}"].column(TRANSLATIONS[ROTATIONS.index(axis)])
    return table()[stem].column("" if axis == "leg" else axis)


def pose_column(stem: str, axis: str) -> str:
    """A coordinate of the platform: ("platform", "roll") -> platform_roll_rad."""
    return table()[stem].columns(6)[HEXAPOD_AXES.index(axis)]


def check_extra_sensors(machine: Machine, source: str) -> None:
    """Raise HexsimError where [extra_sensors] names an unknown sensor, an unknown key or an impossible value."""
    for stem, given in machine.extra_sensors.items():
        place = f"{source}: [extra_sensors.{stem}]"
        if stem not in sensors() or stem in STANDARD:
            known = ", ".join(name for name in sensors() if name not in STANDARD) or "none"
            raise HexsimError(f"{place}: unknown sensor {stem!r}; known beside the standard ones: {known}")
        keys = sensors()[stem].extra_keys
        for key, value in given.items():
            if key not in keys.values():
                raise HexsimError(f"{place} {key} is not a known key: allowed are {', '.join(keys.values())}")
            if key not in (keys["gain"], keys["offset"]) and value < 0:
                raise HexsimError(f"{place} {key} = {value:g} must not be negative")
