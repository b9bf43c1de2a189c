"""Errors as the motion computer shows them: one bit each in the host's reply, one sentence each in the log."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag


class Error(IntFlag):
    """Bits of the error word."""

    NONE = 0
    LEG_ERROR = 1
    PRESSURE_LOW = 2
    OIL_HOT = 4
    SENSOR = 8
    HOST_TIMEOUT = 16
    WORKSPACE = 32
    LOAD_SHIFTED = 64
    POWER = 128


LABELS = {
    Error.LEG_ERROR: "leg error too large",
    Error.PRESSURE_LOW: "pressure low",
    Error.OIL_HOT: "oil hot",
    Error.SENSOR: "sensor fault",
    Error.HOST_TIMEOUT: "host timeout",
    Error.WORKSPACE: "workspace",
    Error.LOAD_SHIFTED: "load shifted",
    Error.POWER: "power loss",
}
WARNINGS = Error.WORKSPACE  # shown; the setpoint is limited, without a fault
PUMP_STOPS = Error.LEG_ERROR | Error.PRESSURE_LOW | Error.POWER  # errors at which the pump is stopped at once


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What a monitor found. leg counts from 1; 0 is the machine."""

    error: Error
    leg: int = 0
    detail: str

    @property
    def text(self) -> str:
        return f"{LABELS[self.error]}: {self.detail}"


def labels(errors: Error) -> list[str]:
    """Texts of the bits that are set."""
    return [text for error, text in LABELS.items() if errors & error]
