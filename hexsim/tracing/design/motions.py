"""The motions that a design chooses from: a vector of numbers gives a scenario inside the machine's limits.

Kinds: multisine, sweep, constant-acceleration reversals, slow strokes at constant velocity, steps. Each is scaled to a
share of the largest that [host_limits] allows, legs and platform: the packets that would leave the host are judged, by the
limiter that they will pass (`motion_computer.host_limiter`). A step goes over as fast as these limits allow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy  # its statistics when asked for: half a second of start-up

from hexsim.declaration import Machine
from hexsim.machine.geometry import machine_kinematics, with_additional_mass
from hexsim.mechanics.kinematics import DOF_NAMES
from hexsim.motion_computer.host_limiter import HostLimiter, setpoints_of
from hexsim.motion_computer.limits import pose_limits
from hexsim.scenarios.scenario import scenario_from_dict
from hexsim.signals.log import Log
from hexsim.tracing import rules

Array = np.ndarray
KINDS = ("multisine", "sweep", "constant_acceleration_reversals", "constant_velocity_strokes", "block")
SLOWEST_Hz = 1.0 / rules.MOTION_S  # one period of the duration


class Sizes(NamedTuple):
    """Sizes of the motions that are tried."""

    fastest_Hz: float = 15.0  # what a loop of a few hertz still answers
    smallest_share: float = 0.1  # of the largest possible size
    fastest_step_Hz: float = 1.0  # periods of steps a second
    seeds: int = 64  # of phases
    free: float = 1.05  # the largest size stays this factor inside the limits


SIZES = Sizes()

FIRST_MOTIONS = (  # kind, lower and upper frequency, slope, size
    ("sweep", "slow", "slow", 0.5, 1.0),
    ("multisine", "slow", "fast", 0.5, 1.0),
    ("block", "slow", "slow", 0.5, 1.0),
    ("constant_acceleration_reversals", "slow", "slow", 0.5, 1.0),
    ("sweep", "fast", "fastest", 0.9, 1.0),
    ("constant_velocity_strokes", "slowest", "slow", 0.5, 1.0),
    ("multisine", "fast", "fastest", 0.5, 1.0),
    ("sweep", "slow", "fast", 0.5, 1.0),
    ("multisine", "slowest", "fastest", 0.5, 1.0),
    ("sweep", "middle", "middle", 0.5, 1.0),
    ("constant_velocity_strokes", "slow", "slow", 0.9, 1.0),
    ("constant_acceleration_reversals", "middle", "middle", 0.9, 1.0),
    ("sweep", "fast", "fast", 0.5, 1.0),
    ("multisine", "slow", "slow", 0.5, 0.3),
)


@dataclass(frozen=True)
class MotionFamily:
    """Motions of a machine that last `duration_s`. A point of the family is a vector within `bounds`."""

    machine: Machine
    duration_s: float
    may_load: bool = False  # the machine's additional mass may be put on
    must_load: bool = False  # it is
    largest: float = 1.0  # share of the machine's limits

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """kind, axis, size, two frequencies, slope of the amplitudes, seed of the phases, load; whole: `integrality`."""
        own: list[tuple[float, float]] = [
            (0, len(KINDS) - 1),
            (0, len(self.axes) - 1),
            (0, 1),
            (0, 1),
            (0, 1),
            (0, 1),
            (0, SIZES.seeds - 1),
        ]
        return [*own, (0, 1)] if self.may_load else own

    @property
    def integrality(self) -> tuple[bool, ...]:
        return (True, True, False, False, False, False, True, True)[: len(self.bounds)]

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """What may be driven."""
        return DOF_NAMES if self.machine.is_hexapod else ("leg_1",)

    @cached_property
    def limiter(self) -> HostLimiter:
        return HostLimiter(self.machine, self.largest)

    @cached_property
    def reach(self) -> Array:
        """Excursion of each axis alone [m or rad]."""
        return self.largest * pose_limits(self.machine).excursion

    @cached_property
    def step_s(self) -> float:
        """In which the largest step goes over: a quintic of height h in T has speed 1.875 h/T, acceleration 5.77 h/T^2 and
        jerk 60 h/T^3; the axes of a platform may ask for less than its legs, and the motion is then scaled."""
        own, stroke_m = self.machine.host_limits, float(np.max(self.machine.mechanics.stroke_m))
        h = 2.0 * own.step_share * stroke_m
        need = (
            1.875 * h / own.velocity_m_s,
            (5.77 * h / own.acceleration_m_s2) ** 0.5,
            (60.0 * h / own.jerk_m_s3) ** (1 / 3),
        )
        return min(SIZES.free * max(need), 0.5 / SIZES.fastest_step_Hz)

    @cached_property
    def corners_Hz(self) -> list[tuple[float, float]]:
        """Of each axis alone, v/(2 pi x) and a/(2 pi v) of what its legs and itself allow together, legs linear in it."""
        limits, found = self.limiter.limits, []
        for place, reach in zip(self.machine.mechanics.dof_places, self.reach, strict=True):
            row = np.zeros((1, len(DOF_NAMES)))
            row[0, place] = reach
            moved = {what: np.abs(values[0]) / reach for what, values in self.limiter.coordinates(row).items()}
            x, v, a = (
                min(
                    float(np.min(getattr(limits[what], kind)[ratio > 0.0] / ratio[ratio > 0.0]))
                    for what, ratio in moved.items()
                )
                for kind in ("excursion", "velocity", "acceleration")
            )
            corners = (v / x, a / v)
            found.append(tuple(float(np.clip(own / (2.0 * np.pi), SLOWEST_Hz, SIZES.fastest_Hz)) for own in corners))
        return found

    def first_points(self, count: int) -> Array:
        """Motions to begin with (count, n): full size, about the frequencies at which two limits are reached together; then
        points spread by Sobol's sequence.

        Below v/(2 pi x) the stroke limits a motion, above a/(2 pi v) the acceleration; between them it is as fast as allowed:
        the flow is largest, and the supply, the gas and the edges work hardest.
        """
        rows = []
        for k, (kind, low, high, slope, size) in enumerate(FIRST_MOTIONS):
            axis = k % len(self.axes)
            slow, fast = self.corners_Hz[axis]
            named = {
                "slowest": SLOWEST_Hz,
                "slow": slow,
                "middle": np.sqrt(slow * fast),
                "fast": fast,
                "fastest": SIZES.fastest_Hz,
            }
            place = {
                name: float(np.log(f / SLOWEST_Hz) / np.log(SIZES.fastest_Hz / SLOWEST_Hz)) for name, f in named.items()
            }
            rows.append((KINDS.index(kind), axis, size, place[low], place[high], slope, k, (k // 2 + k) % 2))
        low, high = np.transpose(self.bounds)
        more = scipy.stats.qmc.scale(scipy.stats.qmc.Sobol(len(low), rng=0).random(count), low, high + 1e-9)
        return np.concatenate([np.array(rows, float)[:, : len(low)], more])[:count]

    def scenario(self, point: Array) -> dict[str, Any] | None:
        """Tables of the scenario; None where it cannot be made inside the limits."""
        kind, axis, seed = KINDS[round(point[0])], round(point[1]) % len(self.axes), round(point[6])
        size = SIZES.smallest_share + (1.0 - SIZES.smallest_share) * float(point[2])
        low, high = sorted(float(SLOWEST_Hz * (SIZES.fastest_Hz / SLOWEST_Hz) ** x) for x in (point[3], point[4]))
        driven = self.axes if kind == "multisine" else self.axes[axis : axis + 1]
        scale = 1.0
        for _ in range(rules.FEW):
            axes = {
                name: signal(
                    kind,
                    scale * float(self.reach[self.axes.index(name)]),
                    low,
                    high,
                    float(point[5]),
                    seed + k,
                    self.step_s,
                )
                for k, name in enumerate(driven)
            }
            tables = self._tables(
                {name: one | {"duration_s": self.duration_s} if kind == "sweep" else one for name, one in axes.items()}
            )
            scale /= SIZES.free * self.beyond(tables) / size
            if not 1e-6 < scale < 1e6:
                return None
        if self.must_load or (self.may_load and round(point[7])):
            tables["machine"] = loaded_machine(self.machine)
        return tables if self.beyond(tables) <= 1.0 else None

    def log(self, tables: dict[str, Any]) -> Log:
        """A motion's setpoints as a log."""
        return replace(setpoint_log(self.machine, tables), loaded="machine" in tables)

    def _tables(self, axes: dict[str, Any]) -> dict[str, Any]:
        hexapod = self.machine.is_hexapod
        return {
            "name": "next-measurement",
            "mode": "dof" if hexapod else "actuator",
            "machine_name": self.machine.name,
            "duration_s": self.duration_s,
            "fade": "smooth",
            "axes": axes,
        }

    def beyond(self, tables: dict[str, Any]) -> float:
        """Largest share of a limit that the motion's packets take; of steps also their size over the stroke."""
        rows = setpoints_of(self.machine, tables)
        share = self.limiter.share(rows)
        if any(one["kind"] == "block" for one in tables["axes"].values()):
            mechanics = self.machine.mechanics
            size = np.abs(mechanics.piston_positions(rows) - mechanics.neutral_positions).max(axis=0)
            step = self.largest * self.machine.host_limits.step_share * np.asarray(mechanics.stroke_m)
            share = max(share, float(np.max(size / step)))
        return share


