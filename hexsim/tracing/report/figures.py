"""Figures of a trace: model against measurement before and after, balances, phase portraits, spectra, parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from hexsim.declaration import Machine
from hexsim.recording import palette
from hexsim.recording.figure_style import WIDTH_IN, legend_above, plain_frequencies, plain_powers, png, styled
from hexsim.recording.quantity import scale_of, split_key
from hexsim.signals.channels import SETTLE_S, kind_of
from hexsim.tracing import rules
from hexsim.tracing.balances import BALANCES
from hexsim.tracing.balances.null import END_S
from hexsim.tracing.dependence import CURVES, design, hats, knots_of, ridge
from hexsim.tracing.state import Trace, Violation
from hexsim.tracing.steps.held_out_errors import banded
from hexsim.tracing.steps.residuals import THIN, rest_of, signals_of
from hexsim.tracing.steps.violations import balance_named

Array = np.ndarray
# kind of channel: (name, scale and unit of the signal, scale and unit of what is left of it)
SCALE = {
    "position_m": ("position", 1e3, "mm", 1e6, "µm"),
    "pressure_bottom_Pa": ("chamber pressure", 1e-5, "bar", 1e-5, "bar"),
    "pressure_supply_Pa": ("supply pressure", 1e-5, "bar", 1e-5, "bar"),
    "acceleration_m_s2": ("acceleration, 50 Hz band", 1.0, "m/s²", 1.0, "m/s²"),
    "angular_acceleration_rad_s2": ("angular acceleration, 50 Hz band", 1.0, "rad/s²", 1.0, "rad/s²"),
}
SIGNALS = {
    "position_m": ("position", 1e3, "mm"),
    "velocity_m_s": ("velocity", 1e3, "mm/s"),
    "valve_V": ("valve voltage", 1.0, "V"),
    "time_s": ("time", 1.0, "s"),
    "pressure_bottom_Pa": ("chamber pressure", 1e-5, "bar"),
    "pressure_supply_Pa": ("supply pressure", 1e-5, "bar"),
    "acceleration_m_s2": ("acceleration", 1.0, "m/s²"),
}
USUAL = {"continuity": "valve_V", "valve": "valve_V", "supply": "velocity_m_s", "sensor": "acceleration_m_s2"}
SPAN_S = 4.0  # [s] of the held-out run that the comparison shows
MEASURED, MEASURED_WIDTH = "#9AA5B1", 3.0  # wide and pale, so that a model on it is seen
COLOURS = {"declared": palette.DEVIATION, "refit": palette.MARK, "with_effect": palette.RESPONSE}
NOISE_BAND, NULL_BAND = "#CBE0F0", "#E7EFF6"
DIRECTIONS = {"extending": ("#56B4E9", "#004D7A"), "retracting": ("#F2B97F", "#9C3D00")}  # points, curve
MOST_POINTS = 4000  # a panel
LEAST_R2 = 0.5  # of a dependence that is drawn in place of the balance's usual signal
BINS_A_DECADE = 30  # of a spectrum


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


def channel_words(channel: str) -> str:
    """pressure_bottom_3_Pa -> chamber pressure of leg 3."""
    kind = kind_of(channel)
    name, place = SIGNALS.get(kind, (split_key(kind)[0],))[0], split_key(channel)[0].split()[-1]
    if place.isdigit():
        return f"{name} of leg {place}"
    return f"{name} {place}" if place in ("x", "y", "z") else name


def worst_channels(result: Trace, log: str) -> list[str]:
    """One channel of each kind: the one that the refitted machine gets most wrong."""
    best: dict[str, tuple[float, str]] = {}
    for name, row in result.error[log].items():
        share = row["refit"] / max(row["noise"], 1e-300)
        if np.isfinite(share) and share > best.get(kind_of(name), (0.0, ""))[0]:
            best[kind_of(name)] = (share, name)
    return [name for _, name in best.values()]


def shown_part(result: Trace) -> slice:
    """Samples of the first held-out run that are drawn over time."""
    log = result.validate_problem.logs[0]
    start = min(result.validate_problem.settle(0) + int(2.0 * log.rate), log.n // 2)
    return slice(start, min(start + int(SPAN_S * log.rate), log.n))


def model_lines(result: Trace) -> list[Line2D]:
    """Legend entries of the models."""
    names = labels_of(result)
    return [Line2D([], [], color=COLOURS[key], lw=1.6, label=names[key]) for key in machines_of(result)]


@styled
def comparison(result: Trace) -> bytes:
    """Measured against simulated on the first held-out run: signals left, what is left of them right."""
    problem, part = result.validate_problem, shown_part(result)
    log, channels = problem.logs[0], worst_channels(result, problem.logs[0].name)
    time = log.time[part]
    answers = {
        name: dict(zip(problem.channels(0), problem.answer(m, 0), strict=True))
        for name, m in machines_of(result).items()
    }
    figure = Figure(figsize=(WIDTH_IN, 0.5 + 1.9 * len(channels)), layout="constrained")
    axes = figure.subplots(len(channels), 2, squeeze=False, sharex=True)
    for (left, right), channel in zip(axes, channels, strict=True):
        name, scale, unit, rest_scale, rest_unit = SCALE[kind_of(channel)]
        measured = problem.measured[0][channel]
        whole = scale * banded(channel, log.time, measured)[part]
        left.plot(time, whole, color=MEASURED, lw=MEASURED_WIDTH)
        noise = rest_scale * result.error[log.name][channel]["noise"]
        right.axhspan(-2 * noise, 2 * noise, color=NOISE_BAND, zorder=0)
        for key, answer in answers.items():
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


# ---- balances --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Explained:
    """By what the residual of a balance is drawn: a signal, the form of the curve over it, an outside frequency."""

    signal: str
    form: str
    frequency_Hz: float | None = None


def explained_by(result: Trace, line: Violation) -> Explained:
    """What the residual depends on, where the balance is violated; else what it usually depends on."""
    line = replace(line, name=family(line.name))
    known = [r for r in result.unexplained if (r.violation.name, r.violation.where) == (line.name, line.where)]
    if not line.violated and not known:
        return Explained(signal=USUAL.get(line.name, "velocity_m_s"), form="plain")
    logs = result.fit_problem.logs
    rest = known[0] if known else rest_of(balance_named(line.name, logs[0]), line, logs)
    found = rest.dependence
    if found.r2_cv < LEAST_R2:
        return Explained(signal=USUAL.get(line.name, "velocity_m_s"), form="plain")
    return Explained(
        signal="time_s" if found.form == "tone" else found.signal, form=found.form, frequency_Hz=found.frequency_Hz
    )


def family(name: str) -> str:
    """Continuity and valve are one residual."""
    return "continuity" if name == "valve" else name


def place_words(line: Violation) -> str:
    """leg 2, all legs, or the axis of the platform."""
    return line.where.removeprefix("platform").strip() or line.where


def unit_of(line: Violation) -> str:
    """N for the platform's forces, N m for its moments; else what the balance says."""
    force, _, moment = line.unit.partition(", ")
    return moment if moment and place_words(line) in ("roll", "pitch", "yaw") else force


