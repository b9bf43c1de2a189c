"""Folders that `ros2 bag record` writes: a metadata.yaml and one file or many, of SQLite or MCAP, perhaps compressed."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from hexsim.errors import HexsimError
from hexsim.readers.formats.mcap import McapReader
from hexsim.readers.formats.ros_bag import RosBagReader
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, Reader
from hexsim.readers.topics import Topics

METADATA = "metadata.yaml"


class BagFolderReader(Reader):
    """All parts of a bag, one after the other, as one log."""

    name = "ROS 2 bag folder"
    suffixes = ()
    needs = "ros"
    marker = METADATA

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        topics, readers = Topics(), {".db3": RosBagReader(), ".mcap": McapReader()}
        parts = [part for part in path.iterdir() if part.name.removesuffix(".zstd").endswith(tuple(readers))]
        plain = {part.name for part in parts}
        parts = [part for part in parts if part.suffix != ".zstd" or part.stem not in plain]
        if not parts:
            raise HexsimError(f"{path} has a {METADATA} and no file of a bag (.db3, .mcap)")
        with tempfile.TemporaryDirectory(prefix="hexsim-bag-") as folder:
            for part in sorted(parts, key=lambda part: [int(n) for n in re.findall(r"\d+", part.name)]):
                file = unpacked(part, Path(folder)) if part.suffix == ".zstd" else part
                readers[file.suffix].collect(file, topics)
                if topics.is_full:
                    break
        return topics.raw(path)


def unpacked(part: Path, folder: Path) -> Path:
    """A part of `--compression-mode file` as a file of its own, no more than log bytes."""
    import zstandard

    out, size = folder / part.stem, 0
    with open(part, "rb") as packed, open(out, "wb") as file:
        for piece in zstandard.ZstdDecompressor().read_to_iter(packed, write_size=LARGEST.piece):
            size += len(piece)
            if size > LARGEST.log:
                raise HexsimError(f"{part} unpacks to more than {LARGEST.log >> 20} MB: cut it (ros2 bag convert)")
            file.write(piece)
    return out


READER = BagFolderReader()
