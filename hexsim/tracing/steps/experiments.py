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
from hexsim.tracing import rules
from hexsim.tracing.attempt import attempted
from hexsim.tracing.design.motions import MotionFamily, setpoint_log
from hexsim.tracing.fitting.fit import Fit
from hexsim.tracing.problems.simulated import SimulatedProblem
from hexsim.tracing.state import Step, Tell, Trace

Array = np.ndarray
MOTIONS = 2 * rules.FEW  # two of each kind nearly, and a power of 2 as the family asks


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
    """Candidate motions inside the limits of this machine; none where none can be made."""
    family = MotionFamily(machine, rules.MOTION_S)
    found = attempted(lambda: [family.scenario(point) for point in family.first_points(MOTIONS)]) or []
    return [tables for tables in found if tables is not None]


def separation(first: Machine, second: Machine, noise: dict[str, float], tables: dict[str, Any]) -> float:
    """chi2 between the answers of two machines to a scenario; 0 where one of them cannot take it."""
    return attempted(lambda: _separation(first, second, noise, tables)) or 0.0


def _separation(first: Machine, second: Machine, noise: dict[str, float], tables: dict[str, Any]) -> float:
    problem = SimulatedProblem(logs=(setpoint_log(first, tables),), noise=noise)
    changes = tables.get("machine", {})
    misfit = problem.misfit([changed(machine, changes) if changes else machine for machine in (first, second)])[0]
    finite = np.isfinite(misfit).all()
    return float(np.sum((misfit[0] - misfit[1]) ** 2)) if finite else 0.0


def experiment_for(first: Fit, second: Fit, names: tuple[str, str], noise: dict[str, float]) -> Experiment | None:
    """The best of the motions, with the load as it is, or heavier where that is needed: an incline grows with the mass, a
    constant force does not. None where there is no motion."""
    carried = first.machine.load
    a, b, plain = first.fitted_machine(), second.fitted_machine(), motions(first.machine)
    best: tuple[float, dict[str, Any]] = (-1.0, {})
    for change in ({}, {"machine": {f"load.{carried.mass_key}": rules.HEAVIER * carried.carried_mass_kg}}):
        if best[0] < 4 * rules.SIGNIFICANT:
            tried = [(separation(a, b, noise, tables | change), tables | change) for tables in plain]
            best = max([best, *tried], key=lambda item: item[0])
    if not best[1]:
        return None
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
            if found is None:
                continue
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
