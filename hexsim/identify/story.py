"""The story of an identification on one page: how it ended, what was missing, the error from round to round."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hexsim.files.atomic import write_text
from hexsim.hydraulics.effects import effect_named
from hexsim.identify.rounds import Story
from hexsim.recording import palette
from hexsim.recording.figure_style import WIDTH_IN, plain_powers, png, styled
from hexsim.recording.quantity import quantity, split_key
from hexsim.recording.report import data_url, render
from hexsim.signals.table import kind_of, places

CAPTION = (
    "How far is the model off, from round to round? "
    "Rms error on motion that no fit has seen, in multiples of the sensor's noise, of the worst channel of each kind. "
    "First bar: the machine as declared. Then what the model leaves after each round. Dotted: the noise."
)


def write_story(story: Story) -> Path:
    """Write report.html into the story's folder; its path."""
    place = story.folder / "report.html"
    figure = data_url(png(budget_figure(story))) if story.rounds else ""
    page = render(
        "identify.html.j2", title=f"Identification of {story.machine.name}", story=story, sentence=sentence(story),
        effects=effects(story), figure=figure, caption=CAPTION,
    )  # fmt: skip
    write_text(place, page)
    return place


def sentence(story: Story) -> str:
    """What was found, in one sentence."""
    if not story.rounds:
        return "Nothing was measured that could be traced."
    names = [row["title"] for row in effects(story)]
    ended = story.rounds[-1].verdict
    if not names:
        return f"No effect is named: {ended}."
    return f"What the declared machine lacks: {', '.join(names)} ({ended})."


def effects(story: Story) -> list[dict[str, Any]]:
    """Rows of the last round's effects with numbers in engineering units."""
    rows = []
    named = [effect for effect in story.rounds[-1].effects if effect["name"]] if story.rounds else []
    for effect in named:
        errors = effect.get("standard_error", {})
        numbers = []
        for key, value in effect.get("parameters", {}).items():
            name, unit = split_key(key)
            numbers.append((name, quantity(value, unit), quantity(errors.get(key, float("nan")), unit)))
        rows.append(
            {
                "title": effect["name"].replace("_", " "),
                "where": effect["where"],
                "numbers": numbers,
                "description": effect_named(effect["name"]).description,
                "tied": ", ".join(effect.get("tied_with", [])),
            }
        )
    return rows


def errors_by_kind(error: dict[str, Any], key: str) -> dict[str, float]:
    """Kind of signal -> largest error over its noise, over logs and channels."""
    worst: dict[str, float] = {}
    for channels in error.values():
        for name, own in channels.items():
            if own.get(key) is not None and own.get("noise"):
                kind = kind_of(name)
                worst[kind] = max(worst.get(kind, 0.0), own[key] / own["noise"])
    return worst


@styled
def budget_figure(story: Story) -> Figure:
    """Error of each kind of channel: as declared, and after each round."""
    first = errors_by_kind(story.rounds[0].error, "declared")
    stages = [("declared", first)]
    for one in story.rounds:
        found = errors_by_kind(one.error, "with_effect") or errors_by_kind(one.error, "refit")
        stages.append((f"round {one.number}", found))
    kinds = list(first)
    figure = Figure(figsize=(WIDTH_IN, 1.2 + 2.0), layout="constrained")
    plot = figure.add_subplot()
    width = 0.8 / len(stages)
    for k, (label, found) in enumerate(stages):
        x = np.arange(len(kinds)) + (k - 0.5 * (len(stages) - 1)) * width
        heights = [max(found.get(kind, np.nan), 1e-3) for kind in kinds]
        color = "#9AA5B1" if k == 0 else palette.RUNS[(k - 1) % len(palette.RUNS)]
        bars = plot.bar(x, heights, 0.92 * width, label=label, color=color)
        plot.bar_label(bars, [f"{height:.3g}" for height in heights], fontsize=7, padding=1)
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
