"""The motion tests of 14 CFR Part 60, appendix A, table A2A, under their own conditions, on a simulated machine.

    3.d  repeatability    within +-0.05 g in each axis, for a signal of at least 5 deg/s2, 10 deg/s and 0.3 g that enters
                          before the transfer to the pilot's reference point, in "ground" and "flight" mode (one mode where
                          both have the same washout)
    4.a  motion onset     after a host's packet, in each axis, against 150 ms (aeroplanes) and 100 ms (helicopters). The rule
                          counts from the vehicle's response or the pilot's control: what the host takes comes on top
    envelope, noise       no number in the rule

What the rule leaves to the applicant (frequency response, leg balance, turn-around) is stated as such.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import welch

from compensation import Compensator
from hexsim.cueing.washout import Cueing, Washout
from hexsim.cueing.washout import g as g0
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.mechanics.workspace import excursions
from hexsim.motion_computer.host_packet import HostCommand
from hexsim.motion_computer.limits import pose_limits
from hexsim.motion_computer.states import State
from hexsim.qualification.rig import MachineRig, Motion
from hexsim.qualification.rows import NAMES, ROTATIONS, Row
from hexsim.scenarios import Scenario
from hexsim.setpoints.signal import Signal
from hexsim.simulation.serve import Server
from hexsim.smoothness import BANDWIDTH_Hz, band_limit

Array = NDArray[np.float64]
AXES = ("x", "y", "z", "roll", "pitch", "yaw")
RULE = "[S] 14 CFR Part 60, app. A, table A2A"
REPEATABILITY = f"{RULE}, 3.d: within ±0.05 g"
ONSET = "[S] 14 CFR Part 60, app. A (2014), table A2A, 4.a: 150 ms, levels C and D (A and B: 300 ms)"
ONSET_SHORT = (
    "[S] 14 CFR Part 60, app. C (2019), table C2A, 4.a: 100 ms, helicopters, levels C and D; [K] for aeroplanes"
)
NO_NUMBER = "no published number"
NOISE = "no published number; [K] commonly beside 1e-6 g²/Hz"


class Trials(NamedTuple):
    """The motions that are ridden."""

    frequency_Hz: float = 1.0  # of the repeatability's sines
    length_s: float = 8.0  # likewise
    fade_s: float = 2.0  # likewise
    # they go on behind what is judged: who looks ahead must not see the end of the record as a stop
    tail_s: float = 0.5
    # from the vehicle's centre of gravity: forward, left, up; the applicant's, here an example
    pilot_m: tuple[float, float, float] = (1.5, 0.5, 1.0)
    onset_share: float = 0.1  # of the sine that sets in; an onset is this share of its asked peak


TRIAL = Trials()


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """A raw record: name of its file, columns by name, arrays of one length."""

    name: str
    columns: dict[str, Array]


@dataclass(frozen=True, kw_only=True)
class SampledSetpoint(Signal):
    """A cubic through samples (n,) at times (n,), at rest outside."""

    kind: ClassVar[str] = "sampled_setpoint"
    spline: CubicSpline

    def __post_init__(self) -> None: ...

    def _of(self, time_s: ArrayLike, derivative: int) -> Array:
        time = np.clip(np.asarray(time_s, dtype=float), self.spline.x[0], self.spline.x[-1])
        return self.spline(time, derivative)

    def value(self, time_s: ArrayLike) -> Array:
        return self._of(time_s, 0)

    def velocity(self, time_s: ArrayLike) -> Array:
        return self._of(time_s, 1)

    def acceleration(self, time_s: ArrayLike) -> Array:
        return self._of(time_s, 2)


# 3.d: 10 deg/s
def signal_of(
    axis: str,
    rate_Hz: float,
    pilot_m: tuple[float, float, float],
    *,
    margin: float = 1.05,  # over these, so that a rounded figure is not below them
    least_force_m_s2: float = 0.3 * g0,  # 3.d, of 0.3 g
    least_rate_rad_s: float = math.radians(10.0),  # 3.d
    least_turn_rad_s2: float = math.radians(5.0),  # 3.d: 5 deg/s2
) -> tuple[Array, Array, Array, Array]:
    """Time (n,), acceleration (n, 3) at the pilot's place, rates (n, 3), and angular acceleration: a sine of `axis` at the
    vehicle's centre of gravity, faded in, with the rule's smallest amplitudes or a little more; tail_s longer than length_s.

    At the pilot: a + dw/dt x r + w x (w x r).
    """
    time = np.arange(round((TRIAL.length_s + TRIAL.tail_s) * rate_Hz)) / rate_Hz
    r = np.clip(time / TRIAL.fade_s, 0.0, 1.0)
    fade, slope = r**3 * (10 - 15 * r + 6 * r**2), 30 * r**2 * (1 - r) ** 2 / TRIAL.fade_s
    w = 2.0 * math.pi * TRIAL.frequency_Hz
    force, turn, change = np.zeros((len(time), 3)), np.zeros((len(time), 3)), np.zeros((len(time), 3))
    k = AXES.index(axis)
    if k < 3:
        force[:, k] = margin * least_force_m_s2 * fade * np.sin(w * time)
    else:
        size = margin * max(least_rate_rad_s, least_turn_rad_s2 / w)
        turn[:, k - 3] = size * fade * np.sin(w * time)
        change[:, k - 3] = size * (fade * w * np.cos(w * time) + slope * np.sin(w * time))
    arm = np.tile(pilot_m, (len(time), 1))
    felt = force + np.cross(change, arm) + np.cross(turn, np.cross(turn, arm))
    return time, felt, turn, change


def washed_out(washout: Washout, axis: str, machine: Machine, pilot_m: tuple[float, float, float]) -> Scenario:
    """The scenario of the poses that the washout gives for `signal_of`."""
    rate = machine.controller.rate_Hz
    time, force, turn, _ = signal_of(axis, rate, pilot_m)
    cueing = Cueing(washout, rate)
    poses = np.array([cueing.step(a, w) for a, w in zip(force, turn, strict=True)])
    ends: Any = ("clamped", "not-a-knot")  # from rest; in the midst of a motion. scipy's stubs know one name alone
    signals: dict[str, Signal] = {
        name: SampledSetpoint(spline=CubicSpline(time, poses[:, k], bc_type=ends)) for k, name in enumerate(AXES)
    }
    return Scenario(
        name=f"repeatability {axis}",
        mode="dof",
        signals=signals,
        duration_s=TRIAL.length_s + TRIAL.tail_s,
        fade_s=0.5,
        fade="smooth",
    )


def repeatability(
    rig: MachineRig,
    washout: Washout,
    mode: str,
    axes: tuple[str, ...] = AXES,
    pilot_m: tuple[float, float, float] = TRIAL.pilot_m,
    progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[list[Row], list[Trace]]:
    """Two runs of the same signal, other sensor noise: the largest difference of the platform's linear acceleration in any
    axis, from the fade's end on until length_s."""
    rows, traces = [], []
    for n, axis in enumerate(axes):
        progress(n / len(axes))
        scenario = washed_out(washout, axis, rig.machine, pilot_m)
        first, second = (rig.play(scenario, seed) for seed in (0, 1))
        late = (first.time_s >= TRIAL.fade_s) & (first.time_s < TRIAL.length_s)
        differences = {
            name: band_limit(first.time_s, first.acceleration[name] - second.acceleration[name], BANDWIDTH_Hz)[late]
            for name in AXES[:3]
        }
        largest = max(float(np.abs(values).max()) for values in differences.values())
        rows.append(
            Row(
                test=f"3.d repeatability, {mode}",
                axis=NAMES.get(axis, axis),
                unit="g",
                value=largest / g0,
                limit=0.05,
                figure="largest difference of two runs, linear, 50 Hz band",
                source=REPEATABILITY,
            )
        )
        traces.append(_trace(f"repeatability_{mode}_{axis}", first, second))
    return rows, traces


