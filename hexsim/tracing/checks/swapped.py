"""Channels of two legs exchanged: setpoints, pressures."""

from __future__ import annotations

import numpy as np

from hexsim.declaration import Machine
from hexsim.hydraulics.parameters import declared_rows
from hexsim.signals.log import Log
from hexsim.signals.table import accelerations_of
from hexsim.signals.weak_form import Window
from hexsim.tracing.checks.finding import Finding, refusal
from hexsim.tracing.friction.stribeck import curve
from hexsim.tracing.leg_loads import leg_loads, oil_forces


def swapped_legs(log: Log) -> list[Finding]:
    """Does each leg's position follow its own setpoint? Undecided where two legs move alike."""
    positions, setpoints = log.names("position"), log.names("setpoint")
    if log.n_legs < 2 or len(positions) != len(setpoints):
        return []
    found = []
    y, r = (np.stack([log.columns[name] for name in names]) for names in (positions, setpoints))
    apart = np.sqrt(np.mean((y[:, None] - r[None]) ** 2, axis=-1))
    for leg in range(len(y)):
        best = int(np.argmin(apart[leg]))
        if best != leg and apart[leg, best] < 0.5 * apart[leg, leg]:
            found.append(
                refusal(
                    channel=positions[leg],
                    description=f"{positions[leg]} follows {setpoints[best]} ({apart[leg, best] * 1e3:.2f} mm rms) "
                    f"rather than {setpoints[leg]} ({apart[leg, leg] * 1e3:.2f} mm): "
                    f"legs {leg + 1} and {best + 1} look swapped",
                )
            )
    return found


def swapped_pressures(log: Log, machine: Machine) -> list[Finding]:
    """Is the supply above the chambers that it feeds, and does each leg's pressure carry its own leg's load? The latter is
    undecided where two legs are loaded alike (pure heave)."""
    pressures, supply = log.names("pressure_bottom"), log.columns.get("pressure_supply_Pa")
    for name in pressures:
        if supply is not None and name in log.columns and np.median(log.columns[name] - supply) > 0.0:
            sentence = f"{name} is above pressure_supply_Pa for most of the time, which feeds it: they look swapped"
            return [refusal(channel=name, description=sentence)]
    oil = oil_forces(log, machine)
    if log.n_legs < 2 or oil is None or not all(name in log.columns for name in accelerations_of(6)):
        return []
    look = Window(log.rate)
    load, _ = leg_loads(log, machine)
    rows = declared_rows(machine)[:1].repeat(2, axis=0)
    speed = [look.rate(log.columns[name]) for name in log.names("position")]
    asked = look.mean(load + np.stack([curve(rows, v) for v in speed]))
    rest = look.mean(oil)[:, None] - asked[None]
    apart = np.std(rest[..., look.half : rest.shape[-1] - look.half], axis=-1)
    found = []
    for leg in range(6):
        best = int(np.argmin(apart[leg]))
        if best != leg and apart[leg, best] < 0.6 * apart[leg, leg]:
            description = (
                f"{pressures[leg]} carries the load of leg {best + 1} (rest {apart[leg, best]:.0f} N) rather than "
            )
            description += f"its own ({apart[leg, leg]:.0f} N): pressures of legs {leg + 1} and {best + 1} look swapped"
            found.append(refusal(channel=pressures[leg], description=description))
    return found
