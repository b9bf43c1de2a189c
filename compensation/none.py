"""No compensation: the machine as it is, to compare with."""

from __future__ import annotations

from dataclasses import dataclass

from .compensator import Compensator, Context, Parameters, Sample


@dataclass(frozen=True, kw_only=True)
class NoCompensation(Compensator):
    """Plain position control: nothing is added."""

    name: str = "none"
    place = 0

    def start(self, context: Context) -> None:
        return None

    def step(self, state: None, sample: Sample) -> tuple[float, None]:
        return 0.0, None

    def parameters(self, state: None) -> Parameters:
        return {}

    def not_engaged(self, state: None) -> str:
        return "plain control was asked for"

    def restore(self, context: Context, parameters: Parameters) -> None:
        return None
