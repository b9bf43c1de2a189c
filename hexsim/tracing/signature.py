"""The signature of an effect: what the declared machine's balances leave of runs in which the effect acts at typical size.

A machine that travels with hexsim is simulated without noise on a motion of many frequencies, with the effect and without
it. Shown is the balance that the effect violates most, or the platform's for what is of it, over the signal whose curve
explains most of its residual. A wave along the stroke or in time is shown over one of its periods, all of them laid on
each other; what settles over time; what swings over the frequency of a sweep; a bristle over the travel since the reversal.
A hexapod has no dry friction here: its jolts where legs turn, between two samples, would hide what is of the platform.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.hydraulics.advice import advice_of
from hexsim.hydraulics.effects import Effect, effect_named
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.machine.geometry import machine_kinematics
from hexsim.recording import palette
from hexsim.recording.figure_style import legend, new_figure, styled
from hexsim.recording.quantity import quantity, scale_of
from hexsim.signals.log import Log
from hexsim.signals.table import table
from hexsim.signals.weak_form import HALF_WIDTH_S
from hexsim.tracing import rules
from hexsim.tracing.balances import Balance, library
from hexsim.tracing.balances.null import used
from hexsim.tracing.fitting.parameters import Candidate, with_settings
from hexsim.tracing.signature_axes import AXES, chosen_signal, picture_signals, travel_since_reversal
from hexsim.tracing.simulation.simulator import simulate_log
from hexsim.tracing.steps.residuals import kept

Array = np.ndarray
MACHINES = {"bench": ("bench", "servo_bench"), "hexapod": ("micro_motion_system", "servo_hexapod")}
DURATION_S = {"bench": 10.0, "hexapod": 6.0}  # three periods of the slowest tone; of a hexapod what takes a second


class Shown(NamedTuple):
    """Motions that show an effect, and what is shown of it."""

    sweep_s: float = 40.0  # slow: where damping is 0.05 the answer comes 0.4 s late, by 2 % of the frequency
    # (Hz, share of a quarter of the stroke)
    tones_Hz: tuple[tuple[float, float], ...] = ((0.3, 0.35), (0.7, 0.2), (1.6, 0.1), (3.1, 0.04), (6.3, 0.01))
    # velocity that a sweep asks for, from a quarter to twice the effect's frequency: beyond the overlap
    sweep_m_s: float = 0.25
    fastest_Hz: float = 0.5 / HALF_WIDTH_S  # a wave that goes by faster is lost in a balance's window
    turning_m: float = 3e-4  # of travel after a reversal, shown of a bristle


SHOWN = Shown()

DRY = {f"friction.{kind}_{way}_N": 0.0 for kind in ("coulomb", "static") for way in ("extend", "retract")}
SHOWN_AT = {  # where the typical size does nothing in this motion, or little but what another effect does
    "air_of_a_chamber": {"bottom_fraction": 0.05},
    "inertia_change": {"x_kg_m2": 30.0, "y_kg_m2": 30.0, "z_kg_m2": 50.0},
    "pump_flow_limit": {"flow_max_m3_s": 4e-5},
    "relief_flow": {"opening_pressure_Pa": 9.3e6},
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Signature:
    """Residual (m,) of a balance over a signal (m,), with the effect (and without it), moving out or in (m,) bool.

    period: of a wave, in the signal's unit; x is then the place within it.
    """

    effect: Effect
    values: dict[str, float]
    machine: str
    balance: Balance
    where: str
    signal: str
    x: Array
    residual: Array
    without: Array
    outward: Array
    period: float | None = None


def signature(name: str) -> Signature:
    """Simulate and choose balance and signal. HexsimError for an unknown effect, or one of no size."""
    effect = effect_named(name)
    if not effect.parameters:
        raise HexsimError(f"{name} has no size of its own: it is learned from logs, so that it has no signature")
    kind = "bench" if "bench" in effect.kinds else "hexapod"
    best: tuple[float, Signature] | None = None
    for machine in (one for place in MACHINES[kind] if effect.fits(one := shown_machine(place, kind))):
        found = on_machine(effect, machine, kind)
        if found is not None and (best is None or found[0] > 3.0 * best[0]):
            best = found
    if best is None:
        raise HexsimError(f"{name} does not act on {' or '.join(MACHINES[kind])} at its typical size")
    return best[1]


def shown_machine(name: str, kind: str) -> Machine:
    """A machine that travels with hexsim; a hexapod without its dry friction."""
    machine = load_machine(name)
    return machine if kind == "bench" else changed(machine, DRY | {"machine.name": f"{name} (no dry friction)"})


def candidate_of(effect: Effect) -> Candidate:
    """In all legs, or in leg 1 what does nothing where all have it alike."""
    return Candidate(effect=effect, where="leg 1" if effect.places == "one leg" else "all legs")


def shown_values(effect: Effect) -> dict[str, float]:
    """Its typical size; of a vector in the frame of the platform all three numbers, else the first."""
    first = 3 if effect.vector and not effect.four_way else 1
    typical = {p.name: p.typical for p in effect.parameters[:first]}
    return candidate_of(effect).start() | typical | SHOWN_AT.get(effect.name, {})


def on_machine(effect: Effect, machine: Machine, kind: str) -> tuple[float, Signature] | None:
    """(times the residual without it, signature) on one machine; None where nothing changes or nothing simulates."""
    values = shown_values(effect)
    changed = with_settings(machine, {}, [(candidate_of(effect), values)])
    sweep_Hz = values["frequency_Hz"] if "damping_ratio" in values else None
    asked = asked_log(machine, kind, sweep_Hz)
    plain, log = (simulated(one, asked) for one in (machine, changed))
    if not np.all(np.isfinite(log.position)):
        return None
    found: list[tuple[float, Balance, int, Array, Array]] = []
    for balance in library():
        if balance.wants(log, machine) and not (balance.shared_out and kind == "hexapod"):
            before, after = balance.residual(plain, machine), balance.residual(log, machine)
            for place in range(len(after)):
                size = rms(used(plain, before)[place]) + 1e-9 * rms(used(log, after)[place]) + 1e-300
                found.append(
                    (rms(used(log, after - before)[place]) / size, balance, place, before[place], after[place])
                )
    home = advice_of(effect.name).shown_in or {"valve": "continuity", "sensor": ""}.get(effect.balance, effect.balance)
    own = [one for one in found if one[1].name.startswith(home) and one[0] > rules.TELLABLE]
    ratio, balance, place, before, after = max(own or found, key=lambda one: one[0])
    if ratio < rules.SLIGHT:
        return None
    where = balance.places(log)[place]
    signals, v = picture_signals(log, machine, where)
    rest = after[kept(log)]
    over = advice_of(effect.name).over
    if not over:
        settles = "time_constant_s" in values and effect.balance != "sensor"
        over = "time_s" if settles else chosen_signal(balance, signals, rest)
    shown = Signature(
        effect=effect, values=values, machine=machine.machine.name, balance=balance, where=where, signal=over, x=signals[over],
        residual=rest, without=before[kept(log)], outward=v > 0,
    )  # fmt: skip
    if sweep_Hz is not None:
        return ratio, replace(shown, signal="frequency_Hz", x=sweep(sweep_Hz, log.time)[0][kept(log)])
    return ratio, over_the_turning(over_a_period(shown, signals, v), signals, v)


def over_a_period(found: Signature, signals: dict[str, Array], v: Array) -> Signature:
    """Of an effect that is a wave: its residual over one period. Along the stroke only where the piston is slow enough for
    the balance's window to show the wave, and fast enough for the wave to be felt."""
    values = found.values
    if "phase_rad" not in values:
        return found
    if "frequency_Hz" in values:
        period = 1.0 / values["frequency_Hz"]
        return replace(found, signal="time_s", x=signals["time_s"] % period, period=period)
    period = values.get("pitch_m") or values["wavelength_m"]
    rate = np.abs(v) / period
    shown = (
        rate < SHOWN.fastest_Hz
        if found.balance.name != "sensor"
        else (rate > 0.4 * SHOWN.fastest_Hz) & (rate < SHOWN.fastest_Hz)
    )
    return replace(
        found, signal="position_m", x=signals["position_m"][shown] % period, period=period, residual=found.residual[shown],
        without=found.without[shown], outward=found.outward[shown],
    )  # fmt: skip


