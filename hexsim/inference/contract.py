"""What a machine gives the inference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Number:
    """A fitted number: where the search begins, its interval, a Gaussian prior (nan: none), scale of a typical change, whether each run
    has its own. local: of a run or of how it begins and not of the machine, so that motion held out is predicted with it given."""

    name: str
    start: float
    low: float = -math.inf
    high: float = math.inf
    mean: float = math.nan
    sd: float = math.nan
    scale: float
    unit: str = ""
    of_run: bool = False
    local: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """Even samples of one run. group: what is held out together. dt: [s]. weight: (n, channels), 1 where a sample counts, else 0.
    top_Hz: highest frequency that counts."""

    name: str
    group: str
    dt: float
    weight: Array
    top_Hz: float = math.inf


class Problem(Protocol):
    """A model with its numbers, against stretches of motion. All hypotheses about a machine have the same stretches and channels."""

    @property
    def stretches(self) -> Sequence[Stretch]: ...

    @property
    def channels(self) -> Sequence[str]: ...

    @property
    def noises(self) -> Sequence[float]:
        """Of a sample of each channel, one standard deviation; nan: from what is left."""
        ...

    @property
    def numbers(self) -> Sequence[Number]: ...

    def residuals(self, theta: Array, at: Sequence[int]) -> list[Array]:
        """Model less measured (n, channels) of these stretches, in the channels' units; not finite where the model cannot be run."""
        ...

    def slopes(self, theta: Array, at: Sequence[int]) -> list[Array]:
        """Their derivatives by theta (n, channels, numbers)."""
        ...
