"""What washouts make of a push forward: the platform's way, its lean, and what is felt of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from hexsim.cueing.washout import Washout, poses, specific_force
from hexsim.mechanics.leg_geometry import write_rotation
from hexsim.recording import palette
from hexsim.recording.figure_style import legend, small_multiples, styled

RATE_Hz = 500.0  # as the motion computer ticks
PUSH_s = 4.0  # that the vehicle accelerates


def push(
    size_m_s2: float,
    *,
    rise_s: float = 0.3,  # of the push, a smooth one
    before_s: float = 0.5,  # that the vehicle stands
) -> tuple[np.ndarray, np.ndarray]:
    """Time (n,) and the vehicle's accelerations (n, 3): forward for `PUSH_s`, smoothly on and off."""
    time = np.arange(0.0, before_s + PUSH_s + 5.5, 1.0 / RATE_Hz)
    ramp = np.interp(time, np.cumsum([before_s, rise_s, PUSH_s - 2.0 * rise_s, rise_s]), [0.0, 1.0, 1.0, 0.0])
    acceleration = np.zeros((len(time), 3))
    acceleration[:, 0] = size_m_s2 * ramp * ramp * (3.0 - 2.0 * ramp)
    return time, acceleration


@styled
def washout_figure(washouts: Mapping[str, Washout], size_m_s2: float) -> Figure:
    """Columns: name -> washout; rows: excursion, lean, specific force forward against the vehicle's, scaled."""
    figure, plots = small_multiples(
        3 * len(washouts),
        f"A push of {size_m_s2:g} m/s² forward for {PUSH_s:g} s through washouts",
        len(washouts),
        1.9,
        True,
    )
    rows = [plots[k * len(washouts) : (k + 1) * len(washouts)] for k in range(3)]
    time, vehicle = push(size_m_s2)
    for k, (name, washout) in enumerate(washouts.items()):
        pose = poses(washout, vehicle, rate_Hz=RATE_Hz)
        own = np.gradient(np.gradient(pose[:, :3], time, axis=0), time, axis=0)
        rotations = np.empty((len(pose), 3, 3))
        for row, rotation in zip(pose, rotations, strict=True):
            write_rotation(row, rotation)
        felt = specific_force(rotations, np.einsum("nji,nj->ni", rotations, own))[:, 0]
        rows[0][k].plot(time, 1e3 * pose[:, 0], color=palette.RESPONSE)
        rows[0][k].set_title(name)
        rows[1][k].plot(time, -np.degrees(pose[:, 4]), color=palette.RESPONSE)
        rows[2][k].plot(time, washout.scale * vehicle[:, 0], color=palette.REFERENCE, ls="--", label="vehicle, scaled")
        rows[2][k].plot(time, felt, color=palette.RESPONSE, label="felt")
        rows[2][k].set_xlabel("time [s]")
    for row, label in zip(rows, ("forward [mm]", "nose up [deg]", "specific force\nforward [m/s²]"), strict=True):
        row[0].set_ylabel(label)
        low, high = min(plot.get_ylim()[0] for plot in row), max(plot.get_ylim()[1] for plot in row)
        for plot in row:
            plot.set_ylim(low, high)
    legend(rows[2][0], columns=2)
    return figure
