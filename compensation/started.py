"""An algorithm that starts with what was learned before, in place of nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .compensator import Context, Parameters, Wrapped
from .legs import Together, stepper


@dataclass(frozen=True)
class Started(Wrapped):
    """`inner` with start parameters: what its own `parameters` gave, of the same leg or of its simulated twin."""

    learned: Parameters

    def start(self, context: Context) -> Any:
        return self.inner.restore(context, self.learned)

    def together(self, states: Sequence[Any]) -> Together:
        """What steps these legs in one call."""
        return stepper(self.inner, states)
