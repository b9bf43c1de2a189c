"""A page of all runs of a folder, the newest first; a run's own page leads to it and is never written again."""

from __future__ import annotations

import re
from contextlib import suppress
from datetime import datetime
from html import escape, unescape
from pathlib import Path
from urllib.parse import quote

from hexsim.errors import HexsimError
from hexsim.files.atomic import write_text

INDEX = "index.html"
MARK = "<!-- hexsim: the runs of this folder, written anew with each -->"  # another index.html is somebody's own
PLACE = "<!-- all runs -->"  # in a report
TITLE = re.compile(r"<title>(.*?)( · hexsim)?</title>", re.DOTALL)
SENTENCE = re.compile(r'<p class="(?:lead|big)">(.*?)</p>', re.DOTALL)
TAG = re.compile(r"<[^>]*>")
STYLE = """
:root { color-scheme: light dark; --soft: #52606d; --line: #e3e7ec; --accent: #0072b2; }
body { font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; max-width: 1140px; margin: 0 auto; padding: 24px 16px; }
table { border-collapse: collapse; width: 100%; } 
td, th { text-align: left; vertical-align: top; padding: 7px 9px; border-bottom: 1px solid var(--line); }
td:first-child { white-space: nowrap; color: var(--soft); font-variant-numeric: tabular-nums; } a { color: var(--accent); }
@media (prefers-color-scheme: dark) { :root { --soft: #9aa5b1; --line: #323f4b; --accent: #56b4e9; } }
@media (max-width: 700px) {
  tr, td { display: block; border: 0; padding: 2px 0; } tr { border-bottom: 1px solid var(--line); padding: 8px 0; } th { display: none; }
}
"""


def link_to_index(report: Path) -> None:
    """A link in a report that is not at its place yet."""
    with suppress(OSError, UnicodeDecodeError, HexsimError):
        text = report.read_text(encoding="utf-8")
        if PLACE in text:
            write_text(report, text.replace(PLACE, f'· <a href="../{INDEX}">all runs</a>', 1))


def write_index(root: Path) -> None:
    """The page of the runs in `root`. What cannot be read is left out; an index.html of somebody's own stays."""
    index = root / INDEX
    with suppress(OSError, HexsimError, UnicodeDecodeError):
        if index.exists() and MARK not in index.read_text(encoding="utf-8")[:400]:
            return
        write_text(index, page_of(root))


def page_of(
    root: Path,
    *,
    most_rows: int = 1000,  # that a browser lays out at once
) -> str:
    pages = []
    for path in root.glob("*/report.html"):
        with suppress(OSError):
            if not path.parent.name.startswith("."):
                pages.append((path.stat().st_mtime, path))
    pages.sort(reverse=True)
    rows = "".join(row_of(time, path) for time, path in pages[:most_rows])
    older = f"<p>{len(pages) - most_rows} older runs are not listed.</p>" if len(pages) > most_rows else ""
    name = escape(root.resolve().name)
    return (
        f'<!doctype html>\n{MARK}\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{name} · hexsim</title>'
        f"<style>{STYLE}</style></head><body><h1>Runs in {name}</h1>\n<table>"
        f"<tr><th>written</th><th>run</th><th>result</th></tr>\n{rows}</table>{older}</body></html>\n"
    )


def row_of(
    time: float,
    path: Path,
    *,
    read_characters: int = 20_000,  # characters of a report in which its title and its first sentence stand
) -> str:
    """Time, title with a link, first sentence of a report; as text, whoever wrote it."""
    text = ""
    with suppress(OSError, UnicodeDecodeError), path.open(encoding="utf-8") as file:
        text = file.read(read_characters)
    title, said = TITLE.search(text), SENTENCE.search(text)
    name = path.parent.name
    shown = unescape(title[1]).strip() if title else name
    sentence = unescape(TAG.sub("", said[1])).strip() if said else ""
    if name.rpartition("-partial")[1]:
        sentence = f"incomplete; {sentence}" if sentence else "incomplete"
    return (
        f"<tr><td>{datetime.fromtimestamp(time):%Y-%m-%d %H:%M}</td>"
        f'<td><a href="{quote(name)}/report.html">{escape(shown)}</a></td><td>{escape(sentence)}</td></tr>\n'
    )
