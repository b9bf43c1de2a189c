"""Which criterion keeps the adaptive algorithm out, in words and numbers: the first of engagement's conditions that fails."""

from __future__ import annotations

import math

from ..records import Record
from .checks import ENABLE_RATIO, MAX_CLOSED_SHARE, plain_valve_told
from .edge_rounding import explains_reversals, jumps, reversals_seen
from .engagement import MIN_OPEN_S
from .friction import MIN_WINDOWS as FRICTION_WINDOWS
from .friction import friction_ready, resonance_of_load_Hz, step_acceleration_m_s2
from .monitor import bump_noise_m_s2, least_bump_m_s2, monitor_ready, noise_range, plain_bump_m_s2, worth_crossing
from .valve import MAX_CROSSING_V_S, crossing_in_time, lags_agree, overlap_V, valve_ready
from .valve_edge import (
    ACCEPT_MISFIT,
    DEAD_BAND_ERROR_V,
    GAIN_ERROR,
    LAG_ERROR_BACKLASH_S,
    LAG_ERROR_S,
    MAX_LAG_S,
    MIN_GAIN,
)

DIRECTIONS = ("retracting", "extending")


def reason(s: Record) -> str:
    """Empty while volts are added or may be at any tick; s: a record STATE."""
    engagement = s.engagement
    if engagement.ramp > 0.0:
        return ""
    if engagement.lockout_s > 0.0:
        why = "the piston does not follow as where it was learned" if engagement.other else (
            "reversals became worse than plain control's")  # fmt: skip
        return f"{why}: plain control for another {engagement.lockout_s:.1f} s"
    if engagement.armed:
        return "ready with what was learned before: waits for the motion to begin"
    if not valve_ready(s.valve):
        return next(found for i in range(2) if (found := _edge(s, i)))
    if not friction_ready(s.friction):
        seen = ", ".join(f"{int(s.friction.windows[i])} {DIRECTIONS[i]}" for i in range(2))
        return f"friction is not identified: it needs {FRICTION_WINDOWS} windows of steady motion in each direction and has {seen}"
    return _motion(s) or _reversals(s) or _time(s)


def _edge(s: Record, i: int) -> str:
    edge, settings = s.valve.edges[i], s.settings
    if edge.ready:
        return ""
    where, window_ms = f"the valve is not identified, {DIRECTIONS[i]}", 1e3 * s.valve.window * s.valve.tick_s
    fit = edge.backlash_fit if s.valve.with_backlash else edge.plain_fit
    k = max(fit.theta[0], MIN_GAIN)
    misfit_m, usual_m = math.sqrt(max(fit.residual, 0.0)), edge.noise_m * math.sqrt(max(edge.misfit_allowed, 1.0))
    if edge.windows < edge.windows_needed and edge.rejections == 0:
        return f"{where}: {int(edge.windows)} of {int(edge.windows_needed)} windows of {window_ms:.0f} ms with steady motion were seen"
    if misfit_m >= ACCEPT_MISFIT * usual_m or edge.rejections:
        noise_um = 1e6 * math.hypot(settings.position_noise_m, settings.position_resolution_m / math.sqrt(12.0))
        return (
            f"{where}: its law (gain, dead band, lag) leaves {1e6 * misfit_m:.1f} um rms in windows of {window_ms:.0f} ms, and "
            f"{1e6 * ACCEPT_MISFIT * usual_m:.1f} um are allowed with the declared position noise of {noise_um:.1f} um"
        )
    if fit.theta[2] / k >= MAX_LAG_S:
        return f"{where}: its lag, {1e3 * fit.theta[2] / k:.1f} ms, is beyond the {1e3 * MAX_LAG_S:.0f} ms of a spool"
    errors = [edge.noise_m * math.sqrt(max(fit.covariance[j, j], 0.0)) / k for j in range(3)]
    limits = (GAIN_ERROR, DEAD_BAND_ERROR_V, LAG_ERROR_S if edge.backlash_V == 0.0 else LAG_ERROR_BACKLASH_S)
    names = (("gain", "", 1.0), ("dead band", " mV", 1e3), ("lag", " ms", 1e3))
    for (name, unit, scale), error, limit in zip(names, errors, limits, strict=True):
        if error >= limit:
            return (
                f"{where}: the standard error of its {name}, {scale * error:.3g}{unit}, is not below {scale * limit:.3g}{unit} yet, with "
                f"{1e6 * edge.noise_m:.1f} um of noise a window"
            )
    return f"{where}: it needs more windows of steady motion"


