"""Score `sure effects` on rough machines of the second plant: one large effect over five or six small ones, or none.

    python benchmarks/tracing_rough.py --seeds 1000-1299 --out docs/results/tracing_rough.jsonl
    python benchmarks/tracing_rough.py --none --seeds 1000-1099 --out docs/results/tracing_rough.jsonl
    python benchmarks/tracing_rough.py --summary docs/results/tracing_rough.jsonl

Balances alone, no simulated refit. One line of JSON a machine, scored at once; a machine in the file is not run again.
Seeds below 1000 are for tuning. right: named, its number within 15 %; number off: named, its number further off;
tie: tied with the first name; wrong: any name that is not in the machine.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "tracing"), str(ROOT / "benchmarks")]
NUMBER = 0.15  # a named effect's number is right within this share


def run_one(seed: int, dominant: str | None) -> dict:
    """Write one machine, look for its sure effects. judged: the evidence for all that was judged, a round a list."""
    from other_plant import write_machine
    from rough_machines import draw
    from tracing_evaluation import commit

    from hexsim.tracing.steps import shapes, violations
    from hexsim.tracing.steps.dominant import sure_effects
    from hexsim.tracing.steps.logs import begin

    effects, name = draw(seed, dominant)
    started = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        write_machine(folder, seed, effects)
        trace = begin(folder, ["fit", "sweep"], ["validate"])
        for step in (violations.STEP, shapes.STEP):
            trace = step.run(trace, lambda doing: None)
        found = sure_effects(trace, lambda doing: None)
    fit = found.best.fit
    named = [
        {"name": own.candidate.effect.name, "values": fit.values[fit.candidates.index(own.candidate)], "tied": own.tied}
        for own in found.named
    ]
    judged = [[asdict(own) | {"candidate": own.candidate.effect.name} for own in tried] for tried in found.tried]
    line = {"seed": seed, "dominant": name, "effects": effects, "named": named, "rest": found.best.sizes.tolist()}
    line |= {"judged": judged, "seconds": round(time.process_time() - started, 1), "commit": commit()}
    return line | {"score": score(line)}


def there(line: dict) -> set[str]:
    """Names of the library that are in the machine, small ones too."""
    from other_effects import LIBRARY_NAMES
    from tracing_evaluation import RIGHT

    small = [name.removeprefix("small_") for name in line["effects"] if name != line["dominant"]]
    return RIGHT.get(line["dominant"], set()) | {
        LIBRARY_NAMES.get(name, name) for name in (*small, *(SAME_AS.get(name, name) for name in small))
    }


SAME_AS = {"seal_friction": "pressure_dependent_friction", "friction_of_position": "position_dependent_friction"}


def score(line: dict) -> str:
    """quiet, named; right, number off, tie, wrong, missed."""
    from rough_machines import number_of
    from tracing_evaluation import RIGHT

    names = [own["name"] for own in line["named"]]
    if line["dominant"] is None:
        return "named" if names else "quiet"
    right = RIGHT[line["dominant"]]
    for own in line["named"]:
        if own["name"] in right:
            found, true = (
                next(iter(own["values"].values())),
                number_of(line["dominant"], line["effects"][line["dominant"]]),
            )
            good = abs(found - true) < NUMBER * abs(true)
            return "wrong" if set(names) - there(line) else "right" if good else "number off"
    if not names:
        return "missed"
    return "wrong" if set(names[1:]) - there(line) or not right & set(line["named"][0]["tied"]) else "tie"


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
        print(line["score"], seed, line["dominant"], line["named"], line["seconds"], flush=True)


if __name__ == "__main__":
    main()
