"""What a reader looks at closely in the pages of a run and of runs side by side: the panels of `zoom`, missing signals left out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hexsim.recording import palette
from hexsim.recording.figure_parts import close_up, tracking_error
from hexsim.recording.quantity import DEG, MM
from hexsim.recording.signals import AXIS_NAMES, Signals, axis_unit_text
from hexsim.recording.summary_table import number
from hexsim.recording.zoom import Curve, Panel
from hexsim.signals.signal import ROTATIONS

Array = NDArray[np.float64]


def run_panels(signals: Signals) -> dict[str, list[Panel]]:
    """Figure of a run -> its panels."""
    return {"motion": _motion(signals), "acceleration": _acceleration(signals)}


def first_seen(signals: Signals, name: str) -> tuple[float, float] | None:
    """What a figure shows first [s]: reversals are looked at in the last periods; default the whole run."""
    return close_up(signals) if name == "acceleration" else None


def _motion(signals: Signals) -> list[Panel]:
    """Setpoint and response of the driven axes; of the legs position, tracking error and volts."""
    panels = []
    for axis in signals.driven_axes:
        scale, unit = (DEG, "deg") if axis in ROTATIONS else (MM, "mm")
        found = {"setpoint": signals.commanded(axis), "response": signals.position(axis)}
        colors = {"setpoint": palette.REFERENCE, "response": palette.RESPONSE}
        curves = [Curve(name, scale * values, colors[name]) for name, values in found.items() if values is not None]
        panels.append(Panel(f"{AXIS_NAMES[axis]} [{unit}]", signals.time_s, curves))
    positions = {leg: signals.leg(leg, "true_position", "position") for leg in signals.legs}
    if signals.kinematics.has_platform:
        panels.append(_legs("leg positions [mm]", signals, positions, MM))
    panels.append(
        _legs("tracking error [mm]", signals, {leg: tracking_error(signals, leg) for leg in signals.legs}, MM)
    )
    panels.append(_legs("valve [V]", signals, {leg: signals.leg(leg, "valve") for leg in signals.legs}, 1.0))
    return panels


def _legs(title: str, signals: Signals, found: Mapping[int, Array | None], scale: float) -> Panel:
    one = len(found) == 1
    curves = [
        Curve("leg" if one else f"leg {leg}", scale * values, palette.RESPONSE if one else palette.LEGS[leg - 1])
        for leg, values in found.items()
        if values is not None
    ]
    return Panel(title, signals.time_s, curves)


def _acceleration(signals: Signals) -> list[Panel]:
    """Of every driven axis the acceleration, and its deviation from the reference with the peaks at reversals."""
    panels = []
    for axis in signals.driven_axes:
        raw, band, found = signals.acceleration(axis), signals.acceleration_in_band(axis), signals.deviation(axis)
        if raw is None or band is None or found is None:
            continue
        name, unit, in_band = AXIS_NAMES[axis], axis_unit_text(axis), f"{found.bandwidth_Hz:g} Hz band"
        reference = np.full(len(raw), np.nan)
        reference[len(raw) - len(found.reference) :] = found.reference
        curves = [
            Curve("raw", raw, palette.RAW, 0.8),
            Curve(found.reference_is, reference, palette.REFERENCE, 1.6),
            Curve(in_band, band, palette.RESPONSE),
        ]
        panels.append(Panel(f"acceleration, {name} [{unit}]", signals.time_s, curves))
        curves = [Curve("raw", found.raw, palette.RAW, 0.8), Curve(in_band, found.band, palette.DEVIATION)]
        marks = [(peak.time_s, peak.value, f"{number(abs(peak.value))} {peak.end}") for peak in found.peaks]
        panels.append(Panel(f"deviation, {name} [{unit}]", found.time_s, curves, marks=marks))
    return panels


def comparison_panels(runs: Mapping[str, Signals], axis: str) -> list[Panel]:
    """Acceleration and deviation of an axis with each compensator, and below them volts and tracking error of the first leg."""
    first = max(runs.values(), key=lambda own: own.time_s[-1])
    name, unit, time = AXIS_NAMES[axis], axis_unit_text(axis), first.time_s
    colors = {label: palette.RUNS[k % len(palette.RUNS)] for k, label in enumerate(runs)}
    found = {label: deviation for label, own in runs.items() if (deviation := own.deviation(axis)) is not None}
    leg = "valve" if len(first.legs) == 1 else "valve of leg 1"
    error = "tracking error" if len(first.legs) == 1 else "tracking error of leg 1"
    panels = {
        f"acceleration, {name}, 50 Hz band [{unit}]": {
            label: (d.time_s, d.reference + d.band) for label, d in found.items()
        },
        f"deviation, {name}, 50 Hz band [{unit}]": {label: (d.time_s, d.band) for label, d in found.items()},
        f"{error} [mm]": {label: (own.time_s, _scaled(tracking_error(own, 1), MM)) for label, own in runs.items()},
        f"{leg} [V]": {label: (own.time_s, own.leg(1, "valve")) for label, own in runs.items()},
    }
    return [
        Panel(
            title,
            time,
            [
                Curve(label, np.interp(time, own_time, values, left=np.nan, right=np.nan), colors[label])
                for label, (own_time, values) in curves.items()
                if values is not None
            ],
        )
        for title, curves in panels.items()
    ]


def _scaled(values: Array | None, scale: float) -> Array | None:
    return None if values is None else scale * values
