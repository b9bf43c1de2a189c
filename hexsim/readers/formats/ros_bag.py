"""Bags of ROS 2 in SQLite, one .db3 file."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import RawTable, Reader, first_line
from hexsim.readers.topics import Topics, on_fastest


class RosBagReader(Reader):
    """Fields of messages that are numbers, on the time stamps of the fastest topic; header stamps where there are such.

    Types by the definitions in the bag (from ROS 2 Iron on), else those that ROS 2 Humble ships.
    """

    name = "ROS 2 bag"
    suffixes = (".db3",)

    def read(self, path: Path, layout: FileLayout) -> RawTable:
        try:
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError:
            raise HexsimError(f"{path} is a bag of ROS 2: pip install 'hexsim[ros]' to read it") from None
        topics, left_out, store = Topics(), {}, get_typestore(Stores.ROS2_HUMBLE)
        try:
            bag = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
            try:
                if bag.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone():
                    for name, text in bag.execute(
                        "SELECT topic_type, encoded_message_definition FROM message_definitions"
                    ):
                        store.register(get_types_from_msg(text, name))
                known = {id: (name, kind) for id, name, kind in bag.execute("SELECT id, name, type FROM topics")}
                rows = bag.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp")
                for topic, stamp_ns, data in rows:
                    name, kind = known[topic]
                    if kind not in store.fielddefs:
                        left_out[name] = kind
                    elif not topics.is_full:
                        topics.add(name, stamp_ns, store.deserialize_cdr(data, kind))
            finally:
                bag.close()
        except Exception as error:  # sqlite3 and rosbags raise many kinds on damaged files
            raise HexsimError(f"cannot read {path} as a bag of ROS 2: {first_line(error)}") from None
        raw = on_fastest(path, topics.channels(), left_out)
        if topics.is_full:
            raw.lose_rows(f"{path.name} holds more numbers than are kept: what comes later is left out")
        return raw


READER = RosBagReader()
