"""Does compensation make a platform's reversals worse? `python benchmarks/hexapod_reversals.py [--seeds 41:42] [--motion ...]`

The 600 kg hexapod in all six axes at once (`combined`, 20 s: a sine of its own frequency in each axis), as declared and
with one effect more that nothing is told of. Every case runs three times: plain control, `adaptive` from nothing
learned with the same sensor noise, and plain control with other noise, which tells what chance gives. `--motion drawn`:
the phases of the six sines are drawn by the seed, so that every seed is another motion.

`--started 1,3,5`: these legs start with what they learned on the same machine in 40 s of another drawn motion, the others stay
under plain control: what part of a platform does to the whole. `--started 1,2,3,4,5,6`: what is left where nothing is to be learned.

Bump of a reversal: of an axis' own acceleration, peak to peak in 3 to 50 Hz from 0.1 s before the commanded reversal to
0.35 s after it, as compensation_robustness.py counts it; reversals after the first 1.9 s. Worse: beyond plain control's
by 5 % and by 0.03 m/s2 (rad/s2 in rotations). A finished case is a line of benchmarks/results/hexapod_reversals.jsonl
(delete it after the algorithm has changed); the table is printed.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from compensation_robustness import Case, WORSE_m_s2, is_worse, run_missing, upper_bound
from journal import RESULTS
from reversal_chance import OTHER_NOISE
from scipy.signal import butter, sosfiltfilt

from hexsim.declaration import Machine
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.recording.signals import Signals
from hexsim.scenarios import Scenario, load_scenario
from hexsim.simulation import Run, simulate
from hexsim.smoothness import reversals_of_velocity

MACHINE, SCENARIO = "micro_motion_system", "combined"
JOURNAL = RESULTS / "hexapod_reversals.jsonl"
SHIPPED, DRAWN = "shipped", "drawn"  # phases of the six sines
SUPPLY, TANK = (f"effects.leakage_{path}.conductance_m3_s_Pa" for path in ("supply_to_chamber", "chamber_to_tank"))
NULL = "effects.null_offset.offset_V"
CONDITIONS: dict[str, dict[str, float]] = {
    "as declared": {},
    "edges rounded by 2 um": {"valve.edge_rounding_m": 2e-6},
    "leak from supply 1e-12": {SUPPLY: 1e-12},
    "leak to tank 2e-12": {TANK: 2e-12},
    "null 0.05 V": {NULL: 0.05},
    "null -0.1 V": {NULL: -0.1},
    "null 0.02 V, leak from supply 1e-12": {NULL: 0.02, SUPPLY: 1e-12},
    "hysteresis 20 mV": {"effects.valve_hysteresis.half_width_V": 0.02},
    "valve delay 4 ms": {"effects.valve_delay.delay_s": 0.004},
    "overlap 20 um": {"valve.overlap_m": 20e-6},
    "air 2 %": {"effects.entrained_air.volume_fraction": 0.02},
}
FIRST_s, BEFORE_s, AFTER_s = 1.9, 0.1, 0.35  # reversals from; window about each
OTHER_MOTION, LEARNING_s = 5000, 40.0  # added to the seed, of the motion that legs which are started learn in
LATE_s = 10.0  # from which compensation has settled
Bumps = list[tuple[str, float, float]]  # axis, time [s], bump [m/s2 or rad/s2]


def motion_of(case: Case) -> Scenario:
    """The scenario, its phases drawn by the seed where that is asked for."""
    scenario = load_scenario(SCENARIO)
    if case["motion"] == SHIPPED:
        return scenario
    draw = np.random.default_rng(case["seed"])
    phases = {axis: float(draw.uniform(0.0, 2.0 * math.pi)) for axis in scenario.signals}
    signals = {
        axis: dataclasses.replace(signal, phase_rad=phases[axis])  # type: ignore[type-var]
        for axis, signal in scenario.signals.items()
    }
    return dataclasses.replace(scenario, signals=signals)


def bumps(run: Run) -> Bumps:
    """Of each commanded reversal of each axis the bump."""
    signals, found = Signals.of_run(run), []
    t = signals.time_s
    band = butter(4, [3.0, 50.0], btype="band", fs=1.0 / (t[1] - t[0]), output="sos")
    for axis in signals.driven_axes:
        acceleration = sosfiltfilt(band, signals.acceleration(axis))
        for one in reversals_of_velocity(t, np.gradient(signals.commanded(axis), t)):
            if FIRST_s < one.time_s < t[-1] - AFTER_s - 0.05:
                near = (t > one.time_s - BEFORE_s) & (t < one.time_s + AFTER_s)
                found.append((axis, one.time_s, float(np.ptp(acceleration[near]))))
    return found


def worse_ones(plain: Bumps, other: Bumps) -> list[tuple[str, float, float, float]]:
    """Axis, time and both bumps of each reversal that is worse."""
    return [
        (axis, round(time, 2), round(before, 3), round(after, 3))
        for (axis, time, before), (_, _, after) in zip(plain, other, strict=True)
        if is_worse(before, after)
    ]


def started(machine: Machine, case: Case, folder: Path) -> str:
    """Start parameters of the legs that are named, learned on the machine itself in another motion with other noise."""
    other = dataclasses.replace(
        motion_of({"motion": DRAWN, "seed": case["seed"] + OTHER_MOTION}), duration_s=LEARNING_s
    )
    run = simulate(machine, other, compensator="adaptive", fast=True, seed=case["seed"] + OTHER_MOTION)
    legs = [p if leg in case["started"] else None for leg, p in enumerate(run.compensator_parameters, 1)]
    place = folder / "compensator.json"
    place.write_text(json.dumps({"compensator": "adaptive", "legs": legs}))
    return str(place)


def result_of(case: Case) -> Case:
    """The case with what came of it."""
    machine, scenario = changed(load_machine(MACHINE), CONDITIONS[case["conditions"][0]]), motion_of(case)
    with tempfile.TemporaryDirectory() as folder:
        adaptive = started(machine, case, Path(folder)) if case.get("started") else "adaptive"
        runs = [
            simulate(machine, scenario, compensator=name, fast=True, seed=case["seed"] + noise)
            for name, noise in (("none", 0), (adaptive, 0), ("none", OTHER_NOISE))
        ]
    plain, adaptive, again = map(bumps, runs)
    volts = runs[1].log.select("^compensation.*$").to_numpy() != 0.0
    on_s = [float(runs[1].log["time_s"][int(leg.argmax())]) if leg.any() else None for leg in volts.T]
    late = [[bump for _, time, bump in one if time > LATE_s] for one in (plain, adaptive)]
    return {
        **case, "reversals": len(plain), "worse": worse_ones(plain, adaptive), "itself": worse_ones(plain, again),
        "engaged_s": on_s, "late_share": round(float(np.mean(late[1]) / np.mean(late[0])), 3),
    }  # fmt: skip


def table(done: list[Case]) -> str:
    """The count as Markdown."""
    lines = [
        "| condition | runs | last leg engages [s] | reversals | worse | plain control against itself | bump from 10 s on |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in CONDITIONS:
        mine = [c for c in done if c["conditions"] == [name]]
        if mine:
            on = [time for c in mine for time in c["engaged_s"]]
            last = "never" if None in on else f"{max(on):.1f}"
            count, share = sum(c["reversals"] for c in mine), np.mean([c["late_share"] for c in mine])
            worse, itself = (sum(len(c[k]) for c in mine) for k in ("worse", "itself"))
            lines.append(f"| {name} | {len(mine)} | {last} | {count} | {worse} | {itself} | 1/{1 / share:.1f} |")
    total = sum(c["reversals"] for c in done)
    worse, itself = (sum(len(c[name]) for c in done) for name in ("worse", "itself"))
    lines += [
        "",
        f"{worse} of {total} worse, a share below {upper_bound(worse, total):.1e} with 95 % confidence; plain control against "
        f"itself {itself}, below {upper_bound(itself, total):.1e}.",
        "",
        "| worse reversal of | axis | time [s] | plain control | adaptive |",
        "|---|---|---|---|---|",
    ]
    for c in done:
        lines += [
            f"| {c['conditions'][0]}, {c['motion']} {c['seed']} | {' | '.join(map(str, one))} |" for one in c["worse"]
        ]
    return "\n".join(lines)


def cases(seeds: Iterable[int], motion: str, legs: list[int]) -> list[Case]:
    """Every condition with every seed; legs: those that start with what was learned, none for all from nothing."""
    more = {"started": legs} if legs else {}
    return [
        {"conditions": [name], "mass_kg": 600.0, "motion": motion, "seed": seed, "host": False, **more}
        for seed in seeds
        for name in CONDITIONS
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="41:42")
    parser.add_argument("--motion", choices=(SHIPPED, DRAWN), default=SHIPPED)
    parser.add_argument(
        "--started",
        default="",
        help="legs that start with what was learned, 1 to 6; each choice has a journal of its own",
    )
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--journal", type=Path, help="in place of the one of benchmarks/results")
    arguments = parser.parse_args()
    legs = [int(leg) for leg in arguments.started.split(",") if leg]
    planned = cases(range(*map(int, arguments.seeds.split(":"))), arguments.motion, legs)
    own = JOURNAL.with_stem("_".join([JOURNAL.stem, "started", *map(str, legs)])) if legs else JOURNAL
    done = run_missing(planned, arguments.journal or own, result_of, arguments.processes)
    print(f"By {WORSE_m_s2} m/s2 and 5 %\n\n{table(done)}")


if __name__ == "__main__":
    main()