def loaded_machine(machine: Machine) -> dict[str, float]:
    """What the additional mass changes on the machine, for a scenario."""
    load = with_additional_mass(machine.load)
    return {f"load.{load.mass_key}": load.carried_mass_kg}


def signal(
    kind: str, reach: float, low_Hz: float, high_Hz: float, slope: float, seed: int, step_s: float
) -> dict[str, Any]:  # fmt: skip
    """A signal of this kind with peaks of about `reach`. slope: amplitudes fall with frequency to the power 0 .. 2.

    step_s: in which a step goes over.
    """
    if kind == "multisine":
        frequencies = np.geomspace(low_Hz, max(high_Hz, 1.05 * low_Hz), len(DOF_NAMES)) * (1.0 + 0.01 * (seed % 7))
        amplitudes = (frequencies[0] / frequencies) ** (2.0 * slope)
        amplitudes *= reach / amplitudes.sum()
        return {
            "kind": kind,
            "amplitudes": [float(a) for a in amplitudes],
            "frequencies_Hz": [float(round(f, 4)) for f in frequencies],
            "seed": seed,
        }
    if kind == "sweep":
        hold = ("position", "velocity", "acceleration")[min(int(3 * slope), 2)]
        return {"kind": kind, "amplitude": reach, "start_Hz": low_Hz, "end_Hz": high_Hz, "law": "log", "hold": hold}
    if kind == "block":
        frequency_Hz = min(max(low_Hz, 0.1), SIZES.fastest_step_Hz)
        return {"kind": kind, "amplitude": reach, "frequency_Hz": frequency_Hz, "transition_s": step_s}
    if kind == "constant_acceleration_reversals":
        half = 0.25 / min(max(low_Hz, 0.1), 2.0)
        top = 2.0 * reach / half**2
        levels = [top * share for share in (1.0, 0.3 ** (0.5 + slope), 0.1 ** (0.5 + slope))]
        return {"kind": kind, "accelerations": levels, "half_time_s": half, "cycles": 2, "transition_s": 0.5}
    top = 4.0 * reach * low_Hz
    levels = [top * share for share in (1.0, 0.3 ** (0.5 + slope), 0.1 ** (0.5 + slope))]
    return {
        "kind": kind,
        "velocities": levels,
        "stroke": 1.5 * reach,
        "cycles": 1,
        "transition_s": 0.5,
        "longest_s": 2.0,
    }


