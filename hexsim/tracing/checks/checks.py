"""Step 0: is the log of this machine, in these units, and do its sensors agree? No model of the hydraulics.

Each finding is a sentence with its channel and number. "refuse": tracing would mislead; "loss": something cannot be
said; "notice": worth knowing (a sensor's gain or delay is an effect of its own and is named by the tracer, not here).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.hydraulics.parameters import declared_rows
from hexsim.signals.log import Log
from hexsim.signals.weak_form import Window
from hexsim.tracing.checks.sensor_agreement import acceleration_agreement, leg_columns, order_that_fits, staircase_bias
from hexsim.tracing.friction.identification import curve
from hexsim.tracing.leg_loads import accelerations_of, leg_loads

NOTICED, REFUSED = 0.08, 0.3  # difference between logs of one machine, by the declared supply or weight
SLOW_Hz = 200.0  # below this rate valve and oil dynamics (20-110 Hz) cannot be seen
SHORT_s = 8.0  # shorter logs have too few independent samples for blocks


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One sentence about a log. value: the number it turns on, in `unit`."""

    severity: Literal["refuse", "loss", "notice"]
    channel: str
    description: str
    value: float | None = None
    unit: str = ""


def check_log(log: Log, machine: Machine) -> list[Finding]:
    """All findings about one log, worst first."""
    if log.n_legs != machine.n_legs:
        return [
            Finding(
                severity="refuse",
                channel="position",
                description=f"log {log.name} is of a {log.kind}, machine {machine.name} is a {machine.machine.kind}: "
                "give the log of this machine",
            )
        ]
    found = [*size_of_log(log, machine), *plausible_values(log, machine)]
    if not any(finding.severity == "refuse" for finding in found):
        found += [*motion(log, machine), *controller(log, machine), *swapped_legs(log)]
    if not any(finding.severity == "refuse" for finding in found):
        found += sensors_against_each_other(log, machine)
    if not any(finding.severity == "refuse" for finding in found):
        found += swapped_pressures(log, machine)
    order = ("refuse", "loss", "notice")
    return sorted(found, key=lambda finding: order.index(finding.severity))


def refuse_misleading(log: Log, machine: Machine) -> list[Finding]:
    """check_log, with its first refusal raised as HexsimError."""
    found = check_log(log, machine)
    if found and found[0].severity == "refuse":
        raise HexsimError(f"{log.path}: {found[0].description}")
    return found


def size_of_log(log: Log, machine: Machine) -> list[Finding]:
    """Rate and length."""
    found = []
    if log.rate < SLOW_Hz:
        found.append(
            Finding(
                severity="loss",
                channel="time_s",
                value=log.rate,
                unit="Hz",
                description=f"the log has {log.rate:g} Hz: nothing above {log.rate / 2:g} Hz can be said "
                "(valve and oil dynamics)",
            )
        )
    if log.duration_s < SHORT_s:
        found.append(
            Finding(
                severity="loss",
                channel="time_s",
                value=log.duration_s,
                unit="s",
                description=f"the log lasts {log.duration_s:.1f} s: too short for blocks; effects must be large to be seen",
            )
        )
    return found