def _trace(name: str, first: Motion, second: Motion) -> Trace:
    columns = {"time_s": first.time_s}
    for label, motion in (("first", first), ("second", second)):
        for axis in motion.acceleration:
            unit = "rad_s2" if axis in ROTATIONS else "m_s2"
            columns[f"{label}_{axis}_{unit}"] = motion.acceleration[axis]
            columns[f"{label}_{axis}_{'rad' if axis in ROTATIONS else 'm'}"] = motion.response[axis]
    return Trace(name=name, columns=columns)


# 4.a
def onset(
    machine: Machine,
    compensator: str | Compensator = "none",
    axes: tuple[str, ...] = AXES,
    progress: Callable[[float], None] = lambda fraction: None,
    *,
    onset_m_s2: float = 0.3,  # 48 mm: far from the limits of a platform that carries people
    onset_rad_s2: float = 0.3,  # 2.7 deg: the same
) -> tuple[list[Row], list[Trace]]:
    """Time from the host's first packet that moves an axis to the platform's acceleration there, packets at the control rate.

    The setpoint is a sine of 1 Hz that sets in, x = A (wt - sin wt)/w^2: the acceleration begins without a step. The time
    until the platform has 0.1 of the peak less that until the asked acceleration has it is the delay of the motion.
    """
    rows, traces = [], []
    with Server(machine, port=0, compensator=compensator) as server:
        place = int(server.plant.model.joint("platform_free").dofadr[0])
        host = _Host(server)
        host.start()
        for n, axis in enumerate(axes):
            progress(n / len(axes))
            k = AXES.index(axis)
            size = onset_rad_s2 if axis in ROTATIONS else onset_m_s2
            time, asked, felt = host.pulse(k, size, place + k)
            found = _first(time, felt, TRIAL.onset_share * size)
            figure = f"platform at {TRIAL.onset_share:g} of the asked peak, after the packet"
            if found is None:  # later than all limits, so outside
                found, figure = len(time) * server.tick_s, f"{figure}: not within this time"
            rows += [
                Row(
                    test="4.a motion onset",
                    axis=NAMES.get(axis, axis),
                    unit="ms",
                    value=1e3 * found,
                    limit=limit,
                    figure=figure,
                    source=source,
                )
                for limit, source in ((150.0, ONSET), (100.0, ONSET_SHORT))
            ]
            unit = "rad_s2" if axis in ROTATIONS else "m_s2"
            traces.append(
                Trace(name=f"onset_{axis}", columns={"time_s": time, f"asked_{unit}": asked, f"platform_{unit}": felt})
            )
    return rows, traces