def residual_points(result: Trace, line: Violation, machine: Machine, signal: str) -> tuple[Array, Array, Array]:
    """(signal, residual, velocity) of a balance over the fit runs."""
    balance, found = balance_named(line.name, result.fit_problem.logs[0]), []
    for log in result.fit_problem.logs:
        own, v = signals_of(log, machine, line.where)
        keep = slice(int((SETTLE_S + 0.1) * log.rate), log.n - int(END_S * log.rate), THIN)
        found.append((own[signal], balance.residual(log, machine)[line.place, keep], v))
    x, r, v = zip(*found, strict=True)
    return np.concatenate(x), np.concatenate(r), np.concatenate(v)


def worst_of_each(result: Trace) -> list[Violation]:
    """The worst place of every balance, violated ones first; continuity and valve are one residual."""
    chosen: dict[str, Violation] = {}
    order = {balance.name: k for k, balance in enumerate(BALANCES)}
    for line in sorted(result.violations, key=lambda v: -v.above_null):
        chosen.setdefault(family(line.name), line)
    return sorted(chosen.values(), key=lambda v: (not v.violated, order.get(v.name, len(order))))


@styled
def balances(result: Trace) -> bytes:
    """Residual of each balance against the signal that explains it, with the fitted curve; before and after."""
    lines = worst_of_each(result)
    models = {"before": None} | ({"after": result.fitted} if result.effects or result.learned else {})
    figure = Figure(figsize=(WIDTH_IN, 0.6 + 2.1 * len(lines)), layout="constrained")
    axes = figure.subplots(len(lines), len(models), squeeze=False)
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
    x, r, v = residual_points(result, line, machine, by.signal)
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
    plot.set_xlabel(f"{words} [{x_unit}]")
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


