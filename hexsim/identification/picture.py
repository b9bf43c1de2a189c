"""The pictures of a story: error budget and bump, the error from round to round, each motion before it is driven."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hexsim.identification.bump import Bump
from hexsim.identification.record import Round
from hexsim.mechanics.mechanics import DOF_NAMES
from hexsim.motion_computer.host_limiter import KINDS, MEMORY, HostLimiter
from hexsim.recording import palette
from hexsim.recording.figure_style import PAPER, legend, plain_powers, styled
from hexsim.recording.quantity import plain
from hexsim.signals.channels import kind_of
from hexsim.signals.table import places
from hexsim.smoothness.threshold import PERCEPTION_m_s2
from hexsim.tracing.report.budget import STEP_COLOURS, worst_of_kinds
from hexsim.tracing.report.signals import SCALE

QUANTITIES = {  # of a leg: its unit for people, and how many of it are one of SI
    "excursion": ("mm", 1e3),
    "velocity": ("mm/s", 1e3),
    "acceleration": ("m/s²", 1.0),
    "jerk": ("m/s³", 1.0),
}
ROUND_COLOURS = ("#9AA5B1", *palette.RUNS)


@styled
def story_figure(headline: str, budget: list[dict[str, Any]], bump: Bump | None) -> Figure:
    """Above: the residual of each kind of signal after each step. Below: the machine's bump before and after."""
    figure = Figure(figsize=(PAPER.width_in, 5.9 if bump else 3.3), layout="constrained")
    figure.suptitle(headline, x=0.01, ha="left", fontsize=12.5, fontweight="bold")
    rows = figure.subplots(2 if bump else 1, 1, squeeze=False, gridspec_kw={"hspace": 0.12})[:, 0]
    draw_budget(rows[0], budget)
    if bump:
        draw_bump(rows[1], bump)
    return figure


def draw_budget(
    plot: Axes,
    budget: list[dict[str, Any]],
    *,
    noise_floor: float = 0.5,  # of the error axis, in multiples of the noise
) -> None:
    """A group of bars a kind of signal, a bar a step, in multiples of the sensor's noise."""
    shown = worst_of_kinds(budget)
    steps = list(dict.fromkeys(row["step"] for row in budget))
    width = 0.84 / len(steps)
    for k, step in enumerate(steps):
        sizes = [
            next(
                (r["multiple_of_noise"] for r in budget if (r["run"], r["channel"], r["step"]) == (*one, step)), np.nan
            )
            for one in shown
        ]
        x = np.arange(len(shown)) + (k - 0.5 * (len(steps) - 1)) * width
        colour = STEP_COLOURS[k] if k < 3 else palette.RUNS[2 + (k - 3) % 4]
        heights = np.maximum(np.nan_to_num(np.array(sizes, dtype=float), nan=1e-3), 1e-3)
        bars = plot.bar(x, heights - noise_floor, 0.92 * width, bottom=noise_floor, color=colour, label=step)
        plot.bar_label(bars, [plain(size) if size else "" for size in sizes], fontsize=8, padding=2)
    plot.set_yscale("log")
    plot.set_ylim(noise_floor, 4.0 * plot.get_ylim()[1])
    plain_powers(plot)
    plot.axhline(1.0, color=palette.INK, linestyle=":", linewidth=1.0)
    _beside(plot, "noise", 1.0)
    plot.set_xticks(
        range(len(shown)), [SCALE[kind_of(channel)][0].replace(", ", "\n") for _, channel in shown], fontsize=9
    )
    plot.set_ylabel("error / noise")
    plot.grid(visible=False, axis="x")
    plot.margins(x=0.02)
    plot.set_title("How far the model is off, on motion that no fit has seen", loc="left", pad=20)
    legend(plot, len(steps))


def _beside(plot: Axes, text: str, height: float) -> None:
    """A small text to the right of the axes."""
    beside = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
    plot.annotate(text, (1.0, height), (4, 0), va="center", fontsize=8, **beside)


def draw_bump(plot: Axes, bump: Bump) -> None:
    """What a passenger feels beside the sine, before and after."""
    for own, worst, label, colour in (
        (bump.plain, bump.before, "as it was", palette.DEVIATION),
        (bump.compensated, bump.after, "compensated, started from what was found", palette.RESPONSE),
    ):
        plot.plot(own.time_s - own.time_s[0], own.band, color=colour, lw=1.3, label=f"{label}: {worst:.3f} m/s²")
    plot.axhspan(-PERCEPTION_m_s2["z"], PERCEPTION_m_s2["z"], color=palette.GRID, lw=0, zorder=0)
    _beside(plot, "below\nperception", 0.0)
    plot.set_xlabel("time of the heave, 0.5 Hz [s]")
    plot.set_ylabel("acceleration beside\nthe sine, 50 Hz [m/s²]")
    plot.set_title(f"The bump at each reversal of the machine: {bump.left}", loc="left", pad=20)
    legend(plot, 2)


