"""The friction-velocity map as a figure (report Fig. 2.9) and the Stribeck parameters as a table."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from hexsim.recording import palette
from hexsim.recording.figure_style import PAPER, styled
from hexsim.tracing.friction.identification import FrictionResult
from hexsim.tracing.friction.stribeck import KEYS, curve, row_with


@styled
def friction_figure(result: FrictionResult) -> Figure:
    """Measured samples, bins with error bars, fitted and declared curve; left the whole range, right the slow part."""
    figure, axes = plt.subplots(1, 2, figsize=(PAPER.width_in, 3.6), layout="constrained", width_ratios=(3, 2))
    fastest = float(np.max(np.abs(result.points_velocity_m_s)))
    c = max(result.parameters["stribeck_velocity_extend_m_s"], result.parameters["stribeck_velocity_retract_m_s"])
    declared = row_with(result.machine, np.array([result.declared[key] for key in KEYS]))
    for plot, reach in zip(axes, (fastest, min(6 * c, fastest)), strict=True):
        inside = np.abs(result.points_velocity_m_s) <= reach
        plot.plot(
            result.points_velocity_m_s[inside] * 1e3, result.points_friction_N[inside], ".", ms=2, color=palette.RAW
        )
        bins = np.abs(result.map_velocity_m_s) <= reach
        plot.errorbar(
            result.map_velocity_m_s[bins] * 1e3, result.map_friction_N[bins], 2 * result.map_error_N[bins],
            fmt="o", ms=3.5, color=palette.INK, lw=1, label="measured, bins (2 standard errors)",
        )  # fmt: skip
        v = np.concatenate([-np.geomspace(reach, 1e-5, 400), np.geomspace(1e-5, reach, 400)])
        plot.plot(v * 1e3, curve(declared, v), "--", lw=1.2, color=palette.REFERENCE, label="declared")
        plot.plot(v * 1e3, result.friction(v), lw=1.6, color=palette.DEVIATION, label="fitted, Eq. 2.4")
        plot.set_xlabel("velocity [mm/s]")
    axes[0].set_ylabel("friction force [N]")
    axes[0].set_title(f"Friction against velocity, leg {result.leg}, log {result.log}")
    axes[1].set_title("Slow part: the Stribeck effect")
    axes[0].legend(loc="upper left")
    return figure


def friction_table(result: FrictionResult) -> Table:
    """Parameters with errors beside the declared values, and the notes."""
    table = Table(title=f"Friction of leg {result.leg}, log {result.log}", caption="\n".join(result.notes) or None)
    for heading in ("parameter", "fitted", "standard error", "declared"):
        table.add_column(heading, justify="left" if heading == "parameter" else "right")
    for key in KEYS:
        value, error = result.parameters[key], result.standard_error[key]
        table.add_row(key, f"{value:.4g}", f"{error:.2g}", f"{result.declared[key]:.4g}")
    table.add_row("mass_kg", f"{result.mass_kg:.5g}", f"{result.mass_error_kg:.2g}", "")
    table.add_row("rest_N (sensors' noise)", f"{result.rest_N:.3g}", f"({result.noise_N:.3g})", "")
    return table
