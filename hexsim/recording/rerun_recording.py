"""A Rerun recording of one run, or of several on a common time line: the machine in 3-D, platform and leg signals.

    /<label>/machine/...                       3-D, see `rerun_scene`
    /<label>/acceleration/<axis>/raw|reference|within_band [m/s2], [rad/s2]
    /<label>/deviation/<axis>/raw|reversal_peaks|within_band   (later names are drawn on top)
    /<label>/pose/<axis>/commanded|actual      [mm], [deg]
    /<label>/legs/<i>/setpoint|position|error [mm], valve|compensation [V], bottom|top [bar], flow [l/min]
    /<label>/supply                            [bar]
    /<label>/messages, /<label>/summary

All series are sent in bulk (`send_columns`), accelerations at the log's own rate, pose and legs at 500 Hz;
styling is static. Where several runs are shown, curves that no view of the blueprint has are left out.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from hexsim.files.atomic import written_whole
from hexsim.recording import palette
from hexsim.recording.deviation import Deviation
from hexsim.recording.quantity import BAR, DEG, L_MIN, MM
from hexsim.recording.rerun_blueprint import blueprint
from hexsim.recording.rerun_scene import log_machine, time_column
from hexsim.recording.signals import AXIS_NAMES, Signals
from hexsim.signals.signal import ROTATIONS
from hexsim.signals.table import table

Array = NDArray[np.float64]

MESSAGE_LEVEL = "INFO"
# entity of a leg: (signals, the first that the log has), what people read per SI unit, colour where not the leg's own
LEG_CURVES: dict[str, tuple[tuple[str, ...], float, str | None]] = {
    "setpoint": (("setpoint",), MM, palette.REFERENCE),
    "position": (("position",), MM, None),
    "valve": (("valve",), 1.0, None),
    "compensation": (("compensation",), 1.0, palette.REFERENCE),
    "bottom": (("true_pressure_bottom", "pressure_bottom"), BAR, None),
    "top": (("true_pressure_top", "pressure_top"), BAR, palette.REFERENCE),
    "flow": (("flow",), L_MIN, None),
}


def write_recording(
    path: Path,
    runs: Mapping[str, Signals],
    summaries: Mapping[str, str] | None = None,
    messages: Mapping[str, Iterable[tuple[float, int | None, str]]] | None = None,
) -> None:
    """Write a recording (.rrd) of label -> signals, whole or not at all, with the blueprint it opens with.

    summaries: label -> Markdown for the text panel. messages: label -> (time_s, leg, text).
    """
    labels = {label: entity_name(label) for label in runs}
    if "pandas" not in sys.modules:  # pyarrow imports it for its first array, in 0.3 s: let it find none now
        sys.modules["pandas.compat"] = None  # type: ignore[assignment]
        rr.Scalars.columns(scalars=[0.0])
        del sys.modules["pandas.compat"]  # for who asks for pandas itself, as `to_pandas`
    with written_whole(Path(path)) as temporary:
        recording = rr.RecordingStream("hexsim", send_properties=True)
        with_text = [labels[label] for label in runs if (summaries or {}).get(label)]
        shown = blueprint({labels[label]: signals for label, signals in runs.items()}, with_text)
        recording.save(os.fspath(temporary), default_blueprint=shown)
        for index, (label, signals) in enumerate(runs.items()):
            root = labels[label]
            color = None if len(runs) == 1 else palette.RUNS[index % len(palette.RUNS)]
            log_machine(recording, f"{root}/machine", signals, _place(index, len(runs), signals))
            series = _Series(recording=recording, root=root, signals=signals, label=label, color=color)
            series.platform()
            series.legs()
            text = (summaries or {}).get(label)
            if text:
                document = rr.TextDocument(f"## {label}\n\n{text}", media_type=rr.MediaType.MARKDOWN)
                recording.log(f"{root}/summary", document, static=True)
            for time_s, leg, message in (messages or {}).get(label, ()):
                recording.set_time("time", duration=time_s)
                place = f"leg {leg}: " if leg else ""
                recording.log(f"{root}/messages", rr.TextLog(f"{place}{message}", level=MESSAGE_LEVEL))
            recording.reset_time()
        recording.flush()
        recording.disconnect()


def entity_name(label: str) -> str:
    """A label as one part of an entity path: letters, digits, - and _ stay."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in label) or "run"


