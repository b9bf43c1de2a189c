"""One estimator and one inverse of the leg."""

from .estimated import Estimated

__all__ = ["Estimated"]
