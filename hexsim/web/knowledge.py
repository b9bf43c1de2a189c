"""What the legs' compensators know, as a table of HTML: a column a leg, a bar as long as the doubt that is left."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

from compensation import Estimate, Knowledge

BAR = "#0072B2"
NOTHING = "No leg says yet what it knows. <code>adaptive</code> does, from some seconds of motion on; other compensators do not."


def knowledge_table(legs: Sequence[Knowledge | None]) -> str:
    """Of all legs in order; None: not known yet."""
    first = next((leg for leg in legs if leg is not None), None)
    style = "font-size:12px;padding:4px 12px;line-height:1.35"
    if first is None:
        return f'<div id="hexsim-known" style="{style}">{NOTHING}</div>'
    head = "".join(f'<th style="text-align:right">{k + 1}</th>' for k in range(len(legs)))
    rows = [
        row("expected bump [m/s²]", [cell(leg and leg.expected_m_s2) for leg in legs]),
        row("with plain control [m/s²]", [cell(leg and leg.plain_m_s2) for leg in legs]),
        row("engages below [m/s²]", [cell(leg and leg.engages_m_s2) for leg in legs]),
        row("engaged [%]", [f"{100.0 * leg.share:.0f}" if leg else "…" for leg in legs]),
    ]
    for k, estimate in enumerate(first.estimates):
        cells = [measured(leg.estimates[k]) if leg else "…" for leg in legs]
        rows.append(row(f"{estimate.name} [{estimate.unit}]", cells))
    return (
        f'<div id="hexsim-known" style="{style}"><p>Value ± standard error. A bar is the error over what it was before any '
        "motion: full is unknown, empty is known.</p>"
        f'<table style="width:100%;border-spacing:3px 2px;font-size:11px"><tr><th style="text-align:left">Leg</th>{head}</tr>'
        f"{''.join(rows)}</table></div>"
    )


def row(name: str, cells: Sequence[str]) -> str:
    side = "".join(f'<td style="text-align:right;vertical-align:top">{one}</td>' for one in cells)
    return f'<tr><td style="vertical-align:top">{html.escape(name)}</td>{side}</tr>'


def cell(value: float | None) -> str:
    return "…" if value is None or not math.isfinite(value) else f"{value:.2g}"


def measured(estimate: Estimate) -> str:
    """Value, error and bar."""
    share = min(estimate.error / estimate.before, 1.0) if estimate.before > 0.0 else 0.0
    return (
        f"{digits(estimate.value, estimate.error)}<br><span style='opacity:.75'>±{digits(estimate.error, estimate.error)}</span>"
        f'<div style="background:#8884;height:4px"><div style="background:{BAR};height:4px;width:{100.0 * share:.0f}%"></div></div>'
    )


def digits(value: float, error: float) -> str:
    """As many digits as the error leaves: its first two."""
    if not error > 0.0:
        return f"{value:g}"
    places = max(1 - math.floor(math.log10(error) + 1e-9), 0)
    return f"{value:.{min(places, 6)}f}"
