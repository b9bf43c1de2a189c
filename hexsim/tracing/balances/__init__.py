"""Balances: what must be zero where the model holds, evaluated at the measured point, one file each.

A balance is a plug-in: anything with a name, a unit, places and `residual(log, machine)` can be traced.
"""

from hexsim.tracing.balances.balance import Balance
from hexsim.tracing.balances.continuity import Continuity
from hexsim.tracing.balances.force import Force
from hexsim.tracing.balances.platform import LegForce, Platform
from hexsim.tracing.balances.sensor import Sensor
from hexsim.tracing.balances.supply import Supply

BALANCES: tuple[Balance, ...] = (
    Sensor(),
    Supply(),
    Continuity(),
    Force(),
    LegForce(),
    Platform(),
)  # in the order of tracing

__all__ = ["BALANCES", "Balance", "Continuity", "Force", "LegForce", "Platform", "Sensor", "Supply"]
