"""What the picture of a signature may be drawn over: the signals of a report, their rates, and the motion itself."""

from __future__ import annotations

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import Log
from hexsim.signals.table import accelerations_of
from hexsim.signals.weak_form import Window
from hexsim.tracing import rules
from hexsim.tracing.balances import Balance
from hexsim.tracing.balances.platform import shown_accelerations
from hexsim.tracing.report.signals import SIGNALS
from hexsim.tracing.steps.residuals import kept, signals_of

Array = np.ndarray
AXES = SIGNALS | {
    "acceleration_x_m_s2": ("acceleration along x", 1.0, "m/s²"),
    "acceleration_y_m_s2": ("acceleration along y", 1.0, "m/s²"),
    "acceleration_z_m_s2": ("acceleration along z", 1.0, "m/s²"),
    "angular_acceleration_x_rad_s2": ("roll acceleration", 1.0, "rad/s²"),
    "angular_acceleration_y_rad_s2": ("pitch acceleration", 1.0, "rad/s²"),
    "angular_acceleration_z_rad_s2": ("yaw acceleration", 1.0, "rad/s²"),
    "jerk_m_s3": ("rate of the acceleration", 1.0, "m/s³"),
    "valve_rate_V_s": ("rate of the valve voltage", 1.0, "V/s"),
    "pressure_bottom_rate_Pa_s": ("rate of the chamber pressure", 1e-5, "bar/s"),
    "pressure_top_rate_Pa_s": ("rate of the rod side pressure", 1e-5, "bar/s"),
    "frequency_Hz": ("frequency of the motion", 1.0, "Hz"),
    "travel_m": ("travel since the reversal", 1e6, "µm"),
}
RATES = ("jerk_m_s3", "valve_rate_V_s", "pressure_bottom_rate_Pa_s", "pressure_top_rate_Pa_s")


def picture_signals(log: Log, machine: Machine, where: str) -> tuple[dict[str, Array], Array]:
    """Signals of a place at the samples that count, and the velocity of its leg; of a platform what it feels, and the time."""
    found, v = signals_of(log, machine, where)
    window, at = Window(log.rate), kept(log)
    if where.startswith("platform"):
        rows = dict(zip(accelerations_of(6), shown_accelerations(log, machine), strict=True))
        return {name: window.mean(row)[at] for name, row in rows.items()} | {"time_s": found["time_s"]}, v
    leg = int(where.split()[1]) - 1 if where.startswith("leg") else 0
    top = log.signal("pressure_top")
    if top is not None:
        found["pressure_top_Pa"] = window.mean(top[leg])[at]
        found["pressure_difference_Pa"] = found["pressure_bottom_Pa"] - found["pressure_top_Pa"]
    channels = {"jerk_m_s3": log.acceleration, "valve_rate_V_s": log.volts, "pressure_bottom_rate_Pa_s": log.pressure}
    channels["pressure_top_rate_Pa_s"] = top
    for name, rows in channels.items():
        if rows is not None:
            found[name] = window.rate(rows[leg if len(rows) == log.n_legs else -1])[at]
    return found, v


def chosen_signal(balance: Balance, signals: dict[str, Array], residual: Array) -> str:
    """Over which the residual is drawn: of the balance's own signals the first whose curve explains as much of it as any, of
    a platform's all; a rate where it explains more."""
    own = [name for name in balance.signals if name in signals]
    if "angular_acceleration_x_rad_s2" in signals:
        own = list(signals)
    shares = {name: explained(signals[name], residual) for name in [*own, *(name for name in RATES if name in signals)]}
    if residual.var() < rules.TELLABLE * np.mean(residual**2) and max(shares.values()) < rules.MAIN:
        return balance.usual_signal if balance.usual_signal in signals else own[0]
    best = max(shares[name] for name in own)
    first = next(name for name in own if shares[name] > best - rules.SLIGHT)
    quickest = max(shares, key=lambda name: shares[name])
    return quickest if shares[quickest] > best + rules.SLIGHT else first


def explained(x: Array, y: Array) -> float:
    """R2 of the curve of y over x in 30 bins."""
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, 31)))
    if len(edges) < 4:
        return 0.0
    place = np.clip(np.searchsorted(edges, x) - 1, 0, len(edges) - 2)
    mean = np.bincount(place, y, minlength=len(edges)) / np.maximum(np.bincount(place, minlength=len(edges)), 1)
    return 1.0 - float(np.var(y - mean[place])) / max(float(np.var(y)), 1e-300)


def travel_since_reversal(y: Array, v: Array) -> Array:
    """How far the piston has gone since it last turned, (n,)."""
    turned = np.concatenate([[True], np.signbit(v[1:]) != np.signbit(v[:-1])])
    return np.abs(y - y[np.maximum.accumulate(np.where(turned, np.arange(len(v)), 0))])
