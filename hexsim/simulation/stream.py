"""A served machine's signals as they come, for PlotJuggler and whatever else reads JSON over UDP.

One datagram a control tick: a JSON object of the log's columns (docs/log_columns.md), and `timestamp` [s], machine time.
"""

from __future__ import annotations

import json
import math
import socket
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexsim.packets import address_of
from hexsim.plant.readout import platform_signals
from hexsim.signals.table import table
from hexsim.simulation.live_sensors import Readings

Array = NDArray[np.float64]
PORT = 9870  # PlotJuggler's UDP server listens there by default


def stream_address(text: str) -> tuple[str, int]:
    """ADDRESS, or ADDRESS:PORT. Raises HexsimError."""
    return address_of(text, PORT, f"--stream {text!r}", f"ADDRESS or ADDRESS:PORT, as 127.0.0.1:{PORT}")


class JsonStream:
    """Sends what a server's machine does. Nobody has to listen: a datagram that is lost is lost."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.address = address
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)

    def close(self) -> None:
        """No more datagrams."""
        self.socket.close()

    def send(self, server: Any, volts: Array, readings: Readings) -> None:
        """The present tick of a `serve.Server`: setpoints, readings, volts, and the true acceleration at its end."""
        plant, computer = server.plant, server.computer
        position, bottom, supply, top = readings
        signals = {
            "setpoint": computer.setpoint, "position": position, "pressure_bottom": bottom, "valve": volts,
            "compensation": computer.compensation, "pressure_supply": np.array([supply]),
        }  # fmt: skip
        if top is not None:
            signals["pressure_top"] = top
        data = plant.data
        true = platform_signals(plant, data.qpos[None], data.qvel[None], data.qacc[None])
        signals["true_acceleration"] = true.acceleration[0]
        if plant.n_legs > 1:
            signals["true_angular_acceleration"] = true.angular_acceleration[0]
        row: dict[str, float | str | None] = {"timestamp": server.time_s, "state": computer.state.name.lower()}
        for stem, values in signals.items():
            names = table()[stem].columns(plant.n_legs)
            row |= {name: _number(value) for name, value in zip(names, values, strict=False)}
        try:
            self.socket.sendto(json.dumps(row).encode(), self.address)
        except OSError:  # nobody there, or no room: the machine does not wait for who looks on
            return


def _number(value: float) -> float | None:
    """JSON has no NaN: a lost transducer is null."""
    return float(value) if math.isfinite(value) else None
