"""MCAP files: messages in JSON, or ROS 2's (CDR) by the definitions that the file carries."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from hexsim.errors import HexsimError
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import LARGEST, RawLog, Reader
from hexsim.readers.ros_messages import BadDefinition, Messages
from hexsim.readers.topics import Topics


class McapReader(Reader):
    """Fields of messages that are numbers, on the stamps of their topic: header time and time of receipt."""

    name = "MCAP"
    suffixes = (".mcap",)
    needs = "ros"

    def read(self, path: Path, layout: FileLayout) -> RawLog:
        topics = Topics()
        self.collect(path, topics)
        return topics.raw(path)

    def collect(
        self,
        path: Path,
        topics: Topics,
        *,
        most_json_bytes: int = 1 << 20,  # bytes of a message: an image, not a measurement
    ) -> None:
        """Messages of a file."""
        schemas, channels, decoders = {}, {}, {}
        with open(path, "rb") as stream:
            for record in records(stream, path, topics):
                kind = type(record).__name__
                if kind == "Schema":
                    schemas[record.id] = record
                elif kind == "Channel":
                    channels[record.id] = record
                elif kind == "Message" and record.channel_id in channels:
                    channel = channels[record.channel_id]
                    if channel.id not in decoders:
                        found = decoder(schemas.get(channel.schema_id), channel)
                        decoders[channel.id] = found
                        if isinstance(found, str):
                            topics.left_out[channel.topic] = found
                    decode = decoders[channel.id]
                    if decode is json.loads and len(record.data) > most_json_bytes:
                        topics.left_out[channel.topic] = (
                            f"has messages of more than {most_json_bytes >> 20} MB: not read"
                        )
                    elif not isinstance(decode, str):
                        topics.add(channel.topic, record.publish_time, decode(record.data))
                        if topics.is_full:
                            break


def records(stream: Any, path: Path, topics: Topics) -> Iterator[Any]:
    """Records of a file one after the other, those of its chunks unpacked. Sizes are asked before anything is unpacked."""
    from mcap.exceptions import EndOfFile, RecordLengthLimitExceeded
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    size = 0
    try:
        for record in StreamReader(stream, emit_chunks=True, record_size_limit=LARGEST.part).records:
            if not isinstance(record, Chunk):
                yield record
                continue
            size += record.uncompressed_size
            if record.uncompressed_size > LARGEST.part or size > LARGEST.log:
                raise HexsimError(
                    f"{path} unpacks to more than {LARGEST.part >> 20} MB in one chunk or {LARGEST.log >> 20} MB in all: "
                    "cut it (mcap filter)"
                )
            record.data, record.compression = unpacked(record), ""
            yield from breakup_chunk(record)
    except EndOfFile:
        if not topics.cells:
            raise
        topics.cut = f"{path.name} ends within a record: what stands before was read"
    except RecordLengthLimitExceeded as error:
        raise HexsimError(f"{path} has a record of more than {LARGEST.part >> 20} MB: {error}") from None


def unpacked(chunk: Any) -> bytes:
    """Bytes of a chunk, no more than it says."""
    if chunk.compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as file:
            return file.read(chunk.uncompressed_size)
    if chunk.compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        return LZ4FrameDecompressor().decompress(chunk.data, max_length=chunk.uncompressed_size)
    if chunk.compression:
        raise ValueError(f"compression {chunk.compression[:20]!r} is not known")
    return chunk.data


def decoder(schema: Any, channel: Any) -> Callable[[bytes], Any] | str:
    """Function from the bytes of a channel's message to its fields; why not, as the rest of a sentence, where there is none."""
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding != "cdr":
        return f"is in {channel.message_encoding or 'no encoding'}: not read"
    if schema is None:
        return "is CDR without a schema: not read"
    messages = Messages()
    name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/")
    if schema.encoding == "ros2msg":
        try:
            messages.define(name, schema.data.decode())
        except BadDefinition as error:
            return f"is not read: {error}"
        return messages.decoder(name)
    return f"is CDR with a {schema.encoding or 'missing'} schema of {name[:60]}: not read"


READER = McapReader()