def _motion(s: Record) -> str:
    engagement, settings = s.engagement, s.settings
    least = max(ENABLE_RATIO * engagement.stability_limit_m_s2, settings.min_excitation_m_s2)
    if engagement.excitation_m_s2 <= least:
        return f"reversals of {engagement.excitation_m_s2:.3f} m/s2 are gentler than the {least:.3f} m/s2 from which it engages"
    if not engagement.closed_ticks < MAX_CLOSED_SHARE * engagement.half_ticks:
        share = engagement.closed_ticks / max(engagement.half_ticks, 1)
        return (
            f"the overlap shuts the valve for {100 * share:.0f} % of a half stroke; with more than "
            f"{100 * MAX_CLOSED_SHARE:.0f} % the piston stands still and tells nothing"
        )
    if not monitor_ready(s.monitor):
        return "no reversal of plain control was seen in both directions yet"
    told = s.reference.load_given == 2
    noise = noise_range(s.valve.four_way, told) * bump_noise_m_s2(s.monitor)
    bump, floor = plain_bump_m_s2(s.monitor, told), least_bump_m_s2(s.monitor, step_acceleration_m_s2(s.friction), told)
    if bump <= floor + noise:
        return (
            f"plain control's bump of {bump:.3f} m/s2 peak to peak is not above {floor:.3f} m/s2 and what "
            f"{1e6 * s.monitor.noise_m:.1f} um of position noise make of a reading, {noise:.3f} m/s2"
        )
    return ""


def _reversals(s: Record) -> str:
    valve, told = s.valve, s.reference.load_given == 2
    down, up = valve.edges[0], valve.edges[1]
    if not lags_agree(valve, told):
        return f"the lags of both directions, {1e3 * down.lag_s:.2f} and {1e3 * up.lag_s:.2f} ms, are not those of one spool"
    if not crossing_in_time(valve):
        crossing = 1e3 * overlap_V(valve) * valve.lag_s
        return f"overlap times lag, {crossing:.1f} mV s, is not below {1e3 * MAX_CROSSING_V_S:.1f} mV s"
    if jumps(valve) and not worth_crossing(s.monitor, resonance_of_load_Hz(s.friction, s.settings)):
        return "plain control's bumps are smaller than what a jump across the overlap lets through wrongly"
    if not explains_reversals(s.rounding):
        misfit = math.sqrt(max(s.rounding.misfit, 0.0))
        return f"passages over the overlap move {misfit:.1f} standard errors of oil more or less than the identified valve lets through"
    if valve.four_way and not reversals_seen(s.rounding):
        return "no passage over the overlap was held against the identified valve yet"
    if not valve.leak_known and not plain_valve_told(s):
        return f"the leak is not known: {int(s.leak.passages)} passages over the overlap were quick enough to tell it"
    return ""


def _time(s: Record) -> str:
    engagement = s.engagement
    if engagement.friction_share < 1.0:
        return "ready: friction's share of the volts comes in first"
    if engagement.waited_s > 0.0:
        return f"ready: has waited {engagement.waited_s:.1f} s for legs that are not"
    if engagement.open_ticks * s.settings.tick_s <= MIN_OPEN_S:
        return f"ready: waits for plain control to hold the valve open for {1e3 * MIN_OPEN_S:.0f} ms"
    return "ready: waits for the middle of a half stroke"
