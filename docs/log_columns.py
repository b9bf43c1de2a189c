"""Writes docs/log_columns.md from the table of signals: python docs/log_columns.py"""

from __future__ import annotations

from pathlib import Path

from hexsim.signals.signal import Signal
from hexsim.signals.table import table

HEAD = """# Columns of a log

*Which columns does a log of hexsim have, and what do they mean?* The same names stand in a log that `hexsim run` writes, in a measured
log that `hexsim trace` reads, and on the left side of a [mapping](bring_your_own_machine.md#3-mappingtoml). One row is one sample.

- `time_s` comes first. All values are in SI units, which stand at the end of the name; pressures are gauge.
- A bench has one leg: `position_m`. A hexapod has six: `position_1_m` to `position_6_m`.
- Positions count from full retraction of the piston. Accelerations are without gravity, along the axes of the platform's frame.
- A measured log may lack any column but the positions. What a transducer reads has its noise, delay and filter in it; columns of the
  truth, which only a simulation knows, have none.

"""
SCOPES = {
    "leg": "of each leg",
    "machine": "of the machine",
    "translation": "along x, y, z; of a bench along its leg",
    "rotation": "about x, y, z, hexapods",
    "pose": "x, y, z, roll, pitch, yaw from neutral, hexapods",
}


def rows(signals: list[Signal]) -> str:
    """A table of columns."""
    lines = ["| bench | hexapod | unit | what | |", "|---|---|---|---|---|"]
    for signal in signals:
        six = signal.columns(6)
        shown = f"`{six[0]}`" + (f" .. `{six[-1]}`" if len(six) > 1 else "")
        own = "".join(f"`{name}`" for name in signal.columns(1)[:1]) or "none"
        unit = (
            signal.unit.replace("m_s2", "m/s2").replace("rad_s", "rad/s").replace("m_s", "m/s").replace("m3_s", "m3/s")
        )
        held = "; held between ticks" if signal.held and signal.stem in ("setpoint", "valve") else ""
        lines.append(f"| {own} | {shown} | {unit or '1'} | {signal.label}{held} | {SCOPES[signal.scope]} |")
    return "\n".join(lines)


def page() -> str:
    """The page's text."""
    signals = list(table().values())
    measured, truth = ([one for one in signals if one.measured == seen] for seen in (True, False))
    return f"{HEAD}## Measured\n{rows(measured)}\n\n## Truth of a simulation\n{rows(truth)}\n"


if __name__ == "__main__":
    Path(__file__).with_suffix(".md").write_text(page(), encoding="utf-8")
