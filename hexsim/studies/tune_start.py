"""Start parameters of a compensator, learned on the simulated twin of a machine: `hexsim tune`.

The twin makes the half-hertz heave of the field and learns from nothing. What it knows then goes into `compensator.json`,
which `run`, `compare` and `serve` take in place of a compensator's name. A second run on the same twin, with other sensor
noise, starts with it: what the machine is to give from its second reversal on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from compensation.compensator import Parameters
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.files.json_files import write_json
from hexsim.motion_computer.limits import pose_limits
from hexsim.recording.felt import driven_bumps
from hexsim.recording.signals import Signals
from hexsim.scenarios.scenario import DOF_NAMES, Scenario, scenario_from_dict
from hexsim.simulation import Run, simulate

FILE = "compensator.json"
FREQUENCY_Hz = 0.5  # of the field's test


@dataclass(frozen=True, kw_only=True)
class Taught:
    """learned: start parameters, an entry a leg. started_m_s2, plain_m_s2: (time, bump peak to peak in 50 Hz) at each
    reversal of a run that starts with them, and of plain control."""

    compensator: str
    learned: list[Parameters]
    started_m_s2: list[tuple[float, float]]
    plain_m_s2: list[tuple[float, float]]

    @property
    def second_m_s2(self) -> float:
        return self.started_m_s2[1][1]

    @property
    def final_m_s2(self) -> float:
        """Mean of the last four bumps."""
        return float(np.mean([bump for _, bump in self.started_m_s2[-4:]]))

    def to_json(self) -> dict[str, Any]:
        return {
            "compensator": self.compensator,
            "legs": self.learned,
            "started_m_s2": self.started_m_s2,
            "plain_m_s2": self.plain_m_s2,
            "second_m_s2": self.second_m_s2,
            "final_m_s2": self.final_m_s2,
        }


def half_hertz_sine(
    machine: Machine,
    *,
    amplitude_m: float = 0.05,  # of the field's test
    within: float = 0.9,  # of the excursion that the limits leave
) -> dict[str, Any]:
    """The signal of the field's test: 0.05 m at 0.5 Hz, or what the limits leave, along z of a platform or on a bench's leg."""
    reach = pose_limits(machine).excursion[DOF_NAMES.index("z") if machine.is_hexapod else 0]
    return {"kind": "sine", "amplitude": min(amplitude_m, within * float(reach)), "frequency_Hz": FREQUENCY_Hz}


def heave(
    machine: Machine,
    duration_s: float,
    *,
    fade_s: float = 2.0,  # from rest to the full sine
) -> Scenario:
    """The half-hertz sine, faded in."""
    axes = {"z": half_hertz_sine(machine)}
    return scenario_from_dict(
        {"name": "heave", "mode": "dof", "duration_s": duration_s, "fade_s": fade_s, "axes": axes}
    )


def simulate_twin(
    machine: Machine, scenario: Scenario, compensator: str, progress: Callable[[float], None], seed: int = 0
) -> Run:
    """A complete run of the twin, a hexapod with tendons. Raises HexsimError where it cannot be simulated to its end."""
    done = simulate(machine, scenario, compensator=compensator, fast=machine.is_hexapod, seed=seed, progress=progress)
    return done.whole(f"the twin of {machine.name} cannot be simulated")


def teach(
    machine: Machine,
    folder: Path,
    compensator: str = "adaptive",
    progress: Callable[[float], None] = lambda share: None,
    *,
    learning_s: float = 30.0,  # 15 periods
    verifying_s: float = 12.0,  # 6 periods
) -> Taught:
    """Learn on the twin, write `compensator.json` into the folder, then run with it and without. progress(share).

    Raises HexsimError where the algorithm learns nothing or the twin cannot be simulated.
    """

    def run(which: str, duration_s: float, seed: int, begin: float, end: float) -> Run:
        return simulate_twin(
            machine, heave(machine, duration_s), which, lambda share: progress(begin + share * (end - begin)), seed
        )

    learned = run(compensator, learning_s, 0, 0.0, 0.6).compensator_parameters
    if not any(learned):
        raise HexsimError(f"compensator {compensator} learns nothing: give adaptive or repetitive")
    place = folder / FILE
    write_json(place, {"compensator": compensator, "legs": learned})
    started, plain = (
        [(one.time_s, one.bump_pp) for one in driven_bumps(Signals.of_run(run(which, verifying_s, 1, begin, end)))]
        for which, begin, end in ((str(place), 0.6, 0.9), ("none", 0.9, 1.0))
    )
    taught = Taught(compensator=compensator, learned=learned, started_m_s2=started, plain_m_s2=plain)
    write_json(place, taught.to_json())
    return taught
