"""Writes docs/log_columns.md from the table of signals: python docs/log_columns.py"""

from __future__ import annotations

from pathlib import Path

from hexsim.signals.signal import Signal
from hexsim.signals.table import table

HEAD = """# Columns of a log

Which columns does a log have, and what do they mean? Simulated logs, measured logs and
[mappings](bring_your_own_machine.md#3-mappingtoml) have the same names.

- `time_s` comes first. Names end with the SI unit; pressures are gauge.
- Names are a bench's, whose axis is its leg. A hexapod has `position_1_m` to `position_6_m`, `acceleration_x_m_s2` (`y`, `z`) and poses
  as `platform_x_m` (`y`, `z`, `roll`, `pitch`, `yaw`). Names marked * are a hexapod's alone.
- Positions count from full retraction. Accelerations are without gravity, in the platform's frame.
- Positions are required in a measured log. Columns of the truth are without noise, delay and filter.

"""
SCOPES = {"leg": "leg", "machine": "machine", "translation": "axis", "rotation": "axis", "pose": "pose"}


def rows(signals: list[Signal]) -> str:
    """A table of columns."""
    lines = ["| column | what | one for each |", "|---|---|---|"]
    for signal in signals:
        own = "".join(f"`{name}`" for name in signal.columns(1)[:1]) or f"`{signal.columns(6)[0]}`*"
        held = ", held between ticks" if signal.held and signal.stem in ("setpoint", "valve") else ""
        lines.append(f"| {own} | {signal.label}{held} | {SCOPES[signal.scope]} |")
    return "\n".join(lines)


def page() -> str:
    """The page's text."""
    signals = list(table().values())
    measured, truth = ([one for one in signals if one.measured == seen] for seen in (True, False))
    return f"{HEAD}## Measured\n{rows(measured)}\n\n## Truth of a simulation\n{rows(truth)}\n"


if __name__ == "__main__":
    Path(__file__).with_suffix(".md").write_text(page(), encoding="utf-8")
