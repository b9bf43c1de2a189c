"""Figures of a trace: model against measurement before and after, balances, phase portraits, spectra, parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from hexsim.declaration import Machine
from hexsim.recording import palette
from hexsim.recording.figure_style import (
    Margins,
    legend_above,
    panels,
    plain_frequencies,
    plain_powers,
    png,
    room_for,
    styled,
)
from hexsim.recording.quantity import split_key
from hexsim.recording.zoom import Curve, Panel
from hexsim.signals.channels import channel_arrays, kind_of
from hexsim.signals.log import Log
from hexsim.tracing.held_out import banded
from hexsim.tracing.problems.problem import in_parallel
from hexsim.tracing.report.signals import NOISE_BAND, SCALE, SIGNALS, channel_words
from hexsim.tracing.state import Trace
from hexsim.tracing.steps.residuals import CHANNEL, signals_of

Array = np.ndarray
MEASURED, MEASURED_WIDTH = "#9AA5B1", 3.0  # wide and pale, so that a model on it is seen
COLOURS = {"declared": palette.DEVIATION, "refit": palette.MARK, "with_effect": palette.RESPONSE}


def labels_of(result: Trace) -> dict[str, str]:
    """What each model is called in the legends."""
    return {"declared": "as declared", "refit": "declared parameters refitted", "with_effect": f"with {added(result)}"}


def added(result: Trace) -> str:
    """What the last model has beside the declared one."""
    names = [effect.candidate.label.replace("_", " ") for effect in result.effects]
    return " and ".join(names) or "the learned curve"


def machines_of(result: Trace) -> dict[str, Machine]:
    """The models that are compared; the last one only if there is an effect."""
    models = {"declared": result.machine, "refit": result.base.fitted_machine()}
    if result.effects or result.learned:
        models["with_effect"] = result.fitted
    return models


def worst_channels(result: Trace, log: str) -> list[str]:
    """One channel of each kind: the one that the refitted machine gets most wrong."""
    best: dict[str, tuple[float, str]] = {}
    for name, row in result.error[log].items():
        share = row["refit"] / max(row["noise"], 1e-300)
        if np.isfinite(share) and share > best.get(kind_of(name), (0.0, ""))[0]:
            best[kind_of(name)] = (share, name)
    return [name for _, name in best.values()]


def shown_part(result: Trace, span_s: float = 4.0) -> slice:
    """Samples of the first held-out run that are drawn over time."""
    log = result.validate_problem.logs[0]
    start = min(result.validate_problem.settle(0) + int(2.0 * log.rate), log.n // 2)
    return slice(start, min(start + int(span_s * log.rate), log.n))


def model_lines(result: Trace) -> list[Line2D]:
    """Legend entries of the models."""
    names = labels_of(result)
    return [Line2D([], [], color=COLOURS[key], lw=1.6, label=names[key]) for key in machines_of(result)]


def answers_of(result: Trace) -> dict[str, Log]:
    """What each model answers to the first held-out run: made once, for all figures."""
    models = machines_of(result)
    answers = in_parallel(lambda machine: result.validate_problem.simulated(machine, 0), models.values())
    return dict(zip(models, answers, strict=True))


@styled
def comparison(result: Trace, answers: Mapping[str, Log]) -> bytes:
    """Measured against simulated on the first held-out run: signals left, residuals right."""
    problem, part = result.validate_problem, shown_part(result)
    log, channels = problem.logs[0], worst_channels(result, problem.logs[0].name)
    time, shown = log.time[part], {name: channel_arrays(answer) for name, answer in answers.items()}
    room = Margins(left=0.6, top=0.52, across=0.62, between=0.4)
    figure, axes = panels(len(channels), 2, 0.5 + 1.9 * len(channels), room, sharex=True)
    for (left, right), channel in zip(axes, channels, strict=True):
        name, scale, unit, rest_scale, rest_unit = SCALE[kind_of(channel)]
        measured = problem.measured[0][channel]
        whole = scale * banded(channel, log.time, measured)[part]
        left.plot(time, whole, color=MEASURED, lw=MEASURED_WIDTH)
        noise = rest_scale * result.error[log.name][channel]["noise"]
        right.axhspan(-2 * noise, 2 * noise, color=NOISE_BAND, zorder=0)
        for key, answer in shown.items():
            left.plot(time, scale * banded(channel, log.time, answer[channel])[part], color=COLOURS[key], lw=0.9)
            rest = banded(channel, log.time, measured - answer[channel])[part]
            right.plot(time, rest_scale * rest, color=COLOURS[key], lw=0.7)
        words = channel_words(channel) + (", 50 Hz band" if "50 Hz" in name else "")
        left.set_title(f"{words} [{unit}]", loc="left")
        right.set_title(f"measured − model [{rest_unit}]", loc="left")
    for plot in axes[-1]:
        plot.set_xlabel("time [s]")
    legend_above(
        figure,
        Line2D([], [], color=MEASURED, lw=MEASURED_WIDTH, label="measured"),
        *model_lines(result),
        Patch(color=NOISE_BAND, label="sensors' noise, 95 %"),
    )
    return png(figure)


def comparison_panels(result: Trace, answers: Mapping[str, Log]) -> list[Panel]:
    """The same over the whole run, to be looked at closely: the first channel, and what each model leaves of each."""
    problem, names = result.validate_problem, labels_of(result)
    log, channels = problem.logs[0], worst_channels(result, problem.logs[0].name)
    late, shown, panels = slice(problem.settle(0), None), {k: channel_arrays(v) for k, v in answers.items()}, []
    time = log.time[late]
    for k, channel in enumerate(channels):
        name, scale, unit, rest_scale, rest_unit = SCALE[kind_of(channel)]
        words = channel_words(channel) + (", 50 Hz band" if "50 Hz" in name else "")
        measured = problem.measured[0][channel]
        own = {key: banded(channel, log.time, answer[channel])[late] for key, answer in shown.items()}
        rests = {key: banded(channel, log.time, measured - answer[channel])[late] for key, answer in shown.items()}
        if k == 0:
            whole = banded(channel, log.time, measured)[late]
            curves = [Curve(names[key], scale * values, COLOURS[key]) for key, values in own.items()]
            panels.append(
                Panel(f"{words} [{unit}]", time, [Curve("measured", scale * whole, MEASURED, MEASURED_WIDTH), *curves])
            )
        noise = 2.0 * rest_scale * result.error[log.name][channel]["noise"]
        curves = [Curve(names[key], rest_scale * values, COLOURS[key]) for key, values in rests.items()]
        panels.append(Panel(f"measured − model, {words} [{rest_unit}]", time, curves, band=(-noise, noise)))
    return panels


@styled
def spectra(result: Trace, answers: Mapping[str, Log]) -> bytes:
    """Spectra of the residuals on the first held-out run, and the sensors' noise."""
    problem, log = result.validate_problem, result.validate_problem.logs[0]
    channels = worst_channels(result, log.name)
    rows = (len(channels) + 1) // 2
    figure, axes = panels(rows, 2, 0.5 + 2.2 * rows, Margins(left=0.62, top=0.52, across=0.65, between=0.8))
    axes = axes.ravel()
    for name, simulated in answers.items():
        answer = channel_arrays(simulated)
        for plot, channel in zip(axes, channels, strict=False):
            rest = (problem.measured[0][channel] - answer[channel])[problem.settle(0) :]
            if np.all(np.isfinite(rest)) and np.ptp(rest) > 0.0:  # a constant one has no spectrum
                f, power = density(rest, log.rate)
                plot.loglog(f, SCALE[kind_of(channel)][3] * np.sqrt(power), color=COLOURS[name], lw=1.3)
    for plot, channel in zip(axes, channels, strict=False):
        scale, unit = SCALE[kind_of(channel)][3:]
        noise = scale * problem.noise[kind_of(channel)] / np.sqrt(log.rate / 2)
        plot.axhline(noise, color=palette.INK, lw=1.0, ls=":")
        low, high = plot.get_ylim()
        plot.set_ylim(min(low, noise / 4), max(high, noise * 4))  # a decade at least
        plot.set_title(f"{channel_words(channel)} [{unit}/√Hz]", loc="left")
        plot.set_xlabel("frequency [Hz]")
        plain_frequencies(plot)
        plain_powers(plot)
    for plot in axes[len(channels) :]:
        plot.set_visible(False)
    legend_above(
        figure, *model_lines(result), Line2D([], [], color=palette.INK, lw=1.0, ls=":", label="sensor's noise alone")
    )
    return png(figure)


