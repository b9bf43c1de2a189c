"""The story of an identification on one page: how it ended, what was missing, the error from round to round."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from markupsafe import Markup

from hexsim.files.atomic import write_text, written_whole
from hexsim.hydraulics.effects import effect_named
from hexsim.identification import bump
from hexsim.identification.picture import rounds_figure, story_figure
from hexsim.identification.record import Story
from hexsim.machine.files import in_one_line
from hexsim.readers import read_log
from hexsim.recording.figure_style import png
from hexsim.recording.page import (
    Column,
    Report,
    Section,
    bold,
    code,
    facts,
    join,
    link,
    picture,
    remark,
    small,
    table,
    verdict,
)
from hexsim.recording.rerun_recording import write_recording
from hexsim.recording.signals import Signals
from hexsim.smoothness.threshold import SOURCE, PERCEPTION_m_s2
from hexsim.tracing.report.readings import names_of, numbers_of, one_term, term_sentence, total_sentence
from hexsim.tracing.report.recording import write_trace_recordings
from hexsim.tracing.report.tables import checks_of, known_and_checks

BUDGET = (
    "What does each step leave? "
    "Rms error in multiples of the sensor's noise, of the channel of each kind that the refitted model gets most wrong. "
    "Each bar is a step of the last trace."
)
BUMP = (
    " Below: acceleration of the machine less its mean and fundamental, in 50 Hz, with its sensor's noise; shaded: below "
    f"the threshold of perception in heave ({PERCEPTION_m_s2['z']:g} m/s², {SOURCE}). The figures "
    "are the largest peaks from the second reversal at full size on. The compensator has learned on the identified twin."
)
ROUNDS = (
    "How far is the model off, from round to round? "
    "Rms error on motion that no fit has seen, in multiples of the sensor's noise, of the worst channel of each kind: as "
    "declared, then after each round. Dotted: the noise."
)


def write_story(story: Story) -> Path:
    """Write report.html and, once there was a round, story.png into the story's folder; the page's path."""
    story_png = rounds_png = None
    if story.rounds and story.rounds[-1].budget:
        story_png = png(story_figure(headline(story), story.rounds[-1].budget, story.bump))
        with written_whole(story.folder / "story.png") as file:
            file.write_bytes(story_png)
    if len(story.rounds) > 1:
        rounds_png = png(rounds_figure(story.rounds))
    found, n = effects(story), len(story.rounds)
    goal = "a smooth one" if story.bump else "the identified one"
    heads = [
        "",
        Column("motion", "wide"),
        Column("verdict after it", "text"),
        Column("left open", "wide"),
        Column("trace", "text"),
    ]
    rounds = [
        (f"round {one.number}", one.purpose, one.verdict, left, link("report", f"round_{one.number}/report.html"))
        for one, left in zip(story.rounds, left_open(story), strict=True)
    ]
    page = Report(
        f"Identification of {story.machine.name}",
        [
            Section(
                f"From the declared machine to {goal}",
                [picture(story_png, BUDGET + BUMP * bool(story.bump))] if story_png else [],
            ),
            Section("What was missing", [_effect_table(found), *known_and_checks(found)]),
            Section("Error from round to round", [picture(rounds_png, ROUNDS)] if rounds_png else []),
            Section(
                "What was measured, and why",
                [
                    table(heads, rounds),
                    remark("Besides, two motions that no fit has seen: every error on this page is of them."),
                ],
            ),
            Section("What it leaves", [facts(FILES)]),
        ],
        about=f"{n} round{'' if n == 1 else 's'}, {story.machine_s / 60:.1f} minutes of machine time. "
        f"Declared: {in_one_line(story.machine)}.",
        top=[
            verdict(
                "",
                [sentence(story), bump_sentence(story)],
                [f"It ended because: {why_ended(story)}."],
                good=bool(n) and story.rounds[-1].verdict in ("explained", "nothing missing"),
            )
        ],
    )
    place = story.folder / "report.html"
    write_text(place, page.html())
    return place


FILES = (
    ("fitted.toml", join(["the machine with what was found: a valid ", code("--machine")])),
    ("compensator.json", "start parameters of the compensator, leg by leg, learned on the identified twin"),
    (
        "held_out.rrd, bump.rrd",
        "recordings for hexsim view: measured beside declared and fitted; the bump before and after",
    ),
    ("logs/", "every log that was measured; the same folder given again goes on from them"),
)


def _effect_table(found: list[dict[str, Any]]) -> Markup:
    heads = ["effect", Column("where", "text"), Column("numbers", "text"), Column("what it is", "wide")]
    rows = []
    for row in found:
        title = [bold(row["title"]), *([small(f"or {row['tied']}")] if row["tied"] else [])]
        numbers = [f"{name} {value}" for name, value in row["numbers"]] + [small(f"or {read}") for read in row["other"]]
        rows.append((join(title, "<br>"), row["where"], join(numbers, "<br>"), row["description"]))
    return table(heads, rows)


def write_recordings(story: Story) -> list[Path]:
    """Rerun recordings: a held-out run with the declared and the fitted machine beside it, and the bump where measured."""
    assert story.fitted is not None
    logs, written = story.folder / "logs", []
    written += write_trace_recordings(logs, ["held_out"], story.machine, story.fitted, story.folder, sentence(story))
    if story.bump:
        runs = {
            label: Signals(log=read_log(logs / f"{name}.parquet"), machine=story.fitted, label=label)
            for label, name in zip(("plain control", "compensated"), bump.LOGS, strict=True)
        }
        written.append(story.folder / "bump.rrd")
        write_recording(written[-1], runs, {"compensated": bump_sentence(story)})
    return written


def bump_sentence(story: Story) -> str:
    """The bump before and after, or why there is none."""
    if story.bump is None:
        return story.no_bump and f"The bump was not compared: {story.no_bump}."
    before, after, left = story.bump.before, story.bump.after, story.bump.left
    return (
        f"The bump at each reversal of the machine: {before:.3f} m/s² as it was, {after:.3f} m/s² compensated ({left})."
    )


def sentence(story: Story) -> str:
    """What was found, in one sentence."""
    if not story.rounds:
        return "Nothing was measured that could be traced."
    place = " in {where}" if story.machine.is_hexapod else ""
    names = [row["title"] + place.format(where=row["where"]) for row in effects(story)]
    ended = story.rounds[-1].verdict
    if not names:
        return f"No effect is named: {ended}."
    rest = "partly: a residual without a name remains" if ended == "partly" else ended
    return f"What the declared machine is missing: {', '.join(names)} ({rest})."


def why_ended(story: Story) -> str:
    """Without the verdict, which the page has said."""
    verdict = story.rounds[-1].verdict if story.rounds else ""
    return story.ended.removeprefix(f"{verdict}: ")


def left_open(story: Story) -> list[str]:
    """What each round has left open, in words."""
    return ["; ".join(one.sentences) or "nothing" for one in story.rounds]


def headline(story: Story) -> str:
    """The found effects with their first numbers, for the picture."""
    found = [f"{row['title']} in {row['where']}: {row['numbers'][0][1]}" for row in effects(story) if row["numbers"]]
    return "\n".join(f"Found: {line}" for line in found) or sentence(story)


def effects(story: Story) -> list[dict[str, Any]]:
    """Rows of the last round's effects with numbers in engineering units."""
    rows = []
    named = [effect for effect in story.rounds[-1].effects if effect["name"]] if story.rounds else []
    for effect in named:
        names = names_of(effect)
        other = [f"{name}: {value}" for own in effect.get("one_term_with", []) for name, value in numbers_of(own)]
        rows.append(
            {
                "title": " or ".join(names),
                "where": effect["where"],
                "numbers": numbers_of(effect),
                "other": [f"as {name}, {own}" for name, own in zip(names[1:], other, strict=True)],
                "description": effect_named(effect["name"]).description,
                "term": term_sentence(effect),
                "total": total_sentence(effect),
                "checks": checks_of(effect),
                "tied": ", ".join(
                    t.replace("_", " ") for t in effect.get("tied_with", []) if t not in one_term(effect)
                ),
            }
        )
    return rows
