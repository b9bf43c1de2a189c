"""Universal files (UFF, UNV) of test and modal analysis: data set 58, functions of time."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, RawSignal, Reader

DIRECTIONS = {1: "x", 2: "y", 3: "z", -1: "-x", -2: "-y", -3: "-z", 4: "rx", 5: "ry", 6: "rz"}


class UffReader(Reader):
    """Signals over time, each on its own abscissa, called by the first ID line, or by point and direction. Spectra and
    other data sets are left out."""

    name = "UFF"
    suffixes = (".uff", ".unv", ".uf58")
    needs = "uff"

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        import pyuff

        refuse_large(path)
        raw = RawLog(signals=[])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of data sets that pyuff does not know
            sets = pyuff.UFF(str(path)).read_sets()
        stamps: dict[tuple[int, float, float], np.ndarray] = {}
        for number, one in enumerate(sets if isinstance(sets, list) else [sets]):
            if one.get("type") != 58:
                raw.left_out.append(f"data set {number + 1} is of type {one.get('type')}")
                continue
            values, time = np.asarray(one["data"]), np.asarray(one["x"], dtype=float)
            # general, and time response: the types that are signals over time
            if one.get("func_type") not in (0, 1) or np.iscomplexobj(values):
                raw.left_out.append(f"data set {number + 1}, {name_of(one, number)}, is no function of time")
                continue
            if len(time) != len(values) or len(values) < 3:
                raw.left_out.append(f"data set {number + 1} has {len(values)} values and {len(time)} times")
                continue
            clock = stamps.setdefault((len(time), float(time[0]), float(time[-1])), time)
            clock = clock if np.array_equal(clock, time) else time
            raw.signals.append(
                RawSignal(
                    name=unique(name_of(one, number), raw),
                    values=values.astype(float),
                    stamps={"abscissa": clock},
                    unit=label(one.get("ordinate_axis_units_lab")),
                )
            )
        if not raw.signals:
            raise HexsimError(f"{path} holds no data set 58 over time{raw.unread()}")
        return raw


def name_of(one: dict[str, Any], number: int) -> str:
    """The label of the ordinate, the first ID line, or point and direction of the response."""
    for key in ("ordinate_axis_lab", "id1"):
        if text := label(one.get(key)):
            return text
    where = DIRECTIONS.get(int(one.get("rsp_dir", 0)), "")
    return f"point {one.get('rsp_node', number + 1)}{where and ' ' + where}"


def unique(name: str, raw: RawLog) -> str:
    """A second signal of a name is called `name 2`."""
    taken = {signal.name for signal in raw.signals}
    return next(other for k in range(1, len(taken) + 2) if (other := name if k == 1 else f"{name} {k}") not in taken)


def label(value: Any) -> str:
    """A label of the file; NONE says that there is none."""
    text = str(value or "").strip()
    return "" if text.upper() in ("", "NONE", "NO") else text


def refuse_large(
    path: Path,
    *,
    most_bytes: int = 100_000_000,  # bytes that are read: pyuff keeps the text of all of them
) -> None:
    """Ask for the size of what would be unpacked: an even abscissa is made of its number of points alone."""
    if path.stat().st_size > most_bytes:
        raise HexsimError(f"{path} is larger than {most_bytes // 1_000_000} MB: save fewer data sets")
    content, cells = path.read_bytes(), 0
    begins = list(re.finditer(rb"(?m)^ {0,4}-1\s*\n {0,5}58b?\b[^\n]*\n", content))
    if not begins:
        raise HexsimError(f"{path} is no universal file with a data set 58")
    for begin in begins:
        lines = content[begin.end() : begin.end() + 4000].split(b"\n", 8)
        numbers = lines[6].split() if len(lines) > 6 else []
        if len(numbers) < 2 or not numbers[1].isdigit():
            raise HexsimError(f"{path}: data set 58 at byte {begin.start()} has no number of points in its record 7")
        cells += int(numbers[1])
        if cells > min(LARGEST.cells, len(content)):  # at least a byte a value
            raise HexsimError(
                f"{path} claims {cells:,} values in {len(content):,} bytes: it is damaged, or save less of it"
            )


READER = UffReader()
