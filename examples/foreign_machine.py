"""A motion computer with a machine behind it that is none of hexsim's: one cylinder on a bench, spoken to by packets alone.

    python examples/foreign_machine.py --port 47120
    hexsim identify bench --host 127.0.0.1:47120 --compensate --out found

It imports nothing of hexsim; docs/motion_computer.md is all that it was written from. Take it as a template for your own machine.
Its time follows the host's packets (lockstep): a packet of host time t runs it to t.
Setpoints are played on a cubic B-spline through the last four packets, one packet late: straight lines would jolt at each
packet. The piston leaks, and `hexsim identify bench` is not told so: `--leak 0`
has none. A compensator that is asked for by HXP2 is of the package `compensation`, which knows numpy and numba and no hexsim;
where it is not installed, the request is refused. It sees 28 ms ahead: with it setpoints are played so much later.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import json
import math
import random
import socket
import struct
import zlib

OFF, STARTING, NEUTRAL, NORMAL, SETTLING, FAULT = 0, 1, 2, 4, 5, 6  # of a reply
START, RUN_NORMAL, RETURN_NEUTRAL, SETTLE, RESET = 1, 3, 4, 5, 6  # of a command
LEG_ERROR, HOST_ERROR, WORKSPACE = 1, 16, 32
COMMAND, REPLY = struct.Struct("<4sHHIId6d"), struct.Struct("<4sHHIIddd6d6d")
ROW = struct.Struct("<4sHHIIdd12d")  # telemetry of one leg, one row a packet
PIECE, PART, LONGEST = struct.Struct("<4sHHHHII"), 1200, 32768  # of a compensator's request

TICK_s, STEPS = 0.002, 20  # of the motion computer; of the machine within it
STROKE_m, NEUTRAL_m, REACH_m = 0.2, 0.1, 0.085  # a setpoint may leave neutral by so much
FASTEST_m_s, MOVE_m_s, LOWER_m_s, REST_m_s = 0.3, 0.05, 0.04, 1e-3
FOLLOW_m, SILENT_s = 0.05, 0.25  # leg error, and silence of the host, that are faults
GAIN_V_m, VOLTS = 50.0, 10.0
SUPPLY_Pa, DENSITY, BULK_Pa, DISCHARGE = 7.0e6, 860.0, 1.5e9, 0.611
BOTTOM_m2, TOP_m2, PIPE_m3, MASS_kg, GRAVITY = math.pi / 4 * 0.04**2, math.pi / 4 * (0.04**2 - 0.03**2), 5e-7, 40.0, 9.8
SPOOL_1_s, DAMPING, SPOOL_m_V, OVERLAP_m, WIDTH_m = 2 * math.pi * 60.0, 0.7, 1.1e-4, 5e-6, math.pi * 0.01
VISCOUS, COULOMB = (1800.0, 2200.0), (60.0, 65.0)  # in, out
STATIC, STRIBECK_m_s, SHARP_m_s = 30.0, 5e-3, 2e-4


class Cylinder:
    """A piston under the load, a three-way valve with overlap, the supply on the rod side. Semi-implicit Euler steps."""

    def __init__(self, leak_m3_s_Pa: float) -> None:
        self.leak, self.y, self.v, self.spool, self.rate = leak_m3_s_Pa, 0.002, 0.0, 0.0, 0.0
        self.pressure = (MASS_kg * GRAVITY + SUPPLY_Pa * TOP_m2) / BOTTOM_m2

    def step(self, volts: float, h: float) -> None:
        """One step of h seconds under the valve's volts."""
        pull = SPOOL_1_s**2 * (SPOOL_m_V * volts - self.spool)
        self.rate = (self.rate + h * pull) / (1.0 + 2.0 * DAMPING * SPOOL_1_s * h)
        self.spool += h * self.rate
        opening = WIDTH_m * max(abs(self.spool) - OVERLAP_m, 0.0)
        drop = SUPPLY_Pa - self.pressure if self.spool > 0.0 else self.pressure
        flow = DISCHARGE * opening * math.copysign(math.sqrt(2.0 * abs(drop) / DENSITY), drop)
        flow = (flow if self.spool > 0.0 else -flow) + self.leak * (SUPPLY_Pa - self.pressure)
        viscous, coulomb = VISCOUS[self.v > 0.0], COULOMB[self.v > 0.0]
        level = coulomb + STATIC * math.exp(-abs(self.v) / STRIBECK_m_s)
        friction = level * math.tanh(self.v / SHARP_m_s) + viscous * self.v
        slope = level / SHARP_m_s / math.cosh(min(abs(self.v) / SHARP_m_s, 50.0)) ** 2 + viscous
        force = BOTTOM_m2 * self.pressure - TOP_m2 * SUPPLY_Pa - MASS_kg * GRAVITY - friction
        self.v += h * force / (MASS_kg + h * slope)
        self.y += h * self.v
        if not 0.0 < self.y < STROKE_m:
            self.y, self.v = min(max(self.y, 0.0), STROKE_m), 0.0
        volume = BOTTOM_m2 * self.y + PIPE_m3
        self.pressure = max(self.pressure + h * BULK_Pa * (flow - BOTTOM_m2 * self.v) / volume, 0.0)


