"""One look for every report: `Report(title, sections)` is a page of its own, light and dark, from 390 px on, printable.

A section is a heading with parts; a part is what the functions below return. What is put in is escaped; a part that is
already `Markup` stays.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from typing import Any, NamedTuple

import jinja2
from markupsafe import Markup, escape

from hexsim import __version__
from hexsim.files.runs_index import PLACE
from hexsim.recording.uplot import scripts

MOST_ROWS = 30  # of a table, about a screen's height; what is beyond folds away
EMPTY = Markup("")


class Column(NamedTuple):
    """A column's head and kind: "" a number, "text", or "wide" for text that may wrap."""

    head: str
    kind: str = ""


class Cell(NamedTuple):
    """A cell of another kind than its column, as "text pass" or "text fail"."""

    content: Any
    kind: str


class Row(NamedTuple):
    """A row with a mark: "best", "off" or "driven"."""

    cells: Sequence[Any]
    mark: str = ""


@dataclass(frozen=True)
class Section:
    """A heading, which the contents lead to, and what stands below it. Parts that are empty are left out."""

    title: str
    parts: Sequence[Markup]


@dataclass(frozen=True)
class Report:
    """A page. about: a line below the title; top: parts before the contents, the result in a sentence first."""

    title: str
    sections: Sequence[Section]
    about: str = ""
    top: Sequence[Markup] = ()

    def html(self) -> str:
        """The page, complete in itself."""
        sections = [section for section in self.sections if any(section.parts)]
        zooms = any('<figure class="zoom">' in part for section in sections for part in section.parts)
        return _template().render(
            page=self,
            sections=sections,
            zoom=scripts() if zooms else None,
            place=Markup(PLACE),
            version=__version__,
            written=f"{datetime.now():%Y-%m-%d %H:%M}",
        )


@cache
def _template() -> jinja2.Template:
    loader = jinja2.PackageLoader("hexsim.recording", "templates")
    return jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True).get_template(
        "page.html.j2"
    )


def join(parts: Iterable[Any], between: str = "") -> Markup:
    """Parts one after another, escaped."""
    return Markup(between).join(parts)


def bold(content: Any) -> Markup:
    return Markup("<b>{}</b>").format(content)


def small(content: Any) -> Markup:
    return Markup("<small>{}</small>").format(content)


def code(content: Any) -> Markup:
    """A command or a name; its options are not broken at their dashes."""
    text = re.sub(r"--[\w-]+", r'<span class="option">\g<0></span>', str(escape(content)))
    return Markup("<code>{}</code>").format(Markup(text))


def link(name: str, path: str) -> Markup:
    return Markup('<a href="{}">{}</a>').format(path, name)


def lead(text: str) -> Markup:
    """The result in one sentence; nothing where there is none."""
    return Markup('<p class="lead">{}</p>\n').format(text) if text else EMPTY


def remark(text: Any) -> Markup:
    """What explains a table or figure."""
    return Markup('<p class="sub">{}</p>\n').format(text) if text else EMPTY


def note(text: Any) -> Markup:
    """A warning."""
    return Markup('<p class="note">{}</p>\n').format(text) if text else EMPTY


def verdict(tag: str, lines: Iterable[Any], more: Iterable[Any] = (), *, good: bool) -> Markup:
    """The answer in large letters, and sentences below it."""
    said = [Markup('<p class="tag">{}</p>').format(tag)] if tag else []
    said += [Markup('<p class="big">{}</p>').format(line) for line in lines if line]
    said += [Markup("<p>{}</p>").format(line) for line in more if line]
    return Markup('<section class="verdict{}">{}</section>\n').format(" done" if good else "", join(said))


def cards(found: Iterable[tuple[str, str, str]]) -> Markup:
    """The figures to see first: (value, unit, what it is)."""
    one = Markup('<div class="card"><b>{}</b><span>{}</span><p>{}</p></div>')
    made = join(one.format(*card) for card in found)
    return Markup('<div class="cards">{}</div>\n').format(made) if made else EMPTY


