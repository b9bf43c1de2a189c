"""Where no hypothesis reaches the noise: each violated balance on its own, and its unexplained residual.

A balance looks at measured signals, so that one balance's trouble does not reach another. What stays violated is reported
with its size and its strongest dependence, never under a name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hexsim.declaration import Machine
from hexsim.hydraulics import leg as leg_equations
from hexsim.signals.channels import SETTLE_S, noise_of
from hexsim.signals.log import Log
from hexsim.signals.weak_form import Window
from hexsim.tracing.balances import Balance, balance_named
from hexsim.tracing.balances.balance import measured_point, resolved_machine
from hexsim.tracing.balances.null import FILLED_WELL, REACH_S
from hexsim.tracing.dependence import dependence_of
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import NamedEffect, Step, Tell, Trace, UnexplainedResidual, Violation
from hexsim.tracing.steps.violations import rms_of

Array = np.ndarray


class Channels(NamedTuple):
    """How residuals of channels are taken."""

    thin: int = 5  # every fifth sample: the window is 40 samples wide
    late_samples: int = 2  # of a channel whose lateness is tried: beyond what a window hides
    play_noise: tuple[float, float] = (7.0, 28.0)  # half widths of play in the position, in units of its noise


CHANNEL = Channels()

CHANNELS = {  # signal -> channel of the log
    "position_m": "position",
    "valve_V": "volts",
    "pressure_bottom_Pa": "pressure",
    "pressure_supply_Pa": "supply",
    "acceleration_m_s2": "acceleration",
}


def signals_of(log: Log, machine: Machine, place: str) -> tuple[dict[str, Array], Array]:
    """Signals that a residual may depend on, under the window, and the velocity. Legs: their own; platform: none of a leg."""
    window, resolved = Window(log.rate), resolved_machine(machine)
    leg = int(place.split()[1]) - 1 if place.startswith("leg") else 0
    point = measured_point(log, machine, resolved, leg)
    found = {
        "position_m": point.y,
        "velocity_m_s": point.v,
        "valve_V": point.volts,
        "pressure_supply_Pa": point.Ps,
        "time_s": point.t,
    }
    if point.P1 is not None:
        found["pressure_bottom_Pa"] = point.P1
    if log.acceleration is not None:
        found["acceleration_m_s2"] = log.acceleration[-1]
    smooth = {name: (window.mean(x) if name != "time_s" else x)[kept(log)] for name, x in found.items()}
    return smooth, smooth["velocity_m_s"]


def kept(log: Log) -> Array:
    """Samples of a log that count, thinned: their places. None of a window that sees a repaired stretch."""
    places = np.arange(int((SETTLE_S + 0.1) * log.rate), log.n - int(REACH_S * log.rate), CHANNEL.thin)
    return places[log.whole(REACH_S, FILLED_WELL)[places]]


def late(channel: Array) -> Array:
    """A channel (..., n) that comes late_samples later."""
    return np.concatenate(
        [np.repeat(channel[..., :1], CHANNEL.late_samples, axis=-1), channel[..., : -CHANNEL.late_samples]], axis=-1
    )


def with_play(position: Array, half_width: float, window: Window) -> Array:
    """A position (n_legs, n) that is measured through backlash of +- half_width [m]."""
    smooth = window.mean(position)
    return position + np.stack([leg_equations.valve_volts(row, half_width, 0.0) for row in smooth]) - smooth


def distortions(balance: Balance, log: Log, violation: Violation, residual: Array) -> dict[tuple[str, str], Array]:
    """(signal, form) -> how the residual would change if that channel were late or had play, (n_kept, k)."""
    window, machine, places = Window(log.rate), violation.machine, kept(log)
    noise = noise_of(machine, [log])["position_m"]

    def change(**channel: Array) -> Array:
        return (balance.residual(replace(log, **channel), machine)[violation.place] - residual)[places]

    found: dict[tuple[str, str], list[Array]] = {}
    for signal, channel in CHANNELS.items():
        values = getattr(log, channel)
        if values is not None:
            found[signal, "late"] = [change(**{channel: late(values)})]
    found["position_m", "play"] = [
        change(position=with_play(log.position, k * noise, window)) for k in CHANNEL.play_noise
    ]
    return {key: np.stack(changes, axis=1) for key, changes in found.items()}


def unexplained_of(balance: Balance, violation: Violation, logs: Sequence[Log]) -> UnexplainedResidual:
    """Dependence of what a balance leaves after its own fit."""
    machine, place = violation.machine, violation.place
    residuals, signals, velocities = [], [], []
    columns: dict[tuple[str, str], list[Array]] = {}
    for log in logs:
        full = balance.residual(log, machine)[place]
        residuals.append(full[kept(log)])
        own, v = signals_of(log, machine, violation.where)
        signals.append(own)
        velocities.append(v)
        for key, column in distortions(balance, log, violation, full).items():
            columns.setdefault(key, []).append(column)
    found = dependence_of(residuals, signals, velocities, logs[0].rate / CHANNEL.thin, balance.signals, columns)
    return UnexplainedResidual(violation=violation, balance=balance.reported_as(found.signal), dependence=found)


def unexplained_residuals(lines: Sequence[Violation], problem: SimulatedProblem) -> list[UnexplainedResidual]:
    """The violated balances with their dependence, the worst first; the worst of all when none is above its null."""

    def rank(line: Violation) -> float:
        first = balance_named(line.name, line.machine).spoils_others and line.violated
        return line.above_null + 1e6 * first

    worst = sorted(lines, key=rank, reverse=True)
    chosen = [line for line in worst if line.violated] or worst[:1]
    rests, seen = [], set()
    for line in chosen:
        balance = balance_named(line.name, line.machine)
        if (line.name, line.where.split()[0]) in seen and balance.one_cause:
            continue
        seen.add((line.name, line.where.split()[0]))
        rests.append(unexplained_of(balance, line, problem.logs))
    return rests


def attributed(
    lines: list[Violation], named: Sequence[NamedEffect], rests: Sequence[UnexplainedResidual]
) -> list[Violation]:
    """The continuity of a leg also as its valve balance: r_Q is the valve's when what explains it is the valve's."""
    out = []
    for line in lines:
        if line.name != "continuity":
            out.append(line)
            continue
        here = [e for e in named if e.candidate.where in (line.where, "all legs")]
        valve = any(e.candidate.effect.balance == "valve" for e in here)
        valve |= any(rest.balance == "valve" and rest.violation.where == line.where for rest in rests)
        own = not valve or any(e.candidate.effect.balance == "continuity" for e in here)
        quiet = replace(line, rms=min(line.rms, line.sigma * line.null))
        out.append(line if own else quiet)
        out.append(replace(line if valve else quiet, name="valve"))
    return out


def beside_effects(trace: Trace) -> list[Violation]:
    """The violations of the machine with its sure effects: what is left beside them."""
    logs, machine, lines = trace.fit_problem.logs, trace.fitted, []
    for line in trace.violations:
        rms = rms_of(balance_named(line.name, machine), machine, logs)[line.place]
        lines.append(replace(line, rms=float(rms), machine=machine))
    return lines


def look_at_residuals(trace: Trace, tell: Tell) -> Trace:
    """Of a machine that is not explained: every violated balance with its size and its strongest dependence."""
    if trace.verdict not in ("unexplained", "partly"):
        return replace(
            trace,
            violations=attributed(trace.violations, trace.effects, []),
            decided="not needed: nothing but noise is left",
        )
    left = beside_effects(trace) if trace.verdict == "partly" else trace.violations
    rests = unexplained_residuals(left, trace.fit_problem)
    lines = attributed(trace.violations, trace.effects, rests)
    found = [f"{r.balance} of {r.violation.where} over {r.dependence.signal} ({r.dependence.form})" for r in rests]
    return replace(trace, violations=lines, unexplained=rests, decided="; ".join(found) or "no balance to look at")


STEP = Step(name="unexplained residuals", doing="looking at unexplained residuals", share=0.03, run=look_at_residuals)