def spline(points: list[float], r: float) -> float:
    """The uniform cubic B-spline of four setpoints, at 0 to 1 of its piece."""
    a, b, c, d = points
    return ((1 - r) ** 3 * a + (3 * r**3 - 6 * r**2 + 4) * b + (-3 * r**3 + 3 * r**2 + 3 * r + 1) * c + r**3 * d) / 6.0


class Request:
    """A compensator's text, put together of its pieces."""

    def __init__(self) -> None:
        self.text, self.parts = (0, 0), {}

    def add(self, data: bytes) -> dict | None:
        """What is asked for once the last piece has come: {} is a request that is none."""
        if len(data) < PIECE.size:
            return None
        _, leg, legs, piece, pieces, size, check = PIECE.unpack_from(data)
        part = data[PIECE.size :]
        whole = legs == 1 and leg <= 1 and 0 < size <= LONGEST and pieces == -(-size // PART)
        if not whole or len(part) != min(PART, size - PART * piece):
            return None
        if self.text != (size, check):
            self.text, self.parts = (size, check), {}
        self.parts[piece] = part
        if len(self.parts) < pieces:
            return None
        text, self.parts = b"".join(self.parts[k] for k in range(pieces)), {}
        try:
            asked = json.loads(text) if zlib.crc32(text) == check else {}
            return {
                "compensator": str(asked["compensator"]) if leg else "none",
                "parameters": dict(asked["parameters"]),
            }
        except (ValueError, KeyError, TypeError, RecursionError):
            return {}


class Compensation:
    """An algorithm of the package `compensation` on the one leg, with what it has learned elsewhere."""

    def __init__(self, name: str, parameters: dict) -> None:
        import compensation

        self.sample_of = compensation.Sample
        self.algorithm = compensation.create_built_in(name)
        context = compensation.Context(
            rate_Hz=1.0 / TICK_s,
            position_gain_V_per_m=GAIN_V_m,
            voltage_max_V=VOLTS,
            stroke_m=STROKE_m,
            area_bottom_m2=BOTTOM_m2,
            area_top_m2=TOP_m2,
            supply_pressure_Pa=SUPPLY_Pa,
            bulk_modulus_Pa=BULK_Pa,
            pipeline_volume_m3=PIPE_m3,
            spool_damping=DAMPING,
            spool_frequency_Hz=SPOOL_1_s / (2.0 * math.pi),
        )
        self.state = self.algorithm.restore(context, parameters)
        self.preview = compensation.preview_count(self.algorithm, context)
        self.volts = 0.0

    def add(self, time_s: float, ahead: list[float], position: float, pressure: float, control: float) -> float:
        """The valve's volts. ahead: setpoints of this tick and the next ones."""
        import numpy

        sample = self.sample_of(
            time_s=time_s,
            setpoint_m=ahead[0],
            preview_m=numpy.array(ahead),
            position_m=position,
            control_V=control,
            valve_V=self.volts,
            pressure_bottom_Pa=pressure,
            pressure_supply_Pa=SUPPLY_Pa,
        )
        more, self.state = self.algorithm.step(self.state, sample)
        self.volts = min(max(control + more, -VOLTS), VOLTS)
        return self.volts


class Machine:
    """States, limits, monitors and the position loop of one leg."""

    def __init__(self, leak_m3_s_Pa: float) -> None:
        self.cylinder, self.state, self.errors, self.refused = Cylinder(leak_m3_s_Pa), OFF, 0, False
        self.time_s, self.asked = 0.0, [NEUTRAL_m] * 4  # of the last four packets
        self.ahead = collections.deque(
            [self.cylinder.y]
        )  # setpoints of this tick and, with a compensator, the next ones
        self.compensation: Compensation | None = None
        self.noise, self.rows = random.Random(1), 0

    @property
    def reference(self) -> float:
        """Setpoint of this tick."""
        return self.ahead[0]

    @property
    def arrived(self) -> bool:
        """Neutral reached, or at rest."""
        return self.state == OFF or (self.state == NEUTRAL and abs(self.reference - NEUTRAL_m) < 1e-9)

    def order(self, command: int) -> None:
        """A command of the host; one that does not fit the state is refused."""
        allowed = {
            START: (OFF,),
            RUN_NORMAL: (NEUTRAL,),
            RETURN_NEUTRAL: (NORMAL,),
            SETTLE: (NEUTRAL, NORMAL),
            RESET: (FAULT,),
        }
        after = {START: STARTING, RUN_NORMAL: NORMAL, RETURN_NEUTRAL: NEUTRAL, SETTLE: SETTLING, RESET: SETTLING}
        if command == 0:
            return
        self.refused = self.state not in allowed.get(command, ())
        if not self.refused:
            self.state = after[command]
            self.errors = 0 if command == RESET else self.errors

    def compensate(self, asked: dict) -> None:
        """Take the host's compensator at rest or standing in neutral, or refuse it. Any parameters are survived."""
        self.refused = self.state not in (OFF, NEUTRAL) or not self.arrived or not asked
        if self.refused:
            return
        try:
            made = None if asked["compensator"] == "none" else Compensation(asked["compensator"], asked["parameters"])
        except Exception as error:
            print(f"refused: {error}", flush=True)
            self.refused = True
            return
        self.compensation = made
        self.ahead = collections.deque([self.reference] * (made.preview if made else 1))

    def fault(self, error: int) -> None:
        """Shut the valve; the operator resets."""
        self.state, self.errors = FAULT, self.errors | error

    def tick(self, setpoint_m: float, time_s: float) -> bytes:
        """One tick of the motion computer; what the sensors read before it, as a packet of telemetry."""
        goal, speed = setpoint_m, FASTEST_m_s
        if self.state in (STARTING, NEUTRAL):
            goal, speed = NEUTRAL_m, MOVE_m_s
        elif self.state in (SETTLING, OFF):
            goal, speed = 0.002, LOWER_m_s
        piston = self.cylinder
        position, pressure = piston.y + self.noise.gauss(0.0, 3e-6), piston.pressure + self.noise.gauss(0.0, 4e3)
        last = self.ahead[-1]
        self.ahead.append(last + min(max(goal - last, -speed * TICK_s), speed * TICK_s))
        self.ahead.popleft()
        volts = min(max(GAIN_V_m * (self.reference - position), -VOLTS), VOLTS)
        if self.compensation is not None and self.state != FAULT:
            volts = self.compensation.add(time_s, list(self.ahead), position, pressure, volts)
        if self.state in (OFF, FAULT):
            volts = 0.0
        if self.state == FAULT:
            self.ahead = collections.deque([position] * len(self.ahead))
        elif self.state != OFF and abs(self.reference - position) > FOLLOW_m:
            self.fault(LEG_ERROR)
        before = piston.v
        for _ in range(STEPS):
            piston.step(volts, TICK_s / STEPS)
        felt = (piston.v - before) / TICK_s + self.noise.gauss(0.0, 0.02)
        if self.state == STARTING and abs(position - NEUTRAL_m) < 1e-3:
            self.state = NEUTRAL
        if self.state == SETTLING and abs(self.reference - goal) < 1e-9 and abs(piston.v) < REST_m_s:
            self.state = OFF
        nothing = math.nan
        row = (self.reference, position, pressure, nothing, volts, SUPPLY_Pa, felt, *[nothing] * 5)
        self.rows += 1
        return ROW.pack(b"HXT1", 1, 1, self.rows - 1, 0, time_s, 1.0 / TICK_s, *row)


class Computer:
    """The machine behind a socket."""

    def __init__(self, port: int, leak_m3_s_Pa: float) -> None:
        self.machine, self.host_s, self.offset_s = Machine(leak_m3_s_Pa), -math.inf, 0.0
        self.request, self.acting = Request(), {"compensator": "none", "parameters": {}}
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", port))
        self.socket.settimeout(0.1)
        self.address = self.socket.getsockname()

    def serve(self, packets: float = math.inf) -> None:
        """Answer so many packets."""
        while packets > 0:
            try:
                data, peer = self.socket.recvfrom(9000)
            except TimeoutError:
                continue
            self.answer(data, peer)
            packets -= 1

    def answer(self, data: bytes, peer: tuple[str, int]) -> None:
        """Run to the host's time, then say where the machine is. What is no command is ignored."""
        if len(data) not in (COMMAND.size, COMMAND.size + 96) or data[:4] not in (b"HXC1", b"HXC2"):
            asked = self.request.add(data) if data[:4] == b"HXP2" else None
            if asked is not None and asked != self.acting:  # a host repeats itself
                self.machine.compensate(asked)
                self.acting = self.acting if self.machine.refused else asked
            return
        _, command, mode, sequence, _, host_s, *setpoints = COMMAND.unpack_from(data)
        if not all(math.isfinite(value) and abs(value) < 1e3 for value in setpoints) or not math.isfinite(host_s):
            return
        machine = self.machine
        if not 0.0 <= host_s - self.host_s < 10.0:  # the first packet, or another host
            self.offset_s = machine.time_s - host_s + TICK_s
        elif host_s - self.host_s > SILENT_s and machine.state == NORMAL:
            machine.fault(HOST_ERROR)
        self.host_s = host_s
        machine.order(command)
        asked = setpoints[0] if mode == 1 else setpoints[2]
        within = min(max(asked, -REACH_m), REACH_m)
        machine.errors = (machine.errors & ~WORKSPACE) | (WORKSPACE if within != asked else 0)
        machine.asked = [*machine.asked[1:], NEUTRAL_m + within]
        ticks = round((host_s + self.offset_s - machine.time_s) / TICK_s)
        for k in range(max(ticks, 0)):
            goal = spline(machine.asked, (k + 1) / ticks)
            self.socket.sendto(machine.tick(goal, machine.time_s), peer)
            machine.time_s += TICK_s
        flags = (
            machine.arrived + 2 * machine.refused + 4 + 8 + 16 * (machine.compensation is not None)
        )  # 4, 8: lockstep, telemetry
        pose, reference = ((0.0, 0.0, y - NEUTRAL_m, 0.0, 0.0, 0.0) for y in (machine.cylinder.y, machine.reference))
        state = (b"HXS1", machine.state, machine.errors, sequence, flags, machine.time_s, 0.0, 0.0)
        self.socket.sendto(REPLY.pack(*state, *pose, *reference), peer)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", type=int, default=47120)
    parser.add_argument("--leak", type=float, default=2e-12, help="across the piston, m3/s/Pa")
    arguments = parser.parse_args()
    computer = Computer(arguments.port, arguments.leak)
    print(f"listens on udp://127.0.0.1:{computer.address[1]}; Ctrl-C stops it", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        computer.serve()


if __name__ == "__main__":
    main()
