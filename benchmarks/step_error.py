"""Error and speed of the chosen time step over machines: `python benchmarks/step_error.py [--only NAMES] [--speed]`.

Error of a run against the same with a constant step of 20 us, on the platform's true acceleration in the 50 Hz band
after the fade-in, in units of the reference's deviation from the fundamental:
    peak = max |a - a_ref| / max |deviation|        rms = rms(a - a_ref) / rms(deviation)
Sine of 0.05 m (roll: 4 deg) at 0.5 Hz, 2 s of fade-in and two periods, 500 Hz proportional control, log at 1 kHz, ideal
position sensors (with noise an error of 1 nm turns a step of the sensor's resolution here and there: 0.04 % between
20 us and 100 us already). Writes the tables of docs/results/step.md to stdout.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.plant import Plant
from hexsim.scenarios import load_scenario
from hexsim.simulation import Run, TickLoop, simulate
from hexsim.smoothness import band_limit, harmonic_deviation

Array = NDArray[np.float64]
Changes = dict[str, Any]

REFERENCE_S = 2.0e-5
CONSTANT_S = (5.0e-5, 1.0e-4, 2.0e-4, 2.5e-4, 5.0e-4, 1.0e-3)
FADE_S, DURATION_S, FREQUENCY_Hz, EDGE_S = 2.0, 6.0, 0.5, 0.04
QUIET = {"sensors.position_noise_m": 0.0, "sensors.position_resolution_m": 0.0}
LONG_STROKE = str(Path(__file__).parents[1] / "tests" / "data" / "long_stroke")
LIGHT = {
    "load.leg_mass_kg": 3.0,
    "load.platform_mass_kg": 150.0,
    "load.platform_inertia_kg_m2": [15.0, 15.0, 25.0],
}
BRISTLE = {
    "effects.presliding.bristle_stiffness_N_m": 5e6,
    "effects.presliding.bristle_damping_N_s_m": 500.0,
}
MACHINES: dict[str, tuple[str, Changes]] = {
    "default": ("micro_motion_system", {}),
    "bench 40 kg": ("bench", {}),
    "bench 10 kg": ("bench", {"load.moving_mass_kg": 10.0}),
    "1 m stroke": (LONG_STROKE, {}),
    "overlap 20 um": ("micro_motion_system", {"valve.overlap_m": 2e-5}),
    "light, 150 kg": ("micro_motion_system", LIGHT),
    "power unit": ("micro_motion_system", {"power_unit": {}}),
    "presliding": ("micro_motion_system", BRISTLE),
    "rod side chamber": ("micro_motion_system", {"cylinder.rod_side": "chamber"}),
    "sharp friction": ("micro_motion_system", {"friction.sharpness_m_s": 2e-5}),
}


def drawn(seed: int) -> tuple[str, Changes]:
    """A machine at random: odd seeds a bench, even ones a hexapod."""
    draw = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return math.exp(draw.uniform(math.log(low), math.log(high)))

    friction, share = load_machine("bench").friction, between(0.3, 3.0)
    changes: Changes = {
        "oil.bulk_modulus_Pa": float(draw.uniform(0.8e9, 1.7e9)),
        "oil.density_kg_m3": float(draw.uniform(840.0, 880.0)),
        "valve.overlap_m": float(draw.uniform(0.0, 3e-5)),
        "valve.edge_rounding_m": float(max(0.0, draw.uniform(-2e-6, 4e-6))),
        "valve.spool_frequency_Hz": between(30.0, 200.0),
        "valve.spool_damping": float(draw.uniform(0.4, 1.0)),
        "friction.sharpness_m_s": between(1e-4, 1e-3),
        "cylinder.pipeline_volume_m3": between(5e-7, 1e-4),
        "controller.gain_V_per_m": float(draw.uniform(20.0, 60.0)),
    }
    for kind in ("viscous", "coulomb", "static"):
        for way in ("extend", "retract"):
            name = f"{kind}_{way}_{'N_s_m' if kind == 'viscous' else 'N'}"
            changes[f"friction.{name}"] = share * getattr(friction, name)
    if seed % 2:
        return "bench", changes | {"load.moving_mass_kg": between(20.0, 300.0)}
    mass = between(150.0, 1000.0)
    inertia = [0.1 * mass, 0.1 * mass, 0.17 * mass]
    legs = {"load.platform_mass_kg": mass, "load.leg_mass_kg": between(3.0, 30.0)}
    return "micro_motion_system", changes | legs | {"load.platform_inertia_kg_m2": inertia}


def machines(seeds: range) -> dict[str, Machine]:
    """The named machines and the drawn ones, with ideal position sensors."""
    every = MACHINES | {f"random {seed}": drawn(seed) for seed in seeds}
    return {name: changed(load_machine(base), {**QUIET, **changes}) for name, (base, changes) in every.items()}


def acceleration(run: Run, motion: str) -> tuple[Array, Array]:
    """Time and the driven axis' true acceleration."""
    name = {"heave": "true_acceleration_z_m_s2", "roll": "true_angular_acceleration_x_rad_s2"}[motion]
    name = name if run.machine.is_hexapod else "true_acceleration_m_s2"
    return run.log["time_s"].to_numpy(), run.log[name].to_numpy()


