"""A run as MCAP, for Foxglove, PlotJuggler and ROS tools: topics of JSON messages with their schemas, and the run's files.

| topic | message | rate |
|---|---|---|
| /measured, /truth | one field a column of the log, SI | the log's |
| /tf | foxglove.FrameTransform: the platform in the world | 50 Hz at most |
| /messages | foxglove.Log: what the compensators say | |

A missing value is null. Time counts from the start of the run. The configuration travels as metadata.
"""

from __future__ import annotations

import importlib.util
import json
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import scipy

from hexsim.errors import HexsimError
from hexsim.files.atomic import written_whole
from hexsim.recording.config import config_tables
from hexsim.signals.table import places
from hexsim.simulation import Run

POSE = (*(f"platform_{axis}_m" for axis in "xyz"), *(f"platform_{axis}_rad" for axis in ("roll", "pitch", "yaw")))


Message = tuple[float, int, str]  # time [s], leg, text


def write_mcap(run: Run, path: Path) -> None:
    """Write `run` to `path`. Raises HexsimError where the library mcap is missing or the file cannot be written."""
    write_log_as_mcap(run.log, path, config_tables(run), run.messages)


def write_log_as_mcap(
    log: pl.DataFrame, path: Path, config: Mapping[str, Any], messages: Sequence[Message] | None = None
) -> None:
    """A log alone. Columns that the table of signals does not know count as measured; without messages there is no topic of them.

    Raises HexsimError likewise, and for a log without rows or without time.
    """
    check_library()
    if "time_s" not in log.columns or not log.height or not log["time_s"].is_finite().all():
        raise HexsimError("the log needs a column time_s with a finite time in every row, and one row at least")
    from mcap.writer import CompressionType, Writer

    with written_whole(path) as begun, open(begun, "wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="", library="hexsim")
        for topic, schema, content in _topics(log, messages):
            fields = {"type": "object", "title": schema, "properties": _properties(schema, log)}
            schema_id = writer.register_schema(schema, "jsonschema", json.dumps(fields).encode())
            channel = writer.register_channel(topic, "json", schema_id)
            for stamp_ns, data in content:
                writer.add_message(channel, stamp_ns, data, stamp_ns)
        writer.add_metadata("config", {"config": json.dumps(config, default=str)})
        writer.finish()


def config_beside(log: Path) -> dict[str, Any]:
    """The configuration in the folder of a log, nothing where there is none."""
    try:
        return tomllib.loads((log.parent / "config.toml").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def check_library() -> None:
    """Raise HexsimError where the library mcap is missing."""
    if importlib.util.find_spec("mcap") is None:
        raise HexsimError("writing MCAP needs its library: pip install 'hexsim[ros]'")


def _topics(
    log: pl.DataFrame, messages: Sequence[Message] | None
) -> Iterator[tuple[str, str, Iterable[tuple[int, bytes]]]]:
    """Topic, name of its schema, and its messages (time [ns], JSON)."""
    for schema in ("hexsim.measured", "hexsim.truth"):
        if columns := _columns(schema, log):
            yield f"/{schema.partition('.')[2]}", schema, _rows(log, columns)
    if set(POSE) <= set(log.columns):
        yield "/tf", "foxglove.FrameTransform", _frames(log)
    if messages is not None:
        yield "/messages", "foxglove.Log", _messages(messages)


def _columns(schema: str, log: pl.DataFrame) -> list[str]:
    """Columns of the log that the topic holds."""
    measured = schema == "hexsim.measured"
    known = places()
    return [
        name
        for name in log.columns
        if name != "time_s" and (known[name][0].measured if name in known else True) == measured
    ]


def _rows(log: pl.DataFrame, columns: list[str]) -> Iterator[tuple[int, bytes]]:
    lines = log.select(columns).write_ndjson().splitlines()
    for stamp, line in zip(_stamps(log["time_s"].to_numpy()), lines, strict=True):
        yield stamp, line.encode()


def _stamps(time_s: Any) -> list[int]:
    return np.rint(np.asarray(time_s) * 1e9).astype(np.int64).tolist()


def _stamp(stamp_ns: int) -> dict[str, int]:
    return {"sec": stamp_ns // 1_000_000_000, "nsec": stamp_ns % 1_000_000_000}


def _frames(
    log: pl.DataFrame,
    *,
    frame_rate_Hz: float = 50.0,  # of poses: a viewer draws no more
) -> Iterator[tuple[int, bytes]]:
    """Poses of the platform, in the world whose origin is the platform's neutral place."""

    time = log["time_s"].to_numpy()
    every = max(1, round(1.0 / (frame_rate_Hz * (time[1] - time[0])))) if len(time) > 1 else 1
    poses = log.select(POSE).to_numpy()[::every]
    turns = scipy.spatial.transform.Rotation.from_euler("ZYX", poses[:, :2:-1]).as_quat()
    for stamp, pose, turn in zip(_stamps(time[::every]), poses.tolist(), turns.tolist(), strict=True):
        message = {
            "timestamp": _stamp(stamp),
            "parent_frame_id": "world",
            "child_frame_id": "platform",
            "translation": dict(zip("xyz", pose[:3], strict=True)),
            "rotation": dict(zip("xyzw", turn, strict=True)),
        }
        yield stamp, json.dumps(message).encode()


def _messages(said: Sequence[Message]) -> Iterator[tuple[int, bytes]]:
    """Level 3 is a warning in foxglove.Log."""
    for (stamp,), leg, text in ((_stamps([time_s]), leg, text) for time_s, leg, text in said):
        message = {
            "timestamp": _stamp(stamp),
            "level": 3,
            "message": text,
            "name": f"leg {leg}",
            "file": "",
            "line": 0,
        }
        yield stamp, json.dumps(message).encode()


def _properties(schema: str, log: pl.DataFrame) -> dict[str, Any]:
    """Fields of a schema, as Foxglove publishes its own."""
    number, text = {"type": "number"}, {"type": "string"}
    time = {"type": "object", "title": "time", "properties": {name: {"type": "integer"} for name in ("sec", "nsec")}}
    if schema == "foxglove.FrameTransform":
        vector, turn = (
            {"type": "object", "title": title, "properties": dict.fromkeys(axes, number)}
            for title, axes in (("foxglove.Vector3", "xyz"), ("foxglove.Quaternion", "xyzw"))
        )
        names = {"timestamp": time, "parent_frame_id": text, "child_frame_id": text}
        return {**names, "translation": vector, "rotation": turn}
    if schema == "foxglove.Log":
        integer = {"type": "integer"}
        return {"timestamp": time, "level": integer, "message": text, "name": text, "file": text, "line": integer}
    return dict.fromkeys(_columns(schema, log), number)
