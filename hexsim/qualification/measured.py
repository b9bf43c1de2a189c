"""The figures of a qualification from a log: what the motion in it allows, with the accelerometer's place and band.

A sine along or about an axis gives half-hertz noise (at its own frequency), peaks, leg balance, turn-around and one point
of the describing function; any other motion gives the describing function where response and command hang together.
A limit judges only the motion that its test is for: half hertz in one axis alone, leg balance in heave, turn-around in
heave of 150 mm peak to peak; figures of other motions are reported.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from hexsim.cueing.washout import g as g0
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.files.atomic import write_text
from hexsim.machine.files import machine_tables
from hexsim.mechanics.mechanics import Mechanics
from hexsim.mechanics.points import mounting, point_acceleration
from hexsim.qualification import measures
from hexsim.qualification.battery import Findings
from hexsim.qualification.page import page
from hexsim.qualification.rig import Motion
from hexsim.qualification.rows import (
    APPLICANT,
    ROTATIONS,
    Row,
    half_hertz_curve,
    half_hertz_rows,
    leg_balance_row,
    row_of,
    turn_around_curve,
    turn_around_row,
)
from hexsim.signals.log import Log
from hexsim.smoothness import BANDWIDTH_Hz, band_limit, describing_function, frequency_below

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Imu:
    """Where and how the accelerometers sit. offset_m: from the platform's origin, in its frame. turn_deg: roll, pitch and
    yaw of their axes in that frame. has_gravity: they measure specific force, +g upwards at rest. bandwidth_Hz: of
    theirs, where it is below 50 Hz."""

    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    has_gravity: bool = False
    bandwidth_Hz: float = math.inf


def measure(
    log: Log,
    machine: Machine,
    out: str | Path,
    imu: Imu | None = None,
    *,
    samples_a_period: float = 2.56,  # of the highest frequency in a log: what anti-aliasing filters leave
) -> dict[str, Any]:
    """Figures of a log into the folder `out`: report.html and measure.json; returns what the JSON holds.

    machine: that of the log; its geometry gives pose from legs. A simulated log that holds the truth is judged by it
    unless `imu` is given. Raises HexsimError where the log lacks setpoints or accelerations.
    """
    if log.n_legs != machine.n_legs:
        raise HexsimError(f"log {log.name} is of a {log.kind}, machine {machine.name} is a {machine.machine.kind}")
    motion, notes = motion_of(log, machine.mechanics, imu, machine.machine.gravity_m_s2)
    band = min(BANDWIDTH_Hz, (imu or Imu()).bandwidth_Hz, log.rate / samples_a_period)
    if band < BANDWIDTH_Hz:
        notes.append(
            f"Figures are of the band up to {band:.3g} Hz: sensor or log hold no more, and peaks are lower for it."
        )
    found = Findings()
    driven = driven_axes(motion)
    if not driven:
        raise HexsimError(f"log {log.name}: the setpoints do not move; give a log of a motion")
    for axis in driven:
        sine = sine_of(motion.time_s, motion.commanded[axis])
        if sine is None:
            notes.append(
                f"{axis} is no sine, or too short: half-hertz noise, turn-around and leg balance need two periods of one."
            )
            _response_of_any_motion(found, axis, motion, log.rate)
        else:
            made = Findings(curves=found.curves)
            _figures_of_a_sine(made, axis, motion, *sine, band)
            amplitude = 0.5 * float(np.ptp(motion.commanded[axis][motion.time_s >= sine[1]]))
            found.rows += [_judged(row, axis, sine[0], amplitude, alone=len(driven) == 1) for row in made.rows]
    result = {
        "log": log.name,
        "machine": machine.name,
        "bandwidth_Hz": band,
        "notes": notes,
        "passed": _passed(found.rows),
        "rows": [asdict(row) | {"passed": row.passed} for row in found.rows],
        "describing_function": found.curves.get("describing_function", {}),
    }
    folder = Path(out)
    write_text(folder / "measure.json", json.dumps(result, indent=1))
    how = f"log {log.name} · {log.duration_s:.1f} s at {log.rate:g} Hz · accelerations in the {band:.3g} Hz band"
    config = tomli_w.dumps(machine_tables(machine))
    write_text(folder / "report.html", page(f"Figures of {machine.name}", how, found, config, [*notes, *log.losses]))
    return result


def _judged(row: Row, axis: str, frequency_Hz: float, amplitude: float, *, alone: bool) -> Row:
    """The row, without its limit where the motion is not that of its test: a machine that follows perfectly must not fail."""
    wanted = {
        "half-hertz noise": ("a sine of 0.5 Hz in one axis alone", True),
        "leg balance": ("heave of 0.5 Hz alone", axis == "z"),
        "turn-around": (
            "heave of 0.5 Hz alone, 150 mm peak to peak",
            axis == "z" and 0.0675 <= amplitude <= 0.0825,  # 75 mm within a tenth
        ),
    }
    if row.limit is None or row.test not in wanted:
        return row
    what, is_its = wanted[row.test]
    if is_its and alone and 0.49 <= frequency_Hz <= 0.51:
        return row
    return replace(row, limit=None, source=f"reported; its limit is for {what}")


def _passed(rows: list[Row]) -> bool | None:
    """None where no limit is for this motion."""
    judged = [row.passed for row in rows if row.passed is not None]
    return all(judged) if judged else None


def motion_of(log: Log, mechanics: Mechanics, imu: Imu | None, gravity_m_s2: float = g0) -> tuple[Motion, list[str]]:
    """The log as a motion of the coordinates, and what is to be said of it."""
    setpoints = log.setpoint
    if setpoints is None or not len(log.position):
        raise HexsimError(f"log {log.name!r} needs setpoint and position of each leg, for command and response")
    true_position, true_linear = log.signal("true_position"), log.signal("true_acceleration")
    from_truth = imu is None and true_position is not None and true_linear is not None
    positions = (true_position if from_truth and true_position is not None else log.position).T
    pose, command = mechanics.forward(positions), mechanics.forward(setpoints.T)
    notes = ["Accelerations are the simulation's true ones."] if from_truth else []
    if from_truth:
        linear, angular = true_linear, log.signal("true_angular_acceleration")
    else:
        linear, angular = log.acceleration, log.angular
    if linear is None or (mechanics.has_platform and angular is None):
        raise HexsimError(f"log {log.name!r} needs acceleration columns of every axis: the figures are accelerations")
    if not from_truth:
        linear, said = at_origin(linear, angular, pose, mechanics, log.rate, imu or Imu(), gravity_m_s2)
        notes += said
    rows = [*linear, *(angular if angular is not None else [])]
    acceleration = dict(zip(mechanics.dofs, rows, strict=True))
    places = dict(zip(mechanics.dofs, mechanics.dof_places, strict=True))
    return Motion(
        time_s=log.time - log.time[0],
        commanded={dof: command[:, k] for dof, k in places.items()},
        response={dof: pose[:, k] for dof, k in places.items()},
        commanded_acceleration={},
        acceleration=acceleration,
        leg_setpoints=setpoints.T,
        leg_positions=positions,
    ), notes


def at_origin(
    measured: Array,
    angular: Array | None,
    pose: Array,
    mechanics: Mechanics,
    rate: float,
    imu: Imu,
    gravity_m_s2: float,
) -> tuple[Array, list[str]]:
    """Accelerations (n_axes, n) of the platform's origin in its frame, from accelerometers as `imu` says.

        a = T f - R' (0, 0, g) - alpha x r - omega x (omega x r)

    T: turn of the sensor's axes, R: of the platform, r: offset; omega from the pose in the 50 Hz band.
    """
    notes = []
    if not imu.has_gravity and abs(float(measured[-1].mean())) > 5.0:  # a mean acceleration beyond this is gravity
        notes.append(
            f"The mean vertical acceleration is {measured[-1].mean():.2f} m/s2: gravity is in it; say --imu-gravity."
        )
    if not mechanics.has_platform:
        return measured - (measured.mean() if imu.has_gravity else 0.0), notes
    found = measured.T @ mounting(imu.turn_deg).T
    if imu.has_gravity:
        found = found - np.einsum("kji,j->ki", mechanics.rotation(pose), [0.0, 0.0, gravity_m_s2])
    if any(imu.offset_m) and angular is not None:
        time = np.arange(len(pose)) / rate
        rates = np.column_stack([np.gradient(band_limit(time, column, BANDWIDTH_Hz), 1 / rate) for column in pose.T])
        turning = mechanics.to_platform_frame(pose, mechanics.twist(pose, rates))[:, 3:]
        found = found - point_acceleration(np.zeros_like(found), angular.T, turning, imu.offset_m)
    return found.T, notes


def driven_axes(
    motion: Motion,
    *,
    driven_share: float = 0.05,  # nor one with so little of the largest (rad as m)
    least_m: float = 1e-3,  # an axis with a smaller command is not driven
    least_rad: float = 1e-3,  # an axis with a smaller command is not driven
) -> list[str]:
    """Axes whose command moves, the one that moves most first."""
    spans = {axis: float(np.ptp(values)) for axis, values in motion.commanded.items()}
    least = driven_share * max(spans.values())
    limits = {axis: max(least, least_rad if axis in ROTATIONS else least_m) for axis in spans}
    return sorted((axis for axis in spans if spans[axis] > limits[axis]), key=lambda axis: -spans[axis])


def sine_of(
    time_s: Array,
    command: Array,
    *,
    sine_error: float = 0.02,  # of its amplitude, by which a command may miss a sine
) -> tuple[float, float] | None:
    """(frequency [Hz], start [s]) of a command that ends in a steady sine, from a period after it is one on.

    None where the last three fifths are none, or fewer than two whole periods are left.
    """
    from scipy.optimize import minimize_scalar

    late = time_s >= 0.4 * time_s[-1]
    part, span = command[late] - command[late].mean(), float(time_s[-1] - time_s[late][0])
    spectrum = np.abs(np.fft.rfft(part * np.hanning(len(part)), 4 * len(part)))
    guess = float(np.fft.rfftfreq(4 * len(part), time_s[1] - time_s[0])[spectrum.argmax()])
    if guess * span < 1.5:
        return None

    def columns(f: float, time: Array) -> Array:
        return np.column_stack([np.sin(2 * np.pi * f * time), np.cos(2 * np.pi * f * time), np.ones_like(time)])

    def miss(f: float) -> float:
        return float(np.linalg.lstsq(columns(f, time_s[late]), command[late], rcond=None)[1].sum())

    near = minimize_scalar(
        miss, bounds=(guess - 0.5 / span, guess + 0.5 / span), method="bounded", options={"xatol": 1e-7}
    )
    f = float(near.x) if miss(float(f"{near.x:.4g}")) > 1.01 * near.fun + 1e-18 * len(part) else float(f"{near.x:.4g}")
    fit = np.linalg.lstsq(columns(f, time_s[late]), command[late], rcond=None)[0]
    amplitude, off = float(np.hypot(*fit[:2])), np.abs(command - columns(f, time_s) @ fit)
    if off[late].max() > sine_error * amplitude:
        return None
    outside = np.flatnonzero(off > sine_error * amplitude)
    steady = float(time_s[outside[-1]]) if len(outside) else 0.0
    start = math.ceil((steady + 1 / f) * f - 1e-6) / f
    return (f, start) if (time_s[-1] - start) * f >= 2 - 1e-3 else None


def _figures_of_a_sine(found: Findings, axis: str, motion: Motion, f: float, start: float, band: float) -> None:
    found.rows += half_hertz_rows(axis, motion, start, f, band)
    found.curves.setdefault("half_hertz", {})[axis] = half_hertz_curve(axis, motion, start, f, band)
    if axis not in ROTATIONS:
        found.rows.append(turn_around_row(axis, motion, start, f, band))
        found.curves.setdefault("turn_around", turn_around_curve(axis, motion, start, f, band))
    if motion.leg_positions.shape[1] > 1:
        row, phases = leg_balance_row(axis, motion, start, f)
        found.rows.append(row)
        found.curves.setdefault("leg_balance", {"phase_deg": list(phases)})
    response = describing_function(motion.time_s, motion.response[axis], motion.commanded[axis], f, start)
    gain_dB, phase = 20 * math.log10(abs(response)), measures.phase_deg(response)
    found.rows.append(row_of("describing function", axis, f"gain at {f:g} Hz", gain_dB, "dB", source=APPLICANT))
    found.rows.append(row_of("describing function", axis, f"phase at {f:g} Hz", phase, "deg", source=APPLICANT))
    found.curves.setdefault("describing_function", {})[axis] = {
        "frequency_Hz": [f],
        "gain_dB": [gain_dB],
        "phase_deg": [phase],
    }


def _response_of_any_motion(
    found: Findings,
    axis: str,
    motion: Motion,
    rate: float,
    *,
    coherent: float = 0.9,  # from here on response and command hang together
) -> None:
    """Response over command by averaged spectra (Welch, H1), where the coherence is 0.9 or more."""
    from scipy import signal

    command, response = (np.diff(values[axis]) for values in (motion.commanded, motion.response))
    length = min(len(command), round(8.0 * rate))
    frequency, cross = signal.csd(command, response, rate, nperseg=length)
    own, other = (signal.welch(values, rate, nperseg=length)[1] for values in (command, response))
    coherence = np.abs(cross) ** 2 / np.maximum(own * other, 1e-300)
    kept = (coherence >= coherent) & (own > 1e-4 * own.max()) & (frequency > 0)
    if kept.sum() < 3 or len(command) < 2 * length:
        return
    ratio = cross[kept] / own[kept]
    gains = (20 * np.log10(np.abs(ratio))).tolist()
    phases = [measures.phase_deg(complex(one)) for one in ratio]
    f = frequency[kept].tolist()
    found.curves.setdefault("describing_function", {})[axis] = {
        "frequency_Hz": f,
        "gain_dB": gains,
        "phase_deg": phases,
    }
    for figure, value in (
        ("gain falls below -3 dB at", frequency_below(f, gains, -3.0)),
        ("phase passes -90 deg at", frequency_below(f, phases, -90.0)),
    ):
        found.rows.append(row_of("describing function", axis, figure, value, "Hz", source=APPLICANT))
