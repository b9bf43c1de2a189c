"""`serve --stream`: the signals of every control tick as JSON by UDP."""

import json
import socket

import pytest
from typer.testing import CliRunner

from hexsim.cli import app
from hexsim.errors import HexsimError
from hexsim.signals.table import table
from hexsim.simulation.serve import Server
from hexsim.simulation.stream import PORT, JsonStream, stream_address

TICKS = 40


@pytest.mark.parametrize("name", ["bench", "hexapod"])
def test_every_tick_is_a_row_of_the_logs_columns(name, request):
    """Each control tick sends one object: machine time in steps of a tick, and columns of the log with what the server read."""
    machine = request.getfixturevalue(name)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind(("127.0.0.1", 0))
        there.settimeout(5.0)
        rows = []
        with Server(machine, port=0, stream=JsonStream(there.getsockname())) as server:
            for _ in range(TICKS):
                server.tick()
                rows.append(json.loads(there.recv(65536)))
    n = machine.n_legs
    stems = ("setpoint", "position", "pressure_bottom", "valve", "compensation", "pressure_supply", "true_acceleration")
    wanted = {column for stem in stems for column in table()[stem].columns(n)} | {"timestamp", "state"}
    assert wanted <= rows[0].keys()
    steps = [b["timestamp"] - a["timestamp"] for a, b in zip(rows, rows[1:], strict=False)]
    assert steps == pytest.approx([1.0 / machine.controller.rate_Hz] * (TICKS - 1))
    positions = [rows[-1][column] for column in table()["position"].columns(n)]
    assert positions == pytest.approx(list(server._positions), abs=1e-9)
    assert rows[-1]["state"] == "neutral"


def test_addresses(capsys):
    """An address alone has PlotJuggler's port; what is none is refused in one sentence, by the command with exit code 2."""
    assert stream_address("127.0.0.1") == ("127.0.0.1", PORT)
    assert stream_address("127.0.0.1:5000") == ("127.0.0.1", 5000)
    for text in ("", ":5000", "127.0.0.1:", "127.0.0.1:70000", "127.0.0.1:x"):
        with pytest.raises(HexsimError, match="--stream"):
            stream_address(text)
    done = CliRunner().invoke(app, ["serve", "bench", "--stream", "127.0.0.1:x", "--duration", "0.1"])
    assert done.exit_code == 2
