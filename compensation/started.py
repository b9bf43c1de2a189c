"""An algorithm that starts with what was learned before, in place of nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .compensator import Context, Parameters, Wrapped


@dataclass(frozen=True)
class Started(Wrapped):
    """`inner` with start parameters: what its own `parameters` gave, of the same leg or of its simulated twin."""

    learned: Parameters

    def start(self, context: Context) -> Any:
        return self.inner.restore(context, self.learned)