@styled
def rounds_figure(rounds: list[Round]) -> Figure:
    """Error of each kind of channel: as declared, and after each round."""
    first = errors_by_kind(rounds[0].error, "declared")
    stages = [("declared", first)]
    for one in rounds:
        found = errors_by_kind(one.error, "with_effect") or errors_by_kind(one.error, "refit")
        stages.append((f"round {one.number}", found))
    kinds = list(first)
    figure = Figure(figsize=(PAPER.width_in, 3.0), layout="constrained")
    plot = figure.add_subplot()
    width = 0.8 / len(stages)
    for k, (label, found) in enumerate(stages):
        x = np.arange(len(kinds)) + (k - 0.5 * (len(stages) - 1)) * width
        heights = [max(found.get(kind, np.nan), 1e-3) for kind in kinds]
        bars = plot.bar(x, heights, 0.92 * width, label=label, color=ROUND_COLOURS[k % len(ROUND_COLOURS)])
        plot.bar_label(bars, [plain(height) for height in heights], fontsize=7, padding=1)
    plot.set_yscale("log")
    plain_powers(plot)
    plot.axhline(1.0, color=palette.INK, linestyle=":", linewidth=1.0)
    labels = {place.kind: place.label for place, _ in places().values()}
    plot.set_xticks(np.arange(len(kinds)), [labels.get(kind, kind) for kind in kinds])
    plot.set_ylabel("error / noise")
    plot.grid(visible=False, axis="x")
    plot.margins(x=0.02, y=0.2)
    plot.legend(ncols=len(stages), loc="upper center", bbox_to_anchor=(0.5, 1.15))
    return figure


@styled
def motion_figure(limiter: HostLimiter, rows: np.ndarray, title: str) -> Figure:
    """A motion as its packets will leave: position, speed, acceleration and jerk of every leg beside their limits, and those of
    the platform's axes as shares of theirs."""
    rows = np.pad(rows, ((MEMORY, MEMORY), (0, 0)))
    share, what = limiter.worst(rows)
    found = limiter.motion(rows)
    figure = Figure(figsize=(PAPER.width_in, 7.2), layout="constrained")
    duration_s = len(rows) * limiter.period_s
    figure.suptitle(
        f"{title}: {duration_s:.0f} s, at most {100 * share:.0f} % of a limit ({what})",
        x=0.01,
        ha="left",
        fontsize=12,
        fontweight="bold",
    )
    plots = figure.subplots(len(KINDS), len(found), sharex=True, squeeze=False)
    for column, (place, derivatives) in enumerate(found.items()):
        legs, limits = place == "leg", limiter.limits[place]
        for row, (kind, values) in enumerate(zip(KINDS, derivatives, strict=True)):
            plot, limit = plots[row, column], getattr(limits, kind)
            unit, scale = QUANTITIES[kind] if legs else ("% of its limit", 100.0)
            time_s = (np.arange(len(values)) - MEMORY + row) * limiter.period_s
            for k, one in enumerate(values.T):
                name = f"leg {k + 1}" if legs else DOF_NAMES[k]
                shown = scale * (one if legs else one / limit[k])
                plot.plot(time_s, shown, color=palette.LEGS[k], lw=0.9, label=name if row == 0 else None)
            edge = scale * float(np.min(limit)) if legs else scale
            for sign in (-1.0, 1.0):
                plot.axhline(sign * edge, color=palette.INK, linestyle=":", linewidth=1.0)
            plot.set_ylim(-1.15 * edge, 1.15 * edge)
            plot.set_ylabel(f"{kind}\n[{unit}]")
        plots[0, column].set_title("Legs, and the limit" if legs else "Platform, and the limit", loc="left", pad=20)
        legend(plots[0, column], len(limits.excursion))
        plots[-1, column].set_xlabel("time [s]")
    return figure


def errors_by_kind(error: dict[str, Any], key: str) -> dict[str, float]:
    """Kind of signal -> largest error over its noise, over logs and channels."""
    worst: dict[str, float] = {}
    for channels in error.values():
        for name, own in channels.items():
            if own.get(key) is not None and own.get("noise"):
                kind = kind_of(name)
                worst[kind] = max(worst.get(kind, 0.0), own[key] / own["noise"])
    return worst
