"""State of the adaptive algorithm: what is identified, what is asked for in the ticks to come, what is remembered."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import Enum

from ..compensator import Context
from .delay import DelayEstimator, Lateness
from .demand import Demand
from .edge_rounding import TRIM_TICKS, RoundingEstimator, RoundingTrim
from .friction import FrictionEstimator
from .inverse import ValveInverse
from .monitor import PerformanceMonitor
from .prediction import SetpointPredictor
from .reference import Reference
from .spool import LEAD_TAPS
from .valve import ValveEstimator

AT_REST_M_S2 = 1e-3  # acceleration below which nothing moves


class Phase(Enum):
    """Where the transfer between plain control and compensation stands; `engagement` has the table."""

    PLAIN = "plain control"
    ENGAGING = "engaging"
    COMPENSATED = "compensated"
    FEED_FORWARD_OUT = "feed-forward going out"
    DISENGAGING = "disengaging"
    TRIPPED = "tripped"


@dataclass(frozen=True, kw_only=True)
class EngagementSettings:
    """Times and thresholds of the transfer; see `Adaptive` for their meaning."""

    engage_s: float
    feed_forward_s: float
    disengage_s: float
    min_excitation_m_s2: float
    max_stability_limit_m_s2: float
    damping_1_s: float
    damping_high_Hz: float


@dataclass(slots=True)
class Engagement:
    """Phase of the transfer, how far it has come, and the signals that decide it."""

    settings: EngagementSettings
    monitor: PerformanceMonitor
    phase: Phase = Phase.PLAIN
    ramp: float = 0.0  # 0 plain control, 1 compensated
    ramp_step: float = 0.01  # a tick
    friction_share: float = 0.0  # of the demanded pressure
    trips: int = 0  # reversals worse than the baseline, not forgiven yet
    good_reversals: int = 0  # since the last trip
    lockout_s: float = 0.0  # left
    # reversals of the reference
    direction: float = 0.0  # its velocity, last seen other than 0
    reversal_ticks: int = 0  # since the last reversal
    half_ticks: int = 0  # between the last two: the half stroke
    after_reversal: bool = False  # a fifth into a half stroke: a reversal can be judged, disengaging may begin
    engage_window: bool = False  # two fifths into it, the valve having been open for long enough
    # valve under plain control
    open_ticks: int = 0  # for which it has been open
    closed_ticks: int = 0  # for which the overlap closed it, at the last reversal
    # excitation: acceleration of the setpoint
    acceleration_m_s2: float = 0.0  # low-pass
    excitation_m_s2: float = 0.0  # its recent peak
    peak_m_s2: float = 0.0  # since the last reversal was judged
    reversal_m_s2: float = 0.0  # at the last reversal
    excited: bool = False
    stability_limit_m_s2: float = AT_REST_M_S2  # reversal acceleration below which compensation disengages

    @property
    def weight(self) -> float:
        """Share of the volts that is added: smooth in the ramp."""
        return self.ramp * self.ramp * (3.0 - 2.0 * self.ramp)


def _zeros(count: int) -> deque[float]:
    return deque([0.0] * count, count)


@dataclass(slots=True)
class AdaptiveState:
    """All that the adaptive algorithm carries from tick to tick, for one actuator."""

    context: Context
    valve: ValveEstimator
    friction: FrictionEstimator
    reference: Reference
    inverse: ValveInverse
    engagement: Engagement
    delay: DelayEstimator
    lateness: Lateness
    lag_s: float = 0.0  # spool lag that the taps were designed for
    lead_taps: tuple[float, ...] = ()
    crossing_taps: tuple[float, ...] = ()
    crossing_path: tuple[float, ...] = ()
    delay_s: float = 0.0  # of the lag, that is delay and no spool
    shift: int = 0  # ticks that the taps lie earlier
    damping_taps: tuple[float, ...] = ()
    demands: deque[Demand] = field(default_factory=deque)  # of the boundaries to come, the nearest first
    flow_V: deque[float] = field(default_factory=lambda: _zeros(LEAD_TAPS))  # spool demand for the flow, newest first
    dead_band_V: deque[float] = field(default_factory=lambda: _zeros(LEAD_TAPS))  # dead-band compensation, newest first
    deviation_Pa: deque[float] = field(default_factory=deque)  # measured less demanded pressure, newest first
    mean_deviation_Pa: float = 0.0  # its slow mean
    last_bottom_Pa: float = 0.0  # bottom pressure at the tick before
    mean_bottom_Pa: float = 0.0  # slow mean of the bottom pressure
    supply_Pa: float = 0.0  # low-pass of the supply pressure
    mean_supply_Pa: float = 0.0  # its slow mean
    rounding: RoundingEstimator = field(default_factory=RoundingEstimator)
    trim: RoundingTrim = field(default_factory=RoundingTrim)
    oil_error_m: deque[float] = field(default_factory=lambda: _zeros(TRIM_TICKS + 1))  # z - z_m, newest last
    leaked_m: float = 0.0  # oil that the leak has let in, as travel
    predictor: SetpointPredictor = field(default_factory=SetpointPredictor)
    backlash_input_V: float = 0.0  # volts fed forward, followed within the width of the backlash inverse
    damping_gain: float = 1.0

    def look_ahead(self, shift: int) -> None:
        """Demands `shift` ticks further ahead than PREVIEW_TICKS, while nothing is added."""
        while self.shift < shift:
            self.demands.append(self.demands[-1])
            self.shift += 1
        while self.shift > shift:
            self.demands.pop()
            self.shift -= 1
