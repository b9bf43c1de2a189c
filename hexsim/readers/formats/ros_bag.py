"""Bags of ROS 2 in SQLite, one .db3 file."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, Reader
from hexsim.readers.ros_messages import BadDefinition, Messages
from hexsim.readers.topics import Topics

ZSTD = b"\x28\xb5\x2f\xfd"  # how a compressed message begins
CELLS = {
    "messages": {"topic_id": int, "timestamp": int, "data": bytes},
    "topics": {"id": int, "name": str, "type": str},
}


class RosBagReader(Reader):
    """Fields of messages that are numbers, on the stamps of their topic: header time and time of receipt.

    Types by the definitions in the bag (from ROS 2 Iron on), else those that ROS 2 Humble ships.
    """

    name = "ROS 2 bag"
    suffixes = (".db3",)
    needs = "ros"

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        topics = Topics()
        self.collect(path, topics)
        return topics.raw(path)

    def collect(self, path: Path, topics: Topics) -> None:
        """Messages of a file."""
        messages = Messages()
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as bag:
            bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST.part)
            tables = {name for (name,) in bag.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            for needed in CELLS:
                if needed not in tables:
                    raise HexsimError(f"{path} is no bag of ROS 2: it has no table {needed}")
            types = {id: (name, kind) for id, name, kind in rows(bag, path, "topics", "id, name, type")}
            if "message_definitions" in tables:
                self.define(bag, messages, {kind for _, kind in types.values()})
            size = 0
            for topic, stamp_ns, data in rows(bag, path, "messages", "topic_id, timestamp, data"):
                if topic not in types or types[topic][0] in topics.left_out:
                    continue
                name, kind = types[topic]
                if not messages.knows(kind):
                    topics.left_out[name] = f"is {kind[:60]}, the bag has no definition of it: not read"
                    continue
                if data[:4] == ZSTD:
                    data = self.unpacked(data)
                    size += len(data)
                    if size > LARGEST.log:
                        raise HexsimError(
                            f"{path} unpacks to more than {LARGEST.log >> 20} MB: cut it (ros2 bag convert)"
                        )
                topics.add(name, stamp_ns, messages.decoder(kind)(data))
                if topics.is_full:
                    break

    def define(self, bag: sqlite3.Connection, messages: Messages, used: set[str]) -> None:
        """Definitions in the bag of types that its topics have."""
        found = bag.execute("SELECT topic_type, encoded_message_definition FROM message_definitions LIMIT 2000")
        for name, text in found:
            if name in used:
                try:
                    messages.define(name, text)
                except BadDefinition as error:
                    raise HexsimError(f"a bag's message definition is not read: {error}") from None

    def unpacked(self, data: bytes) -> bytes:
        """A message of `ros2 bag record --compression-mode message --compression-format zstd`."""
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(data) as file:
            return file.read(LARGEST.part)


def rows(
    bag: sqlite3.Connection,
    path: Path,
    table: str,
    columns: str,
    *,
    steps_a_look: int = 100_000,  # of SQLite between two looks at the clock
    longest_s: float = 15.0,  # that SQLite may take for one row: only a damaged or hostile file takes more than a moment
) -> Iterator[tuple[Any, ...]]:
    """Rows of a real table in their order; a row that takes SQLite too long, or holds other cells, is a refusal."""
    begun = time.monotonic()
    bag.set_progress_handler(lambda: time.monotonic() - begun > longest_s, steps_a_look)
    kinds = tuple(CELLS[table].values())
    for number, row in enumerate(bag.execute(f"SELECT {columns} FROM {table}")):
        for value, kind, name in zip(row, kinds, CELLS[table], strict=True):
            if not isinstance(value, kind):
                raise HexsimError(
                    f"cannot read {path} as a ROS 2 bag: {name} in row {number + 1} of {table} is "
                    f"{type(value).__name__}, not {kind.__name__}"
                )
        begun = time.monotonic()
        yield row
    bag.set_progress_handler(None, 0)


READER = RosBagReader()
