"""How results show themselves: pictures, and small tables for a notebook."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hexsim.errors import HexsimError, one_of
from hexsim.files.atomic import written_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Picture:
    """A drawn figure: a notebook shows it, `save` writes it. figure: matplotlib's, to go on with; None where there is none."""

    def __init__(self, png: bytes, figure: Figure | None = None) -> None:
        self.png, self.figure = png, figure

    def save(self, path: str | Path) -> Path:
        """Write the PNG file; its path. Raises HexsimError where it cannot be written."""
        place = Path(path)
        try:
            with written_whole(place) as begun:
                begun.write_bytes(self.png)
        except OSError as error:
            raise HexsimError(f"cannot write {place}: {error.strerror or error}") from None
        return place

    def _repr_png_(self) -> bytes:
        return self.png

    def __repr__(self) -> str:
        return f"<Picture of {len(self.png) // 1024 + 1} kB: save(path) writes it>"


def picture_of(figure: Figure | None, what: str) -> Picture:
    """Drawn. HexsimError where the result has nothing to draw it from."""
    from hexsim.recording.figure_style import png

    if figure is None:
        raise HexsimError(f"there is nothing to draw a picture {what!r} of: the log lacks what it shows")
    return Picture(png(figure), figure)


def chosen(what: str, there: dict[str, Callable[[], Any]]) -> Any:
    """What the maker of this name makes. HexsimError that names those there are."""
    if what not in there:
        raise HexsimError(f"there is no picture {what!r}: {one_of(str(what), list(there))}")
    return there[what]()


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]], title: str = "", notes: Iterable[str] = ()) -> str:
    """A table of texts as HTML, with a title above and lines below."""
    top = f"<p><b>{escape(title)}</b></p>" if title else ""
    heads = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    lines = "".join(f"<p>{escape(note)}</p>" for note in notes if note)
    return f"{top}<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>{lines}"
