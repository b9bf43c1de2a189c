"""Compensation of the reversal bump: algorithms that could run on a real motion computer (numpy and numba).

`create(name)` makes one; `available()` lists them; `Compensator` is what an own one derives from.
"""

from .compensator import NO_LOAD, Compensator, Context, Parameters, Sample, preview_count
from .learned_parameters import check_parameters
from .registry import available, check, create

__all__ = [
    "NO_LOAD",
    "Compensator",
    "Context",
    "Parameters",
    "Sample",
    "available",
    "check",
    "check_parameters",
    "create",
    "preview_count",
]
