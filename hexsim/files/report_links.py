"""Links between reports that lie side by side: a run, a comparison, a trace and a qualification of one folder.

Each report.html has a place for them near its head, between two marks. When a report comes to its place, that part is
written anew in it and in the newest reports beside it; nothing else of a page changes.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from html import escape, unescape
from pathlib import Path
from urllib.parse import quote

from hexsim.errors import HexsimError
from hexsim.files.atomic import write_text

BEGIN, END = "<!-- reports beside this one -->", "<!-- end of reports -->"
MOST = 8  # reports that are linked, the newest
PLACE = re.compile(f"{BEGIN}.*?{END}", re.DOTALL)
TITLE = re.compile(r"<title>(.*?)( · hexsim)?</title>", re.DOTALL)


def link_reports(folder: Path) -> None:
    """Link the report of `folder` with those of the folders beside it, both ways. What cannot be read is left out."""
    pages: list[tuple[float, Path, str]] = []
    with suppress(OSError):
        for path in folder.resolve().parent.glob("*/report.html"):
            if not path.parent.name.startswith("."):
                pages.append((path.stat().st_mtime, path, ""))
    pages = [(time, path, _text(path)) for time, path, _ in sorted(pages)[-MOST:]]
    pages = [page for page in pages if PLACE.search(page[2])]
    for time, path, text in pages:
        linked = with_links(text, [(other, of) for _, other, of in pages if other != path])
        if linked != text:
            with suppress(OSError, HexsimError):
                write_text(path, linked)
                os.utime(path, (time, time))  # it stays as old as what it says


def with_links(text: str, others: list[tuple[Path, str]]) -> str:
    """The page `text` with links to `others`: path and text of each."""
    links = []
    for path, page in others:
        title = TITLE.search(page)
        name, shown = quote(path.parent.name), unescape(title[1]) if title else path.parent.name
        links.append(f'<a href="../{name}/report.html">{escape(shown)}</a>')
    line = f'<nav class="beside">Beside this report: {" · ".join(links)}</nav>' if links else ""
    return PLACE.sub(lambda found: f"{BEGIN}{line}{END}", text, count=1)


def _text(path: Path) -> str:
    """The page, or nothing where it cannot be read."""
    with suppress(OSError, UnicodeDecodeError):
        return path.read_text(encoding="utf-8")
    return ""