def _place(index: int, count: int, signals: Signals) -> Array:
    """Machines stand side by side along y, the first at the left of the picture."""
    radius = signals.kinematics.radius_m
    return np.array([0.0, (0.5 * (count - 1) - index) * 2.6 * radius, 0.0])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Series:
    """Sends the curves of one run. color: of all its curves where several runs are shown, None where it is alone."""

    recording: rr.RecordingStream
    root: str
    signals: Signals
    label: str
    color: str | None

    def curve(self, path: str, time_s: Array, values: Array | None, name: str, color: str, width: float = 1.5) -> None:
        """A static style and one bulk message; nothing where the log has no such signal."""
        if values is None:
            return
        named = f"{self.label} {name}" if self.color else name
        style = rr.SeriesLines(
            colors=[palette.rgb(color)],
            names=[named],
            widths=[width],
            aggregation_policy="MinMax",  # bumps are short
        )
        self.recording.log(f"{self.root}/{path}", style, static=True)
        columns = rr.Scalars.columns(scalars=np.ascontiguousarray(values))
        self.recording.send_columns(f"{self.root}/{path}", [time_column(time_s)], columns)

    @property
    def alone(self) -> bool:
        return self.color is None

    def slow_curve(self, path: str, values: Array | None, name: str, color: str) -> None:
        """A curve at the motion computer's rate or the log's own, whichever is lower."""
        t, rate_Hz = self.signals.time_s, 500.0
        every = max(1, round((len(t) - 1) / (np.ptp(t) * rate_Hz)))
        self.curve(path, t[::every], None if values is None else values[::every], name, color)

    def platform(self) -> None:
        """Pose, acceleration and deviation of every axis."""
        signals = self.signals
        for axis in signals.axes:
            scale, name = DEG if axis in ROTATIONS else MM, AXIS_NAMES[axis]
            commanded, position = _times(signals.commanded(axis), scale), _times(signals.position(axis), scale)
            self.slow_curve(f"pose/{axis}/commanded", commanded, f"{name} commanded", palette.REFERENCE)
            self.slow_curve(f"pose/{axis}/actual", position, name, self.color or palette.RESPONSE)
            found = signals.deviation(axis)
            if found is not None:
                self.acceleration(axis, found)
                self.deviation(axis, found)

    def acceleration(self, axis: str, found: Deviation) -> None:
        signals, path, name = self.signals, f"acceleration/{axis}", AXIS_NAMES[axis]
        band = f"{name} {found.bandwidth_Hz:g} Hz"
        t, color = signals.time_s, self.color or palette.RESPONSE
        if self.alone:
            self.curve(f"{path}/raw", t, signals.acceleration(axis), f"{name} raw", palette.RAW, 1.0)
        self.curve(f"{path}/within_band", t, signals.acceleration_in_band(axis), band, color)
        if self.alone and axis in signals.driven_axes:
            self.curve(
                f"{path}/reference", found.time_s, found.reference, f"{name} {found.reference_is}", palette.REFERENCE
            )

    def deviation(self, axis: str, found: Deviation) -> None:
        path, name, t = f"deviation/{axis}", AXIS_NAMES[axis], found.time_s
        band, color = f"{name} {found.bandwidth_Hz:g} Hz", self.color or palette.DEVIATION
        self.curve(f"{path}/within_band", t, found.band, band, color)
        if axis not in self.signals.driven_axes or not self.alone:
            return
        self.curve(f"{path}/raw", t, found.raw, f"{name} raw", palette.RAW, 1.0)
        if found.peaks:
            style = rr.SeriesPoints(
                colors=[palette.rgb(palette.MARK)], names=[f"{name} peaks"], markers=["Circle"], marker_sizes=[5.0]
            )
            self.recording.log(f"{self.root}/{path}/reversal_peaks", style, static=True)
            times = time_column(np.array([peak.time_s for peak in found.peaks]))
            columns = rr.Scalars.columns(scalars=[peak.value for peak in found.peaks])
            self.recording.send_columns(f"{self.root}/{path}/reversal_peaks", [times], columns)

    def legs(self) -> None:
        """Every leg's signals, and the supply they share."""
        signals = self.signals
        self.slow_curve("supply", _times(signals.supply, BAR), "supply", self.color or palette.SUPPLY)
        for leg in signals.legs:
            own = self.color or (palette.LEGS[leg - 1] if len(signals.legs) > 1 else palette.RESPONSE)
            for key, (stems, factor, color) in LEG_CURVES.items():
                values = signals.leg(leg, *stems)
                if key == "compensation" and values is not None and not values.any():
                    continue
                name = f"leg {leg} {table()[stems[0]].label}"
                self.slow_curve(f"legs/{leg}/{key}", _times(values, factor), name, color or own)
            setpoint, position = signals.leg(leg, "setpoint"), signals.leg(leg, "position")
            if setpoint is not None and position is not None:
                self.slow_curve(f"legs/{leg}/error", MM * (setpoint - position), f"leg {leg} tracking error", own)


def _times(values: Array | None, factor: float) -> Array | None:
    return None if values is None else factor * values
