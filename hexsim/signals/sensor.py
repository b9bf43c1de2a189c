"""A sensor: the signal it gives, what it measures, and the keys of the machine file that say how it errs.

measured = round((g s'(t - T) + b + n) / q) q         g gain, b offset, T delay, n noise, q resolution (0 = none)
tau ds'/dt + s' = s + A sin(2 pi s/L + phase)         tau lag (0 = none), A ripple of the scale (0 = none)
"""

from __future__ import annotations

from dataclasses import dataclass

from hexsim.signals.signal import Signal

ERRORS = {
    "gain": 1.0,
    "offset": 0.0,
    "delay": 0.0,
    "lag": 0.0,
    "noise": 0.0,
    "resolution": 0.0,
}  # and where each vanishes


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A sensor is one file of `hexsim/signals/sensors` that defines SENSOR, or an entry point `hexsim.sensors`.

    signal: what it writes into the log. source: stem of the true signal that it measures.
    ripple: field of the resolved machine that holds the ripple of its scale.
    gain .. resolution: keys of the machine file's [sensors], of the standard sensors only; filter: of its low-pass, there
    as <filter>_Hz and <filter>_order. Any other sensor is on the
    machines that declare it, by a table [extra_sensors.<stem>] with the keys of `extra_keys`, all optional.
    """

    signal: Signal
    source: str
    gain: str = ""
    offset: str = ""
    delay: str = ""
    lag: str = ""
    noise: str = ""
    resolution: str = ""
    filter: str = ""
    ripple: str = ""

    @property
    def extra_keys(self) -> dict[str, str]:
        """Error -> its key of [extra_sensors.<stem>]: gain, offset_<unit>, delay_s, lag_s, noise_<unit>, resolution_<unit>."""
        unit = f"_{self.signal.unit}" if self.signal.unit else ""
        return {error: error + {"gain": "", "delay": "_s", "lag": "_s"}.get(error, unit) for error in ERRORS}
