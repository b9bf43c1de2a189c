"""The next measurement: the motion that tells most about what a trace has left open."""

from hexsim.tracing.design.next_measurement import NextMeasurement, next_measurement

__all__ = ["NextMeasurement", "next_measurement"]
