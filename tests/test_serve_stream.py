"""`--stream`: the signals of every control tick, for PlotJuggler, Foxglove and Rerun."""

import contextlib
import json
import re
import socket
import struct
import time

import polars as pl
import pytest
from typer.testing import CliRunner
from websockets.typing import Subprotocol

from hexsim import HexsimError
from hexsim.cli import app
from hexsim.signals import table as signal_table
from hexsim.simulation import live, serve
from hexsim.simulation import stream as stream_module

TICKS = 40


@pytest.mark.parametrize("name", ["bench", "hexapod"])
def test_every_tick_is_a_row_of_the_logs_columns(name, request):
    """Each control tick sends one object: machine time in steps of a tick, and columns of the log with what the server read."""
    machine = request.getfixturevalue(name)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind(("127.0.0.1", 0))
        there.settimeout(5.0)
        rows = []
        with serve.Server(machine, port=0, stream=stream_module.JsonStream(there.getsockname())) as server:
            for _ in range(TICKS):
                server.tick()
                rows.append(json.loads(there.recv(65536)))
    n = machine.n_legs
    stems = ("setpoint", "position", "pressure_bottom", "valve", "compensation", "pressure_supply", "true_acceleration")
    wanted = {column for stem in stems for column in signal_table.table()[stem].columns(n)} | {"timestamp", "state"}
    assert wanted <= rows[0].keys()
    steps = [b["timestamp"] - a["timestamp"] for a, b in zip(rows, rows[1:], strict=False)]
    assert steps == pytest.approx([1.0 / machine.controller.rate_Hz] * (TICKS - 1))
    positions = [rows[-1][column] for column in signal_table.table()["position"].columns(n)]
    assert positions == pytest.approx(list(server._positions), abs=1e-9)
    assert rows[-1]["state"] == "neutral"


def test_a_live_machine_sends_the_same_columns(bench):
    """The machine of `hexsim live` sends a row a control tick, with the columns of `serve` but for the state."""
    rows = []

    class Kept:
        def row(self, time_s, values):
            rows.append((time_s, values))

        def close(self):
            pass

    live.LiveMachine(bench, stream=Kept()).advance(0.02)
    assert [time for time, _ in rows] == pytest.approx([0.002 * (k + 1) for k in range(10)])
    assert {"setpoint_m", "position_m", "valve_V", "true_acceleration_m_s2"} <= rows[0][1].keys()
    assert "state" not in rows[0][1]


def test_a_log_is_played_as_it_was_logged():
    """Each row of a log with its time; a value that is missing is none."""
    log, rows = pl.DataFrame({"time_s": [0.0, 0.001, 0.002], "position_m": [0.1, 0.2, float("nan")]}), []

    class Kept:
        def row(self, time_s, values):
            rows.append((time_s, values["position_m"]))

        def close(self):
            pass

    stream_module.play_log(log, Kept())
    assert rows == [(0.0, 0.1), (0.001, 0.2), (0.002, None)]


def test_foxglove_sees_the_rows():
    """The port is taken at once and lets nobody in before the first row, so that the topic is there for whoever comes; a client
    of the websocket is offered /hexsim, and after it has subscribed it gets each row with its time."""
    pytest.importorskip("foxglove")
    from websockets.sync.client import connect

    stream = stream_module.FoxgloveStream(("127.0.0.1", 0))
    try:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(stream.address)
        stream.row(0.5, {"position_m": 0.1, "state": "normal"})
        with pytest.raises(HexsimError, match=r"cannot listen on 127\.0\.0\.1:\d+ for Foxglove"):
            stream_module.FoxgloveStream(stream.address)
        with connect(f"ws://127.0.0.1:{stream.address[1]}", subprotocols=[Subprotocol("foxglove.sdk.v1")]) as client:
            offered = {}
            while offered.get("op") != "advertise":
                offered = json.loads(client.recv(timeout=5.0))
            [channel] = offered["channels"]
            assert channel["topic"] == "/hexsim" and "position_m" in channel["schema"]
            asked = {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channel["id"]}]}
            client.send(json.dumps(asked))
            data = b""
            for k in range(200):  # until the subscription is there
                stream.row(0.502 + 0.002 * k, {"position_m": 0.2, "state": "normal"})
                with contextlib.suppress(TimeoutError):
                    data = client.recv(timeout=0.05)
                    break
        assert isinstance(data, bytes) and data[0] == 1
        assert json.loads(data[13:]) == {"position_m": 0.2, "state": "normal"}
        assert 0.5e9 < struct.unpack_from("<Q", data, 5)[0] < 1.0e9
    finally:
        stream.close()