def errors(run: Run, reference: Run, motion: str) -> tuple[float, float]:
    """(peak, rms) error as defined above; infinite for a run that diverged."""
    if not run.complete:
        return np.inf, np.inf
    (t, found), (_, true) = acceleration(run, motion), acceleration(reference, motion)
    judged = (t >= FADE_S) & (t <= t[-1] - EDGE_S)
    difference = (band_limit(t, found) - band_limit(t, true))[judged]
    deviation = harmonic_deviation(t, true, FREQUENCY_Hz, start_s=FADE_S).band
    return float(np.abs(difference).max() / np.abs(deviation).max()), float(np.std(difference) / np.std(deviation))


def error_row(name: str, machine: Machine, motion: str, constant: bool) -> str:
    """A row of the table of errors [%]."""
    scenario = load_scenario(motion, duration_s=DURATION_S)
    reference = simulate(machine, scenario, fast=True, timestep=REFERENCE_S)
    chosen = simulate(machine, scenario, fast=True)
    peak, rms = errors(chosen, reference, motion)
    mean, least = (1e6 * chosen.summary[f"timestep_{which}_s"] for which in ("mean", "shortest"))
    cells = [name, motion, f"{100 * peak:.3f}", f"{100 * rms:.3f}", f"{mean:.0f}", f"{least:.0f}"]
    for step in CONSTANT_S if constant else ():
        error = errors(simulate(machine, scenario, fast=True, timestep=step), reference, motion)[0]
        cells.append(f"{100 * error:.2g}" if np.isfinite(error) else "-")
    return f"| {' | '.join(cells)} |"


def asks(machine: Machine) -> str:
    """A row of the table of what limits the step."""
    plant = Plant(machine, model="tendon" if machine.is_hexapod else "full")
    rule = plant.step_rule()
    capacity = 0.5 * machine.cylinder.stroke_m * machine.cylinder.area_bottom_m2 + machine.cylinder.pipeline_volume_m3
    oil = math.sqrt(rule.springs * machine.oil.bulk_modulus_Pa / capacity)
    spool = 2 * math.pi * machine.valve.spool_frequency_Hz
    return f"{oil:.0f} | {spool:.0f} | {2.2 * rule.standstill:.0f} | {1e6 / rule.standstill:.0f}"


def run_time(machine: Machine, model: str, timestep: float | None) -> float:
    """CPU time [s] of a heave of 6 s, everything but the set-up."""
    plant = Plant(machine, model=model, timestep=timestep)  # type: ignore[arg-type]
    loop = TickLoop(plant, PositionLoop(machine, [], None), load_scenario("heave", duration_s=6.0), 0)
    start = time.process_time()
    loop.go(lambda fraction: None, ())
    return time.process_time() - start


def speeds(repeats: int) -> list[str]:
    """Rows of speed: simulated seconds a second of CPU time, and the ratio to 100 us, in turn."""
    rows, machine = [], load_machine("micro_motion_system")
    for model in ("full", "tendon"):
        times = np.array([[run_time(machine, model, step) for step in (None, 1e-4)] for _ in range(repeats)])
        chosen, constant = times.min(axis=0)
        rows.append(f"| {model} | {6.0 / chosen:.1f} | {6.0 / constant:.1f} | {constant / chosen:.1f} |")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description="Error of the chosen time step over machines, and its speed")
    parser.add_argument("--only", default="", help="names of machines, separated by commas")
    parser.add_argument("--constant", action="store_true", help="also constant steps")
    parser.add_argument("--speed", action="store_true", help="also speeds against 100 us")
    parser.add_argument("--seeds", type=int, default=4, help="how many machines to draw")
    arguments = parser.parse_args()
    wanted = [name for name in arguments.only.split(",") if name]
    fixed = [f"{1e6 * step:.0f} us" for step in CONSTANT_S] if arguments.constant else []
    head = ["machine", "motion", "peak [%]", "rms [%]", "mean step [us]", "shortest [us]", *fixed]
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    chosen = {n: m for n, m in machines(range(1, arguments.seeds + 1)).items() if not wanted or n in wanted}
    for name, machine in chosen.items():
        for motion in ("heave", "roll") if machine.is_hexapod else ("heave",):
            print(error_row(name, machine, motion, arguments.constant and motion == "heave"), flush=True)
    print(
        "\n| machine | oil [rad/s] | spool [rad/s] | friction [1/s] | step at standstill [us] |\n|---|---|---|---|---|"
    )
    for name, machine in chosen.items():
        print(f"| {name} | {asks(machine)} |")
    if arguments.speed:
        print("\n| model | chosen: simulated s per CPU s | 100 us | ratio |\n|---|---|---|---|")
        print("\n".join(speeds(5)))


if __name__ == "__main__":
    main()
