"""Step 0: is the log of this machine, in these units, and do its sensors agree? No model of the hydraulics."""

from __future__ import annotations

import numpy as np

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.signals.log import Log
from hexsim.signals.table import places, table
from hexsim.signals.units import UNITS
from hexsim.tracing import rules
from hexsim.tracing.balances.controller import is_position_loop
from hexsim.tracing.checks.finding import Finding, loss, notice, refusal
from hexsim.tracing.checks.sensor_agreement import (
    Agreement,
    acceleration_agreement,
    order_that_fits,
    staircase_bias,
    whole_correlation,
)
from hexsim.tracing.checks.swapped import swapped_legs, swapped_pressures

SHORT_s = rules.FEW * rules.REST_BLOCK_S  # shorter logs have too few independent blocks
AGAINST = "the second derivative of the positions"


def check_log(log: Log, machine: Machine) -> list[Finding]:
    """All findings about one log, worst first."""
    if log.n_legs != machine.n_legs:
        return [
            refusal(
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
    """check_log, with its first refusal raised as HexsimError; what the reader dropped, filled or converted follows."""
    found = check_log(log, machine)
    if found and found[0].severity == "refuse":
        raise HexsimError(f"{log.path}: {found[0].description}")
    return [*found, *(notice(channel="", description=sentence) for sentence in log.losses)]


def size_of_log(log: Log, machine: Machine) -> list[Finding]:
    """Rate and length."""
    found = []
    if log.rate < 200.0:  # [Hz] below it valve and oil dynamics (20-110 Hz) cannot be seen
        found.append(
            loss(
                channel="time_s",
                value=log.rate,
                unit="Hz",
                description=f"the log has {log.rate:g} Hz: nothing above {log.rate / 2:g} Hz can be said "
                "(valve and oil dynamics)",
            )
        )
    if log.duration_s < SHORT_s:
        found.append(
            loss(
                channel="time_s",
                value=log.duration_s,
                unit="s",
                description=f"the log lasts {log.duration_s:.1f} s: too short for blocks; effects must be large to be seen",
            )
        )
    return found


# units that a column may have been given in by mistake
WRONG_UNITS = {"m": ("mm", "cm", "in", "um"), "Pa": ("bar", "psi", "kPa", "MPa"), "V": ("mV",), "m_s2": ("mm_s2",)}


def possible_values(machine: Machine) -> dict[str, tuple[float, float, float]]:
    """Signal -> low, high, and the least size of its largest value."""
    L, u = max(machine.of_legs("cylinder", "stroke_m")), max(machine.of_legs("valve", "voltage_max_V"))
    P = machine.supply.pressure_Pa
    return {
        "position": (-0.02 * L, 1.02 * L, 0.02 * L),
        "setpoint": (-0.5 * L, 1.5 * L, 0.02 * L),
        "valve": (-1.05 * u, 1.05 * u, 0.0),
        "pressure_bottom": (-1.2e5, 2.5 * P, 0.01 * P),
        "pressure_supply": (-1.2e5, 2.5 * P, 0.1 * P),
        "acceleration": (-80.0, 80.0, 0.0),
    }


def plausible_values(log: Log, machine: Machine) -> list[Finding]:
    """Each channel inside what this machine can do; else the unit that would explain it is named."""
    found = []
    for stem, limits in possible_values(machine).items():
        for name in log.names(stem):
            x = log.columns[name]
            if not _fits(x, limits):
                found.append(_implausible(log, name, table()[stem].unit, limits))
    return found


def _fits(x: np.ndarray, limits: tuple[float, float, float], factor: float = 1.0) -> bool:
    low, high, least = limits
    bulk = factor * np.quantile(x, [0.005, 0.995])
    return bool(bulk[0] >= low and bulk[1] <= high and np.max(np.abs(bulk)) >= least)


def _implausible(log: Log, name: str, unit: str, limits: tuple[float, float, float]) -> Finding:
    low, high, least = limits
    x = log.columns[name]
    looks = [other for other in WRONG_UNITS[unit] if _fits(x, limits, UNITS[other][0])]
    outside = (x < low) | (x > high)
    beyond = np.quantile(x, 0.005) < low or np.quantile(x, 0.995) > high
    row = int(np.argmax(outside)) if beyond else int(np.argmax(np.abs(x)))
    hint = f"it looks like {looks[0]}: name the unit" if looks else "name unit and offset"
    return refusal(
        channel=name,
        value=float(x[row]),
        unit=unit.replace("_", "/"),
        description=f"column {name} reads {x[row]:.6g} at {log.time[row]:.3f} s, this machine allows {low:.4g} to "
        f"{high:.4g} (at least {least:.4g} in size): {hint} in a mapping file",
    )


def motion(log: Log, machine: Machine) -> list[Finding]:
    """Does it move? And does the valve reach its stop?"""
    found = []
    names = log.names("position")
    noise = max(machine.sensors.position_noise_m, machine.sensors.position_resolution_m, 1e-7)
    travel = max(float(np.ptp(np.quantile(log.columns[name], [0.002, 0.998]))) for name in names)
    if travel < max(50 * noise, 2e-3 * machine.cylinder.stroke_m):
        found.append(
            refusal(
                channel=names[0],
                value=travel,
                unit="m",
                description=f"the machine stands still: positions move by {travel * 1e6:.0f} um; give a log of motion",
            )
        )
    for name in log.names("valve"):
        limit = machine.legs[places()[name][1]].valve.voltage_max_V
        share = float(np.mean(np.abs(log.columns[name]) >= 0.999 * limit))
        if share > 1e-3:
            description = f"column {name} is at its stop of {limit:g} V for {share:.1%} of the time"
            found.append(notice(channel=name, description=description, value=share, unit="1"))
    return found


def controller(log: Log, machine: Machine) -> list[Finding]:
    """u = K (setpoint - position) with one delay: where it breaks, a column is damaged or the controller another.

    Silent where the declared controller is more than a gain.
    """
    found: list[Finding] = []
    if not is_position_loop(machine.controller):
        return found
    hold = max(1, round(log.rate / machine.controller.rate_Hz))
    for leg, setpoint, position, valve in zip(
        machine.legs, *(table()[stem].columns(log.n_legs) for stem in ("setpoint", "position", "valve")), strict=True
    ):
        K, limit = leg.controller.gain_V_per_m, leg.valve.voltage_max_V
        if not all(name in log.columns for name in (setpoint, position, valve)):
            continue
        asked = np.clip(K * (log.columns[setpoint] - log.columns[position]), -limit, limit)
        u = log.columns[valve]
        near = np.full(len(u), np.inf)
        for late in range(2 * hold + 2):  # the valve may hold any of the last samples
            shifted = np.concatenate([np.full(late, asked[0]), asked[: len(u) - late]])
            near = np.minimum(near, np.abs(u - shifted))
        level = float(np.quantile(near, 0.9))
        scale = max(float(np.std(u)), 1e-9)
        if level > 0.1 * scale:
            error = log.columns[setpoint] - log.columns[position]
            gain = float(np.polyfit(error, u, 1)[0])
            if gain < 0.0 and (gain * np.std(error)) ** 2 > 0.5 * scale**2:  # most of it: so no loop holds a position
                sign = (
                    f"column {valve} has the opposite sign of setpoint - position; give factor = -1 in a mapping file"
                )
                found.append(refusal(channel=valve, description=sign, value=gain, unit="V/m"))
                continue
            description = (
                f"column {valve} is not the declared {K:g} V/m times (setpoint - position): slope {gain:.4g} V/m"
            )
            found.append(notice(channel=valve, description=description, value=gain, unit="V/m"))
            continue
        typical = float(np.median(near)) + K * max(machine.sensors.position_noise_m, 1e-6)
        broken = near > max(12 * typical, 0.05 * scale)
        if broken.any():
            row = int(np.argmax(broken))
            found.append(
                loss(
                    channel=valve,
                    value=float(near[row]),
                    unit="V",
                    description=f"{valve}, {setpoint} and {position} do not belong together in {broken.sum()} samples, "
                    f"the first at {log.time[row]:.3f} s ({near[row]:.3g} V off): one of them is damaged there",
                )
            )
    return found


def sensors_against_each_other(log: Log, machine: Machine) -> list[Finding]:
    """The accelerometers against the second derivative of the positions: gain, offset, delay where not 1, 0, 0."""
    try:
        results = acceleration_agreement(log, machine)
        together = log.n_legs == 1 or np.median([result.correlation for result in results.values()] or [1.0]) > 0.9
    except HexsimError:  # positions that belong to no pose
        results, together = {}, False
    legs = None
    if not together:
        legs = order_that_fits(log, machine)
        together = legs is None and whole_correlation(results, machine) > 0.9
    if not together:
        hint = (
            f"legs {legs[0]} and {legs[1]} look swapped" if legs else "other numbers of the legs, or another geometry?"
        )
        description = f"the legs' positions do not belong to the platform's accelerations: {hint}"
        return [refusal(channel="position", description=description)]
    return [
        finding
        for name, result in results.items()
        for finding in agreement_findings(name, result, staircase_bias(machine, log.rate_of(name)), log.rate)
    ]


def agreement_findings(name: str, result: Agreement, bias: float, rate_Hz: float) -> list[Finding]:
    """What the agreement of an accelerometer channel with the positions says about it."""
    angular = name.startswith("angular")
    unit = "rad/s2" if angular else "m/s2"
    if result.correlation < 0.7:
        description = f"{name} does not follow {AGAINST} (correlation {result.correlation:.2f})"
        return [notice(channel=name, description=description, value=result.correlation, unit="1")]
    found = []
    seen = 1.0 / result.gain / (1.0 - bias) if result.gain else np.inf
    for other in ("deg_s2",) if angular else ("g", "mm_s2"):
        if abs(seen * UNITS[other][0] - 1) < 0.2:
            description = f"column {name} is {seen:.3g} times {AGAINST}: it looks like {other.replace('_', '/')}; "
            description += "name its unit in a mapping"
            found.append(refusal(channel=name, description=description, value=seen, unit="1"))
    if seen < 0:
        description = f"column {name} has the opposite sign of {AGAINST}; give factor = -1 in a mapping file"
        found.append(refusal(channel=name, description=description, value=seen, unit="1"))
    if result.correlation < 0.99:
        return found
    if abs(seen - 1) > 3 * result.gain_error + bias / 2 + 0.01:
        description = f"{name} reads {seen:.3f} times {AGAINST} (+-{result.gain_error + bias / 2:.3f})"
        found.append(notice(channel=name, description=description, value=seen, unit="1"))
    if abs(result.delay_s) > 3 * result.delay_error_s + 0.5 / rate_Hz:
        late, error = result.delay_s * 1e3, result.delay_error_s * 1e3
        description = f"{name} is {late:+.1f} ms late against the positions (+-{error:.1f} ms)"
        found.append(notice(channel=name, description=description, value=result.delay_s, unit="s"))
    if abs(result.offset) > 0.05:
        offset = -result.offset * seen
        description = f"{name} has an offset of {offset:+.3f} {unit} against the positions"
        found.append(notice(channel=name, description=description, value=offset, unit=unit))
    return found