class _Host:
    """Sends packets into a server's buffer and ticks it."""

    def __init__(self, server: Server) -> None:
        self.server, self.sequence = server, 0

    def send(self, pose: Array, order: str = "none") -> None:
        server = self.server
        self.sequence += 1
        command = HostCommand(
            sequence=self.sequence, time_s=server.time_s, setpoints=tuple(float(x) for x in pose), command=order
        )
        server.link.buffer.add(command, server.time_s)
        server.link.peer = server.link.peer or ("127.0.0.1", 9)
        server.orders.execute(command, server.time_s)
        server.computer.last_packet_s = server.time_s
        server.advance()

    def start(self) -> None:
        for _ in range(round(1.0 / self.server.tick_s)):
            self.send(np.zeros(6), "run_normal" if self.server.computer.state == State.NEUTRAL else "none")
        if self.server.computer.state != State.NORMAL:
            raise HexsimError("motion onset: the machine does not go to normal")

    def pulse(
        self,
        k: int,
        size: float,
        place: int,
        *,
        period_s: float = 1.0,  # of the sine that sets in
    ) -> tuple[Array, Array, Array]:
        """Time from the first packet that moves, asked and platform's acceleration: out, and back in the same way."""
        w, tick = 2.0 * math.pi / period_s, self.server.tick_s
        n = round(2 * period_s / tick)
        t = tick * np.arange(n, dtype=np.float64)
        asked = np.where(t < period_s, 1.0, -1.0) * size * np.sin(w * t)
        one = size * (w * t - np.sin(w * t)) / w**2
        there = size * period_s / w
        back = there - size * (w * (t - period_s) - np.sin(w * (t - period_s))) / w**2
        path, felt = np.where(t < period_s, one, back), np.zeros(n)
        for i in range(n):
            pose = np.zeros(6)
            pose[k] = path[i]
            self.send(pose)
            felt[i] = self.server.plant.data.qacc[place]
        for _ in range(round(1.0 / tick)):
            self.send(np.zeros(6))
        if self.server.computer.state != State.NORMAL:
            raise HexsimError(f"motion onset: the machine left normal: {self.server.messages[-1][2]}")
        return t, asked, felt


