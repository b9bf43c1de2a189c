"""Do several logs come from one machine?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hexsim.declaration import Machine
from hexsim.signals.log import Log
from hexsim.tracing.checks.finding import Finding, notice, refusal
from hexsim.tracing.leg_loads import oil_forces

NOTICED, REFUSED = 0.08, 0.3  # difference between logs of one machine, by the declared supply or weight


def check_same_machine(logs: Sequence[Log], machine: Machine) -> list[Finding]:
    """Do several logs come from one machine? Another kind, or a supply or load that differs by a quarter, is refused.

    Of a log with the additional mass on the machine, its weight is taken off.

    Smaller differences may be effects (a supply that droops, friction that depends on the direction): noticed.
    """
    found = []
    first = logs[0]
    gravity, extra = machine.machine.gravity_m_s2, machine.load.additional_mass_kg or 0.0
    weight = machine.load.carried_mass_kg * gravity
    for other in logs[1:]:
        if other.n_legs != first.n_legs:
            kinds = f"log {first.name} is of a {first.kind}, log {other.name} of a {other.kind}"
            return [refusal(channel="position", description=f"{kinds}: give logs of one machine")]
        supply = [None if log.supply is None else float(np.median(log.supply)) for log in (first, other)]
        carried = [(log, carried_force(log, machine)) for log in (first, other)]
        force = [None if own is None else own - log.loaded * extra * gravity for log, own in carried]
        for channel, (a, b), scale, what, factor, unit in (
            ("pressure_supply_Pa", supply, machine.supply.pressure_Pa, "the supply has", 1e-5, "bar"),
            ("pressure_bottom_Pa", force, weight, "the legs carry", 1.0, "N"),
        ):
            if a is None or b is None or abs(a - b) <= NOTICED * scale:
                continue
            description = (
                f"{what} {a * factor:.4g} {unit} in log {first.name} and {b * factor:.4g} {unit} in {other.name}"
            )
            severity = "refuse" if abs(a - b) > REFUSED * scale else "notice"
            description += ": two machines, or another load?" if severity == "refuse" else ""
            found.append(Finding(severity=severity, channel=channel, description=description, value=b - a))
        if abs(other.rate - first.rate) > 0.01 * first.rate:
            description = f"log {first.name} has {first.rate:g} Hz, log {other.name} {other.rate:g} Hz"
            found.append(notice(channel="time_s", description=description, value=other.rate, unit="Hz"))
    return found


def carried_force(log: Log, machine: Machine) -> float | None:
    """Mean of P1 A1 - P2 A2, summed over the legs [N]: the load, as motion up and down cancels."""
    oil = oil_forces(log, machine)
    return None if oil is None else float(np.mean(oil, axis=1).sum())