# ---- spectra, phase portraits, parameters ----------------------------------------------------------------------------


@styled
def spectra(result: Trace) -> bytes:
    """Spectra of what is left on the first held-out run, and the sensors' noise."""
    problem, log = result.validate_problem, result.validate_problem.logs[0]
    channels = worst_channels(result, log.name)
    rows = (len(channels) + 1) // 2
    figure = Figure(figsize=(WIDTH_IN, 0.5 + 2.2 * rows), layout="constrained")
    axes = figure.subplots(rows, 2, squeeze=False).ravel()
    for name, machine in machines_of(result).items():
        answer = dict(zip(problem.channels(0), problem.answer(machine, 0), strict=True))
        for plot, channel in zip(axes, channels, strict=False):
            rest = (problem.measured[0][channel] - answer[channel])[problem.settle(0) :]
            if np.all(np.isfinite(rest)):
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


def density(x: Array, rate: float) -> tuple[Array, Array]:
    """Power spectral density, Welch with windows of about 4 s, averaged over bins that are even in log(f)."""
    from scipy.signal import welch

    f, power = welch(x - x.mean(), rate, nperseg=min(int(4 * rate), len(x)))
    f, power = f[1:], power[1:]
    bins = np.floor(BINS_A_DECADE * np.log10(f / f[0])).astype(int)
    _, place = np.unique(bins, return_inverse=True)
    count = np.bincount(place)
    return np.bincount(place, f) / count, np.bincount(place, power) / count


@styled
def portraits(result: Trace) -> bytes:
    """Phase portraits of the first held-out run: velocity over position, pressure over velocity, velocity over volts."""
    problem, log, models = result.validate_problem, result.validate_problem.logs[0], machines_of(result)
    leg = portrait_leg(result)
    part = shown_part(result)
    shown = slice(part.start // THIN, part.stop // THIN)
    pairs = [("position_m", "velocity_m_s"), ("velocity_m_s", "pressure_bottom_Pa"), ("valve_V", "velocity_m_s")]
    measured, _ = signals_of(log, result.machine, leg)
    pairs = [pair for pair in pairs if all(name in measured for name in pair)]
    drawn = {name: signals_of(problem.simulated(m, 0), result.machine, leg)[0] for name, m in models.items()}
    figure = Figure(figsize=(WIDTH_IN, 3.4), layout="constrained")
    for plot, pair in zip(figure.subplots(1, len(pairs), squeeze=False)[0], pairs, strict=True):
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
    figure = Figure(figsize=(WIDTH_IN, 0.8 + 0.25 * len(entries)), layout="constrained")
    plot = figure.subplots()
    for k, (prior, deviation) in enumerate(zip(result.final.priors, result.final.deviations, strict=True)):
        color = palette.DEVIATION if entries[prior.key]["at_bound"] else palette.RESPONSE
        plot.plot([-1, 1], [k, k], color=palette.GRID, lw=6, solid_capstyle="butt", zorder=1)
        plot.plot([0, deviation / prior.half_width], [k, k], color=color, lw=1.6, zorder=2)
        plot.plot(deviation / prior.half_width, k, "o", color=color, ms=6, zorder=3)
        plot.annotate(f"±{100 * prior.half_width:.3g} %", (1.03, k), va="center", fontsize=8, color=palette.WANTED)
    plot.axvline(0, color=palette.INK, lw=0.8)
    plot.set_yticks(range(len(entries)), [split_key(prior.key)[0] for prior in result.final.priors])
    plot.tick_params(axis="y", length=0)
    plot.grid(False)
    plot.invert_yaxis()
    plot.set_xlim(-1.04, 1.15)
    plot.set_xticks([-1, 0, 1], ["lower limit", "declared", "upper limit"])
    return png(figure)
