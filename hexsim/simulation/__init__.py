"""A run of a scenario on a machine, headless, live or over UDP."""

from hexsim.simulation.simulation import Run, TickLoop, make_compensators, setpoints, simulate, whole_ratio

__all__ = ["Run", "TickLoop", "make_compensators", "setpoints", "simulate", "whole_ratio"]
