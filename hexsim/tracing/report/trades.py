"""Numbers that trade: where the logs know a combination of two far better than each, what one gives the other takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hexsim.recording import palette
from hexsim.recording.figure_style import Margins, panels, png, styled
from hexsim.recording.quantity import scale_of, split_key
from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit
from hexsim.tracing.fitting.fitted_numbers import Number, numbers_of
from hexsim.tracing.state import Trace

Array = np.ndarray
CAPTION = (
    "Which numbers trade? Pairs with a correlation beyond 0.9: the runs know a combination of the two better than each. "
    "Inside: one standard error of both together, outside two."
)


def trades(fit: Fit, named: Sequence[str]) -> list[tuple[Number, Number, float]]:
    """(number of a named effect, another number, their correlation), the closest first; each pair once."""
    numbers = [number for number in numbers_of(fit, named) if number.standard_error > 0.0]
    found = []
    for k, other in enumerate(numbers):
        for one in numbers[:k]:
            if not (one.named or other.named):
                continue
            assert fit.covariance is not None
            shared = float(fit.covariance[one.place, other.place]) * one.slope * other.slope
            r = shared / (one.standard_error * other.standard_error)
            if abs(r) > rules.TRADES:
                found.append((one, other, r) if one.named else (other, one, r))
    return sorted(found, key=lambda pair: -abs(pair[2]))


def trades_of(result: Trace) -> list[tuple[Number, Number, float]]:
    """Those of the numbers of a trace's effects."""
    return trades(result.final, [effect.candidate.label for effect in result.effects])


def trade_entries(result: Trace) -> list[dict[str, Any]]:
    """For report.json."""
    return [
        {"numbers": [{"of": one.of, "number": one.key} for one in pair], "correlation": r}
        for *pair, r in trades_of(result)
    ]


@styled
def pairs(result: Trace, columns: int = 3) -> bytes:
    """A panel a pair, of two rows at most: the fitted point, and where both are with one and with two standard errors."""
    shown = trades_of(result)[: 2 * columns]
    rows = -(-len(shown) // columns)
    room = Margins(left=0.85, top=0.3, bottom=0.62, across=0.95, between=0.95)
    figure, axes = panels(rows, columns, 0.2 + 2.7 * rows, room)
    axes = axes.ravel()
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    for plot, (one, other, r) in zip(axes, shown, strict=False):
        (x_unit, x_name), (y_unit, y_name) = (
            scale_of(max(abs(n.value), n.standard_error), n.unit) for n in (one, other)
        )
        x = np.cos(turn)
        y = r * x + np.sqrt(max(1.0 - r * r, 0.0)) * np.sin(turn)
        for times, width in ((1.0, 1.8), (2.0, 0.9)):
            plot.plot((one.value + times * one.standard_error * x) / x_unit,
                      (other.value + times * other.standard_error * y) / y_unit, color=palette.RESPONSE, lw=width)  # fmt: skip
        plot.plot(one.value / x_unit, other.value / y_unit, "o", color=palette.DEVIATION, ms=5)
        plot.set_xlabel(words(one, x_name))
        plot.set_ylabel(words(other, y_name))
        plot.set_title(f"correlation {r:+.3f}".replace("-", "\N{MINUS SIGN}"), loc="left")
        plot.locator_params(nbins=4)
        plot.ticklabel_format(useOffset=False)
        plot.margins(0.06)
    for plot in axes[len(shown) :]:
        plot.set_visible(False)
    return png(figure)


def words(number: Number, unit: str) -> str:
    """An axis: a line for the effect, one for its number and the unit; the declared parameter's name."""
    name = split_key(number.key)[0] + (f" [{unit}]" if unit else "")
    return name if number.of == "declared" else f"{number.of.replace('_', ' ')}:\n{name}"
