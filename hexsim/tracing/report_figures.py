"""Figures of a trace: model against measurement before and after, balances, phase portraits, spectra, parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from hexsim.recording import palette
from hexsim.recording.figure_style import WIDTH_IN, png, styled
from hexsim.tracing.balances import BALANCES
from hexsim.tracing.channels import kind_of
from hexsim.tracing.dependence import hats, knots_of, ridge
from hexsim.tracing.errors_before_after import banded
from hexsim.tracing.localise import Violation, balance_named
from hexsim.tracing.null import END_S
from hexsim.tracing.unexplained import signals_of

if TYPE_CHECKING:
    from hexsim.machine.declaration import Machine
    from hexsim.tracing.trace import TraceResult

Array = np.ndarray
SCALE = {
    "position_m": (1e3, "position [mm]", 1e6, "µm"),
    "pressure_bottom_Pa": (1e-5, "chamber pressure [bar]", 1e-5, "bar"),
    "pressure_supply_Pa": (1e-5, "supply pressure [bar]", 1e-5, "bar"),
    "acceleration_m_s2": (1.0, "acceleration, 50 Hz band [m/s²]", 1.0, "m/s²"),
    "angular_acceleration_rad_s2": (1.0, "angular acceleration [rad/s²]", 1.0, "rad/s²"),
}
SIGNAL_NAMES = {
    "position_m": "position [m]", "velocity_m_s": "velocity [m/s]", "valve_V": "valve [V]", "time_s": "time [s]",
    "pressure_bottom_Pa": "chamber pressure [Pa]", "pressure_supply_Pa": "supply pressure [Pa]",
    "acceleration_m_s2": "acceleration [m/s²]",
}  # fmt: skip
SPAN_S = 4.0  # [s] of the held-out run that the comparison shows
COLOURS = {"declared": palette.RAW, "refit": palette.MARK, "with_effect": palette.RESPONSE}
LABELS = {"declared": "declared", "refit": "parameters refitted", "with_effect": "with effect"}


def machines_of(result: TraceResult) -> dict[str, Machine]:
    """The three models that are compared; the last one only if there is an effect."""
    models = {"declared": result.machine, "refit": result.base.fitted_machine()}
    if result.effects or result.learned:
        models["with_effect"] = result.fitted
    return models


def worst_channels(result: TraceResult, log: str) -> list[str]:
    """One channel of each kind: the one that the declared machine gets most wrong."""
    best: dict[str, tuple[float, str]] = {}
    for name, row in result.error[log].items():
        share = row["declared"] / max(row["noise"], 1e-300)
        if np.isfinite(share) and share > best.get(kind_of(name), (0.0, ""))[0]:
            best[kind_of(name)] = (share, name)
    return [name for _, name in best.values()]


@styled
def comparison(result: TraceResult) -> bytes:
    """Measured against simulated on the first held-out run: signals left, what is left of them right."""
    question, i = result.validate_question, 0
    log = question.logs[i]
    channels = worst_channels(result, log.name)
    answers = {
        name: dict(zip(question.channels(i), question.answer(m, i), strict=True))
        for name, m in machines_of(result).items()
    }
    start = min(question.settle(i) + int(2.0 * log.rate), log.n // 2)
    part = slice(start, min(start + int(SPAN_S * log.rate), log.n))
    figure = Figure(figsize=(WIDTH_IN, 2.0 * len(channels)), layout="constrained")
    axes = figure.subplots(len(channels), 2, squeeze=False, sharex=True, width_ratios=(1, 1))
    for row, channel in zip(axes, channels, strict=True):
        scale, title, rest_scale, unit = SCALE[kind_of(channel)]
        measured = question.measured[i][channel]
        row[0].plot(
            log.time[part],
            scale * banded(channel, log.time, measured)[part],
            color=palette.INK,
            lw=1.6,
            label="measured",
        )
        for name, answer in answers.items():
            shown = banded(channel, log.time, answer[channel])
            row[0].plot(log.time[part], scale * shown[part], color=COLOURS[name], lw=0.9, label=LABELS[name])
            rest = banded(channel, log.time, measured - answer[channel])
            row[1].plot(log.time[part], rest_scale * rest[part], color=COLOURS[name], lw=0.7, label=LABELS[name])
        row[0].set_title(title if log.n_legs == 1 else f"{title}: {channel}", loc="left")
        row[1].set_title(f"measured - simulated [{unit}]", loc="left")
        noise = rest_scale * result.error[log.name][channel]["noise"]
        row[1].axhspan(-2 * noise, 2 * noise, color="#DDEBF5", zorder=0, label="noise, 95 %")
    axes[0, 0].legend(loc="upper right", ncols=2)
    axes[0, 1].legend(loc="upper right", ncols=2)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    return png(figure)


def residual_points(result: TraceResult, line: Violation, machine: Machine, signal: str) -> tuple[Array, Array]:
    """(signal, residual) of a balance over the fit runs."""
    balance, xs, rs = balance_named(line.name, result.fit_question.logs[0]), [], []
    for log in result.fit_question.logs:
        own, _ = signals_of(log, machine, line.where)
        x = own[signal]
        n = log.n - int(END_S * log.rate)
        r = balance.residual(log, machine)[line.place, :n][-len(x) * 5 :][::5]
        xs.append(x[-len(r) :])
        rs.append(r[: len(x)])
    return np.concatenate(xs), np.concatenate(rs)


def explaining_signal(result: TraceResult, line: Violation) -> str:
    """The signal against which a residual is drawn: what it depends on, else what it usually depends on."""
    for rest in result.unexplained:
        if rest.violation.name == line.name and rest.violation.where == line.where and rest.dependence.form != "tone":
            return rest.dependence.signal
    return {"continuity": "valve_V", "valve": "valve_V", "supply": "velocity_m_s", "sensor": "acceleration_m_s2"}.get(
        line.name, "velocity_m_s"
    )


@styled
def balances(result: TraceResult) -> bytes:
    """Residual of each balance against the signal that explains it, with the fitted curve; before and after."""
    chosen: dict[str, Violation] = {}
    for line in sorted(result.violations, key=lambda v: -v.violation / max(v.null, 1.0)):
        if line.name != "valve":
            chosen.setdefault(line.name, line)
    names = [balance.name for balance in BALANCES if balance.name in chosen]
    names = list(dict.fromkeys(names))
    columns = 2 if result.effects or result.learned else 1
    figure = Figure(figsize=(WIDTH_IN, 2.1 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), columns, squeeze=False)
    for row, name in zip(axes, names, strict=True):
        line = chosen[name]
        signal = explaining_signal(result, line)
        limits = None
        for ax, machine, when in zip(
            row, (line.machine, result.fitted), ("own parameters refitted", "with effect"), strict=False
        ):
            x, r = residual_points(result, line, machine, signal)
            ax.scatter(x[::2], r[::2], s=2, color=palette.RAW, rasterized=True, linewidths=0)
            knots = knots_of(x)
            theta, _ = ridge(hats(x, knots), r)
            ax.plot(knots, theta, color=palette.DEVIATION, lw=1.6)
            ax.axhspan(-2 * line.sigma, 2 * line.sigma, color="#DDEBF5", zorder=0)
            ax.set_title(f"{name}, {line.where}: {when}", loc="left")
            ax.set_xlabel(SIGNAL_NAMES.get(signal, signal))
            ax.set_ylabel(f"residual [{line.unit}]")
            limits = limits or ax.get_ylim()
    return png(figure)


@styled
def spectra(result: TraceResult) -> bytes:
    """Spectra of what is left on the first held-out run, and the sensors' noise."""
    question, i = result.validate_question, 0
    log = question.logs[i]
    channels = worst_channels(result, log.name)
    figure = Figure(figsize=(WIDTH_IN, 2.1 * ((len(channels) + 1) // 2)), layout="constrained")
    axes = figure.subplots((len(channels) + 1) // 2, 2, squeeze=False).ravel()
    for name, machine in machines_of(result).items():
        answer = dict(zip(question.channels(i), question.answer(machine, i), strict=True))
        for ax, channel in zip(axes, channels, strict=False):
            rest = (question.measured[i][channel] - answer[channel])[question.settle(i) :]
            if np.all(np.isfinite(rest)):
                f, power = density(rest, log.rate)
                ax.loglog(f, np.sqrt(power), color=COLOURS[name], lw=0.9, label=LABELS[name])
    for ax, channel in zip(axes, channels, strict=False):
        ax.axhline(
            question.noise[kind_of(channel)] / np.sqrt(log.rate / 2),
            color=palette.INK,
            lw=0.8,
            ls=":",
            label="sensor noise",
        )
        ax.set_title(f"{channel}: rest, per √Hz", loc="left")
        ax.set_xlabel("frequency [Hz]")
    axes[0].legend(loc="lower left")
    return png(figure)


def density(x: Array, rate: float) -> tuple[Array, Array]:
    """Power spectral density, Welch with windows of about 4 s."""
    from scipy.signal import welch

    f, power = welch(x - x.mean(), rate, nperseg=min(int(4 * rate), len(x)))
    return f[1:], power[1:]


@styled
def portraits(result: TraceResult) -> bytes:
    """Phase portraits of the first held-out run: velocity over position, chamber pressure over velocity."""
    question, i = result.validate_question, 0
    log = question.logs[i]
    models = machines_of(result)
    last = list(models.values())[-1]
    simulated = question.simulated(last, i)
    figure = Figure(figsize=(WIDTH_IN, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    own, v = signals_of(log, result.machine, "leg 1")
    model, w = signals_of(simulated, result.machine, "leg 1")
    left.plot(1e3 * own["position_m"], v, color=palette.INK, lw=1.4, label="measured")
    left.plot(1e3 * model["position_m"], w, color=palette.RESPONSE, lw=0.8, label=LABELS[list(models)[-1]])
    left.set_xlabel("position [mm]")
    left.set_ylabel("velocity [m/s]")
    if "pressure_bottom_Pa" in own:
        right.plot(v, 1e-5 * own["pressure_bottom_Pa"], color=palette.INK, lw=1.4)
        right.plot(w, 1e-5 * model["pressure_bottom_Pa"], color=palette.RESPONSE, lw=0.8)
    right.set_xlabel("velocity [m/s]")
    right.set_ylabel("chamber pressure [bar]")
    left.legend(loc="upper right")
    left.set_title("phase portrait" + (", leg 1" if log.n_legs > 1 else ""), loc="left")
    right.set_title("pressure over velocity", loc="left")
    return png(figure)


@styled
def parameters(result: TraceResult) -> bytes:
    """Where each declared parameter ended inside its uncertainty."""
    entries = result.report["parameters"]
    figure = Figure(figsize=(WIDTH_IN, 0.8 + 0.26 * len(entries)), layout="constrained")
    ax = figure.subplots()
    for k, (prior, deviation) in enumerate(zip(result.final.priors, result.final.deviations, strict=True)):
        at_bound = entries[prior.key]["at_bound"]
        ax.plot([-1, 1], [k, k], color=palette.GRID, lw=6, solid_capstyle="butt", zorder=1)
        ax.plot(
            deviation / prior.half_width,
            k,
            "o",
            color=palette.DEVIATION if at_bound else palette.RESPONSE,
            ms=6,
            zorder=3,
        )
    ax.axvline(0, color=palette.INK, lw=0.8)
    ax.set_yticks(range(len(entries)), [prior.key for prior in result.final.priors])
    ax.invert_yaxis()
    ax.set_xlim(-1.08, 1.08)
    ax.set_xticks([-1, -0.5, 0, 0.5, 1], ["lower limit", "", "declared", "", "upper limit"])
    ax.set_title("fitted parameters inside their declared uncertainty (orange: at a limit)", loc="left")
    return png(figure)
