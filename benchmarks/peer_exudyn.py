"""The same hexapod in Exudyn and in hexsim, timed at equal acceleration error: `python benchmarks/peer_exudyn.py`.

Machine: rigid platform on six massless hydraulic legs, ideal sensors, spools that follow at once, 500 Hz proportional
control, heave of 0.05 m at 0.5 Hz; both log once a control tick. hexsim runs its tendon model as `hexsim run --fast`
does, logging every state; Exudyn runs `exudyn_hexapod`, logging one velocity.

Error of a setting (integrator, time step), against the same tool's own converged solution, on the platform's vertical
acceleration in the 50 Hz band, after the fade-in, in units of the peak deviation from the fundamental:
    wave = max |a - a_ref| / peak(a_ref)          peak = | peak(a) / peak(a_ref) - 1 |
wave bounds the error of every peak; a setting is good when wave <= ERROR_LIMIT. Time: CPU time of the process (both
tools use one thread, and the machine may be shared), the settings in turn, the least of the repeats.
docs/results/tools.md has the result.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from exudyn_hexapod import exudyn_run, load_exudyn
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from hexsim.declaration import Machine
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer.position_loop import PositionLoop
from hexsim.plant import Plant
from hexsim.scenarios import Scenario, load_scenario
from hexsim.simulation import TickLoop
from hexsim.smoothness import band_limit, harmonic_deviation

Array = NDArray[np.float64]
Run = Callable[[], Array]  # one simulation; the platform's vertical velocity (n,) [m/s] every LOG_STEP_S

DURATION_S = 4.0  # fade-in, then one period that is judged
FADE_S = 2.0
FREQUENCY_Hz = 0.5
LOG_STEP_S = 2.0e-3
ERROR_LIMIT = 0.001
TEN_kHz = 1.0e-4  # [s]
STEPS_S = (2.0e-3, 1.0e-3, 2.0e-3 / 3, 5.0e-4, 2.5e-4, 2.0e-4, TEN_kHz)
REFERENCE_STEP_S = 2.0e-5
REFERENCE = {"hexsim": "rk4", "Exudyn": "RK44"}
SCHEMES = {
    "hexsim": ("rk4",),
    "Exudyn": ("ExplicitEuler", "ExplicitMidpoint", "RK33", "RK44", "RK67"),
}
SLOWER_SCHEMES = ("VelocityVerlet", "DOPRI5", "TrapezoidalIndex2", "GeneralizedAlpha")  # of Exudyn, with --all
CHOSEN = 0.0  # in place of a step: hexsim chooses it
LEADERS = 3  # settings of each tool that are timed with care
COMMON = {
    "load.leg_mass_kg": 0.0,
    "valve.spool_frequency_Hz": 0.0,
    "sensors.position_noise_m": 0.0,
    "sensors.position_resolution_m": 0.0,
    "sensors.log_rate_Hz": 1.0 / LOG_STEP_S,
}


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A tool with its integrator and time step."""

    tool: str
    scheme: str
    step_s: float


@dataclass(frozen=True, kw_only=True)
class Error:
    """Error of a setting's acceleration, relative to the peak deviation; infinite for a run that failed."""

    wave: float = np.inf
    peak: float = np.inf

    @property
    def good(self) -> bool:
        return self.wave <= ERROR_LIMIT


@dataclass(frozen=True, kw_only=True)
class Result:
    """What a setting costs: error, and simulated seconds a second of CPU time, the best of `timings` runs."""

    setting: Setting
    error: Error
    speed: float
    timings: int = 1


def common_machine() -> Machine:
    """The 600 kg machine without what Exudyn's model has not: leg mass, spool dynamics, sensor noise."""
    return changed(load_machine("micro_motion_system"), COMMON)


