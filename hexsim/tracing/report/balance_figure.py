"""The figure of the balances: each residual over the signal that it depends on, before and after."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from hexsim.declaration import Machine
from hexsim.recording import palette
from hexsim.recording.figure_style import MOST_POINTS, Margins, legend_above, panels, png, styled
from hexsim.recording.quantity import scale_of
from hexsim.tracing import rules
from hexsim.tracing.balances import balance_named, family, library
from hexsim.tracing.dependence import CURVES, behind_low_pass, design, hats, knots_of, low_passed, ridge
from hexsim.tracing.report.signals import NOISE_BAND, SIGNALS
from hexsim.tracing.state import Trace, Violation
from hexsim.tracing.steps.residuals import CHANNEL, kept, signals_of, unexplained_of

Array = np.ndarray
NULL_BAND = "#E7EFF6"
DIRECTIONS = {"extending": ("#56B4E9", "#004D7A"), "retracting": ("#F2B97F", "#9C3D00")}  # points, curve


@dataclass(frozen=True, kw_only=True)
class Explained:
    """By what the residual of a balance is drawn: a signal, its low-pass, the form of the curve over it, an outside frequency."""

    signal: str
    form: str
    frequency_Hz: float | None = None
    memory_s: float | None = None


def explained_by(result: Trace, line: Violation) -> Explained:
    """What the residual depends on, where the balance is violated; else what it usually depends on."""
    line, logs = replace(line, name=family(line.name)), result.fit_problem.logs
    balance = balance_named(line.name, line.machine)
    known = [r for r in result.unexplained if (r.violation.name, r.violation.where) == (line.name, line.where)]
    if not line.violated and not known:
        return Explained(signal=balance.usual_signal, form="plain")
    rest = known[0] if known else unexplained_of(balance, line, logs)
    found = rest.dependence
    if found.r2_cv < rules.MAIN:
        return Explained(signal=balance.usual_signal, form="plain")
    return Explained(
        signal="time_s" if found.form == "tone" else found.signal, form=found.form, frequency_Hz=found.frequency_Hz,
        memory_s=None if found.form == "memory" else found.memory_s,
    )  # fmt: skip


def place_words(line: Violation) -> str:
    """leg 2, all legs, or the axis of the platform."""
    return line.where.removeprefix("platform").strip() or line.where


def unit_of(line: Violation) -> str:
    """N for the platform's forces, N m for its moments; else what the balance says."""
    force, _, moment = line.unit.partition(", ")
    return moment if moment and place_words(line) in ("roll", "pitch", "yaw") else force


def residual_points(result: Trace, line: Violation, machine: Machine, by: Explained) -> tuple[Array, Array, Array]:
    """(signal, residual, velocity) of a balance over the fit runs."""
    balance, found = balance_named(line.name, line.machine), []
    for log in result.fit_problem.logs:
        own, v = signals_of(log, machine, line.where)
        x = low_passed(own[by.signal], by.memory_s, log.rate / CHANNEL.thin) if by.memory_s else own[by.signal]
        found.append((x, balance.residual(log, machine)[line.place, kept(log)], v))
    x, r, v = zip(*found, strict=True)
    return np.concatenate(x), np.concatenate(r), np.concatenate(v)


def worst_of_each(result: Trace) -> list[Violation]:
    """The worst place of every balance, violated ones first; continuity and valve are one residual."""
    chosen: dict[str, Violation] = {}
    order = {balance.name: k for k, balance in enumerate(library())}
    for line in sorted(result.violations, key=lambda v: -v.above_null):
        chosen.setdefault(family(line.name), line)
    return sorted(chosen.values(), key=lambda v: (not v.violated, order.get(v.name, len(order))))