# factor that would bring a column into its range, by unit it may have been given in
WRONG_UNITS: dict[str, dict[str, float]] = {
    "m": {"mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "um": 1e-6},
    "Pa": {"bar": 1e5, "psi": 6894.757, "kPa": 1e3, "MPa": 1e6},
    "V": {"mV": 1e-3},
    "m_s2": {"mm/s2": 1e-3},
}


def plausible_values(log: Log, machine: Machine) -> list[Finding]:
    """Each channel inside what this machine can do; else the unit that would explain it is named."""
    L, P, u = machine.cylinder.stroke_m, machine.supply.pressure_Pa, machine.valve.voltage_max_V
    ranges: list[tuple[str, str, float, float, float]] = [  # stem, unit, low, high, least size of the largest value
        ("position", "m", -0.02 * L, 1.02 * L, 0.02 * L),
        ("setpoint", "m", -0.5 * L, 1.5 * L, 0.02 * L),
        ("valve", "V", -1.05 * u, 1.05 * u, 0.0),
        ("pressure_bottom", "Pa", -1.2e5, 2.5 * P, 0.01 * P),
    ]
    channels = [
        (name, unit, low, high, least)
        for stem, unit, low, high, least in ranges
        for name in leg_columns(log, stem, unit)
    ]
    channels += [("pressure_supply_Pa", "Pa", -1.2e5, 2.5 * P, 0.1 * P)] if "pressure_supply_Pa" in log.columns else []
    channels += [(name, "m_s2", -80.0, 80.0, 0.0) for name in log.columns if name.startswith("acceleration")]
    found = []
    for name, unit, low, high, least in channels:
        x = log.columns[name]
        bulk = np.quantile(x, [0.005, 0.995])
        if bulk[0] >= low and bulk[1] <= high and np.max(np.abs(bulk)) >= least:
            continue
        guess = [
            other
            for other, factor in WRONG_UNITS[unit].items()
            if low <= bulk[0] * factor
            and bulk[1] * factor <= high
            and np.max(np.abs(bulk)) * factor >= max(least, 0.1 * low)
        ]
        row = int(np.argmax((x < low) | (x > high))) if bulk[0] < low or bulk[1] > high else int(np.argmax(np.abs(x)))
        hint = (
            f"it looks like {guess[0]}: name the unit in a mapping file"
            if guess
            else "name unit and offset in a mapping file"
        )
        found.append(
            Finding(
                severity="refuse",
                channel=name,
                value=float(x[row]),
                unit=unit.replace("_", "/"),
                description=f"column {name} reads {x[row]:.6g} at {log.time[row]:.3f} s, this machine "
                f"allows {low:.4g} to {high:.4g} "
                f"(at least {least:.4g} in size): {hint}",
            )
        )
    return found


def motion(log: Log, machine: Machine) -> list[Finding]:
    """Does it move? And does the valve reach its stop?"""
    found = []
    names = leg_columns(log, "position", "m")
    noise = max(machine.sensors.position_noise_m, machine.sensors.position_resolution_m, 1e-7)
    travel = max(float(np.ptp(np.quantile(log.columns[name], [0.002, 0.998]))) for name in names)
    if travel < max(50 * noise, 2e-3 * machine.cylinder.stroke_m):
        found.append(
            Finding(
                severity="refuse",
                channel=names[0],
                value=travel,
                unit="m",
                description=f"the machine stands still: positions move by {travel * 1e6:.0f} um; give a log of motion",
            )
        )
    limit = machine.valve.voltage_max_V
    for name in leg_columns(log, "valve", "V"):
        share = float(np.mean(np.abs(log.columns[name]) >= 0.999 * limit))
        if share > 1e-3:
            description = f"column {name} is at its stop of {limit:g} V for {share:.1%} of the time"
            found.append(Finding(severity="notice", channel=name, description=description, value=share, unit="1"))
    return found


def controller(log: Log, machine: Machine) -> list[Finding]:
    """u = K (setpoint - position) with one delay: where it breaks, a column is damaged or the controller another."""
    found = []
    K, limit = machine.controller.gain_V_per_m, machine.valve.voltage_max_V
    hold = max(1, round(log.rate / machine.controller.rate_Hz))
    for setpoint, position, valve in leg_channels(log):
        asked = np.clip(K * (log.columns[setpoint] - log.columns[position]), -limit, limit)
        u = log.columns[valve]
        near = np.full(len(u), np.inf)
        for late in range(2 * hold + 2):  # the valve may hold any of the last samples
            shifted = np.concatenate([np.full(late, asked[0]), asked[: len(u) - late]])
            near = np.minimum(near, np.abs(u - shifted))
        level = float(np.quantile(near, 0.9))
        scale = max(float(np.std(u)), 1e-9)
        if level > 0.1 * scale:
            gain = float(np.polyfit(log.columns[setpoint] - log.columns[position], u, 1)[0])
            description = (
                f"column {valve} is not the declared {K:g} V/m times (setpoint - position): slope {gain:.4g} V/m"
            )
            found.append(Finding(severity="notice", channel=valve, description=description, value=gain, unit="V/m"))
            continue
        typical = float(np.median(near)) + K * max(machine.sensors.position_noise_m, 1e-6)
        broken = near > max(12 * typical, 0.05 * scale)
        if broken.any():
            row = int(np.argmax(broken))
            found.append(
                Finding(
                    severity="loss",
                    channel=valve,
                    value=float(near[row]),
                    unit="V",
                    description=f"{valve}, {setpoint} and {position} do not belong together in {broken.sum()} samples, "
                    f"the first at {log.time[row]:.3f} s ({near[row]:.3g} V off): one of them is damaged there",
                )
            )
    return found


def leg_channels(log: Log) -> list[tuple[str, str, str]]:
    """(setpoint, position, valve) of the legs that have all three."""
    marks = [""] if log.n_legs == 1 else [f"_{leg}" for leg in range(1, log.n_legs + 1)]
    triples = [(f"setpoint{mark}_m", f"position{mark}_m", f"valve{mark}_V") for mark in marks]
    return [triple for triple in triples if all(name in log.columns for name in triple)]


def swapped_legs(log: Log) -> list[Finding]:
    """Does each leg's position follow its own setpoint? Undecided where two legs move alike."""
    positions, setpoints = leg_columns(log, "position", "m"), leg_columns(log, "setpoint", "m")
    if log.n_legs < 2 or len(positions) != len(setpoints):
        return []
    found = []
    y = np.stack([log.columns[name] for name in positions])
    r = np.stack([log.columns[name] for name in setpoints])
    apart = np.sqrt(np.mean((y[:, None] - r[None]) ** 2, axis=-1))
    for leg in range(len(y)):
        best = int(np.argmin(apart[leg]))
        if best != leg and apart[leg, best] < 0.5 * apart[leg, leg]:
            found.append(
                Finding(
                    severity="refuse",
                    channel=positions[leg],
                    description=f"{positions[leg]} follows {setpoints[best]} ({apart[leg, best] * 1e3:.2f} mm rms) "
                    f"rather than {setpoints[leg]} ({apart[leg, leg] * 1e3:.2f} mm): "
                    f"legs {leg + 1} and {best + 1} look swapped",
                )
            )
    return found


def swapped_pressures(log: Log, machine: Machine) -> list[Finding]:
    """Does each leg's pressure carry its own leg's load? Undecided where two legs are loaded alike (pure heave)."""
    pressures = leg_columns(log, "pressure_bottom", "Pa")
    need = ["pressure_supply_Pa", *accelerations_of(6)]
    if log.n_legs < 2 or len(pressures) != 6 or not all(name in log.columns for name in need):
        return []
    A1, A2 = machine.cylinder.area_bottom_m2, machine.cylinder.area_top_m2
    supply = log.columns["pressure_supply_Pa"]
    oil = np.stack([log.columns[name] * A1 - supply * A2 for name in pressures])
    look = Window(log.rate)
    load, _ = leg_loads(log, machine)
    rows = declared_rows(machine)[:1].repeat(2, axis=0)
    speed = [look.rate(log.columns[name]) for name in leg_columns(log, "position", "m")]
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
            found.append(Finding(severity="refuse", channel=pressures[leg], description=description))
    return found


def sensors_against_each_other(log: Log, machine: Machine) -> list[Finding]:
    """The accelerometer against the second derivative of the positions: gain, offset, delay where not 1, 0, 0."""
    found = []
    bias = staircase_bias(machine, log.rate)
    try:
        results = acceleration_agreement(log, machine)
        together = log.n_legs == 1 or np.median([result.correlation for result in results.values()] or [1.0]) > 0.9
    except HexsimError:  # positions that belong to no pose
        results, together = {}, False
    if not together:
        legs = order_that_fits(log, machine)
        description = "the legs' positions do not belong to the platform's accelerations"
        description += (
            f": legs {legs[0]} and {legs[1]} look swapped"
            if legs
            else ": other numbers of the legs, or another geometry?"
        )
        return [Finding(severity="refuse", channel="position", description=description)]
    for name, result in results.items():
        unit = "rad/s2" if name.startswith("angular") else "m/s2"
        seen = 1.0 / result.gain / (1.0 - bias) if result.gain else np.inf
        against = "the second derivative of the positions"
        if result.correlation < 0.7:
            description = f"{name} does not follow {against} (correlation {result.correlation:.2f})"
            found.append(
                Finding(severity="notice", channel=name, description=description, value=result.correlation, unit="1")
            )
            continue
        wrong = {"deg/s2": 57.296} if unit == "rad/s2" else {"g": 1 / 9.80665, "mm/s2": 1e3}
        for other, factor in wrong.items():
            if abs(seen / factor - 1) < 0.2:
                description = (
                    f"column {name} is {seen:.3g} times {against}: it looks like {other}; name its unit in a mapping"
                )
                found.append(Finding(severity="refuse", channel=name, description=description, value=seen, unit="1"))
        if seen < 0:
            description = f"column {name} has the opposite sign of {against}; give factor = -1 in a mapping file"
            found.append(Finding(severity="refuse", channel=name, description=description, value=seen, unit="1"))
        if result.correlation < 0.99:
            continue
        if abs(seen - 1) > 3 * result.gain_error + bias / 2 + 0.01:
            description = f"{name} reads {seen:.3f} times {against} (+-{result.gain_error + bias / 2:.3f})"
            found.append(Finding(severity="notice", channel=name, description=description, value=seen, unit="1"))
        if abs(result.delay_s) > 3 * result.delay_error_s + 0.5 / log.rate:
            late, error = result.delay_s * 1e3, result.delay_error_s * 1e3
            description = f"{name} is {late:+.1f} ms late against the positions (+-{error:.1f} ms)"
            found.append(
                Finding(severity="notice", channel=name, description=description, value=result.delay_s, unit="s")
            )
        if abs(result.offset) > 0.05:
            description = f"{name} has an offset of {-result.offset * seen:+.3f} {unit} against the positions"
            found.append(
                Finding(
                    severity="notice", channel=name, description=description, value=-result.offset * seen, unit=unit
                )
            )
    return found


def check_same_machine(logs: Sequence[Log], machine: Machine) -> list[Finding]:
    """Do several logs come from one machine? Another kind, or a supply or load that differs by a quarter, is refused.

    Smaller differences may be effects (a supply that droops, friction that depends on the direction): noticed.
    """
    found = []
    first = logs[0]
    weight = (machine.load.moving_mass_kg or machine.load.platform_mass_kg or 0.0) * machine.machine.gravity_m_s2
    for other in logs[1:]:
        if other.n_legs != first.n_legs:
            kinds = f"log {first.name} is of a {first.kind}, log {other.name} of a {other.kind}"
            return [Finding(severity="refuse", channel="position", description=f"{kinds}: give logs of one machine")]
        supply = [median_supply(log) for log in (first, other)]
        force = [carried_force(log, machine) for log in (first, other)]
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
            found.append(
                Finding(severity="notice", channel="time_s", description=description, value=other.rate, unit="Hz")
            )
    return found


def median_supply(log: Log) -> float | None:
    """Supply pressure [Pa] of most of the run."""
    return float(np.median(log.columns["pressure_supply_Pa"])) if "pressure_supply_Pa" in log.columns else None


def carried_force(log: Log, machine: Machine) -> float | None:
    """Mean of P1 A1 - Ps A2, summed over the legs [N]: the load, as motion up and down cancels."""
    pressures = leg_columns(log, "pressure_bottom", "Pa")
    if len(pressures) != log.n_legs or "pressure_supply_Pa" not in log.columns:
        return None
    A1, A2 = machine.cylinder.area_bottom_m2, machine.cylinder.area_top_m2
    supply = float(np.mean(log.columns["pressure_supply_Pa"]))
    return sum(float(np.mean(log.columns[name])) * A1 - supply * A2 for name in pressures)
