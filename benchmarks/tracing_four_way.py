"""Score the tracer on four-way benches of another writer (tests/tracing/four_edge_plant.py), one line of JSON a set.

    python benchmarks/tracing_four_way.py --seeds 100-104 --out benchmarks/results/tracing_four_way.jsonl.gz

A set that is in the file already is not run again. Seeds below 100 are for tuning, 100 and above for scoring.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "tracing"), str(ROOT / "benchmarks")]
from journal import RESULTS, append, lines_of  # noqa: E402


def main() -> None:
    """All sets of all seeds."""
    from four_edge_plant import EFFECTS
    from tracing_evaluation import seeds_of

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="100-104")
    parser.add_argument("--effects", default=",".join(EFFECTS))
    parser.add_argument("--out", type=Path, default=RESULTS / "tracing_four_way.jsonl.gz")
    options = parser.parse_args()
    done = {(line["effect"], line["seed"]) for line in lines_of(options.out)}
    for seed in seeds_of(options.seeds):
        for effect in options.effects.split(","):
            if (effect, seed) in done:
                continue
            line = run_one(effect, seed)
            append(line, options.out)
            print(line["score"], effect, seed, line["named"], line["seconds"], flush=True)


def run_one(effect: str, seed: int) -> dict:
    """Write one set, trace it, score it."""
    from four_edge_plant import EFFECTS, write_machine
    from tracing_evaluation import commit

    from hexsim.tracing.trace import trace

    size, _, right, key = EFFECTS[effect]
    with tempfile.TemporaryDirectory() as folder:
        write_machine(folder, seed, effect)
        started = time.process_time()
        report = trace(folder, ["fit", "sweep"], ["validate"]).report
    named = [[e["name"], e["parameters"], e["tied_with"]] for e in report["effects"] if e["name"]]
    line = {
        "effect": effect,
        "seed": seed,
        "verdict": report["verdict"],
        "named": named,
        "commit": commit(),
        "seconds": round(time.process_time() - started, 1),
    }
    return line | {"score": score(line, size, right, key)}


def score(line: dict, size: float, right: tuple[str, ...], key: str) -> str:
    """right (the number within 2 %), tie, number (right name, number off), unexplained, quiet, missed, wrong."""
    named = line["named"]
    if not right:
        return "quiet" if line["verdict"] == "nothing missing" and not named else "wrong" if named else "unexplained"
    if not named:
        return "missed" if line["verdict"] == "nothing missing" else "unexplained"
    name, parameters, tied = named[0]
    if len(named) > 1 or (name not in right and not set(tied) & set(right)):
        return "wrong"
    if name not in right:
        return "tie"
    return "right" if key not in parameters or abs(parameters[key] / size - 1.0) < 0.02 else "number"


if __name__ == "__main__":
    main()