def over_the_turning(found: Signature, signals: dict[str, Array], v: Array) -> Signature:
    """Of a bristle: its residual just after the reversals."""
    if "bristle_stiffness_N_m" not in found.values:
        return found
    travel = travel_since_reversal(signals["position_m"], v)
    near = travel < SHOWN.turning_m
    return replace(
        found, signal="travel_m", x=travel[near], residual=found.residual[near], without=found.without[near],
        outward=found.outward[near],
    )  # fmt: skip


def sweep(middle_Hz: float, t: Array) -> tuple[Array, Array]:
    """Frequency [Hz] and position [m] of a sweep of constant velocity, from middle_Hz/4 to 2 middle_Hz."""
    growth = np.log(8.0) / t[-1]
    frequency = 0.25 * middle_Hz * np.exp(growth * t)
    angle = 2.0 * np.pi * (frequency - frequency[0]) / growth
    return frequency, SHOWN.sweep_m_s / (2.0 * np.pi * frequency) * np.sin(angle)


def asked_log(machine: Machine, kind: str, sweep_Hz: float | None) -> Log:
    """A log that holds setpoints alone: heave and, of a hexapod, roll and pitch of many frequencies; a sweep of heave about
    that frequency where one is given."""
    n = int((DURATION_S[kind] if sweep_Hz is None else SHOWN.sweep_s) * rules.LOG_RATE_Hz)
    t = np.arange(n) / rules.LOG_RATE_Hz
    fade = np.clip(t, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(t, 0.0, 1.0))
    reach = 0.25 * machine.cylinder.stroke_m
    waves = [fade * sum(a * np.sin(2 * np.pi * f * t + k * f) for f, a in SHOWN.tones_Hz) for k in range(3)]
    if sweep_Hz is not None:
        waves = [fade * sweep(sweep_Hz, t)[1] / reach, 0.0 * t, 0.0 * t]
    if kind == "bench":
        setpoint = 0.5 * machine.cylinder.stroke_m + reach * waves[0][None]
    else:
        kinematics = machine_kinematics(machine)
        pose = np.zeros((n, 6))
        pose[:, 2], pose[:, 3], pose[:, 4] = 0.5 * reach * waves[0], 0.05 * waves[1], 0.05 * waves[2]
        setpoint = np.stack([kinematics.piston_positions(one) for one in pose]).T
    every = max(round(rules.LOG_RATE_Hz / machine.controller.rate_Hz), 1)
    held = np.repeat(setpoint[:, ::every], every, axis=1)[:, :n]
    return Log(
        name="signature", kind=machine.machine.kind, time=t, rate=rules.LOG_RATE_Hz, setpoint=held, position=setpoint
    )


