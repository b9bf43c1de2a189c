"""The one limiter of setpoints that leave a host, whatever made them: any motion in, one within the limits out.

Judged are the samples themselves, a packet each, as legs and as platform:

    x       excursion from neutral           v = (x_k - x_k-1)/T         speed
    a = (v_k - v_k-1)/T   acceleration       j = (a_k - a_k-1)/T         jerk

A motion begins and ends at rest at neutral, so that zeros stand before and behind it. One within its limits passes
unchanged. Of any other what is kept is the largest of: the motion scaled, and the motion smoothed by a window and scaled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.mechanics.mechanics import DOF_NAMES
from hexsim.motion_computer.limits import Limits, leg_limits, pose_limits
from hexsim.packets import LARGEST
from hexsim.scenarios.scenario import scenario_from_dict

Array = NDArray[np.float64]
PERIOD_s = 0.01  # between the packets of a host that identifies
KINDS = ("excursion", "velocity", "acceleration", "jerk")


class Smoothing(NamedTuple):
    """How a motion is smoothed that is beyond its limits, or is broken off."""

    rounding: float = 1e-6  # of a limit, which differences of samples may be off
    # samples by which a motion beyond its limits is smoothed
    windows: tuple[int, ...] = (1, 3, 5, 9, 17, 33, 65, 129, 257)
    stops_s: tuple[float, ...] = (0.1, 0.2, 0.4, 0.8)  # in which a motion that is broken off comes to rest
    returns_s: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # in which it is then back at neutral


SMOOTHING = Smoothing()

MEMORY = len(KINDS) - 1  # samples that a jerk looks back


def setpoints_of(machine: Machine, tables: dict[str, Any], period_s: float = PERIOD_s) -> Array:
    """A scenario as setpoints (m, 6) of packets that begin and end at neutral; a bench moves in z."""
    scenario = scenario_from_dict(tables)
    time = np.arange(0.0, scenario.duration_s, period_s)
    values = scenario.evaluate(time)[0]
    if not machine.is_hexapod:
        along = np.zeros_like(values)
        along[:, DOF_NAMES.index("z")] = values[:, 0]
        values = along
    left = np.clip((scenario.duration_s - time) / scenario.fade_s, 0.0, 1.0) if scenario.fade_s else np.ones(len(time))
    return values * (left**3 * (10.0 - 15.0 * left + 6.0 * left**2))[:, None]


class HostLimiter:
    """Limits of a machine's setpoints, `share` of those in its file, for packets `period_s` apart."""

    def __init__(self, machine: Machine, share: float = 1.0, period_s: float = PERIOD_s) -> None:
        if not 0.0 < share <= 1.0:
            raise HexsimError(f"a largest motion of {share:g}: give a share above 0, at most 1")
        self.mechanics, self.period_s = machine.mechanics, period_s
        self.limits: dict[str, Limits] = {"leg": leg_limits(machine).scaled(share)}
        if self.mechanics.has_platform:
            self.limits["axis"] = pose_limits(machine).scaled(share)

    def coordinates(self, rows: Array) -> dict[str, Array]:
        """Excursions from neutral of rows (m, 6): legs (m, n) [m], axes (m, 6) [m, rad]."""
        found = {"leg": self.mechanics.piston_positions(rows) - self.mechanics.neutral_positions}
        return found | ({"axis": rows} if self.mechanics.has_platform else {})

    def motion(self, rows: Array) -> dict[str, tuple[Array, ...]]:
        """Excursion, speed, acceleration and jerk of rows that follow on each other, (m, n) each: differences of samples."""
        return {
            what: tuple(np.diff(x, order, axis=0) / self.period_s**order for order in range(len(KINDS)))
            for what, x in self.coordinates(rows).items()
        }

    def worst(self, rows: Array) -> tuple[float, str]:
        """Largest share of a limit in rows (m, 6) that follow on each other, and which one it is."""
        found = [(0.0, "at rest")]
        for what, derivatives in self.motion(rows).items():
            for kind, values in zip(KINDS, derivatives, strict=True):
                if len(values):
                    shares = np.abs(values).max(axis=0) / getattr(self.limits[what], kind)
                    place = int(np.argmax(shares))
                    name = f"leg {place + 1}" if what == "leg" else DOF_NAMES[place]
                    found.append((float(shares[place]), f"{kind} of {name}"))
        return max(found)

    def share(self, rows: Array) -> float:
        """Largest share of a limit that a motion takes which begins and ends at rest at neutral."""
        return self.worst(np.pad(rows, ((MEMORY, MEMORY), (0, 0))))[0]

    def limit(
        self,
        rows: Array,
        *,
        within: float = 0.98,  # of the limits, for what had to be changed
    ) -> Array:
        """The motion (m, 6) itself where it is within the limits, else one that is; it may be longer.

        Raises HexsimError for what is no motion of this machine: a value that is not finite, above 1000 m or rad, or in an
        axis that the machine has not.
        """
        rows = self._checked(rows)
        if self.share(rows) <= 1.0 + SMOOTHING.rounding:
            return rows
        size = float(np.sqrt(np.sum(rows**2)))
        best: tuple[float, Array] = (-1.0, rows)
        for width in SMOOTHING.windows:
            smooth = _smoothed(rows, width)
            kept = min(1.0, within / self.share(smooth)) * float(np.sqrt(np.sum(smooth**2))) / size
            if kept > best[0] + SMOOTHING.rounding:
                best = kept, smooth
        rows = best[1]
        while (share := self.share(rows)) > within:  # legs are not quite linear in the pose
            rows = min(0.999, within / share) * rows
        return rows

    def _checked(
        self,
        rows: Array,
    ) -> Array:
        rows = np.asarray(rows, dtype=float)
        if rows.ndim != 2 or rows.shape[1] != len(DOF_NAMES):
            raise HexsimError(f"setpoints of shape {rows.shape}: give rows of x y z roll pitch yaw")
        if not (np.abs(rows) <= LARGEST).all():  # False for NaN too
            raise HexsimError(f"setpoints with values that are not finite or above {LARGEST:g} m or rad are no motion")
        other = [name for k, name in enumerate(DOF_NAMES) if k not in self.mechanics.dof_places and rows[:, k].any()]
        if other:
            raise HexsimError(
                f"setpoints in {', '.join(other)}: this machine moves in {', '.join(self.mechanics.dofs)} only"
            )
        return rows

    def way_back(self, sent: Array, planned: Array) -> Array:
        """Rows that end a motion early, within its limits: a little further as planned where it must be, to rest, to neutral.

        sent (`MEMORY` + 1, 6): what has left; planned (m, 6): what would have followed, a motion that `limit` has given.
        """
        for further in (0, *(2**k for k in range(1, 13)), len(planned)):
            if further > len(planned):
                continue
            past = np.concatenate([sent, planned[:further]])
            for stop_s in SMOOTHING.stops_s:
                stop = self._stopped(past[-MEMORY:], stop_s)
                if (
                    self.worst(np.concatenate([past, stop, np.repeat(stop[-1:], MEMORY, axis=0)]))[0]
                    > 1.0 + SMOOTHING.rounding
                ):
                    continue
                for return_s in SMOOTHING.returns_s:
                    back = (1.0 - _smooth_step(round(return_s / self.period_s)))[:, None] * stop[-1]
                    if self.worst(np.concatenate([past, stop, back]))[0] <= 1.0 + SMOOTHING.rounding:
                        return np.concatenate([planned[:further], stop, back])
        return planned

    def _stopped(self, past: Array, stop_s: float) -> Array:
        """The quintic from the speed and acceleration of the last three rows to rest, half the way on that it would go."""
        n = max(round(stop_s / self.period_s), 1)
        T, r = n * self.period_s, np.arange(1, n + 1)[:, None] / n
        velocity = (1.5 * past[-1] - 2.0 * past[-2] + 0.5 * past[-3]) / self.period_s
        acceleration = (past[-1] - 2.0 * past[-2] + past[-3]) / self.period_s**2
        v, a = velocity * T, acceleration * T**2
        # p = v r + a r^2/2 + c3 r^3 + c4 r^4 + c5 r^5 to rest at v/2 + a/12, where braking evenly would end
        end = 0.5 * v + a / 12.0
        c3 = 10.0 * end - 6.0 * v - 1.5 * a
        c4 = -15.0 * end + 8.0 * v + 1.5 * a
        c5 = 6.0 * end - 3.0 * v - 0.5 * a
        return past[-1] + v * r + 0.5 * a * r**2 + c3 * r**3 + c4 * r**4 + c5 * r**5


