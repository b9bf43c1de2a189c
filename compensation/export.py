"""What was learned, for another computer: a table, and a C function that needs nothing.

`table_of` turns the parameters of any algorithm here into one compensation curve u_c(u) at the reference pressure
drop; `to_csv` writes it as a table, `to_c` as C99 that interpolates the same table in the same order of operations,
so that both agree to the last bits of a double.
"""

from __future__ import annotations

import csv
import io
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

from .compensator import Parameters
from .report_functions import FUNCTIONS, RANGE

EDGE_V = 1e-6  # half width of the step across the overlap, in a table that must be a function


@dataclass(frozen=True)
class CompensationTable:
    """u_c over u, both [V], u increasing (n,); straight between the points, constant beyond the ends."""

    control_V: tuple[float, ...]
    compensation_V: tuple[float, ...]

    def __call__(self, u: float) -> float:
        """u_c [V] at a control voltage u [V]."""
        xs, ys = self.control_V, self.compensation_V
        if u <= xs[0]:
            return ys[0]
        if u >= xs[-1]:
            return ys[-1]
        i = bisect_right(xs, u) - 1
        return ys[i] + (ys[i + 1] - ys[i]) * ((u - xs[i]) / (xs[i + 1] - xs[i]))


def table_of(parameters: Parameters, voltage_max_V: float = 10.0) -> CompensationTable:
    """The learned curve of an algorithm's parameters.

    Report algorithms: Eq. 5.2 or 5.3 with the learned a, q, r (of two curves their mean). `adaptive`, `repetitive`:
    the dead band of either direction, and the difference of the two gains from their mean. `exact`: the
    inverse of its flow curve.
    """
    if "numbers" in parameters:
        numbers = parameters["numbers"]
        gains = [numbers["gain_dn"], numbers["gain_up"]]
        if not min(gains) > 0.0:
            raise ValueError("these parameters hold no valve yet: give those of a leg that has moved for some seconds")
        return _of_edges([numbers["dead_dn_V"], numbers["dead_up_V"]], gains, voltage_max_V)
    if "function" in parameters:
        return _of_function(parameters, voltage_max_V)
    if "voltage_V" in parameters:
        return _of_flow_curve(parameters["voltage_V"], parameters["velocity_m_s"])
    raise ValueError(
        "these parameters hold no curve that could be exported; give those of an adaptive, report or exact algorithm"
    )


def _grid(
    voltage_max_V: float,
    *,
    n_points: int = 401,  # of the table: 0.05 V apart over a range of 10 V
) -> list[float]:
    """Points dense around zero, symmetric, increasing."""
    half = n_points // 2
    return [voltage_max_V * (i / half) * abs(i / half) for i in range(-half, half + 1)]


def _of_function(parameters: Parameters, voltage_max_V: float) -> CompensationTable:
    number = int(parameters["function"])
    curves = parameters.get("curves") or [[parameters["a_V"], parameters["q_V"], parameters["r_V"]]]

    def value(u: float) -> float:
        total = 0.0
        for a, q, r in curves:
            if q > 0.0:
                b = RANGE[number] / q
                total += FUNCTIONS[number](min(max(u, -2 * q), 2 * q), a, b, b * r) / len(curves)
        return total

    grid = _grid(voltage_max_V)
    return CompensationTable(tuple(grid), tuple(value(u) for u in grid))


def _of_edges(dead_bands_V: list[float], gains: list[float], voltage_max_V: float) -> CompensationTable:
    """Of the edge that is open while retracting and of the other; gains in any unit."""
    mean = 0.5 * sum(gains)
    control = (-voltage_max_V, -EDGE_V, EDGE_V, voltage_max_V)
    volts = tuple(
        (-1.0, 1.0)[side] * dead_bands_V[side] + u * (mean / gains[side] - 1.0)
        for u, side in zip(control, (0, 0, 1, 1), strict=True)
    )
    return CompensationTable(control, volts)


def _of_flow_curve(voltage_V: list[float], velocity_m_s: list[float]) -> CompensationTable:
    slope = (velocity_m_s[-1] - velocity_m_s[-2]) / (voltage_V[-1] - voltage_V[-2])
    control: list[float] = []
    volts: list[float] = []
    for u, v in zip(voltage_V, velocity_m_s, strict=True):
        w = v / slope
        if control and w <= control[-1]:
            w = control[-1] + 2 * EDGE_V
        control.append(w)
        volts.append(u - w)
    return CompensationTable(tuple(control), tuple(volts))


def to_csv(table: CompensationTable, path: str | Path | None = None) -> str:
    """The table as CSV with a header row; 17 digits, so that reading it gives the same numbers. Written to `path`
    if given."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["control_V", "compensation_V"])
    writer.writerows([f"{u:.17g}", f"{v:.17g}"] for u, v in zip(table.control_V, table.compensation_V, strict=True))
    return _written(text.getvalue(), path)


C_TEMPLATE = """/* {note}
 * Volts to add to a control voltage [V]; straight between the points, constant beyond the ends. C99, no library. */
static const int {name}_count = {count};
static const double {name}_control_V[{count}] = {{
{control}
}};
static const double {name}_added_V[{count}] = {{
{added}
}};

double {name}(double control_V)
{{
    const double *x = {name}_control_V, *y = {name}_added_V;
    int low = 0, high = {name}_count - 1;
    if (control_V <= x[low]) return y[low];
    if (control_V >= x[high]) return y[high];
    while (high - low > 1) {{
        int middle = (low + high) / 2;
        if (control_V >= x[middle]) low = middle; else high = middle;
    }}
    return y[low] + (y[high] - y[low]) * ((control_V - x[low]) / (x[high] - x[low]));
}}
"""


def to_c(
    table: CompensationTable,
    name: str = "compensation",
    note: str = "Learned compensation curve.",
    path: str | Path | None = None,
) -> str:
    """The table as a C function `double name(double control_V)`; written to `path` if given."""
    if not (name.isidentifier() and name.isascii()):
        raise ValueError(f"'{name}' is no name for a C function: letters, digits and underscores, no digit first")
    if "*/" in note:
        raise ValueError("the note must not hold */, which would end its comment in C")
    numbers = [",\n".join(f"    {x:.17g}" for x in values) for values in (table.control_V, table.compensation_V)]
    text = C_TEMPLATE.format(name=name, note=note, count=len(table.control_V), control=numbers[0], added=numbers[1])
    return _written(text, path)


def _written(text: str, path: str | Path | None) -> str:
    if path is not None:
        Path(path).write_text(text, encoding="utf-8")
    return text