def simulated(machine: Machine, asked: Log) -> Log:
    """What the sensors would show, without noise."""
    out = simulate_log(machine, asked, 0, {})
    columns = dict(asked.columns)
    for stem, rows in out.items():
        if stem in table():
            columns |= zip(table()[stem].columns(asked.n_legs), np.atleast_2d(rows), strict=False)
    return Log(name=asked.name, kind=asked.kind, time=asked.time, rate=asked.rate, columns=columns)


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def axis_of(found: Signature) -> tuple[str, float, str]:
    """(words, scale, unit) of the signal."""
    label, scale, unit = AXES[found.signal]
    if found.period is not None:
        label = f"{label} within a period of {scale * found.period:.3g} {unit}"
    return label, scale, unit


def unit_of(found: Signature) -> str:
    """Of the residual: a balance of a platform has one unit for its forces, another for its moments."""
    units = found.balance.unit.split(", ")
    return units[-1] if found.where.split()[-1] in ("roll", "pitch", "yaw") else units[0]


def title_of(found: Signature) -> str:
    """Effect, its size, the balance and where."""
    first = found.effect.parameters[0]
    size = quantity(found.values[first.name], first.unit, 2)
    balance, *side = found.balance.name.split(" of ")
    place = " of ".join([*side, found.where.removeprefix(f"{balance} ")])
    return f"{found.effect.name.replace('_', ' ')}, {size}: {balance} balance of {place}, {found.machine}"


