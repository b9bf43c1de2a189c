"""The report's algebraic compensation functions and flow curves, each equation once.

Both functions are odd about their zero: "taking the square-root out of the absolute value and multiplying by the
sign of the original expression" (report 5.3).
"""

from __future__ import annotations

import math

from .compiled import compiled


@compiled
def function_1(u: float, a: float, b: float, c: float) -> float:
    """Compensation [V] at control voltage `u` [V], a sqrt(sin(b u - c)) (Eq. 5.2).

    a [V] is its maximum, pi/b [V] the voltage where it returns to zero, c/b [V] its offset. Beyond the half period
    the sine changes sign and the function turns over: it describes a curve between -pi/b and pi/b only.
    """
    s = math.sin(b * u - c)
    return a * math.sqrt(s) if s >= 0 else -a * math.sqrt(-s)


@compiled
def function_2(u: float, a: float, b: float, c: float) -> float:
    """Compensation [V] at control voltage `u` [V], 4 a [sqrt(x) - x] with x = b u - c (Eq. 5.3).

    a [V] is its maximum (at x = 1/4), 1/b [V] the voltage where it returns to zero, c/b [V] its offset. With a =
    1/(4 b) and c = 0 it is the exact inverse of a quadratic flow curve against the line that crosses it at u = 1/b.
    """
    x = b * u - c
    return 4 * a * (math.sqrt(x) - x) if x >= 0 else -4 * a * (math.sqrt(-x) + x)


FUNCTIONS = {1: function_1, 2: function_2}
RANGE = {1: math.pi, 2: 1.0}  # b q, with q the voltage where the function returns to zero (report 5.3)

MOST_RANGES = 10.0  # a learned number of the report's forms, which nothing bounds, over the valve's range


def check_function(number: int) -> None:
    """Raise ValueError unless `number` is one of the report's two compensation functions."""
    if number not in RANGE:
        raise ValueError(f"compensation function {number} does not exist; choose 1 (Eq. 5.2) or 2 (Eq. 5.3)")


@compiled
def compensation_V(function, u, a, b, c):
    """Function 1 or 2."""
    return function_1(u, a, b, c) if function == 1.0 else function_2(u, a, b, c)
