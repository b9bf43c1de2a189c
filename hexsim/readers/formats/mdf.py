"""MDF files of measurement systems."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import RawTable, Reader, first_line


class MdfReader(Reader):
    """Channels on the time stamps of the fastest group; slower ones by linear interpolation, missing outside their time.

    Of several channels of one name the first keeps it, others are called `group.name` (the acquisition's name or `group 2`).
    """

    name = "MDF"
    suffixes = (".mf4", ".mdf")

    def read(self, path: Path, layout: FileLayout) -> RawTable:
        found = channels(path)
        if not found:
            raise HexsimError(f"{path} holds no channel of numbers")
        time = np.asarray(max((signal.timestamps for *_, signal in found), key=len), dtype=float)
        raw, units = RawTable(columns={"time_s": time}), {}
        signals: dict[str, Any] = {}
        for group, name, signal in found:
            key = name if name not in signals else f"{group}.{name}"
            if key in signals:
                key = f"{key} {len(signals)}"
            if key != name:
                raw.losses.append(f"another channel is called {name} too: it is {key} here, the first one is {name}")
            signals[key] = signal
        for name, signal in signals.items():
            stamps, values = np.asarray(signal.timestamps, dtype=float), signal.samples.astype(float)
            if not np.array_equal(stamps, time):
                raw.losses.append(
                    f"channel {name} has {len(stamps)} samples, the fastest {len(time)}: linear between them"
                )
                ends = 1.5 * float(np.median(np.diff(stamps)))
                outside = (time < stamps[0] - ends) | (time > stamps[-1] + ends)
                values = np.interp(time, stamps, values)
                values[outside] = np.nan
                if outside.any():
                    raw.losses.append(
                        f"channel {name} lasts from {stamps[0]:.3f} to {stamps[-1]:.3f} s: missing before and after"
                    )
            raw.columns[name] = values
            if signal.unit:
                units[name] = str(signal.unit)
        raw.units = units
        return raw


def channels(path: Path) -> list[tuple[str, str, Any]]:
    """(group, name, signal) of all channels of numbers."""
    try:
        from asammdf import MDF
    except ImportError:
        raise HexsimError(f"{path} is an MDF file: reading it needs asammdf; pip install 'hexsim[mdf]'") from None
    content = BytesIO(path.read_bytes())  # asammdf leaves a damaged file open
    if content.getvalue()[:3] != b"MDF":
        raise HexsimError(f"{path} is no MDF file: it does not begin with MDF")
    found: list[tuple[str, str, Any]] = []
    try:
        with quiet(), MDF(content) as file:
            for number, group in enumerate(file.groups):
                where = str(getattr(group.channel_group, "acq_name", "") or "") or f"group {number + 1}"
                for index, channel in enumerate(group.channels):
                    if index != file.masters_db.get(number):
                        signal = file.get(group=number, index=index)
                        if signal.samples.dtype.kind in "fiub" and signal.samples.ndim == 1 and len(signal.samples) > 2:
                            found.append((where, channel.name, signal))
    except Exception as error:  # asammdf raises many kinds on damaged files
        raise HexsimError(f"cannot read {path} as MDF: {first_line(error)}") from None
    return found


@contextmanager
def quiet() -> Iterator[None]:
    """asammdf logs and raises in destructors on damaged files; the HexsimError says it once."""
    hook, logger = sys.unraisablehook, logging.getLogger("asammdf")
    level = logger.level
    sys.unraisablehook = lambda _: None
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = hook
        logger.setLevel(level)


READER = MdfReader()
