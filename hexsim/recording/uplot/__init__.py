"""Style and script of plots that can be looked at closely: uPlot, vendored (README.md), and `zoom.js`, which feeds it."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from markupsafe import Markup


@cache
def scripts() -> dict[str, Markup]:
    """What a page with such a plot has besides, by the name in its template."""
    here = files("hexsim.recording.uplot")
    style, library, own = (
        here.joinpath(name).read_text(encoding="utf-8").strip()
        for name in ("uPlot.min.css", "uPlot.iife.min.js", "zoom.js")
    )
    return {"style": Markup(style), "script": Markup(f"{library}\n{own}")}