def setpoint_log(machine: Machine, tables: dict[str, Any], rate_Hz: float = rules.LOG_RATE_Hz) -> Log:
    """An empty log with the scenario's setpoints, as a problem for the simulation."""
    scenario = scenario_from_dict(tables)
    time = np.arange(int(scenario.duration_s * rate_Hz)) / rate_Hz
    every = max(round(rate_Hz / machine.controller.rate_Hz), 1)
    held = time[(np.arange(len(time)) // every) * every]
    value = scenario.evaluate(held)[0]
    if machine.is_hexapod:
        setpoint = machine_kinematics(machine).piston_positions(value).T.copy()
    else:
        setpoint = value[:, 0][None] + machine.mechanics.neutral_positions[:, None]
    zeros = np.zeros_like(setpoint)
    axes = np.zeros((3 if machine.is_hexapod else 1, len(time)))
    return Log(
        name="experiment",
        kind=machine.machine.kind,
        time=time,
        rate=rate_Hz,
        setpoint=setpoint,
        position=setpoint.copy(),
        volts=zeros,
        pressure=zeros,
        pressure_top=zeros if machine.cylinder.rod_side == "valve" else None,
        supply=np.zeros(len(time)),
        acceleration=axes,
        angular=axes if machine.is_hexapod else None,
    )
