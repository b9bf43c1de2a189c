"""Telemetry as a log, judged before anybody uses it: what cannot be a measurement is refused, each in its sentence."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.motion_computer.telemetry import Telemetry
from hexsim.signals.table import table

Array = NDArray[np.float64]
LOST_SHARE = 0.05  # of the telemetry that may be lost in a run
STEMS = (
    "setpoint",
    "position",
    "pressure_bottom",
    "pressure_top",
    "valve",
    "pressure_supply",
    "acceleration",
    "angular_acceleration",
)


def log_of(
    packets: Iterable[Telemetry],
    machine: Machine | None = None,
    *,
    rate_share: float = 0.02,  # by which rows may be farther apart than the rate says
) -> pl.DataFrame:
    """The log of telemetry packets: columns of the log format, a gap in time where packets were lost.

    Raises HexsimError where there is none, where too much is lost, where times and rate contradict each other, or where a
    channel cannot be a measurement (`judged`).
    """
    newest = {packet.sequence: packet for packet in packets}
    if not newest:
        raise HexsimError("the machine sends no telemetry: start it with `hexsim serve --telemetry`")
    kept = sorted(newest.values(), key=lambda packet: packet.time_s)
    n, rate = kept[0].n_legs, kept[0].rate_Hz
    if any(packet.n_legs != n or packet.rate_Hz != rate for packet in kept):
        raise HexsimError("the telemetry changes its number of legs or its rate in the middle of a run")
    time = np.concatenate([packet.time_s + np.arange(len(packet.rows)) / rate for packet in kept])
    rows = np.concatenate([packet.rows for packet in kept])
    following = [(one, other) for one, other in pairwise(kept) if (other.sequence - one.sequence) % 2**32 == 1]
    steps = [(other.time_s - one.time_s) / len(one.rows) for one, other in following]
    usual = float(np.median(steps)) if steps else 1.0 / rate
    if abs(usual * rate - 1.0) > rate_share:
        raise HexsimError(
            f"the telemetry says {rate:g} Hz, but its rows are {1e3 * usual:.3f} ms apart: its rate cannot be trusted; "
            "mend the rate or the time stamps"
        )
    found = columns(rows, n)
    judged(found, n, machine)
    whole = np.all([np.isfinite(values) for values in found.values()], axis=0)
    expected = round((time[-1] - time[0]) * rate) + 1
    if whole.sum() < (1.0 - LOST_SHARE) * expected:
        raise HexsimError(
            f"{100 * (1 - whole.sum() / expected):.0f} % of the telemetry was lost or not a number, at most "
            f"{100 * LOST_SHARE:g} % can be: use a nearer or a wired network"
        )
    return pl.DataFrame({"time_s": time - time[0]} | found).filter(pl.Series(whole))


def columns(rows: Array, n: int) -> dict[str, Array]:
    """Columns of the log format; sensors that the machine has not are left out."""
    parts = np.split(rows, [n, 2 * n, 3 * n, 4 * n, 5 * n, 5 * n + 1, 5 * n + 4], axis=1)
    found = {}
    for stem, values in zip(STEMS, parts, strict=True):
        for name, value in zip(table()[stem].columns(n), values.T, strict=False):
            if not np.isnan(value).all():
                found[name] = np.ascontiguousarray(value)
    return found


def judged(found: dict[str, Array], n: int, machine: Machine | None) -> None:
    """Raises HexsimError for channels that cannot be measurements: missing, infinite, out of range, frozen."""
    for stem in ("position", "setpoint"):
        for leg, name in enumerate(table()[stem].columns(n), start=1):
            if name not in found:
                raise HexsimError(f"the telemetry has no number in {name}: the {stem} of leg {leg} must be there")
    for name, values in found.items():
        if np.isinf(values).any():
            raise HexsimError(f"the telemetry's {name} is infinite: no sensor reads that")
    if all(_constant(values) for values in found.values()):
        zero = all((values == 0.0).all() for values in found.values())
        raise HexsimError(
            f"the telemetry is frozen: in {len(next(iter(found.values())))} rows no channel has changed"
            + (", and all of them are zero" if zero else "")
        )
    if machine is not None:
        _in_range(found, n, machine)
        _alive(found, n)


def _in_range(
    found: dict[str, Array],
    n: int,
    machine: Machine,
    *,
    stroke_share: float = 0.05,  # of the stroke, by which a transducer may read beyond it: its zero is known so well
    pressure_ratio: float = 1.5,  # times what a chamber can hold: shocks
    below_Pa: float = 2e5,  # a gauge's zero, and one atmosphere: no pressure lies farther below zero
    volts_ratio: float = 1.1,  # times the valve's range
    most_m_s2: float = 100.0,  # ten times gravity: the range of a platform's accelerometer is smaller
    most_rad_s2: float = 1000.0,  # the same at 0.1 m from the axis
) -> None:
    """By the declaration: stroke, pressures that the chambers can hold, the valve's volts."""
    if n != machine.n_legs:
        raise HexsimError(f"the machine sends {n} legs, and {machine.name} is declared with {machine.n_legs}")
    stroke, volts = machine.of_legs("cylinder", "stroke_m"), machine.of_legs("valve", "voltage_max_V")
    bottom, top = machine.of_legs("cylinder", "area_bottom_m2"), machine.of_legs("cylinder", "area_top_m2")
    held = pressure_ratio * (machine.supply.pressure_Pa + machine.supply.tank_pressure_Pa) * bottom / top
    supply = np.full(1, pressure_ratio * machine.supply.pressure_Pa)
    ranges = {
        "setpoint": (-stroke_share * stroke, (1.0 + stroke_share) * stroke),
        "position": (-stroke_share * stroke, (1.0 + stroke_share) * stroke),
        "pressure_bottom": (np.full(n, -below_Pa), held),
        "pressure_top": (np.full(n, -below_Pa), held),
        "valve": (-volts_ratio * volts, volts_ratio * volts),
        "pressure_supply": (np.full(1, -below_Pa), supply),
        "acceleration": (np.full(3, -most_m_s2), np.full(3, most_m_s2)),
        "angular_acceleration": (np.full(3, -most_rad_s2), np.full(3, most_rad_s2)),
    }
    for stem, (low, high) in ranges.items():
        for name, least, most in zip(table()[stem].columns(n), low, high, strict=False):
            values = found.get(name)
            if values is None:
                continue
            outside = np.mean((values < least) | (values > most))
            if outside > LOST_SHARE:
                raise HexsimError(
                    f"the telemetry's {name} lies outside {least:g} to {most:g} in {100 * outside:.0f} % of the rows, from "
                    f"{np.nanmin(values):g} to {np.nanmax(values):g}: check its unit and sign, or the declaration"
                )