def table(
    columns: Sequence[str | Column],
    rows: Iterable[Sequence[Any] | Row],
    first: Sequence[Sequence[Any] | Row] | None = None,
) -> Markup:
    """A table; a long one folds. first: rows that stand before the fold; default the first ones."""
    heads = [Column(one) if isinstance(one, str) else one for one in columns]
    every = list(rows)
    if not every:
        return EMPTY
    shown = every[:MOST_ROWS] if first is None else list(first)
    made = _table(heads, shown)
    if len(every) > len(shown):
        made += folded(f"all {len(every)} rows", [_table(heads, every)])
    return Markup('<div class="panel">{}</div>\n').format(made)


def _table(heads: Sequence[Column], rows: Iterable[Sequence[Any] | Row]) -> Markup:
    # on a phone more than five columns, or text that wraps, become a list a row
    stacks = len(heads) > 5 or any(one.kind == "wide" for one in heads)
    top = join(Markup("<th{}>{}</th>").format(_class("text" if one.kind else ""), one.head) for one in heads)
    return Markup("<table{}><thead><tr>{}</tr></thead>\n<tbody>{}</tbody></table>").format(
        _class("stack" if stacks else ""), top, join(_row(heads, row, stacks) for row in rows)
    )


def _row(heads: Sequence[Column], row: Sequence[Any] | Row, stacks: bool) -> Markup:
    cells, mark = (row.cells, row.mark) if isinstance(row, Row) else (row, "")
    made = []
    for k, (head, cell) in enumerate(zip(heads, cells, strict=True)):
        content, kind = cell if isinstance(cell, Cell) else (cell, head.kind)
        name = Markup(' data-head="{}"').format(head.head) if stacks and k and head.head else EMPTY
        made.append(Markup("<td{}{}>{}</td>").format(_class(kind), name, "" if content is None else content))
    return Markup("<tr{}>{}</tr>\n").format(_class(mark), join(made))


def _class(name: str) -> Markup:
    return Markup(' class="{}"').format(name) if name else EMPTY


def bar(share: float | None) -> Cell:
    """A bar that fills this share of its cell, 0 to 1; nothing for None."""
    drawn = (
        Markup('<span style="width: {}%"></span>').format(round(100 * min(max(share, 0.0), 1.0), 1))
        if share is not None
        else ""
    )
    return Cell(drawn, "text bar")


def question(caption: str) -> tuple[str, str]:
    """The question that a figure answers, which its caption begins with, and the rest of the caption."""
    asked, mark, rest = caption.partition("? ")
    return (f"{asked}?", rest) if mark else ("", caption)


def picture(png: bytes, caption: str) -> Markup:
    """A PNG inside the page, below its question."""
    asked, rest = question(caption)
    above = Markup('<p class="question">{}</p>').format(asked) if asked else EMPTY
    source = f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
    shown = Markup('<figure>{}<img src="{}" alt="{}"><figcaption>{}</figcaption></figure>\n')
    return shown.format(above, source, asked or rest, rest)


def facts(pairs: Iterable[tuple[str, Any]], more: Sequence[Markup] = ()) -> Markup:
    """Names with their values in a panel; more: parts below them in it."""
    made = join(Markup("<dt>{}</dt><dd>{}</dd>\n").format(*pair) for pair in pairs)
    return Markup('<div class="panel"><dl>{}</dl>{}</div>\n').format(made, join(more))


def folded(summary: str, parts: Sequence[Markup], *, unfolded: bool = False) -> Markup:
    """Parts that a click shows."""
    shown = Markup(" open") if unfolded else EMPTY
    return Markup("<details{}><summary>{}</summary>{}</details>\n").format(shown, summary, join(parts))


def text_block(text: str) -> Markup:
    """A file or a command as it is."""
    return Markup("<pre>{}</pre>\n").format(text)


def messages(found: Sequence[tuple[Any, ...]], heads: Mapping[str, str], *, unfolded: bool = False) -> Markup:
    """Messages of the motion computer, folded. heads: head -> kind of each column."""
    if not found:
        return EMPTY
    columns = [Column(head, kind) for head, kind in heads.items()]
    title = f"{len(found)} messages of the motion computer"
    return folded(title, [_table(columns, found[:200])], unfolded=unfolded)
