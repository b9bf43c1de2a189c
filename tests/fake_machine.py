"""A machine behind packets that is no simulation of hexsim: integrators in a loop, without any monitor, that fail and lie.

Each leg is y' = K_v u, u = K_p (s - y_read) within the valve's volts, in steps of a millisecond. What it received is kept.
"""

from __future__ import annotations

import math
import socket
import struct
import threading
import time

import numpy as np

from hexsim.motion_computer import host_packet, monitors, states, telemetry
from hexsim.motion_computer.errors import Error

STEP_s = 1e-3
VISIBLE_m = 0.01
NEXT = {
    "start": states.State.NEUTRAL,
    "run_normal": states.State.NORMAL,
    "return_neutral": states.State.NEUTRAL,
    "settle": states.State.OFF,
}


def neutral_reply(**more) -> host_packet.Reply:
    """What a machine in neutral tells, that took the host's first packet at once. more: fields that differ."""
    zeros = dict.fromkeys(("time_s", "behind_s", "age_s"), 0.0) | dict.fromkeys(("pose", "reference"), (0.0,) * 6)
    told = {"state": states.State.NEUTRAL, "errors": Error.NONE, "sequence": 0, "arrived": True, "refused": False}
    return host_packet.Reply(**told | zeros | more)


class FakeMachine:
    """In a thread, at `address`; the machine's clock follows the host's packets, or the real one.

    fault, leg, at_s: what breaks, where (from 0), and when after the motion began. lie: what its packets say wrongly, from
    then on. rows: (state, setpoints (6,)) of every command, in order. visible_s, stopped_s: machine times at which the fault
    could be seen, and of the first command to stop after it. A valve can be seen once its leg is `VISIBLE_m` from where a
    healthy one would be. down_s: how long it takes to come down.
    """

    def __init__(self, machine, *, lockstep=True, fault="", leg=0, at_s=1.0, lie="", down_s=0.0):
        self.machine, self.lockstep, self.fault, self.leg, self.at_s, self.lie = (
            machine,
            lockstep,
            fault,
            leg,
            at_s,
            lie,
        )
        self.n, self.mechanics, self.down_s = machine.n_legs, machine.mechanics, down_s
        self.gain, self.limit = machine.of_legs("controller", "gain_V_per_m"), machine.of_legs("valve", "voltage_max_V")
        self.velocity_gain = monitors.velocity_gain(machine)
        self.stroke = machine.of_legs("cylinder", "stroke_m")
        self.position = self.mechanics.neutral_positions.copy()
        self.read, self.held, self.twin = self.position.copy(), None, self.position.copy()
        self.state, self.time_s, self.host_s, self.sequence = states.State.OFF, 0.0, None, 0
        self.moving_since_s = self.broke_s = self.visible_s = self.stopped_s = self.settling_s = None
        self.rows, self.random, self.packets = [], np.random.default_rng(0), 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.02)
        self.address = self._socket.getsockname()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *exc):
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def _run(self):
        while not self._ended.is_set():
            try:
                data, peer = self._socket.recvfrom(9000)
            except TimeoutError:
                continue
            except OSError:
                continue
            command = host_packet.unpack_command(data)
            if command is not None:
                self.packets += 1
                self._answer(command, peer)
            if self.lie == "dies" and self._lying:
                self._socket.close()
                return

    @property
    def _lying(self):
        return self.moving_since_s is not None and self.time_s - self.moving_since_s >= self.at_s

    def _answer(self, command: host_packet.HostCommand, peer):
        self.rows.append((self.state, np.array(command.setpoints)))
        if command.command in NEXT and not (self.state == states.State.OFF and command.command != "start"):
            if self.broke_s is not None and self.stopped_s is None and command.command in ("settle", "return_neutral"):
                self.stopped_s = self.time_s
            self.state = NEXT[command.command]
            if self.state == states.State.NORMAL:
                self.moving_since_s = self.time_s
            if self.state == states.State.OFF:
                self.state, self.settling_s = states.State.SETTLING, self.time_s
        elapsed = 0.01 if self.host_s is None else command.time_s - self.host_s
        self.host_s = command.time_s
        setpoint = self.mechanics.piston_positions(np.array(command.setpoints))
        rows = [self._step(setpoint) for _ in range(round(max(elapsed, 0.0) / STEP_s))]
        if self.state == states.State.SETTLING and self.time_s - self.settling_s >= self.down_s:
            self.state = states.State.OFF
        self._send(rows, command, peer)

    def _step(self, setpoint):
        self.time_s += STEP_s
        driven = self.state == states.State.NORMAL
        wanted = setpoint if driven else self.mechanics.neutral_positions
        faulty = self.fault and driven and self.time_s - self.moving_since_s >= self.at_s
        if faulty and self.broke_s is None:
            self.broke_s, self.held = self.time_s, self.read.copy()
        volts = np.clip(self.gain * (wanted - self.read), -self.limit, self.limit)
        acts, k = volts.copy(), self.leg
        if faulty:
            stuck = {"valve_open": self.limit[k], "valve_back": -self.limit[k], "valve_shut": 0.0, "valve_creeps": 0.3}
            acts[k] = stuck.get(self.fault, acts[k])
        self.position = np.clip(self.position + STEP_s * self.velocity_gain * acts, 0.0, self.stroke)
        healthy = np.clip(self.gain * (wanted - self.twin), -self.limit, self.limit)
        self.twin = self.twin + STEP_s * self.velocity_gain * healthy
        if faulty and self.fault == "at_end":
            self.position[k] = self.stroke[k]
        self.read = self.position + self.random.normal(0.0, 3e-6, self.n)
        supply, felt = self.machine.supply.pressure_Pa, self.random.normal(0.0, 0.02, 3)
        bottom = 0.6 * supply + self.random.normal(0.0, 4e3, self.n)
        if faulty:
            self.read[k] = {
                "encoder_frozen": self.held[k],
                "encoder_nan": math.nan,
                "encoder_jumps": self.read[k] + 0.05,
            }.get(self.fault, self.read[k])
            supply = 0.1 * supply if self.fault == "supply" else supply
            bottom[k] = 1e5 if self.fault == "pressure" else bottom[k]
            felt[0] += 40.0 if self.fault == "jolt" else 0.0
        hidden = self.fault.startswith("valve") and abs(self.position[k] - self.twin[k]) < VISIBLE_m
        if faulty and not hidden and self.visible_s is None:
            self.visible_s = self.time_s
        shown = wanted if self.fault != "other_setpoint" or not faulty else self.mechanics.neutral_positions + 0.06
        acceleration = felt if self.machine.is_hexapod else [felt[0], math.nan, math.nan]
        nothing = np.full(self.n, math.nan)
        return np.concatenate([shown, self.read, bottom, nothing, volts, [supply], acceleration, np.full(3, math.nan)])

    def _send(self, rows, command, peer):
        lie = self.lie if self._lying or self.lie in ("version", "nonsense", "short", "state_always") else ""
        if lie in ("inf", "nan", "zero", "same"):
            value = {"inf": math.inf, "nan": math.nan, "zero": 0.0, "same": 0.1}[lie]
            rows = [np.full_like(row, value) for row in rows]
        if lie == "huge":
            rows = [1e6 * row for row in rows]
        times = {
            "clock_nan": math.nan,
            "clock_inf": math.inf,
            "clock_negative": -5.0,
            "clock_still": self.at_s,
            "clock_jumps": self.time_s + 1e6,
            "clock_back": 0.5 * self.time_s,
        }
        if lie not in ("silent", "no_telemetry"):
            first_s = self.time_s - len(rows) * STEP_s
            for k in range(0, len(rows), 4):
                packet = telemetry.Telemetry(
                    n_legs=self.n,
                    sequence=self.sequence,
                    time_s=first_s + k * STEP_s,
                    rate_Hz=1.0 / STEP_s,
                    rows=np.array(rows[k : k + 4]),
                ).pack()
                self.sequence += 1
                for _ in range(3000 if lie == "flood" else 1):
                    self._socket.sendto(packet, peer)
        if lie == "silent" or (lie == "flood" and self.packets % 2):
            return
        reply = host_packet.Reply(
            state=self.state,
            errors=Error.NONE,
            sequence=command.sequence,
            arrived=self.state != states.State.SETTLING,
            refused=False,
            time_s=times.get(lie, self.time_s),
            behind_s=0.0,
            age_s=0.0,
            pose=(0.0,) * 6,
            reference=(0.0,) * 6,
            lockstep=self.lockstep,
            telemetry=True,
        ).pack()
        if lie == "version":
            reply = b"HXS9" + reply[4:]
        elif lie == "short":
            reply = reply[:50]
        elif lie == "nonsense":
            reply = bytes(self.random.integers(0, 256, 136, dtype=np.uint8))
        elif lie in ("state", "state_always"):
            reply = reply[:4] + struct.pack("<H", 99) + reply[6:]
        self._socket.sendto(reply, peer)
        if not self.lockstep and lie == "flood":
            time.sleep(0.0)
