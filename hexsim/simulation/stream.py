"""A machine's signals as they come, for people who look on: PlotJuggler, Foxglove, Rerun.

One row a control tick: columns of the log (docs/log_columns.md), `state` where there is one, and machine time. Nobody has to
look: the machine waits for nobody, and what cannot be sent is lost.

| address | what it is |
|---|---|
| ADDRESS:PORT | a JSON object a row, by UDP, with `timestamp` [s]: PlotJuggler's UDP server |
| foxglove://ADDRESS:PORT | a websocket that Foxglove opens; topic /hexsim, layout in `LAYOUT` |
| rerun+http://ADDRESS:PORT/proxy | a Rerun viewer that runs there |
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import socket
import threading
import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hexsim.errors import HexsimError
from hexsim.packets import address_of
from hexsim.plant.readout import platform_signals
from hexsim.signals.table import table
from hexsim.simulation.live_sensors import Readings

Array = NDArray[np.float64]
Row = dict[str, float | str | None]
PORT, FOXGLOVE_PORT = 9870, 8765  # PlotJuggler's UDP server listens there by default; Foxglove asks there
ALLOWED = f"127.0.0.1:{PORT} (PlotJuggler), foxglove://127.0.0.1:{FOXGLOVE_PORT} or rerun+http://127.0.0.1:9876/proxy"
FOXGLOVE, RERUN = "foxglove://", "rerun+http"
LAYOUT = Path(__file__).with_name("foxglove_layout.json")
FLUSH_s = 2.0  # for a viewer that is slow


class Stream(Protocol):
    """What takes rows."""

    def row(self, time_s: float, values: Row) -> None: ...

    def close(self) -> None: ...


def open_stream(text: str) -> Stream:
    """The stream at an address as people type it. Raises HexsimError: no such form, no such address, a package that is missing."""
    if text.startswith(FOXGLOVE):
        return FoxgloveStream(_address(text, text.removeprefix(FOXGLOVE), FOXGLOVE_PORT))
    if text.startswith(RERUN):
        return RerunStream(text)
    return JsonStream(_address(text, text, PORT))


def _address(text: str, place: str, port: int) -> tuple[str, int]:
    return address_of(place, port, f"--stream {text!r}", ALLOWED)


class JsonStream:
    """Datagrams. Nobody has to listen: one that is lost is lost."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.address = address
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)

    def close(self) -> None:
        """No more datagrams."""
        self.socket.close()

    def row(self, time_s: float, values: Row) -> None:
        try:
            self.socket.sendto(json.dumps({"timestamp": time_s, **values}).encode(), self.address)
        except OSError:  # nobody there, or no room: the machine does not wait for who looks on
            return


class FoxgloveStream:
    """A websocket server; whoever reaches its port may look on, and can do nothing else. Times count from the machine's start.

    The port is held from the beginning and answers from the first row on: foxglove-sdk refuses who subscribes to a topic in the
    moment in which it is made ("Unknown channel ID"), so nobody may be there then.
    """

    def __init__(self, address: tuple[str, int]) -> None:
        try:
            import foxglove
        except ModuleNotFoundError:
            raise HexsimError(f"--stream {FOXGLOVE} needs its library: pip install 'hexsim[foxglove]'") from None
        self.foxglove, self.context = foxglove, foxglove.Context()
        self.channel: Any = None
        self.server: Any = None
        self.held = socket.socket(socket.AF_INET6 if ":" in address[0] else socket.AF_INET)
        if os.name == "posix":  # elsewhere it would take the port from another program
            self.held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self.held.bind(address)
        except OSError as error:
            self.held.close()
            raise self._refused(address, error) from None
        self.address = (address[0], int(self.held.getsockname()[1]))

    @staticmethod
    def _refused(address: tuple[str, int], error: Exception) -> HexsimError:
        return HexsimError(f"cannot listen on {address[0]}:{address[1]} for Foxglove: {error}; give a free port")

    def close(self) -> None:
        """Let the lookers on go."""
        self.held.close()
        if self.server is not None:
            within(FLUSH_s, self.server.stop)

    def row(self, time_s: float, values: Row) -> None:
        if self.channel is None:
            self.channel = self._open(values)
        self.channel.log(values, log_time=round(1e9 * time_s))

    def _open(self, values: Row) -> Any:
        """Make the topic of these columns, then let people in; the topic."""
        kinds = {name: {"type": "string" if isinstance(value, str) else "number"} for name, value in values.items()}
        schema = {"type": "object", "title": "hexsim", "properties": kinds}
        channel = self.foxglove.Channel("/hexsim", schema=schema, message_encoding="json", context=self.context)
        self.held.close()
        host, port = self.address
        try:
            self.server = self.foxglove.start_server(name="hexsim", host=host, port=port, context=self.context)
        except (OSError, RuntimeError) as error:
            raise self._refused(self.address, error) from None
        return channel