@styled
def picture(found: Signature) -> Figure:
    """The residual over its signal: with the effect, moving out and in, and without it."""
    label, scale, unit = axis_of(found)
    figure, (plot,) = new_figure(1, title_of(found), height=4.2)
    x, (size, shown) = scale * found.x, scale_of(float(np.max(np.abs(found.residual))), unit_of(found))
    add_dots(plot, x, found.without / size, palette.RAW, "without it")
    sides = ((found.outward, palette.LEGS[0], ", moving out"), (~found.outward, palette.DEVIATION, ", moving in"))
    if found.where.startswith("platform"):
        sides = ((np.full(len(x), True), palette.LEGS[0], ""),)
    for rows, color, words in sides:
        add_dots(plot, x[rows], found.residual[rows] / size, color, f"with it{words}")
    if found.signal == "frequency_Hz":
        own_Hz = found.values["frequency_Hz"]
        plot.axvline(own_Hz, color=palette.REFERENCE, lw=1.0, ls=":", label=f"its own frequency, {own_Hz:g} Hz")
    plot.set_xlabel(f"{label} [{unit}]")
    plot.set_ylabel(f"residual [{shown}]")
    legend(plot)
    return figure


def add_dots(plot: Axes, x: Array, y: Array, color: str, words: str) -> None:
    """Small in the plot, large in its legend."""
    plot.plot(x, y, ".", ms=2.0, color=color)
    plot.plot([], [], ".", ms=6.0, color=color, label=words)


def drawn(found: Signature, width: int = 61, height: int = 13) -> Sequence[str]:
    """The same in characters: + moving out, o moving in, mean of columns; the axis is the residual's zero."""
    x, y = found.x, found.residual
    low, high = (0.0, found.period) if found.period else (np.min(x), np.max(x) + 1e-300)
    edges = np.linspace(low, high, width + 1)
    column = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, width - 1)
    rows = [[" "] * width for _ in range(height)]
    means = {}
    for mark, side in (("+", found.outward), ("o", ~found.outward)):
        for k in range(width):
            own = y[side & (column == k)]
            if len(own):
                means[mark, k] = float(own.mean())
    low, high = min(0.0, *means.values()), max(0.0, *means.values())
    span = max(high - low, 1e-300)
    zero = round((high - 0.0) / span * (height - 1))
    rows[zero] = ["-"] * width
    for (mark, k), value in means.items():
        rows[round((high - value) / span * (height - 1))][k] = mark
    label, scale, unit = axis_of(found)
    left = [f"{high:.2g}", *[""] * (height - 2), f"{low:.2g}"]
    left[zero] = left[zero] or "0"
    lines = [f"{text:>9} |{''.join(row)}" for text, row in zip(left, rows, strict=True)]
    ends = f"{scale * edges[0]:.3g}", f"{scale * edges[-1]:.3g} {unit}"
    return [*lines, " " * 11 + ends[0] + label.center(width - len(ends[0]) - len(ends[1])) + ends[1]]
