"""The experiment that would separate a tie: of a few motions, the one in which the tied models differ most.

Every member of a tie is a fitted machine. Both are simulated in each candidate motion; what counts is

    separation = sum ((answer_A - answer_B)/noise)^2

over all channels. Where no motion separates them, the same motion with another load may: an incline grows with the
mass, a constant force does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import tomli_w

from hexsim.declaration import Machine
from hexsim.machine.files import changed
from hexsim.machine.geometry import machine_kinematics
from hexsim.scenarios.scenario import scenario_from_dict
from hexsim.signals.log import Log
from hexsim.tracing import rules
from hexsim.tracing.attempt import attempted
from hexsim.tracing.fitting.fit import Fit
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import Step, Tell, Trace

Array = np.ndarray
RATE_Hz = 1000.0
HEAVIER = 1.5  # load of the heavier variant


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A motion that separates two effects: scenario tables, chi2 it would give, and what is changed on the machine."""

    effects: tuple[str, str]
    separation: float
    tables: dict[str, Any]

    @property
    def file_name(self) -> str:
        return f"separate_{self.effects[0]}_from_{self.effects[1]}.toml".replace(" ", "_")

    def text(self) -> str:
        return tomli_w.dumps(self.tables)


def motions(machine: Machine) -> list[dict[str, Any]]:
    """Candidate motions as scenario tables, for the stroke of this machine."""
    half = machine.cylinder.stroke_m / 2
    sines = [
        {"kind": "sine", "amplitude": 0.5 * half, "frequency_Hz": 0.5},
        {"kind": "sine", "amplitude": 0.8 * half, "frequency_Hz": 0.1},
        {"kind": "sine", "amplitude": 0.1 * half, "frequency_Hz": 3.0},
        {"kind": "sweep", "amplitude": 0.2 * half, "start_Hz": 0.2, "end_Hz": 8.0, "duration_s": 20.0, "law": "log"},
        {
            "kind": "multisine",
            "amplitudes": [0.3 * half, 0.15 * half, 0.08 * half, 0.03 * half],
            "frequencies_Hz": [0.17, 0.53, 1.3, 3.7],
            "seed": 1,
        },
    ]
    return [scenario_tables(machine, signal) for signal in sines]


def scenario_tables(machine: Machine, signal: dict[str, Any]) -> dict[str, Any]:
    """One signal as a scenario of 20 s: along z of a platform, on the leg of a bench."""
    axis = "z" if machine.is_hexapod else "leg_1"
    return {
        "name": "separate",
        "mode": "dof" if machine.is_hexapod else "actuator",
        "machine_name": machine.name,
        "duration_s": 20.0,
        "fade_s": 2.0,
        "fade": "smooth",
        "axes": {axis: signal},
    }


def setpoint_log(machine: Machine, tables: dict[str, Any], rate_Hz: float = RATE_Hz) -> Log:
    """An empty log with the scenario's setpoints, as a problem for the simulation."""
    scenario = scenario_from_dict(tables)
    time = np.arange(int(scenario.duration_s * rate_Hz)) / rate_Hz
    every = max(round(rate_Hz / machine.controller.rate_Hz), 1)
    held = time[(np.arange(len(time)) // every) * every]
    value = scenario.evaluate(held)[0]
    if machine.is_hexapod:
        setpoint = machine_kinematics(machine).piston_positions(value).T.copy()
    else:
        setpoint = value[:, 0][None] + machine.mechanics.neutral_positions[:, None]
    zeros = np.zeros_like(setpoint)
    axes = np.zeros((3 if machine.is_hexapod else 1, len(time)))
    return Log(
        name="experiment",
        kind=machine.machine.kind,
        time=time,
        rate=rate_Hz,
        setpoint=setpoint,
        position=setpoint.copy(),
        volts=zeros,
        pressure=zeros,
        pressure_top=zeros if machine.cylinder.rod_side == "valve" else None,
        supply=np.zeros(len(time)),
        acceleration=axes,
        angular=axes if machine.is_hexapod else None,
    )


def separation(first: Machine, second: Machine, noise: dict[str, float], tables: dict[str, Any]) -> float:
    """chi2 between the answers of two machines to a scenario; 0 where one of them cannot take it."""
    return attempted(lambda: _separation(first, second, noise, tables)) or 0.0


def _separation(first: Machine, second: Machine, noise: dict[str, float], tables: dict[str, Any]) -> float:
    problem = SimulatedProblem(logs=(setpoint_log(first, tables),), noise=noise)
    changes = tables.get("machine", {})
    misfit = problem.misfit([changed(machine, changes) if changes else machine for machine in (first, second)])[0]
    finite = np.isfinite(misfit).all()
    return float(np.sum((misfit[0] - misfit[1]) ** 2)) if finite else 0.0


def heavier_load(machine: Machine) -> dict[str, float]:
    """What a person may change where no motion separates: an incline grows with the mass, a constant force does not."""
    return {f"load.{machine.load.mass_key}": HEAVIER * machine.load.carried_mass_kg}


def experiment_for(first: Fit, second: Fit, names: tuple[str, str], noise: dict[str, float]) -> Experiment:
    """The best of the motions, with the load as it is, or heavier where that is needed."""
    a, b, machine = first.fitted_machine(), second.fitted_machine(), first.machine
    tried = [(separation(a, b, noise, tables), tables) for tables in motions(machine)]
    best = max(tried, key=lambda item: item[0])
    if best[0] < 4 * rules.TIE_CHI2:
        heavier = [tables | {"machine": heavier_load(machine)} for tables in motions(machine)]
        best = max([best, *((separation(a, b, noise, tables), tables) for tables in heavier)], key=lambda item: item[0])
    tables = dict(best[1])
    tables["name"] = f"separate-{names[0]}-from-{names[1]}".replace("_", "-").replace(" ", "-")
    load = " with a heavier load" if "machine" in tables else ""
    tables["description"] = f"motion{load} in which {names[0]} and {names[1]} differ most (chi2 {best[0]:.0f})"
    return Experiment(effects=names, separation=best[0], tables=tables)


def plan_experiments(trace: Trace, tell: Tell) -> Trace:
    """For every tie the motion that would separate it, as a scenario file; none for what is one term."""
    entries, scenarios = [], {}
    for effect, tied in zip(trace.effects, trace.ties, strict=True):
        for label in sorted(set(tied) & set(effect.apart)):
            rival = tied[label]
            names = (effect.candidate.label, label)
            found = experiment_for(trace.final, rival, names, trace.fit_problem.noise)
            scenarios[found.file_name] = found.text()
            words = found.tables["description"]
            entries.append(
                {
                    "effects": list(names),
                    "file": found.file_name,
                    "description": words[0].upper() + words[1:],
                    "chi2": found.separation,
                }
            )
    decided = ", ".join(scenarios) or "not needed: no tie"
    return replace(trace, experiments=entries, scenarios=scenarios, decided=decided)


STEP = Step(name="experiments", doing="motions that would separate ties", share=0.02, run=plan_experiments)