@styled
def balances(result: Trace) -> bytes:
    """Residual of each balance against the signal that explains it, with the fitted curve; before and after."""
    lines = worst_of_each(result)
    models = {"before": None} | ({"after": result.fitted} if result.effects or result.learned else {})
    figure, axes = panels(len(lines), len(models), 0.6 + 2.1 * len(lines), Margins(top=0.52, between=0.82))
    for row, line in zip(axes, lines, strict=True):
        by = explained_by(result, line)
        for plot, (when, machine) in zip(row, models.items(), strict=True):
            draw_residual(plot, result, line, machine or line.machine, by)
            title = f"{line.name}, {place_words(line)}" + (f": {when}" if len(models) > 1 else "")
            plot.set_title(title + (" (violated)" if line.violated and machine is None else ""), loc="left")
    legend_above(
        figure,
        *(Line2D([], [], ls="", marker="o", ms=4, color=c, label=label) for label, (c, _) in DIRECTIONS.items()),
        Line2D([], [], color=palette.INK, lw=1.6, label="fitted curve (blue and brown: one each way)"),
        Patch(color=NOISE_BAND, label="noise, 95 %"),
        Patch(color=NULL_BAND, label="balance holds"),
    )
    return png(figure)


def draw_residual(plot: Axes, result: Trace, line: Violation, machine: Machine, by: Explained) -> None:
    """Points coloured by the direction of motion, the curve of the dependence through them, noise behind."""
    x, r, v = residual_points(result, line, machine, by)
    one, unit = scale_of(2 * line.sigma, unit_of(line))
    words, scale, x_unit = SIGNALS[by.signal]
    for limit, color in (
        (2 * line.sigma * rules.VIOLATED * max(line.null, 1.0), NULL_BAND),
        (2 * line.sigma, NOISE_BAND),
    ):
        plot.axhspan(-limit / one, limit / one, color=color, zorder=0)
    if by.frequency_Hz:
        x, words, scale, x_unit = (x * by.frequency_Hz) % 1.0, f"phase of {by.frequency_Hz:.2f} Hz", 360.0, "deg"
        first = len(x) // len(result.fit_problem.logs)
        x, r, v = x[:first], r[:first], v[:first]  # another run has another phase
    thin = slice(None, None, max(1, len(x) // MOST_POINTS))
    for own, (pale, _) in zip((v > 0, v <= 0), DIRECTIONS.values(), strict=True):
        shown = np.flatnonzero(own)[thin]
        plot.plot(scale * x[shown], r[shown] / one, ".", ms=2, mew=0, color=pale, rasterized=True)
    for color, knots, curve in fitted_curves(by.form, x, r, v):
        plot.plot(scale * knots, curve / one, color=color, lw=1.7)
    plot.set_xlabel(f"{behind_low_pass(words, by.memory_s)} [{x_unit}]")
    plot.set_ylabel(f"residual [{unit}]")


def fitted_curves(form: str, x: Array, r: Array, v: Array) -> list[tuple[str, Array, Array]]:
    """(colour, knots, curve) of a dependence: one curve, or one a direction of motion (a product: at its typical speed)."""
    if form == "tone":  # x is the phase, 0 to 1
        phase = np.linspace(0.0, 1.0, 73)
        waves = [np.stack([np.sin(2 * np.pi * p), np.cos(2 * np.pi * p), np.ones(len(p))], axis=1) for p in (x, phase)]
        return [(palette.INK, phase, waves[1] @ np.linalg.lstsq(waves[0], r, rcond=None)[0])]
    knots = knots_of(x)
    if form == "size":
        theta, _ = ridge(hats(x, knots), np.abs(r))
        return [(palette.INK, knots, theta), (palette.INK, knots, -theta)]
    if form not in CURVES:  # a memory or a distorted channel shows as a loop: one curve each way
        form = "direction"
    theta, _ = ridge(design(form, x, v, knots), r)
    if form == "plain":
        return [(palette.INK, knots, theta)]
    out, back = (theta, -theta) if form == "product" else np.split(theta, 2)
    return [(dark, knots, curve) for (_, dark), curve in zip(DIRECTIONS.values(), (out, back), strict=True)]
