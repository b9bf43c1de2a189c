"""A sensor: the signal it gives, what it measures, and the keys of the machine file that say how it errs.

measured = round((g s(t - T) + b + n) / q) q          g gain, b offset, T delay, n noise, q resolution (0 = none)
"""

from __future__ import annotations

from dataclasses import dataclass

from hexsim.signals.signal import Signal


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A sensor is one file of `hexsim/signals/sensors` that defines SENSOR, or an entry point `hexsim.sensors`.

    signal: what it writes into the log. source: stem of the true signal that it measures.
    noise .. delay: keys of the machine file's [sensors]; an empty one has no such error.
    declared_apart: not every machine has it; where [extra_sensors.<stem>] stands in the machine file it is there, with
    the keys noise_<unit>, resolution_<unit>, gain, offset_<unit> and delay_s, all optional.
    """

    signal: Signal
    source: str
    noise: str = ""
    resolution: str = ""
    gain: str = ""
    offset: str = ""
    delay: str = ""

    @property
    def declared_apart(self) -> bool:
        return not self.noise

    @property
    def extra_keys(self) -> dict[str, str]:
        """Error -> its key of [extra_sensors.<stem>]."""
        unit = f"_{self.signal.unit}" if self.signal.unit else ""
        return {
            "noise": f"noise{unit}",
            "resolution": f"resolution{unit}",
            "gain": "gain",
            "offset": f"offset{unit}",
            "delay": "delay_s",
        }