class RerunStream:
    """To a viewer at its address, a batch every `batch_s` on the time line `time`."""

    def __init__(self, url: str) -> None:
        import rerun

        place = urlsplit(url)
        try:
            whole = place.scheme in ("rerun+http", "rerun+https") and place.hostname and place.port
        except ValueError:  # a port that is none
            whole = False
        if not whole:
            raise HexsimError(f"--stream {url!r}: give {ALLOWED}")
        self.rerun, self.recording = rerun, rerun.RecordingStream("hexsim")
        within(FLUSH_s, lambda: self.recording.connect_grpc(url))
        self.times: list[float] = []
        self.columns: dict[str, list[float]] = {}

    def close(self) -> None:
        """Send what is left; the library says where no viewer was there."""
        self._send()
        with contextlib.suppress(RuntimeError):
            self.recording.flush(timeout_sec=FLUSH_s)
        within(FLUSH_s, self.recording.disconnect)

    def row(
        self,
        time_s: float,
        values: Row,
        *,
        batch_s: float = 0.1,  # rows that go to Rerun at once: a call for each number would take longer than a tick
    ) -> None:
        if self.times and not self.times[0] <= time_s < self.times[0] + batch_s:
            self._send()
        self.times.append(time_s)
        for name, value in values.items():
            if not isinstance(value, str):
                self.columns.setdefault(name, []).append(math.nan if value is None else value)

    def _send(self) -> None:
        if not self.times:
            return
        index = self.rerun.TimeColumn("time", duration=self.times)
        for name, numbers in self.columns.items():
            if len(numbers) == len(self.times):
                self.recording.send_columns(name, indexes=[index], columns=self.rerun.Scalars.columns(scalars=numbers))
        self.times, self.columns = [], {}


def within(seconds: float, close: Callable[[], object]) -> None:
    """Call `close` of a viewer's library and wait for it no longer than this: nobody's machine waits for a viewer."""
    closing = threading.Thread(target=close, daemon=True)
    closing.start()
    closing.join(seconds)


def tick_row(plant: Any, loop: Any, volts: Array, readings: Readings, state: str = "") -> Row:
    """The present tick: setpoints and compensation of a loop, what it has read, its volts, the true acceleration at its end."""
    position, bottom, supply, top = readings
    signals = {
        "setpoint": loop.setpoint,
        "position": position,
        "pressure_bottom": bottom,
        "valve": volts,
        "compensation": loop.compensation,
        "pressure_supply": np.array([supply]),
    }
    if top is not None:
        signals["pressure_top"] = top
    data = plant.data
    true = platform_signals(plant, data.qpos[None], data.qvel[None], data.qacc[None])
    signals["true_acceleration"] = true.acceleration[0]
    if plant.n_legs > 1:
        signals["true_angular_acceleration"] = true.angular_acceleration[0]
    row: Row = {"state": state} if state else {}
    for stem, values in signals.items():
        names = table()[stem].columns(plant.n_legs)
        row |= {name: _number(value) for name, value in zip(names, values, strict=False)}
    return row


def play_log(log: pl.DataFrame, stream: Stream, stopped: Callable[[], bool] = lambda: False) -> None:
    """A log's rows in real time, until its end or until `stopped`."""
    begun = clock.monotonic()
    for row in log.iter_rows(named=True):
        time_s = row.pop("time_s")
        wait_s = begun + time_s - log["time_s"][0] - clock.monotonic()
        if wait_s > 0.0:
            clock.sleep(wait_s)
        if stopped():
            return
        stream.row(time_s, {name: _number(value) for name, value in row.items()})


def _number(value: float) -> float | None:
    """JSON has no NaN: a lost transducer is null."""
    return float(value) if value is not None and math.isfinite(value) else None
