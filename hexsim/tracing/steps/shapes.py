"""Shapes worth screening, read off the balances: a wavelength, a payload's frequency, an outside line, a worn place.

Each is the maximum of a scan of single regressors over the balance's residual; the scan costs microseconds where a
simulated column costs a tenth of a second. What the residual does not show gets the library's default shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hexsim.declaration import Machine
from hexsim.mechanics.rigid_body import Suspension, pushed_back
from hexsim.signals.channels import SETTLE_S
from hexsim.signals.log import Log
from hexsim.signals.ripple import wave_along
from hexsim.signals.weak_form import WIDE_S, Window
from hexsim.tracing import rules
from hexsim.tracing.balances.balance import measured_point, resolved_machine, sensed_leg
from hexsim.tracing.balances.continuity import Continuity
from hexsim.tracing.balances.controller import Loop
from hexsim.tracing.balances.force import Force
from hexsim.tracing.balances.null import REACH_S
from hexsim.tracing.balances.platform import Platform, felt_by_load
from hexsim.tracing.dependence import tone_of
from hexsim.tracing.fitting.parameters import Candidate, candidates
from hexsim.tracing.state import Step, Tell, Trace, Violation
from hexsim.tracing.steps.residuals import CHANNEL
from hexsim.tracing.steps.violations import own_machine

Array = np.ndarray
PLACES = 150  # along the stroke at which wear is looked for
SEEN_FIRST = ("position_ripple",)  # without their shape they have no column


def proposed_shapes(machine: Machine, logs: Sequence[Log]) -> dict[str, dict[str, float]]:
    """Effect name -> numbers of its shape. machine: with the parameters at which the residual is looked at."""
    keep = [slice(int((SETTLE_S + 0.1) * log.rate), log.n - int(REACH_S * log.rate), CHANNEL.thin) for log in logs]
    platform, force = Platform(), Force()
    high = _high_pressure(logs, keep) | _worn_place(machine, logs, keep) | _scale_ripple(machine, logs, keep)
    if all(platform.wants(log, machine) for log in logs):
        forces = [platform.residual(log, machine)[:3, k] for log, k in zip(logs, keep, strict=True)]
        return high | {"flexible_payload": _payload_shape(logs, keep, forces, [felt_by_load(g, machine) for g in logs])}
    if not all(force.wants(log, machine) for log in logs):
        return high
    residuals = [force.residual(log, machine)[0, k] for log, k in zip(logs, keep, strict=True)]
    return high | {
        "position_dependent_friction": {"wavelength_m": _wavelength(machine, logs, keep, residuals)},
        "flexible_payload": _payload_shape(
            logs, keep, [r[None] for r in residuals], [accelerations_of(g) for g in logs]
        ),
        "outside_force_tone": {"frequency_Hz": tone_of(residuals, logs[0].rate / CHANNEL.thin)[0]},
    }


def accelerations_of(log: Log) -> Array:
    """(n_axes, n) [m/s2] as measured; of a bench without an accelerometer by its position, under the balances' window."""
    return Window(log.rate).second_rate(log.position) if log.acceleration is None else log.acceleration


def _high_pressure(logs: Sequence[Log], keep: list[slice]) -> dict[str, dict[str, float]]:
    """Pressure [Pa] that a quarter of the samples exceed: about there a threshold may lie."""
    felt = [log.pressure[:, k].ravel() for log, k in zip(logs, keep, strict=True) if log.pressure is not None]
    return {"relief_flow": {"opening_pressure_Pa": float(np.quantile(np.concatenate(felt), 0.75))}} if felt else {}


