"""Adaptive compensation: one estimator and one inverse of one leg model.

| file | what it holds |
|---|---|
| `adaptive` | the face: configuration, parameters by name |
| `step` | one tick from sample to volts; engagement |
| `leg` | the model: valve, oil, load and friction, with derivatives by its numbers |
| `prior` | what is believed of each number before anything is measured |
| `estimator`, `fit` | windows of motion; the fit of the numbers to them, spread over the ticks |
| `reference` | the demanded motion |
| `inverse` | the volts that make the model follow it |
| `damping` | volts against the oil column's oscillation |
| `known`, `learned` | what is known, for people; what is kept between runs |
| `layout`, `legs`, `native` | the flat state; all legs in one call; native code |
"""

from .adaptive import Adaptive

__all__ = ["Adaptive"]
