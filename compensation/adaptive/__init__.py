"""One estimator and one inverse of the leg."""

from .adaptive import Adaptive

__all__ = ["Adaptive"]
