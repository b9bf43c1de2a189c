"""How much of the valve's lag is spool and how much is delay, from compensated reversals.

Plain control's volts are slow, and of a spool they show the lag alone: a second-order spool of damping 0.7 has the
phase of a delay as long as its lag, up to the third order in frequency. Only where the volts jump, at a compensated
reversal, do the two part. So a bank of spools, all with the identified total lag, is run over each of them:

    d = tau - tau_s,     x_s = spool(tau_s) u(t - d),     z_s' = k f(x_s) R,     S_s += |(1 - Q Q') (z - z_s)|^2 / noise^2

Q holds what other errors leave: a constant, a slope (leak, null) and a kink at the reversal (gain, dead band). S / 2 is
a negative log-likelihood. Too long a delay is benign: the lead then trusts the spool too much, and is a little slow.
Too short a one makes the volts overshoot into the flow. So a standard deviation is added.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from ..compensator import Parameters, clip
from .demand import Demand
from .spool import step_response
from .valve import ValveEstimator

SPOOL_LAGS_S = tuple(
    1e-3 * x for x in (1.2, 1.5, 1.8, 2.1, 2.4, 2.7, 3.0, 3.3, 3.6, 3.9, 4.2, 4.6, 5.0, 5.5, 6.0, 6.7, 7.5)
)
BEFORE, AFTER, PAST = 14, 16, 12  # ticks about the reversal that are compared, and of volts before them
FINE = 5  # samples a tick
NOISE_M = 3.3e-6  # of an oil displacement
MEMORY = 0.985  # of the sums, a reversal
ERRORS, ERRORS_FIRST = 0.2, 1.3  # standard deviations added to the delay at last; and further ones at first
MODEL_SUM = 0.3  # of a reversal, which errors of the rest of the model may make
MAX_SUM = 40.0  # that one reversal may add

LATE_SHARE, LATE_TICKS = 0.3, 9  # of its correction at a reversal; ticks by which a position may be late, and two


def _nuisance() -> np.ndarray:
    t = np.arange(-BEFORE, AFTER + 1.0)
    return np.linalg.qr(np.stack([np.ones_like(t), t, np.abs(t)], axis=1))[0]


NUISANCE = _nuisance()  # Q (BEFORE + AFTER + 1, 3)


@dataclass(slots=True)
class DelayEstimator:
    """Sums S of the bank, the last ticks, and the reversal that is being compared, one spool a tick."""

    tick_s: float
    sums: list[float] = field(default_factory=lambda: [0.0] * len(SPOOL_LAGS_S))
    reversals: int = 0
    volts_V: deque[float] = field(default_factory=lambda: deque([0.0] * (BEFORE + AFTER + PAST), BEFORE + AFTER + PAST))
    oil_m: deque[float] = field(default_factory=lambda: deque([0.0] * (BEFORE + AFTER + 1), BEFORE + AFTER + 1))
    direction: float = 0.0
    ticks: int = 0  # since the demanded flow reversed
    task: tuple[np.ndarray, np.ndarray, tuple[float, ...], float] | None = None
    found: list[float] = field(default_factory=list)

    def add(self, z_m: float, volts_V: float, flow_m_s: float, roots: tuple[float, float], valve: ValveEstimator,
            compensated: bool) -> bool:  # fmt: skip
        """One tick: oil displacement now, volts of the tick past, demanded flow now. True when a reversal was judged.

        compensated: whether the reversal that lies AFTER ticks back, if one does, was.
        """
        self.volts_V.append(volts_V)
        self.oil_m.append(z_m)
        if flow_m_s * self.direction < 0.0:
            self.ticks = 0
        if flow_m_s:
            self.direction = flow_m_s
        self.ticks += 1
        if self.ticks == AFTER + 1 and compensated:
            self.task, self.found = self._prepare(roots, valve), []
        return self.task is not None and self._compare()

    def delay_s(self, lag_s: float) -> float:
        """The delay taken, of a total lag: mean of its likelihood, and a part of its standard deviation more."""
        least, total, mean, square = min(self.sums), 0.0, 0.0, 0.0
        for spool_s, chi in zip(SPOOL_LAGS_S, self.sums, strict=True):
            delay, weight = max(lag_s - spool_s, 0.0), math.exp(0.5 * (least - chi))
            total, mean, square = total + weight, mean + weight * delay, square + weight * delay * delay
        mean /= total
        errors = ERRORS + ERRORS_FIRST / (1.0 + self.reversals)
        return min(mean + errors * math.sqrt(max(square / total - mean * mean, 0.0)), max(lag_s - SPOOL_LAGS_S[0], 0.0))

    def parameters(self) -> Parameters:
        """What was identified, in numbers."""
        return {"sums": list(self.sums), "reversals": self.reversals}

    def restore(self, known: Parameters) -> None:
        """Start with what was identified before."""
        self.sums, self.reversals = [float(x) for x in known["sums"]], int(known["reversals"])

    def _prepare(self, roots: tuple[float, float], valve: ValveEstimator) -> tuple:
        volts = np.array(self.volts_V)
        if valve.with_backlash:
            half, follower = valve.edge(volts[-1]).backlash_V, volts[0]
            for i, u in enumerate(volts):
                follower = volts[i] = clip(follower, u - half, u + half)
        down, up = valve.edges
        edges = (
            down.gain_m_s_V * roots[0], down.dead_band_V, up.gain_m_s_V * roots[1], up.dead_band_V,
        )  # fmt: skip
        return volts, np.array(self.oil_m), edges, valve.lag_s

    def _compare(self) -> bool:
        """The next spool of the bank against the reversal; True after the last."""
        assert self.task is not None
        volts, oil, (k_down, delta_down, k_up, delta_up), lag_s = self.task
        spool_s = min(SPOOL_LAGS_S[len(self.found)], lag_s)
        t = (np.arange((PAST + 2) * FINE) + 0.5) * self.tick_s / FINE
        delay_s = lag_s - spool_s
        pulse = step_response(t, lag_s, delay_s) - step_response(t - self.tick_s, lag_s, delay_s)
        steps = np.zeros(len(volts) * FINE)
        steps[::FINE] = volts - volts[0]
        path = volts[0] + np.convolve(steps, pulse)[PAST * FINE : len(steps)]
        flow = k_up * np.maximum(path - delta_up, 0.0) - k_down * np.maximum(-path - delta_down, 0.0)
        error = oil - np.concatenate([[0.0], np.cumsum(flow.reshape(-1, FINE).mean(axis=1))]) * self.tick_s
        error -= NUISANCE @ (NUISANCE.T @ error)
        self.found.append(float(error @ error) / NOISE_M**2)
        if len(self.found) < len(SPOOL_LAGS_S):
            return False
        self.task, least = None, min(self.found)
        scale = max(1.0, least / (len(error) - 3))
        self.sums = [
            MEMORY * s + clip((x - least) / scale - MODEL_SUM, 0.0, MAX_SUM)
            for s, x in zip(self.sums, self.found, strict=True)
        ]
        self.reversals += 1
        return True


@dataclass(slots=True)
class Lateness:
    """How late the position transducer is, from when the pressure steps at compensated reversals.

    All that is asked for holds for the position as it is measured. Pressure and oil are then early by as much. Least
    squares of what the pressure deviates by on the rate that is asked for:  late += share sum(dev P') / sum(P'^2).
    """

    tick_s: float
    late_s: float = 0.0
    rate_Pa: float = 0.0  # of the demand, a tick
    sums: tuple[float, float] = (0.0, 0.0)  # of a half stroke
    pressures_Pa: deque[float] = field(default_factory=lambda: deque([0.0] * LATE_TICKS, LATE_TICKS))  # newest first

    def due_Pa(self, now: Demand, ahead: deque[Demand]) -> float:
        """The pressure demanded for now."""
        late = self.late_s / self.tick_s
        whole = int(late)
        near, far = (ahead[whole - 1] if whole else now).pressure_Pa, ahead[whole].pressure_Pa
        self.rate_Pa = far - near
        return near + (late - whole) * (far - near)

    def then_Pa(self, pressure_Pa: float) -> float:
        """One tick: the pressure that belongs to the position measured now."""
        self.pressures_Pa.appendleft(pressure_Pa)
        late = self.late_s / self.tick_s
        whole = int(late)
        near, far = self.pressures_Pa[whole], self.pressures_Pa[whole + 1]
        return near + (late - whole) * (far - near)

    def add(self, deviation_Pa: float, judged: bool, lag_s: float) -> None:
        """One tick: measured less demanded pressure; judged: a compensated reversal lies behind."""
        product, square = self.sums
        self.sums = product + deviation_Pa * self.rate_Pa, square + self.rate_Pa * self.rate_Pa
        if judged:
            if square > 0.0:
                late_s = self.late_s + LATE_SHARE * product / square * self.tick_s
                self.late_s = clip(late_s, 0.0, max(lag_s - SPOOL_LAGS_S[0], 0.0))
            self.sums = 0.0, 0.0