def _worn_place(machine: Machine, logs: Sequence[Log], keep: list[slice]) -> dict[str, dict[str, float]]:
    """Place and width [m] of the bump of a leak past the piston that takes most of a leg's continuity, beside an even leak.

    Sums over the places of the stroke serve all bumps: a bump b takes (sum b R)^2 / sum b^2 D, R = sum r dp, D = sum dp^2.
    """
    balance, resolved = Continuity(), resolved_machine(machine)
    if not all(balance.wants(log, machine) for log in logs):
        return {}
    residuals = [balance.residual(log, machine) for log in logs]
    best = (0.0, {})
    for leg in range(machine.n_legs):
        points = [measured_point(log, machine, resolved, leg) for log in logs]
        drops = [(point.Ps if point.P2 is None else point.P2) - point.P1 for point in points]
        y, dp, r = (
            np.concatenate([own[k] for own, k in zip(signals, keep, strict=True)])
            for signals in ([point.y for point in points], drops, [own[leg] for own in residuals])
        )
        edges = np.linspace(y.min(), y.max() + 1e-9, PLACES + 1)
        middle, place = 0.5 * (edges[1:] + edges[:-1]), np.digitize(y, edges) - 1
        R, D = (np.bincount(place, weights=weights, minlength=PLACES) for weights in (r * dp, dp**2))
        for width in np.geomspace(2.0, 0.3 * PLACES, 8) * (edges[1] - edges[0]):
            bumps = np.exp(-(((middle - middle[:, None]) / width) ** 2))
            bumps -= (bumps @ D)[:, None] / D.sum()  # beside an even leak
            gains = (bumps @ R) ** 2 / np.maximum(bumps**2 @ D, 1e-300)
            k = int(np.argmax(gains))
            if gains[k] > best[0]:
                best = (float(gains[k]), {"place_m": float(middle[k]), "width_m": float(max(width, 1e-3))})
    return {"worn_bore": best[1]} if best[1] else {}


def _scale_ripple(machine: Machine, logs: Sequence[Log], keep: list[slice]) -> dict[str, dict[str, float]]:
    """Pitch [m] and phase of the wave along the stroke in what the positions show beyond how the pistons moved.

    That is the position less the integral of its velocity, under a window. Of several legs the one that stands out most;
    none where no pitch does.
    """
    resolved, best = resolved_machine(machine), (0.0, {})
    for leg in range(machine.n_legs):
        places, values = [], []
        for log, k in zip(logs, keep, strict=True):
            sensed, own = sensed_leg(log, resolved, leg), slice(k.start, k.stop)
            beyond = sensed.y - np.cumsum(sensed.v) / log.rate
            beyond = (beyond - Window(log.rate, WIDE_S).mean(beyond))[own]
            places.append(sensed.y[own])
            slow_m_s = 0.01  # below it a ripple is slower than that window
            values.append(beyond * sensed.v[own] ** 2 / (sensed.v[own] ** 2 + slow_m_s**2))
        pitch, phase, level = wave_along(np.concatenate(places), np.concatenate(values))
        if level > best[0]:
            best = (level, {"pitch_m": pitch, "phase_rad": phase})
    return {"position_ripple": best[1]} if best[0] > rules.CERTAIN else {}


def _gain(X: Array, r: Array) -> float:
    """Sum of squares that the regressors take from r."""
    theta = np.linalg.lstsq(X, r, rcond=None)[0]
    return float(np.sum((X @ theta) ** 2))


def _wavelength(machine: Machine, logs: Sequence[Log], keep: list[slice], residuals: list[Array]) -> float:
    resolved = resolved_machine(machine)
    points = [measured_point(log, machine, resolved, 0) for log in logs]
    windows = [Window(log.rate) for log in logs]
    side = [np.tanh(point.v / machine.friction.sharpness_m_s) for point in points]
    reach = max(float(np.ptp(point.y)) for point in points)
    r = np.concatenate(residuals)
    lengths = np.geomspace(0.004, max(2.0 * reach, 0.01), 80)

    def gain(length: float) -> float:
        waves = []
        for point, window, s, k in zip(points, windows, side, keep, strict=True):
            phase = 2 * np.pi * point.y / length
            wave = np.stack([s * np.sin(phase), s * np.cos(phase), s])
            waves.append(window.mean(wave)[:, k])
        return _gain(np.concatenate(waves, axis=1).T, r)

    return float(max(lengths, key=gain))