class Gate:
    """What has left the host, and whether the next row may. A host that knows no machine keeps it at neutral."""

    def __init__(self, limiter: HostLimiter | None) -> None:
        self.limiter = limiter
        self.sent, self.count = np.zeros((MEMORY + 1, len(DOF_NAMES))), 0

    def let_out(self, row: Array) -> Array:
        """The row (6,), remembered. Raises HexsimError for one beyond the limits: it must not leave."""
        rows = np.concatenate([self.sent[1:], np.asarray(row, dtype=float)[None]])
        if self.limiter is None:
            if rows.any():
                raise HexsimError("a host without the machine's declaration drives nothing: give Host its machine")
        else:
            share, what = self.limiter.worst(rows) if np.isfinite(rows).all() else (np.inf, "value")
            if share > 1.0 + 2.0 * SMOOTHING.rounding:
                raise HexsimError(
                    f"a setpoint was not sent: its {what} is {share:.3g} times what [host_limits] allows; pass the motion "
                    "through `HostLimiter.limit` first"
                )
        self.sent, self.count = rows, self.count + 1
        return rows[-1]


def _smooth_step(n: int) -> Array:
    """0 to 1 in n samples, 10 r^3 - 15 r^4 + 6 r^5."""
    r = np.arange(1, n + 1) / n
    return r**3 * (10.0 - 15.0 * r + 6.0 * r**2)


def _smoothed(rows: Array, width: int) -> Array:
    """Rows (m, 6) through a Hann window of so many samples, whose ends are its own: (m + width - 1, 6)."""
    window = np.hanning(width + 2)[1:-1]
    window /= window.sum()
    return np.stack([np.convolve(column, window) for column in rows.T], axis=1)
