"""Logs read, checked and made a problem: where a trace begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hexsim.errors import HexsimError
from hexsim.machine import Machine, load_machine
from hexsim.machine.files import changed, find_machine_file
from hexsim.readers import log_files, read_stretches
from hexsim.signals.channels import measured_noise, noise_of
from hexsim.signals.log import Log
from hexsim.tracing import rules
from hexsim.tracing.balances.controller import ALIKE, loops_of, reads_another_transducer
from hexsim.tracing.checks.checks import refuse_misleading
from hexsim.tracing.checks.finding import Finding, loss
from hexsim.tracing.checks.imu import at_origin
from hexsim.tracing.checks.same_machine import check_same_machine
from hexsim.tracing.fitting.fit import start_fit
from hexsim.tracing.fitting.parameters import priors
from hexsim.tracing.fitting.selection import Search
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.simulation.rig import DECLARED_LOOP, LOGGED_VOLTS, OWN_TRANSDUCER
from hexsim.tracing.state import Trace

DRIVEN = {
    DECLARED_LOOP: "the declared loop's setpoints drive",
    LOGGED_VOLTS: "the logged volts drive",
    OWN_TRANSDUCER: "the declared loop's setpoints, its position read by a transducer that is not logged, drive",
}


def read_runs(
    folder: Path, names: Sequence[str], machine: Machine, loaded: Sequence[str] = (), mapping: Path | None = None
) -> tuple[list[Log], dict[str, list[Finding]]]:
    """Read and check the named logs. Each stretch between long gaps is a run that begins with states of its own.

    loaded: names of logs with the additional mass on the machine.
    """
    logs: list[Log] = []
    for name in names:
        parts = [
            replace(part, loaded=name in loaded) for part in read_stretches(log_files(folder, name), mapping, machine)
        ]
        parts = [part for k, part in enumerate(parts) if k == 0 or part.duration_s >= rules.REST_BLOCK_S]
        logs += [
            one if k == 0 else replace(one, name=f"{one.name} from {one.offset_s:.1f} s") for k, one in enumerate(parts)
        ]
    if machine.cylinder.rod_side != "valve":  # no transducer: what a simulation writes there is the truth
        logs = [replace(log, pressure_top=None) for log in logs]
    logs = [at_origin(log, machine) for log in logs]
    return logs, {log.name: refuse_misleading(log, machine) for log in logs}


def feedback_of(machine: Machine, logs: Sequence[Log], noise: dict[str, float]) -> int:
    """What gives the volts (`simulation.rig.Controller`): the declared loop, whatever its gain and computing delay, on the
    logged position or on a transducer of its own; the logged volts where another controller was at work."""
    own = [reads_another_transducer(log, machine) for log in logs]
    if any(another_controller(machine, log, noise) for log, there in zip(logs, own, strict=True) if not there):
        return LOGGED_VOLTS
    return OWN_TRANSDUCER if any(own) else DECLARED_LOOP


def another_controller(machine: Machine, log: Log, noise: dict[str, float]) -> bool:
    """Are the volts of a log those of no position loop?"""
    if log.setpoint is None:
        return True
    if log.volts is None:
        return False
    K = machine.of_legs("controller", "gain_V_per_m")[:, None]
    limit = machine.of_legs("valve", "voltage_max_V")[:, None]
    asked = np.clip(K * (log.setpoint - log.position), -limit, limit)
    off = np.median(np.abs(log.volts - asked)[:, ticks_of(machine, log)])
    another = off > rules.CERTAIN * K.max() * noise["position_m"] and off > ALIKE * np.std(log.volts)
    return bool(another) and loops_of(log, machine) is None


def ticks_of(machine: Machine, log: Log) -> slice:
    """Samples of a log at the controller's ticks."""
    every = max(round(log.rate / machine.controller.rate_Hz), 1)
    return slice(log.tick_phase(every), None, every)


def misses_ticks(machine: Machine, log: Log) -> bool:
    """Does a log show less than every tick of the controller?"""
    return log.rate < 0.95 * machine.controller.rate_Hz  # clocks differ by less


def shown_share(
    machine: Machine,
    logs: Sequence[Log],
    noise: dict[str, float],
    *,
    shown: float = 0.1,  # least share: twice what the estimate of a log of 5 s, 2,500 ticks, is off by
    late_ticks: int = 3,  # of logged volts: a computer's and a logger's tick, and one to spare
) -> float:
    """Share of the position's noise that the logged volts show, in their variance, 0 to 1: it moved the machine.

    1: the volts are those of the logged samples. 0: the controller read others, or the log lacks setpoints, volts or ticks.
    """
    shares, K = [], machine.of_legs("controller", "gain_V_per_m")
    for log in logs:
        if log.setpoint is None or log.volts is None or misses_ticks(machine, log):
            return 0.0
        ticks = ticks_of(machine, log)
        for gain, s, y, u in zip(K, log.setpoint[:, ticks], log.position[:, ticks], log.volts[:, ticks], strict=True):
            asked, n = gain * (s - y), len(u) - late_ticks
            off = min(measured_noise(u[k:][:n] - asked[:n]) for k in range(late_ticks + 1)) / gain
            shares.append(1.0 - (off / max(measured_noise(y), noise["position_m"])) ** 2)
    share = float(np.clip(np.mean(shares), 0.0, 1.0))
    return share if share > shown else 0.0