def hexsim_run(machine: Machine, scenario: Scenario, step_s: float) -> Run:
    """A function that runs the scenario whole: reset, setpoints, control, hydraulics and the log of all states."""
    plant = Plant(machine, model="tendon", timestep=None if step_s == CHOSEN else step_s)

    def go() -> Array:
        plant.reset()
        loop = TickLoop(plant, PositionLoop(plant.machine, [], None), scenario, 0)
        stopped = loop.go(lambda fraction: None, ())
        if stopped:
            raise RuntimeError(stopped)
        return loop.record.qvel[:, 2]

    return go


def make_run(setting: Setting, duration_s: float = DURATION_S) -> Run:
    """The simulation of a setting, ready to run any number of times."""
    machine, scenario = common_machine(), load_scenario("heave", duration_s=duration_s)
    if setting.tool == "hexsim":
        return hexsim_run(machine, scenario, setting.step_s)
    return exudyn_run(machine, scenario, setting.scheme, setting.step_s, LOG_STEP_S)


@cache
def reference(tool: str) -> Array:
    """The tool's own converged velocity (n,)."""
    return make_run(Setting(tool=tool, scheme=REFERENCE[tool], step_s=REFERENCE_STEP_S))()


def acceleration(velocity: Array) -> tuple[Array, Array]:
    """Middle (n - 1,) [s] and mean acceleration (n - 1,) [m/s2] of each log step."""
    return (np.arange(len(velocity) - 1) + 0.5) * LOG_STEP_S, np.diff(velocity) / LOG_STEP_S


def error_of(velocity: Array, converged: Array) -> Error:
    """Errors of a run in the 50 Hz band, from the fade-in's end to 40 ms before the run's."""
    if velocity.shape != converged.shape or not np.abs(velocity).max() < 10.0:
        return Error()
    (time_s, found), (_, true) = acceleration(velocity), acceleration(converged)
    judged = (time_s >= FADE_S) & (time_s <= time_s[-1] - 0.04)
    begin = time_s[-1] - 1.0 / FREQUENCY_Hz
    peaks = [np.abs(harmonic_deviation(time_s, a, FREQUENCY_Hz, start_s=begin).band).max() for a in (found, true)]
    difference = np.abs(band_limit(time_s, found) - band_limit(time_s, true))[judged].max()
    return Error(wave=float(difference / peaks[1]), peak=float(abs(peaks[0] / peaks[1] - 1.0)))


def speeds(runs: Sequence[Run], simulated_s: float, repeats: int) -> list[float]:
    """Simulated seconds a second of CPU time, best of the repeats; the runs in turn."""
    times = np.full((repeats, len(runs)), np.inf)
    for k in range(repeats):
        for i, run in enumerate(runs):
            start = time.process_time()
            run()
            times[k, i] = time.process_time() - start
    return (simulated_s / times.min(axis=0)).tolist()


def judge(setting: Setting) -> Result:
    """Error and rough speed of a setting, from one run; an infinite error where the solver gives up."""
    converged, run = reference(setting.tool), make_run(setting)
    start = time.process_time()
    try:
        velocity = run()
    except RuntimeError:  # Exudyn's SolverError is one
        return Result(setting=setting, error=Error(), speed=0.0)
    spent = time.process_time() - start
    return Result(setting=setting, error=error_of(velocity, converged), speed=DURATION_S / spent)


def good(results: Sequence[Result], tool: str, step_s: float | None) -> list[Result]:
    """The good settings of a tool, at a given step or at any."""
    return [r for r in results if r.setting.tool == tool and r.error.good and step_s in (None, r.setting.step_s)]


def leaders(results: Sequence[Result]) -> list[Result]:
    """The settings that may be the fastest good ones of their tool, at 10 kHz or at any step, by their rough speed."""
    chosen = []
    for tool in SCHEMES:
        for step_s in (TEN_kHz, None):
            chosen += sorted(good(results, tool, step_s), key=lambda r: -r.speed)[:LEADERS]
    return [r for r in results if r in chosen]


