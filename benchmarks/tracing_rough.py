"""Score `sure effects` on rough machines of the second plant: one large effect over five or six small ones, or none.

    python benchmarks/tracing_rough.py --seeds 1000-1299 --out docs/results/tracing_rough.jsonl
    python benchmarks/tracing_rough.py --none --seeds 1000-1099 --out docs/results/tracing_rough.jsonl
    python benchmarks/tracing_rough.py --summary docs/results/tracing_rough.jsonl

Balances alone, no simulated refit. One line of JSON a machine, scored at once; a machine in the file is not run again.
Seeds below 1000 are for tuning. right: the first name or one tied with it, number within 15 %; wrong: any other name.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "tracing"), str(ROOT / "benchmarks")]


def run_one(seed: int, dominant: str | None) -> dict:
    """Write one machine, look for its sure effects."""
    from other_plant import write_machine
    from rough_machines import draw

    from hexsim.tracing.steps import shapes, violations
    from hexsim.tracing.steps.dominant import sure_effects
    from hexsim.tracing.steps.logs import begin

    effects, name = draw(seed, dominant)
    with tempfile.TemporaryDirectory() as folder:
        write_machine(folder, seed, effects)
        trace = begin(folder, ["fit", "sweep"], ["validate"])
        for step in (violations.STEP, shapes.STEP):
            trace = step.run(trace, lambda doing: None)
        best, found, _ = sure_effects(trace, lambda doing: None)
    named = []
    for own in found:
        values = best.fit.values[best.fit.candidates.index(own.candidate)]
        named.append([own.candidate.effect.name, values, list(own.tied), own.share, own.unseen])
    line = {"seed": seed, "dominant": name, "effects": effects, "named": named, "rest": best.sizes.tolist()}
    return line | {"score": score(line)}


def score(line: dict) -> str:
    """quiet, named; right, tie, wrong, missed."""
    from tracing_evaluation import RIGHT

    small = {"small_friction_of_position": "position_dependent_friction", "small_spool_lag": "spool_lag"}
    there = {small.get(name, name.removeprefix("small_")) for name in line["effects"]}
    names = [name for name, *_ in line["named"]]
    if line["dominant"] is None:
        return "named" if names else "quiet"
    right = RIGHT[line["dominant"]]
    if any(name not in right | there for name in names[1:]):
        return "wrong"
    if not names:
        return "missed"
    if names[0] in right or set(names) & right:
        return "right"
    return "tie" if right & set(line["named"][0][2]) else "wrong"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1000-1009")
    parser.add_argument("--none", action="store_true", help="machines without a large effect")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results" / "tracing_rough.jsonl")
    parser.add_argument("--summary", type=Path)
    options = parser.parse_args()
    if options.summary:
        lines = [json.loads(text) for text in options.summary.read_text().splitlines()]
        print(Counter((line["dominant"] is not None, line["score"]) for line in lines))
        return
    first, _, last = options.seeds.partition("-")
    known = [json.loads(text) for text in options.out.read_text().splitlines()] if options.out.is_file() else []
    done = {(line["seed"], line["dominant"] is None) for line in known}
    for seed in range(int(first), int(last or first) + 1):
        if (seed, options.none) in done:
            continue
        line = run_one(seed, None if options.none else "any")
        with options.out.open("a") as file:
            file.write(json.dumps(line) + "\n")
        print(line["score"], seed, line["dominant"], [(n, v) for n, v, *_ in line["named"]], flush=True)


if __name__ == "__main__":
    main()