def _first(time: Array, values: Array, level: float) -> float | None:
    """When the values first reach the level, for good over 10 ms."""
    beyond = values >= level
    held = np.convolve(beyond, np.ones(5), "full")[4:] >= 5
    found = np.flatnonzero(held)
    return float(time[found[0]]) if len(found) else None


# envelope and noise
def envelope(machine: Machine) -> list[Row]:
    """Excursion of each axis alone, from the geometry; speed and acceleration as the motion computer lets a host ask."""
    limits, rows = pose_limits(machine), []
    for k, reach in enumerate(excursions(machine.mechanics)):
        turns = reach.dof in ROTATIONS
        unit, factor = ("deg", 180.0 / math.pi) if turns else ("m", 1.0)
        for figure, value, suffix in (
            ("excursion, downwards or to the right", reach.minimum, ""),
            ("excursion, upwards or to the left", reach.maximum, ""),
            ("speed, the host's limit", limits.velocity[k], "/s"),
            ("acceleration, the host's limit", limits.acceleration[k], "/s²"),
        ):
            rows.append(
                Row(
                    test="envelope",
                    axis=NAMES.get(reach.dof, reach.dof),
                    figure=figure,
                    value=factor * float(value),
                    unit=unit + suffix,
                    source=NO_NUMBER,
                )
            )
    return rows


def noise(
    rig: MachineRig,
    *,
    noise_s: float = 20.0,  # of a platform that stands
) -> tuple[list[Row], list[Trace]]:
    """Power spectrum of the platform's linear acceleration while it stands in neutral under control, up to 50 Hz."""
    still = {axis: SampledSetpoint(spline=CubicSpline([0.0, noise_s], [0.0, 0.0])) for axis in rig.axes}
    scenario = Scenario(name="platform noise", mode="dof", signals=still, duration_s=noise_s, fade_s=0.5, fade="smooth")
    motion = rig.play(scenario)
    rows, columns = [], {}
    for axis in AXES[:3]:
        if axis in motion.acceleration:
            late = motion.time_s >= 2.0
            rate = 1.0 / (motion.time_s[1] - motion.time_s[0])
            frequency, power = welch(motion.acceleration[axis][late] / g0, rate, nperseg=round(4.0 * rate))
            band = (frequency >= 0.5) & (frequency <= BANDWIDTH_Hz)
            columns |= {"frequency_Hz": frequency[band], f"{axis}_g2_Hz": power[band]}
            rows.append(
                Row(
                    test="platform noise",
                    axis=NAMES[axis],
                    figure="largest power density, 0.5 to 50 Hz",
                    unit="g²/Hz",
                    value=float(power[band].max()),
                    source=NOISE,
                )
            )
    return rows, [Trace(name="platform_noise", columns=columns)]
