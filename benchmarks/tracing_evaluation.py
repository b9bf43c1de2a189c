"""Score the tracer on machines of another writer (tests/tracing/other_plant.py): nothing missing, library, outside.

    python benchmarks/tracing_evaluation.py null --seeds 100-199 --out benchmarks/results/tracing_null_bench.jsonl.gz
    python benchmarks/tracing_evaluation.py library --seeds 100-109 --duration 20
    python benchmarks/tracing_evaluation.py outside --seeds 100-104
    python benchmarks/tracing_evaluation.py rough --kind hexapod --seeds 100-119
    python benchmarks/tracing_evaluation.py summary benchmarks/results/tracing_*_bench.jsonl.gz

One line of JSON a machine; a machine that is in the file already is not run again, so a broken run is continued.
Seeds below 100 are for tuning, 100 and above for scoring.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "tracing"), str(ROOT / "benchmarks")]
from journal import RESULTS, append, lines_of  # noqa: E402

# name of the injected effect in the other plant -> names of the library that are right
RIGHT = {
    "supply_droop": {"supply_droop"},
    "pump_limit": {"pump_flow_limit"},
    "supply_accumulator": {"gas_accumulator"},
    "return_line": {"return_line_back_pressure"},
    "leakage_supply_to_chamber": {"leakage_supply_to_chamber"},
    "leakage_chamber_to_tank": {"leakage_chamber_to_tank"},
    "leakage_clearance": {"clearance_leakage"},
    "entrained_air": {"entrained_air"},
    "hose_compliance": {"hose_compliance"},
    "dead_volume": {"dead_volume"},
    "laminar_edge": {"laminar_edge"},
    "laminar_edge_merritt": {"laminar_edge"},
    "laminar_edge_wu": {"laminar_edge"},
    "overlap": {"overlap_change"},
    "underlap": {"overlap_change"},
    "null_offset": {"null_offset"},
    "null_drift": {"null_drift"},
    "unequal_ports": {"unequal_ports"},
    "spool_lag": {"spool_lag"},
    "spool_rate_limit": {"spool_rate_limit"},
    "valve_hysteresis": {"valve_hysteresis"},
    "valve_delay": {"valve_delay"},
    "coulomb_friction": {"coulomb_friction_change"},
    "viscous_friction": {"viscous_friction_change"},
    "stribeck_change": {"stribeck_friction_change"},
    "presliding": {"presliding"},
    "seal_friction": {"pressure_dependent_friction"},
    "friction_of_position": {"position_dependent_friction"},
    "mass": {"mass_change"},
    "incline": {"incline"},
    "spring": {"spring"},
    "flexible_payload": {"flexible_payload"},
    "outside_force": {"outside_force_tone"},
    "accelerometer_gain": {"accelerometer_gain"},
    "accelerometer_offset": {"accelerometer_offset"},
    "accelerometer_delay": {"accelerometer_delay"},
    "pressure_gain": {"pressure_gain"},
    "pressure_offset": {"pressure_offset"},
    "pressure_delay": {"pressure_delay"},
    "supply_pressure_gain": {"supply_pressure_gain"},
    "position_gain": {"position_gain"},
    "position_delay": {"position_delay"},
    "position_lag": {"position_lag"},
    "pressure_lag": {"pressure_lag"},
    "centre_of_mass": {"centre_of_mass"},
    "platform_inertia": {"inertia_change"},
    "leg_differs": {"valve_gain_change"},
    "base_joint_x": {"base_joint_offset"},
    "base_joint_z": {"base_joint_offset"},
    "platform_joint_x": {"platform_joint_offset"},
    "platform_joint_z": {"platform_joint_offset"},
    "leg_zero": {"leg_zero_offset", "position_offset"},
    "imu_turn": {"imu_orientation"},
    "oil_warms_up": {"viscous_friction_drift"},  # outside the library till it had this: fades evenly, by half in 20 s
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["null", "library", "outside", "rough", "summary"])
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--seeds", default="100-109")
    parser.add_argument("--effects", default="")
    parser.add_argument("--strength", type=float, default=1.0, help="times the typical size")
    parser.add_argument("--kind", default="bench", choices=["bench", "hexapod"])
    parser.add_argument("--duration", type=float, default=20.0, help="length of each run [s]")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    if options.what == "summary":
        summarise([line for file in options.files for line in lines_of(file)])
        return
    out = options.out or RESULTS / f"tracing_{options.what}_{options.kind}.jsonl.gz"
    run_all(options, seeds_of(options.seeds), out)


def seeds_of(text: str) -> range:
    """The seeds of "1000-1009", or of "1000"."""
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def run_all(options: argparse.Namespace, seeds: range, out: Path) -> None:
    """Every effect at every seed that the file does not hold yet."""
    from other_effects import BUILT_OTHERWISE, EFFECTS
    from rough_hexapods import draw

    names = [None]
    if options.what in ("library", "outside"):
        names = [
            n
            for n, e in (EFFECTS | BUILT_OTHERWISE).items()
            if e.in_library == (options.what == "library") and options.kind in e.kinds
        ]
    if options.effects:
        names = options.effects.split(",")
    done = {(line["effect"], line["seed"], line["strength"]) for line in lines_of(out)}
    for seed in seeds:
        for name in [draw(seed)[1]] if options.what == "rough" else names:
            if (name, seed, options.strength) in done:
                continue
            line = run_one(name, seed, options)
            append(line, out)
            print(line["seconds"], name, seed, line["verdict"], line["named"], line["score"], flush=True)


def run_one(name: str | None, seed: int, options: argparse.Namespace) -> dict:
    """Write one machine, trace it, score it."""
    from other_plant import KNOWN, write_machine
    from rough_hexapods import draw

    from hexsim.errors import HexsimError
    from hexsim.tracing.trace import trace

    bench = options.kind == "bench"
    fit, validate = (["fit", "sweep"], ["validate"]) if bench else (["fit"], ["validate_heave", "validate_roll"])
    size = None
    if name is not None:
        size = KNOWN[name].size(options.kind) * options.strength
    leg = None if bench or name is None or KNOWN[name].place != "leg" else 1 + seed % 6
    key = name if leg is None else f"{name}@{leg}"
    effects = {} if key is None else {key: size}
    if options.what == "rough":
        effects, name, leg = draw(seed)
        size = effects[name if leg is None else f"{name}@{leg}"]
    with tempfile.TemporaryDirectory() as folder:
        write_machine(folder, seed, effects, options.kind, duration_s=options.duration)
        started = time.process_time()
        try:
            result = trace(folder, fit, validate)
            report = result.report
        except HexsimError as error:
            report = {"verdict": "refused", "effects": [], "unexplained": [], "balances": [], "description": str(error)}
    line = {
        "effect": name,
        "seed": seed,
        "strength": options.strength,
        "size": size,
        "leg": leg,
        "verdict": report["verdict"],
        "named": [[e["name"], e["where"], e["parameters"], e["tied_with"]] for e in report["effects"] if e["name"]],
        "learned": [[e["balance"], e["where"], e["curve"]["signal"]] for e in report["effects"] if not e["name"]],
        "unexplained": [
            [u["balance"], u["where"], u["depends_on"], u["r2_cv"], u["frequency_Hz"]] for u in report["unexplained"]
        ],
        "detectable": {k: v["theta_min"] for k, v in report.get("detectable", {}).items()},
        "seconds": round(time.process_time() - started, 1),
        "duration": options.duration,
        "commit": commit(),
        "description": report.get("description", ""),
    }
    return line | {"score": score(line, KNOWN)}


def score(line: dict, effects: dict) -> str:
    """right, tie, wrong, unexplained, quiet; for what no library has: flagged, balance, missed, wrong."""
    name, named = line["effect"], line["named"]
    if name is None:
        return "quiet" if line["verdict"] == "nothing missing" else "false alarm"
    injected = effects[name]
    if injected.in_library:
        if not named:
            return "quiet" if line["verdict"] == "nothing missing" else "unexplained"
        right = RIGHT[name]
        place = line["leg"] is None or named[0][1] == f"leg {line['leg']}"
        if len(named) == 1 and named[0][0] in right and place:
            return "right"
        if len(named) == 1 and any(label.split(" in ")[0] in right for label in named[0][3]):
            return "tie"
        return "right among others" if any(entry[0] in right for entry in named) else "wrong"
    if named:
        return "right" if {entry[0] for entry in named} <= RIGHT.get(name, set()) else "wrong"
    if line["verdict"] == "nothing missing":
        return "missed"
    if not line["unexplained"]:
        return "refused"
    balance, _, depends, _, frequency = line["unexplained"][0]
    right_balance = balance in (injected.balance, *injected.also_balances)
    right_signal = depends in injected.depends_on
    if injected.frequency_Hz:
        right_signal = frequency is not None and abs(frequency / injected.frequency_Hz - 1) < 0.02
    return "flagged" if right_balance and right_signal else "balance" if right_balance else "elsewhere"


def commit() -> str:
    return subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True
    ).stdout.strip()


def summarise(lines: list[dict]) -> None:
    """Counts by effect and overall."""
    table: dict[str, dict[str, int]] = {}
    for line in lines:
        row = table.setdefault(str(line["effect"]), {})
        row[line["score"]] = row.get(line["score"], 0) + 1
    for name, row in table.items():
        print(f"{name:30s}", row)
    total: dict[str, int] = {}
    for row in table.values():
        for score_, count in row.items():
            total[score_] = total.get(score_, 0) + count
    print("all", len(lines), total)


if __name__ == "__main__":
    main()