def compare(settings: Sequence[Setting], repeats: int) -> list[Result]:
    """Error and rough speed of every setting; speed of the leaders from `repeats` runs in turn."""
    results = [judge(setting) for setting in settings]
    chosen = leaders(results)
    measured = speeds([make_run(r.setting) for r in chosen], DURATION_S, repeats)
    timed = {r.setting: replace(r, speed=s, timings=repeats) for r, s in zip(chosen, measured, strict=True)}
    return [timed.get(r.setting, r) for r in results]


def fastest(results: Sequence[Result], tool: str, step_s: float | None = None) -> Result:
    """The fastest good setting of a tool among those timed most often, at a given step or at any."""
    return max(good(results, tool, step_s), key=lambda r: (r.timings, r.speed))


def all_settings(slower: bool = False) -> list[Setting]:
    """Every integrator at every step, and hexsim with the step that it chooses."""
    schemes = {**SCHEMES, "Exudyn": SCHEMES["Exudyn"] + SLOWER_SCHEMES} if slower else SCHEMES
    chosen = Setting(tool="hexsim", scheme="rk4", step_s=CHOSEN)
    return [chosen] + [
        Setting(tool=tool, scheme=s, step_s=h) for tool, names in schemes.items() for s in names for h in STEPS_S
    ]


def ratio(results: Sequence[Result], step_s: float | None = None) -> float:
    """hexsim's speed over Exudyn's, each in its fastest good setting at a given step or at any."""
    return fastest(results, "hexsim", step_s).speed / fastest(results, "Exudyn", step_s).speed


def exudyn_ratio(repeats: int = 9, any_step: bool = False) -> float:
    """`ratio` at 10 kHz, or each tool at its own best step."""
    settings = [s for s in all_settings() if any_step or s.step_s == TEN_kHz]
    return ratio(compare(settings, repeats), None if any_step else TEN_kHz)


def step_text(setting: Setting) -> str:
    """Step in us."""
    return "chosen" if setting.step_s == CHOSEN else f"{setting.step_s * 1e6:.0f}"


def print_table(results: Sequence[Result]) -> None:
    """All settings, then the ratios."""
    console = Console(width=120)
    columns = ("tool", "integrator", "step [us]", "wave error [%]", "peak error [%]", "simulated s per CPU s", "runs")
    table = Table(*columns)
    for r in results:
        errors = [f"{100 * e:.2g}" if np.isfinite(e) else "fails" for e in (r.error.wave, r.error.peak)]
        table.add_row(r.setting.tool, r.setting.scheme, step_text(r.setting), *errors, f"{r.speed:.1f}", str(r.timings))
    console.print(table)
    same = error_of(reference("Exudyn"), reference("hexsim"))
    console.print(f"converged Exudyn against converged hexsim: wave {same.wave:.1e}, peak {same.peak:.1e}")
    for where, step_s in (("both at 10 kHz", TEN_kHz), ("each at its best step", None)):
        best = [fastest(results, tool, step_s) for tool in SCHEMES]
        names = [f"{r.setting.tool} {r.setting.scheme} {step_text(r.setting)} us" for r in best]
        console.print(f"{where}, wave error <= {ERROR_LIMIT:.1%}: {' / '.join(names)} = {ratio(results, step_s):.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description="hexsim and Exudyn on the same hexapod, at equal acceleration error")
    parser.add_argument("--repeats", type=int, default=9, help="timings of the leading settings")
    parser.add_argument("--all", action="store_true", help="try also Exudyn's other integrators (none leads)")
    arguments = parser.parse_args()
    try:
        exudyn = load_exudyn()
    except ImportError:
        parser.error("exudyn is not installed: pip install hexsim[benchmark]")
    print(f"Exudyn {exudyn.__version__}")
    print_table(compare(all_settings(arguments.all), arguments.repeats))


if __name__ == "__main__":
    main()
