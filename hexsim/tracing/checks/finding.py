"""What a check finds in a log."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One sentence about a log.

    severity: "refuse", tracing would mislead; "loss", something cannot be said; "notice", worth knowing (a sensor's gain or
    delay is an effect of its own and is named by the tracer, not here). value: the number it turns on, in `unit`.
    """

    severity: Literal["refuse", "loss", "notice"]
    channel: str
    description: str
    value: float | None = None
    unit: str = ""


refusal, loss, notice = (partial(Finding, severity=severity) for severity in ("refuse", "loss", "notice"))