def _alive(
    found: dict[str, Array],
    n: int,
    *,
    must_move_m: float = 1e-3,  # a leg that is asked for so much changes every reading of its own
) -> None:
    """A channel of a leg that was asked to move and did not change once is frozen; so is an accelerometer of which no axis
    has changed."""
    names = {stem: table()[stem].columns(n) for stem in STEMS}
    moved = [np.nanmax(found[name]) - np.nanmin(found[name]) > must_move_m for name in names["setpoint"]]
    driven = [
        (name, f"leg {leg + 1}")
        for stem in ("position", "pressure_bottom", "valve")
        for leg, name in enumerate(names[stem])
        if moved[leg]
    ]
    for stem in ("acceleration", "angular_acceleration"):
        axes = [name for name in names[stem] if name in found]
        if any(moved) and all(_constant(found[name]) for name in axes):
            driven += [(name, "the machine") for name in axes]
    for name, what in driven:
        if name in found and _constant(found[name]):
            raise HexsimError(
                f"the telemetry's {name} is frozen at {found[name][0]:g} while {what} was driven: mend the sensor, or send "
                "not-a-number where there is none"
            )


def _constant(values: Array) -> bool:
    """Whether all its numbers are one."""
    values = values[np.isfinite(values)]
    return bool(len(values) and np.ptp(values) == 0.0)