def test_the_layout_shows_columns_that_are_sent():
    """Every path of the layout in the package is a column of the log, of a bench or of a hexapod."""
    paths = re.findall(r'"value": "/hexsim\.(\w+)"', stream_module.LAYOUT.read_text())
    known = {column for signal in signal_table.table().values() for n in (1, 6) for column in signal.columns(n)}
    assert len(paths) > 30 and set(paths) <= known


def test_rerun_gets_every_number(tmp_path, monkeypatch):
    """Rows of half a second, to a file in the place of a viewer: each number of each column is sent once, at its time, in fewer
    than ten calls a second."""
    import rerun as rr

    monkeypatch.setattr(rr.RecordingStream, "connect_grpc", lambda self, url: None)
    stream, sent = stream_module.RerunStream("rerun+http://127.0.0.1:9/proxy"), []
    stream.recording.save(tmp_path / "rows.rrd")
    column, columns = rr.TimeColumn, rr.Scalars.columns
    monkeypatch.setattr(
        rr, "TimeColumn", lambda name, duration: sent.append(list(duration)) or column(name, duration=duration)
    )
    monkeypatch.setattr(rr.Scalars, "columns", lambda scalars: sent.append(list(scalars)) or columns(scalars=scalars))
    for k in range(250):
        stream.row(0.002 * k, {"position_m": 0.001 * k, "state": "normal"})
    stream.close()
    times, values = ([x for batch in sent[i::2] for x in batch] for i in (0, 1))
    assert times == pytest.approx([0.002 * k for k in range(250)])
    assert values == pytest.approx([0.001 * k for k in range(250)]) and len(sent) <= 12
    assert (tmp_path / "rows.rrd").stat().st_size > 1000


def test_without_a_viewer_nothing_is_raised(monkeypatch):
    """Rerun's address with nobody at it: beginning, rows and end pass, and wait no longer for it than they should (0.2 s each here;
    the library alone waits for 5 s)."""
    import rerun  # noqa: F401  # before the clock starts

    monkeypatch.setattr(stream_module, "FLUSH_s", 0.2)
    begun = time.monotonic()
    stream = stream_module.open_stream("rerun+http://127.0.0.1:9/proxy")
    stream.row(0.0, {"position_m": 0.1, "pressure_top_Pa": None})
    stream.close()
    assert time.monotonic() - begun < 4.0


def test_addresses(capsys):
    """An address alone has PlotJuggler's port; what is none is refused in one sentence, by the command with exit code 2."""
    for text, address in (("127.0.0.1", ("127.0.0.1", stream_module.PORT)), ("127.0.0.1:5000", ("127.0.0.1", 5000))):
        stream = stream_module.open_stream(text)
        stream.close()
        assert isinstance(stream, stream_module.JsonStream) and stream.address == address
    wrong = (
        "",
        ":5000",
        "127.0.0.1:",
        "127.0.0.1:70000",
        "127.0.0.1:x",
        "foxglove://:1",
        "rerun+http://x",
        "rerun+http://x:y/proxy",
    )
    for text in wrong:
        with pytest.raises(HexsimError, match="--stream"):
            stream_module.open_stream(text)
    for command in (["serve", "-m", "bench"], ["run", "heave"], ["live", "heave"]):
        done = CliRunner().invoke(app, [*command, "--stream", "127.0.0.1:x"])
        assert done.exit_code == 2 and "--stream" in done.output
