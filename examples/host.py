"""A host computer: starts the machine, plays a heave of 30 mm at 0.5 Hz at 60 packets a second, and settles it.

    hexsim serve --start off          (in one terminal; or let this example start it)
    python examples/host.py           (in another)

The packet layout of `hexsim.motion_computer.host_packet` is all that is needed to drive the machine; what leaves the host
passes the limiter of the machine file first (`hexsim.motion_computer.host_limiter`).
"""

from __future__ import annotations

import argparse
import contextlib
import socket
import threading
import time

import numpy as np

import hexsim as hx
from hexsim.motion_computer.host_limiter import HostLimiter
from hexsim.motion_computer.host_packet import REPLY, HostCommand, Reply, unpack_reply
from hexsim.motion_computer.states import State
from hexsim.packets import HOST_PORT
from hexsim.simulation.serve import Server

MACHINE = "micro_motion_system"


class Host:
    """Sends setpoints at a steady rate and keeps the newest reply."""

    def __init__(self, address: tuple[str, int], rate_Hz: float) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.address, self.period_s = address, 1.0 / rate_Hz
        self.sequence, self.started = 0, time.perf_counter()
        self.reply: Reply | None = None

    def send(self, heave_m: float = 0.0, command: str = "none") -> None:
        """One packet, then wait for the next one's time and read what came back."""
        now = time.perf_counter() - self.started
        setpoints = (0.0, 0.0, heave_m, 0.0, 0.0, 0.0)
        packet = HostCommand(sequence=self.sequence, time_s=now, setpoints=setpoints, command=command)
        self.socket.sendto(packet.pack(), self.address)
        self.sequence += 1
        time.sleep(max(0.0, self.sequence * self.period_s - (time.perf_counter() - self.started)))
        with contextlib.suppress(OSError):
            while True:
                reply = unpack_reply(self.socket.recv(REPLY.size + 1))
                self.reply = reply if isinstance(reply, Reply) else self.reply

    def close(self) -> None:
        self.socket.close()

    def until(self, state: State, command: str = "none", timeout_s: float = 30.0) -> None:
        """Give a command and wait for a state to be reached."""
        self.send(command=command)
        end = time.perf_counter() + timeout_s
        while not (self.reply and self.reply.state == state and self.reply.arrived):
            if time.perf_counter() > end:
                raise TimeoutError(
                    f"{state.name.lower()} not reached in {timeout_s:g} s; the last reply was {self.reply}"
                )
            self.send()


def motion(seconds: float, period_s: float) -> np.ndarray:
    """Setpoints (m, 6), a row a packet: a heave that begins and ends at neutral, within the limits of the machine."""
    elapsed = np.arange(0.0, seconds, period_s)
    fade = np.minimum(np.minimum(elapsed, seconds - elapsed) / 2.0, 1.0)
    rows = np.zeros((len(elapsed), 6))
    rows[:, 2] = fade**3 * (10 - 15 * fade + 6 * fade**2) * 0.03 * np.sin(np.pi * elapsed)
    return HostLimiter(hx.load_machine(MACHINE), period_s=period_s).limit(rows)


def drive(host: Host, seconds: float) -> float:
    """Start, move, settle; returns the largest heave [m] that the machine reported."""
    host.until(State.NEUTRAL, "start")
    print(f"neutral at machine time {host.reply.time_s:.2f} s")
    host.send(command="run_normal")
    highest = 0.0
    for row in motion(seconds, host.period_s):
        host.send(heave_m=row[2])
        if host.reply:
            highest = max(highest, host.reply.pose[2])
    print(f"highest heave {1000 * highest:.1f} mm of 30 mm commanded; state {host.reply.state.name.lower()}")
    host.until(State.OFF, "settle")
    print(f"settled at machine time {host.reply.time_s:.2f} s, {1000 * host.reply.behind_s:.1f} ms behind real time")
    return highest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--port", type=int, default=None, help=f"of a running `hexsim serve` (usually {HOST_PORT}); else start one here"
    )
    parser.add_argument("--seconds", type=float, default=6.0, help="how long to move")
    parser.add_argument("--rate", type=float, default=60.0, help="packets a second [Hz]")
    arguments = parser.parse_args()
    if arguments.port is not None:
        with contextlib.closing(Host(("127.0.0.1", arguments.port), arguments.rate)) as host:
            drive(host, arguments.seconds)
        return
    stop = threading.Event()
    with Server(hx.load_machine(MACHINE), port=0, start="off") as server:
        thread = threading.Thread(target=server.run, kwargs={"stop": stop})
        thread.start()
        try:
            with contextlib.closing(Host(server.address, arguments.rate)) as host:
                drive(host, arguments.seconds)
        finally:
            stop.set()
            thread.join()
    print(f"the machine could run {server.status.margin:.1f} times as fast as real time")


if __name__ == "__main__":
    main()
