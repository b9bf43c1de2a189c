"""MDF files of measurement systems."""

from __future__ import annotations

import gc
import logging
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, RawSignal, Reader
from hexsim.readers.sizes import check_mdf, too_large


class MdfReader(Reader):
    """Channels on the stamps of their group, called `group.name` (the acquisition's name or `group 2`)."""

    name = "MDF"
    suffixes = (".mf4", ".mdf")
    needs = "mdf"

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        from asammdf import MDF

        content = BytesIO(path.read_bytes())  # asammdf leaves a damaged file open
        if content.getvalue()[:3] != b"MDF":
            raise HexsimError(f"{path} is no MDF file: it does not begin with MDF")
        check_mdf(path, content.getvalue())
        raw = RawLog(signals=[])
        with quiet(), MDF(content) as file:
            refuse_large(path, file)
            for number, group in enumerate(file.groups):
                where = str(getattr(group.channel_group, "acq_name", "") or "") or f"group {number + 1}"
                stamps: np.ndarray | None = None
                for index, channel in enumerate(group.channels):
                    if index == file.masters_db.get(number):
                        continue
                    signal = file.get(group=number, index=index, ignore_invalidation_bits=True)
                    if signal.samples.dtype.kind not in "fiub" or signal.samples.ndim != 1:
                        signal = as_numbers(file, number, index, signal, raw, f"{where}.{channel.name}")
                    if signal is None or len(signal.samples) < 3:
                        continue
                    if stamps is None:
                        stamps = np.asarray(signal.timestamps)
                    raw.signals.append(as_raw(signal, stamps, f"{where}.{channel.name}"))
        if not raw.signals:
            raise HexsimError(f"{path} holds no channel of numbers{raw.unread()}")
        return raw


def as_raw(signal: Any, stamps: np.ndarray, name: str) -> RawSignal:
    """A channel with its invalid samples missing."""
    values = signal.samples.astype(float)
    invalid = getattr(signal, "invalidation_bits", None)
    if invalid is not None:
        values[np.asarray(invalid, dtype=bool)] = np.nan
    own = stamps if len(stamps) == len(values) else signal.timestamps
    return RawSignal(name=name, values=values, stamps={"master": own}, unit=str(signal.unit or ""))


def as_numbers(file: Any, number: int, index: int, signal: Any, raw: RawLog, name: str) -> Any:
    """A channel of texts among numbers ("SNA" of a CAN bus) as numbers, texts missing; None for one of texts alone."""
    texts = signal.samples
    if texts.ndim != 1 or texts.dtype.kind not in "SUO":
        raw.left_out.append(f"channel {name} holds {texts.dtype}, not numbers")
        return None
    values = pl.Series([t.decode("latin-1") if isinstance(t, bytes) else str(t) for t in texts]).str.strip_chars()
    numbers = values.cast(pl.Float64, strict=False)
    good = len(numbers) - numbers.null_count()
    if good < 0.5 * len(numbers):
        raw.left_out.append(f"channel {name} holds text")
        return None
    if good < len(numbers):
        at = int(numbers.is_null().arg_max() or 0)
        raw.losses.append(
            f"channel {name}: {len(numbers) - good} samples are text, the first is {values[at][:20]!r} in row {at + 1}: missing"
        )
    signal.samples = numbers.fill_null(np.nan).to_numpy().astype(float)
    return signal


def refuse_large(path: Path, file: Any) -> None:
    """Ask for the size of what would be unpacked."""
    cells = sum(int(group.channel_group.cycles_nr) * max(len(group.channels), 1) for group in file.groups)
    if cells > LARGEST.cells:
        raise too_large(path, f"{LARGEST.cells:,} numbers")


@contextmanager
def quiet() -> Iterator[None]:
    """asammdf logs and raises in destructors on damaged files; the HexsimError says it once."""
    hook, logger = sys.unraisablehook, logging.getLogger("asammdf")
    level = logger.level
    sys.unraisablehook = lambda _: None
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    except Exception as error:
        chained: BaseException | None = error
        while chained is not None:  # their frames hold the half-opened file, whose destructor must run here
            traceback.clear_frames(chained.__traceback__)
            chained = chained.__context__
        gc.collect()
        raise
    finally:
        sys.unraisablehook = hook
        logger.setLevel(level)


READER = MdfReader()
