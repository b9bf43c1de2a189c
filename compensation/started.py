"""An algorithm that starts with what was learned before, in place of nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .compensator import Compensator, Context, Parameters, Sample


@dataclass(frozen=True)
class Started(Compensator):
    """`inner` with start parameters: what its own `parameters` gave, of the same leg or of its simulated twin."""

    inner: Compensator
    learned: Parameters

    @property
    def name(self) -> str:  # type: ignore[override]
        """The algorithm's own name."""
        return self.inner.name

    @property
    def preview_s(self) -> float:  # type: ignore[override]
        """The algorithm's own preview [s]."""
        return self.inner.preview_s

    @property
    def description(self) -> str:
        """The algorithm's own description."""
        return self.inner.description

    def start(self, context: Context) -> Any:
        return self.inner.restore(context, self.learned)

    def step(self, state: Any, sample: Sample) -> tuple[float, Any]:
        return self.inner.step(state, sample)

    def parameters(self, state: Any) -> Parameters:
        return self.inner.parameters(state)

    def restore(self, context: Context, parameters: Parameters) -> Any:
        return self.inner.restore(context, parameters)

    def resume(self, context: Context, parameters: Parameters) -> Any:
        return self.inner.resume(context, parameters)

    def status(self, state: Any) -> str:
        return self.inner.status(state)