def refuse_same_logs(folder: Path, fit: Sequence[str], validate: Sequence[str]) -> None:
    """A log that everything is fitted on says nothing about motion that no fit has seen."""
    fitted = {log_files(folder, name).resolve() for name in fit}
    for name in validate:
        if log_files(folder, name).resolve() in fitted:
            raise HexsimError(
                f"log {name} is given to fit and to validate: judge on another motion that no fit has seen"
            )


def refuse_undriven(logs: Sequence[Log], feedback: int) -> None:
    """A model needs the setpoints of its loop or the valve's volts."""
    for log in logs:
        if feedback == LOGGED_VOLTS and log.volts is None:
            raise HexsimError(
                f"log {log.name} has no valve_V, and setpoints of the declared loop are missing: nothing drives the model, "
                "so that nothing can be said about the machine; log the valve's volts or the setpoint"
            )


def with_additional_mass(machine: Machine, load_kg: float | None, loaded: Sequence[str]) -> Machine:
    """The machine with what people can put on it [kg], known to half a percent where its file does not say how well."""
    key = "additional_mass_kg"
    if load_kg is not None:
        machine = changed(machine, {f"load.{key}": load_kg})
    if machine.load.additional_mass_kg is None:
        if loaded:
            raise HexsimError(f"log {loaded[0]} has a load on: say what it weighs, load_kg or {key} in [load]")
        return machine
    return changed(machine, {f"uncertainty.{key}": machine.uncertainty.get(key, rules.KNOWN)})


def slower_than_controller(logs: Sequence[Log], machine: Machine) -> list[Finding]:
    """That logs show less than every tick of the controller, and what cannot be said then."""
    rate_Hz = float(machine.controller.rate_Hz)
    slow = [log for log in logs if misses_ticks(machine, log)]
    if not slow:
        return []
    names, slowest = " and ".join(log.name for log in slow), min(log.rate for log in slow)
    description = (
        f"{names}: {slowest:.4g} Hz is slower than the controller of {rate_Hz:.4g} Hz: what it does between samples is simulated "
        f"and not seen, a delay of less than {1e3 / slowest:.3g} ms and what is faster than {0.5 * slowest:.4g} Hz cannot be told; log "
        "at the controller's rate or faster"
    )
    return [loss(channel="time_s", description=description)]


def begin(
    machine_folder: Path | str,
    fit: Sequence[str],
    validate: Sequence[str],
    load_kg: float | None = None,
    loaded: Sequence[str] = (),
    mapping: Path | None = None,
) -> Trace:
    """The first state of a trace: the declared machine, nothing fitted. HexsimError for logs that cannot be used.

    load_kg: what people can put on the machine; loaded: logs that were taken with it. mapping: of the columns
    of all logs; default mapping.toml beside each.
    """
    if not fit or not validate:
        raise HexsimError("tracing needs at least one log to fit and one held-out log to validate: give both")
    unknown = set(loaded) - {*fit, *validate}
    if unknown:
        raise HexsimError(f"log {min(unknown)} is said to have a load on and is not traced: give it to fit or validate")
    folder = find_machine_file(machine_folder).parent
    machine = with_additional_mass(load_machine(machine_folder), load_kg, loaded)
    refuse_same_logs(folder, fit, validate)
    fit_logs, findings = read_runs(folder, fit, machine, loaded, mapping)
    held_out_logs, more = read_runs(folder, validate, machine, loaded, mapping)
    findings |= more
    findings["all logs"] = [
        *check_same_machine([*fit_logs, *held_out_logs], machine),
        *slower_than_controller([*fit_logs, *held_out_logs], machine),
    ]
    noise = noise_of(machine, fit_logs)
    feedback = feedback_of(machine, [*fit_logs, *held_out_logs], noise)
    refuse_undriven([*fit_logs, *held_out_logs], feedback)
    share = shown_share(machine, [*fit_logs, *held_out_logs], noise)
    problem = SimulatedProblem(logs=tuple(fit_logs), noise=noise, feedback=feedback, shown=share)
    base = start_fit(machine, priors(machine), problem)
    if not np.isfinite(base.chi2):  # of the declared machine its user is told why it cannot be built
        for i in range(len(fit_logs)):
            problem.simulated_or_refused(machine, i)
    count = sum(len(found) for found in findings.values())
    driven = DRIVEN[feedback]
    return Trace(
        machine=machine,
        fit_problem=problem,
        validate_problem=replace(problem, logs=tuple(held_out_logs)),
        findings=findings,
        base=base,
        final=base,
        search=Search(base=base, best=base),
        decided=f"{len(fit_logs)} to fit, {len(held_out_logs)} held out, {count} findings; {driven} the model",
    )
