"""TDMS files of LabVIEW and NI's data loggers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.clock_columns import seconds_of, time_columns
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, RawSignal, Reader


class TdmsReader(Reader):
    """Channels called `group.channel`, on the stamps of their waveform (wf_increment), else of a channel of time in their
    group; without either they are columns of a table."""

    name = "TDMS"
    suffixes = (".tdms",)
    needs = "tdms"

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        from nptdms import TdmsFile

        raw = RawLog(signals=[])
        with open(path, "rb") as stream:
            if stream.read(4) not in (b"TDSm", b"TDSh"):
                raise HexsimError(f"{path} is no TDMS file: it does not begin with TDSm")
            stream.seek(0)
            file = TdmsFile.open(stream)  # a damaged file would stay open if nptdms opened it
            channels = [channel for group in file.groups() for channel in group.channels()]
            cells = sum(len(channel) for channel in channels)
            if cells > LARGEST.cells:
                raise HexsimError(f"{path} holds {cells:,} numbers, {LARGEST.cells:,} are the most: save less of it")
            begins = [start for channel in channels if (start := begin(channel)) is not None]
            lengths = {(channel.group_name, len(channel)) for channel in channels if len(channel)}
            for group in file.groups():
                self.collect(group, raw, min(begins, default=None), alone=len(lengths) < 2)
        if not raw.signals:
            raise HexsimError(f"{path} holds no channel of numbers{raw.unread()}")
        return raw

    def collect(self, group: Any, raw: RawLog, first: np.datetime64 | None, alone: bool) -> None:
        """Channels of a group. Channels that begin and step alike share one array of stamps. alone: the file is one table."""
        read: dict[str, np.ndarray] = {}
        for channel in group.channels():
            if channel.dtype is not None and np.dtype(channel.dtype).kind in "fiubM" and len(channel):
                read[channel.name] = channel[:]
            else:
                raw.left_out.append(
                    f"channel {group.name}.{channel.name} holds {'nothing' if not len(channel) else 'text'}"
                )
        clocks = {} if alone else time_columns(read)
        stamps: dict[Any, np.ndarray] = {}
        for channel in group.channels():
            values = read.get(channel.name)
            if values is None:
                continue
            unit = str(channel.properties.get("unit_string", "") or "")
            if values.dtype.kind == "M":
                values, unit = seconds_of(values), "s"
            own: dict[str, np.ndarray] = {}
            step = channel.properties.get("wf_increment")
            if isinstance(step, float) and step > 0.0:
                start = begin(channel)
                late = (
                    0.0 if start is None or first is None else float((start - first) / np.timedelta64(1, "ns")) * 1e-9
                )
                late += float(channel.properties.get("wf_start_offset", 0.0) or 0.0)
                own["time"] = stamps.setdefault((late, step, len(values)), late + step * np.arange(len(values)))
            elif (clock := clocks.get(len(values))) is not None and channel.name != clock[0]:
                own["time"] = clock[1]
            raw.signals.append(
                RawSignal(name=f"{group.name}.{channel.name}", values=values.astype(float), unit=unit, stamps=own)
            )


def begin(channel: Any) -> np.datetime64 | None:
    """When a waveform begins."""
    start = channel.properties.get("wf_start_time")
    return start if isinstance(start, np.datetime64) else None


READER = TdmsReader()
