"""The compiled designs of the taps, called with numbers and giving arrays; records with the noises of the usual data sheet."""

from __future__ import annotations

import numpy as np

from compensation import damping_design
from compensation.adaptive import spool, taps
from compensation.adaptive.layout import (
    DELAY,
    DESIGN,
    FRICTION,
    LEAD_TAPS,
    LEAK,
    PATH,
    PRESLIDING,
    ROUNDING,
    SETTINGS,
    TRUST,
    VALVE,
)
from compensation.records import Record, empty

DAMPING = 0.7


def usual(layout: np.dtype) -> Record:
    """An empty record with the noises of 3 um and 4 kPa, and a spool of damping 0.7."""
    record = empty(layout)
    if layout is VALVE:
        for edge in record.edges:
            edge.noise_m = 5e-6
    elif layout in (LEAK, ROUNDING):
        record.noise_m = 7e-6 if layout is LEAK else 5e-6
    elif layout is DELAY:
        record.noise_m, record.scale, record.damping = 3.3e-6, 1.0, DAMPING
    elif layout is FRICTION:
        record.noise_MPa, record.stribeck_velocity_m_s = 2e-3, 5e-3
    elif layout is PRESLIDING:
        record.noise_m, record.noise_Pa = 3.3e-6, 4e3
    elif layout is TRUST:
        record.noise_Pa = 4e3
    return record


def step_response(t_s: np.ndarray, lag_s: float, delay_s: float = 0.0) -> np.ndarray:
    return np.array([spool.step_response(float(t), lag_s, delay_s, DAMPING) for t in t_s])


def tick_response(lag_s: float, tick_s: float, count: int, delay_s: float = 0.0) -> np.ndarray:
    response = np.zeros(count)
    taps.tick_response(response, lag_s, tick_s, delay_s, DAMPING)
    return response


def lead(lag_s: float, tick_s: float, smoothing: float, delay_s: float = 0.0, shift: int = 0) -> np.ndarray:
    found = np.zeros(LEAD_TAPS)
    taps.lead(empty(DESIGN), found, lag_s, tick_s, smoothing, delay_s, shift, DAMPING)
    return found


def crossing_lead(lag_s: float, tick_s: float, delay_s: float = 0.0, shift: int = 0) -> np.ndarray:
    found = np.zeros(LEAD_TAPS)
    taps.crossing_lead(empty(DESIGN), found, lag_s, tick_s, delay_s, shift, DAMPING)
    return found


def crossing_path(lag_s: float, tick_s: float, delay_s: float = 0.0, shift: int = 0) -> np.ndarray:
    path, found = np.zeros(PATH), crossing_lead(lag_s, tick_s, delay_s, shift)
    taps.crossing_path(empty(DESIGN), path, found, lag_s, tick_s, delay_s, shift, DAMPING)
    return path


def damping_filter(
    lag_s: float, tick_s: float, low_Hz: float, high_Hz: float, count: int, delay_s: float = 0.0,
    resonance_Hz: float = 0.0, viscous_share: float = 0.0,
) -> np.ndarray:  # fmt: skip
    settings, found = empty(SETTINGS), np.zeros(count)
    settings.damping_count, settings.tick_s, settings.spool_damping = count, tick_s, DAMPING
    settings.damping_low_Hz, settings.damping_high_Hz = low_Hz, high_Hz
    taps.damping_filter(empty(DESIGN), found, lag_s, delay_s, (resonance_Hz, viscous_share), settings)
    return found


def damped_share(found: np.ndarray, f_Hz: np.ndarray, lag_s: float, tick_s: float, delay_s: float) -> np.ndarray:
    valve = tick_s, lag_s, delay_s, DAMPING
    return np.array([damping_design.damped_share(found, len(found), float(f), valve) for f in f_Hz])
