"""MCAP files: messages in JSON, or ROS 2's (CDR) by the definitions that the file carries."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import RawTable, Reader, first_line
from hexsim.readers.topics import Topics, on_fastest

CDR = "cdr"


class McapReader(Reader):
    """Fields of messages that are numbers, on the time stamps of the fastest topic; header stamps where there are such."""

    name = "MCAP"
    suffixes = (".mcap",)

    def read(self, path: Path, layout: FileLayout) -> RawTable:
        try:
            from mcap.reader import make_reader
        except ImportError:
            raise HexsimError(f"{path} is an MCAP file: pip install 'hexsim[ros]' to read it") from None
        topics, decoders, left_out = Topics(), {}, {}
        try:
            with open(path, "rb") as stream:
                for schema, channel, message in make_reader(stream).iter_messages():
                    if channel.id not in decoders:
                        decoders[channel.id] = decoder(schema, channel)
                    decode = decoders[channel.id]
                    if decode is None:
                        left_out[channel.topic] = channel.message_encoding
                    elif not topics.is_full:
                        topics.add(channel.topic, message.publish_time, decode(message.data))
        except Exception as error:  # mcap and rosbags raise many kinds on damaged files
            raise HexsimError(f"cannot read {path} as MCAP: {first_line(error)}") from None
        raw = on_fastest(path, topics.channels(), left_out)
        if topics.is_full:
            raw.lose_rows(f"{path.name} holds more numbers than are kept: what comes later is left out")
        return raw


def decoder(schema: Any, channel: Any) -> Any:
    """Function from the bytes of a channel's message to its fields; None for an encoding that is not read."""
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding != CDR or schema is None or schema.encoding != "ros2msg":
        return None
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/")
    store.register(get_types_from_msg(schema.data.decode(), name))
    return lambda data: store.deserialize_cdr(data, name)


READER = McapReader()