def density(x: Array, rate: float, bins_a_decade: int = 30) -> tuple[Array, Array]:
    """Power spectral density, Welch with windows of about 4 s, averaged over bins that are even in log(f)."""
    from scipy.signal import welch

    f, power = welch(x - x.mean(), rate, nperseg=min(int(4 * rate), len(x)))
    f, power = f[1:], power[1:]
    bins = np.floor(bins_a_decade * np.log10(f / f[0])).astype(int)
    _, place = np.unique(bins, return_inverse=True)
    count = np.bincount(place)
    return np.bincount(place, f) / count, np.bincount(place, power) / count


@styled
def portraits(result: Trace, answers: Mapping[str, Log]) -> bytes:
    """Phase portraits of the first held-out run: velocity over position, pressure over velocity, velocity over volts."""
    log, leg = result.validate_problem.logs[0], portrait_leg(result)
    part = shown_part(result)
    shown = slice(part.start // CHANNEL.thin, part.stop // CHANNEL.thin)
    pairs = [("position_m", "velocity_m_s"), ("velocity_m_s", "pressure_bottom_Pa"), ("valve_V", "velocity_m_s")]
    measured, _ = signals_of(log, result.machine, leg)
    pairs = [pair for pair in pairs if all(name in measured for name in pair)]
    drawn = {name: signals_of(answer, result.machine, leg)[0] for name, answer in answers.items()}
    figure, axes = panels(1, len(pairs), 3.4, Margins(top=0.35, across=0.72))
    for plot, pair in zip(axes[0], pairs, strict=True):
        (x_name, x_scale, x_unit), (y_name, y_scale, y_unit) = (SIGNALS[name] for name in pair)
        for own, color, width in [
            (measured, MEASURED, MEASURED_WIDTH),
            *((own, COLOURS[name], 1.0) for name, own in drawn.items()),
        ]:
            x, y = (own[name][shown] for name in pair)
            plot.plot(x_scale * x, y_scale * y, color=color, lw=width)
        plot.set_xlabel(f"{x_name} [{x_unit}]")
        plot.set_ylabel(f"{y_name} [{y_unit}]")
        plot.margins(0.04)
    legend_above(figure, Line2D([], [], color=MEASURED, lw=MEASURED_WIDTH, label="measured"), *model_lines(result))
    return png(figure)


def portrait_leg(result: Trace) -> str:
    """The leg with the effect, else the one whose balance is furthest off."""
    places = [effect.candidate.where for effect in result.effects]
    places += [v.where for v in sorted(result.violations, key=lambda v: -v.above_null)]
    return next((place for place in places if place.startswith("leg ")), "leg 1")


@styled
def parameters(result: Trace) -> bytes:
    """Where each declared parameter ended inside its uncertainty."""
    entries = result.report["parameters"]
    names = [split_key(prior.key)[0] for prior in result.final.priors]
    figure, axes = panels(1, 1, 0.8 + 0.25 * len(entries), Margins(left=room_for(names), top=0.06, bottom=0.3))
    plot = axes[0, 0]
    for k, (prior, deviation) in enumerate(zip(result.final.priors, result.final.deviations, strict=True)):
        color = palette.DEVIATION if entries[prior.key]["at_bound"] else palette.RESPONSE
        plot.plot([-1, 1], [k, k], color=palette.GRID, lw=6, solid_capstyle="butt", zorder=1)
        plot.plot([0, deviation / prior.half_width], [k, k], color=color, lw=1.6, zorder=2)
        plot.plot(deviation / prior.half_width, k, "o", color=color, ms=6, zorder=3)
        plot.annotate(f"±{100 * prior.half_width:.3g} %", (1.03, k), va="center", fontsize=8, color=palette.REFERENCE)
    plot.axvline(0, color=palette.INK, lw=0.8)
    plot.set_yticks(range(len(entries)), names)
    plot.tick_params(axis="y", length=0)
    plot.grid(False)
    plot.invert_yaxis()
    plot.set_xlim(-1.04, 1.15)
    plot.set_xticks([-1, 0, 1], ["lower limit", "declared", "upper limit"])
    return png(figure)