def _payload_shape(
    logs: Sequence[Log], keep: list[slice], residuals: list[Array], felt: Sequence[Array]
) -> dict[str, float]:
    """Of the spring on which a part of the load would explain most of the residual forces: frequency, axis of a platform.

    residuals, felt: a run (n_axes, .) each. A part m that swings along n pushes back by m n n' B, B what springs along each axis
    would: n is the first principal axis of the matrix that does so.
    """
    r = np.concatenate(residuals, axis=1).T
    frequencies = np.geomspace(1.0, 60.0, 30)
    swings = [own - own.mean(axis=1, keepdims=True) for own in felt]

    def columns(frequency: float) -> Array:
        spring = Suspension(mass=1.0, omega=2 * np.pi * frequency, damping=0.05)
        found = []
        for log, k, own in zip(logs, keep, swings, strict=True):
            back = [pushed_back(spring, row, log.rate) for row in own]
            found.append(Window(log.rate).mean(np.concatenate([back, own]))[:, k])
        return np.concatenate(found, axis=1).T

    best = float(max(frequencies, key=lambda frequency: _gain(columns(frequency), r)))
    axes = r.shape[1]
    if axes == 1:
        return {"frequency_Hz": best}
    back = np.linalg.lstsq(columns(best), r, rcond=None)[0][:axes]
    x, y, z = np.linalg.eigh(back + back.T)[1][:, -1]
    side = -1.0 if z < 0.0 else 1.0
    return {
        "frequency_Hz": best,
        "tilt_rad": float(np.arccos(np.clip(abs(z), 0.0, 1.0))),
        "azimuth_rad": float(np.arctan2(side * y, side * x)),
    }


def worth_screening(
    machine: Machine, lines: Sequence[Violation], proposed: dict[str, dict[str, float]]
) -> list[Candidate]:
    """All effects on a bench. On a hexapod: in all legs alike, and in the legs that are violated, the worst at least.

    What is built wrong in one leg tilts the platform and shows in all of them: it is looked for in each. A controller whose
    volts are those of the declared loop has no error: a simulation alone would take it for one of the valve.
    """
    loop = any(line.name == Loop.name for line in lines)
    possible = [c for c in candidates(machine, proposed) if c.shape or c.effect.name not in SEEN_FIRST]
    everything = [c for c in possible if loop or c.effect.balance != Loop.name]
    legs = [line for line in lines if line.where.startswith("leg ")]
    if machine.n_legs == 1 or not legs:
        return everything
    worst = max(legs, key=lambda line: line.violation / line.null)
    there = {line.where for line in legs if line.violated} | {worst.where}
    return [c for c in everything if not c.where.startswith("leg ") or c.where in there or c.effect.places == "one leg"]


def with_octaves(possible: Sequence[Candidate]) -> list[Candidate]:
    """The candidates, a payload's spring at every octave besides: where the force balance holds, its rest shows no shape."""
    sprung = [c for c in possible if c.effect.name == "flexible_payload"]
    return [
        *possible,
        *(replace(c, shape=c.shape | {"frequency_Hz": own}) for c in sprung for own in (4.0, 8.0, 16.0, 32.0)),
    ]


def propose(trace: Trace, tell: Tell) -> Trace:
    """The candidates that are worth a column, with the shapes that the balances show."""
    shapes = proposed_shapes(own_machine(trace.machine, trace.violations), trace.fit_problem.logs)
    found = worth_screening(trace.machine, trace.violations, shapes)
    read = [f"{name} {key} = {value:.3g}" for name, shape in shapes.items() for key, value in shape.items()]
    return replace(trace, candidates=found, decided=f"{len(found)} candidates; {', '.join(read) or 'default shapes'}")


STEP = Step(name="shapes", doing="reading shapes off the force balance", share=0.02, run=propose)
