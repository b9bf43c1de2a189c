"""Compensation of the reversal bump: algorithms that could run on a real motion computer (numpy and numba).

`create(name)` makes one; `available()` lists them; `Compensator` is what an own one derives from. A name that comes from
outside the process goes through `create_built_in`.
"""

from .compensator import NO_LOAD, Compensator, Context, Parameters, Sample, preview_count
from .knowledge import Estimate, Knowledge
from .learned_parameters import check_parameters
from .registry import available, built_in, check, create, create_built_in

__all__ = [
    "NO_LOAD",
    "Compensator",
    "Context",
    "Estimate",
    "Knowledge",
    "Parameters",
    "Sample",
    "available",
    "built_in",
    "check",
    "check_parameters",
    "create",
    "create_built_in",
    "preview_count",
]
