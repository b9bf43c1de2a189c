"""Bags of ROS 1."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, Reader
from hexsim.readers.ros_messages import BadDefinition, Messages
from hexsim.readers.topics import Topics


class Ros1BagReader(Reader):
    """Fields of messages that are numbers, on the stamps of their topic: header time and time of receipt. Types by the
    definitions in the bag."""

    name = "ROS 1 bag"
    suffixes = (".bag",)
    needs = "ros"

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        from rosbags.rosbag1 import Reader as Bag

        topics, messages = Topics(), Messages(ros1=True)
        bag = Bag(path)
        bag.open()
        try:
            bag.chunks = {
                at: chunk._replace(decompressor=bounded(chunk.decompressor)) for at, chunk in bag.chunks.items()
            }
            decoders: dict[int, Callable[[bytes], Any] | None] = {}
            for connection, stamp_ns, data in bag.messages():
                if connection.id not in decoders:
                    decoders[connection.id] = self.decoder(connection, messages, topics)
                decode = decoders[connection.id]
                if decode is not None:
                    topics.add(connection.topic, stamp_ns, decode(data))
                if topics.is_full:
                    break
        finally:
            bag.close()
        return topics.raw(path)

    def decoder(self, connection: Any, messages: Messages, topics: Topics) -> Callable[[bytes], Any] | None:
        """Function from the bytes of a topic's message to its fields; None, with a reason, where the type is not known."""
        name = connection.msgtype
        try:
            messages.define(name, connection.msgdef.data)
        except BadDefinition as error:
            topics.left_out[connection.topic] = f"is not read: {error}"
            return None
        return messages.decoder(name)


def bounded(unpack: Callable[[bytes], bytes]) -> Callable[[bytes], bytes]:
    """The same decompressor, that unpacks no more than part."""
    kind = getattr(unpack, "__module__", "") or ""

    def limited(data: bytes) -> bytes:
        if "bz2" in kind:
            out = bz2.BZ2Decompressor().decompress(data, LARGEST.part)
        elif "lz4" in kind:
            from lz4.frame import LZ4FrameDecompressor

            out = LZ4FrameDecompressor().decompress(data, LARGEST.part)
        else:
            return unpack(data)
        if len(out) >= LARGEST.part:
            raise HexsimError(f"a chunk of the bag unpacks to more than {LARGEST.part >> 20} MB: save it again")
        return out

    return limited


READER = Ros1BagReader()
