"""Adaptive compensation: identified valve and friction, feed-forward, pressure damping, bumpless transfer.

| file | what it holds |
|---|---|
| `adaptive` | the face: configuration, parameters by name |
| `start` | the state before the first tick; parameters in and out |
| `step` | the algorithm: one control tick from sample to volts |
| `layout` | the flat array that is carried from tick to tick |
| `engagement` | transfer between plain control and compensation, as a table of phases |
| `monitor` | performance monitor: is a reversal worse than plain control's? |
| `reference` | motion asked for while the feed-forward comes in |
| `valve`, `edge_rounding` | identification of the valve: gain, dead band, lag, backlash; rounding of its edges |
| `valve_edge`, `leak`, `delay` | one direction of the valve; its leak; how much of its lag is delay |
| `demand`, `feedback` | what is asked for at a tick; pressure damping and backlash inverse |
| `lateness` | a late position transducer |
| `chambers`, `chamber_pressures`, `piston_leak` | two chambers on a four-way valve |
| `friction`, `stribeck` | identification of load and friction from pressure |
| `spool`, `inverse` | the spool's lag; inverse of the valve |
| `taps` | design of the leads and of the damping filter |
| `recursive_least_squares` | the estimator that all identification uses |
"""

from .adaptive import Adaptive, AdaptiveState

__all__ = ["Adaptive", "AdaptiveState"]
