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

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import RawTable, Reader, first_line
from hexsim.readers.topics import Channel, on_fastest


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
        losses: list[str] = []
        signals: dict[str, Any] = {}
        for group, name, signal in found:
            key = name if name not in signals else f"{group}.{name}"
            if key in signals:
                key = f"{key} {len(signals)}"
            if key != name:
                losses.append(f"another channel is called {name} too: it is {key} here, the first one is {name}")
            signals[key] = signal
        raw = on_fastest(
            path,
            (
                Channel(name=name, time_s=s.timestamps, values=s.samples, unit=str(s.unit or ""))
                for name, s in signals.items()
            ),
        )
        raw.losses[:0] = losses
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
