"""The 600 kg hexapod with its numbers drawn: hexsim's own machine and motion computer, heave, a compensator by name.

Drawn as of the family `reality` where a machine file has the number: spool, damping, overlap, rounding, hysteresis, null, friction,
Stribeck, oil, load, gain, noises. Not in a machine file, thus not drawn: counts of the volts, the spool's third order, a bent gain.
Declared `right`: the compensator is given the drawn machine's sheet; `sheet`: each number off by its stated uncertainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.grid.figures import Figures, figures_of
from benchmarks.grid.legs import SHEET
from benchmarks.grid.motions import Motion, sine
from compensation import Context, create
from compensation.compensator import Wrapped
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import load_scenario
from hexsim.simulation import Run, simulate

MACHINE, SCENARIO, DURATION_S = "micro_motion_system", "heave", 28.0
COLUMN = "true_acceleration_z_m_s2"
FIELDS = {  # of a context, and the row of SHEET that says how far it is off
    "spool_frequency_Hz": "spool",
    "spool_damping": "damping",
    "position_noise_m": "position noise",
    "edge_V": "edge",
    "pressure_noise_Pa": "pressure noise",
    "stribeck_velocity_m_s": "stribeck",
    "velocity_gain_m_s_V": "velocity gain",
    "supply_pressure_Pa": "supply",
    "pipeline_volume_m3": "pipeline",
}


@dataclass(frozen=True)
class Told(Wrapped):
    """A compensator whose data sheets are off by factors (field, factor)."""

    off: tuple[tuple[str, float], ...] = ()

    def start(self, context: Context) -> Any:
        return self.inner.start(
            replace(context, **{name: getattr(context, name) * factor for name, factor in self.off})
        )


def drawn_machine(seed: int) -> tuple[dict[str, Any], tuple[tuple[str, float], ...]]:
    """Changes to the machine file, and how far off a sheet is."""
    random = np.random.default_rng([seed, 43])

    def uniform(low: float, high: float) -> float:
        return float(random.uniform(low, high))

    def orders(low: float, high: float) -> float:
        return math.exp(uniform(math.log(low), math.log(high)))

    machine = load_machine(MACHINE)
    rubs, load = orders(0.5, 3.0), uniform(0.75, 1.6)
    changes: dict[str, Any] = {
        "valve.spool_frequency_Hz": orders(30.0, 150.0),
        "valve.spool_damping": uniform(0.4, 1.2),
        "valve.overlap_m": uniform(0.0, 2e-5),
        "valve.edge_rounding_m": orders(5e-7, 5e-6),
        "valve.hysteresis_percent": uniform(0.0, 0.6),
        "valve.null_shift_percent": uniform(-1.0, 1.0),
        "friction.stribeck_velocity_m_s": orders(2e-3, 1.5e-2),
        "oil.bulk_modulus_Pa": uniform(0.75e9, 1.65e9),
        "controller.gain_V_per_m": orders(25.0, 100.0),
        "sensors.position_noise_m": orders(1e-6, 1e-5),
        "sensors.pressure_noise_Pa": orders(2e3, 3e4),
        "load.platform_mass_kg": 600.0 * load,
        "load.platform_inertia_kg_m2": [load * x for x in machine.load.platform_inertia_kg_m2 or ()],
    }
    for kind, unit in (("viscous", "N_s_m"), ("coulomb", "N"), ("static", "N")):
        for way in ("extend", "retract"):
            name = f"{kind}_{way}_{unit}"
            changes[f"friction.{name}"] = rubs * getattr(machine.friction, name)
    shares = {name: SHEET[row] * uniform(-1.0, 1.0) for name, row in FIELDS.items()}
    return changes, tuple((name, math.exp(share)) for name, share in shares.items())


def run_platform(seed: int, compensator: str, declared: str, noise: int = 0) -> Run:
    """One run of the drawn hexapod."""
    changes, off = drawn_machine(seed)
    made = create(compensator)
    told = made if declared == "right" or compensator == "none" else Told(made, off)
    scenario = load_scenario(SCENARIO, duration_s=DURATION_S)
    return simulate(
        changed(load_machine(MACHINE), changes), scenario, compensator=told, fast=True, seed=2 * seed + noise
    )


def accelerated(run: Run) -> np.ndarray:
    """True acceleration in heave every 1e-4 s, as the figures want it."""
    t = run.log["time_s"].to_numpy()
    return np.interp(np.arange(round(DURATION_S * 1e4)) * 1e-4, t, run.log[COLUMN].to_numpy())


def judged_platform(seed: int, compensator: str, declared: str) -> tuple[Figures, str, dict[str, Any]]:
    """Figures of a draw, what keeps legs out, and the draw."""
    motion: Motion = sine(seed)
    runs = [run_platform(seed, name, declared, noise) for name, noise in ((compensator, 0), ("none", 0), ("none", 1))]
    legs = runs[0].summary.get("compensation", [])
    engaged = [leg["engaged_at_s"] for leg in legs if leg["engaged"]]
    reason = "; ".join(f"leg {leg['leg']}: {leg['reason']}" for leg in legs if leg["reason"])
    last_s = max(engaged) if len(engaged) == len(legs) > 0 else None
    added = np.any([runs[0].log[f"compensation_{k}_V"].to_numpy() != 0.0 for k in range(1, 7)], axis=0)
    first_s = float(runs[0].log["time_s"].to_numpy()[added].min(initial=math.inf))
    found = figures_of([accelerated(run) for run in runs], motion, last_s, first_s)
    return found, reason, drawn_machine(seed)[0]
