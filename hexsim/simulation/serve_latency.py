"""Latency from a host's packet to the acceleration that is felt, measured while a server runs.

The host's setpoints, on its own clock moved by the fastest packet's way, give the acceleration that was asked for when
(a spline's second derivative); the delay of the platform's acceleration behind it, below 10 Hz, is the latency. It holds
transport behind the fastest packet, buffer, controller, valve and load.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import scipy
from numpy.typing import NDArray

from hexsim.motion_computer.host_packet import HostCommand
from hexsim.smoothness import band_limit, response_delay_s

Array = NDArray[np.float64]
AXES = ("x", "y", "z", "roll", "pitch", "yaw")


class LatencyLog:
    """places: of the axes that the machine has in pose and acceleration."""

    def __init__(
        self,
        tick_s: float,
        places: list[int],
        *,
        kept_s: float = 60.0,  # of the last motion
    ) -> None:
        self.places = places
        self._ticks: deque[tuple[float, Array]] = deque(maxlen=round(kept_s / tick_s))
        self._packets: deque[tuple[float, float, tuple[float, ...]]] = deque(maxlen=round(kept_s / tick_s))

    def packet(self, now_s: float, command: HostCommand) -> None:
        self._packets.append((now_s, command.time_s, command.setpoints))

    def tick(self, now_s: float, acceleration: Array) -> None:
        """acceleration: one number an axis of `places`."""
        self._ticks.append((now_s, acceleration))

    def ms(
        self,
        *,
        least_s: float = 2.0,  # of the last motion
        least_m_s2: float = 0.01,  # rms asked for along an axis, or rad/s2
        band_Hz: float = 10.0,  # of what is compared: slower than the bumps, quicker than the washout
    ) -> dict[str, float]:
        """Axis -> latency [ms], of the axes that the host has moved."""

        if len(self._packets) < 20 or len(self._ticks) < 20:
            return {}
        arrived, sent = np.array([one[:2] for one in self._packets]).T
        sent, order = np.unique(sent, return_index=True)
        poses = np.array([self._packets[k][2] for k in order])
        time = np.array([one[0] for one in self._ticks])
        felt = np.array([one[1] for one in self._ticks])
        host = time - (arrived[order] - sent).min()
        known = (host > sent[0]) & (host < sent[-1])
        if known.sum() < least_s / (time[1] - time[0]):
            return {}
        time = np.arange(known.sum()) * (time[1] - time[0])
        asked = band_limit(time, scipy.interpolate.CubicSpline(sent, poses)(host[known], 2), band_Hz)
        found = {}
        for column, place in enumerate(self.places):
            if np.std(asked[:, place]) > least_m_s2:
                answer = band_limit(time, felt[known][:, column], band_Hz)
                found[AXES[place]] = 1e3 * response_delay_s(time, answer, asked[:, place])
        return found
