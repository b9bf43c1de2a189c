"""Score `sure effects` on rough machines of the second plant: one large effect over five or six small ones, or none.

Of hexapods each leg has small ones of its own, and the large one is in one leg or in the machine.

    python benchmarks/tracing_rough.py --seeds 1000-1299 --out benchmarks/results/tracing_rough.jsonl.gz
    python benchmarks/tracing_rough.py --none --seeds 1000-1099 --out benchmarks/results/tracing_rough.jsonl.gz
    python benchmarks/tracing_rough.py --hexapods --seeds 1000-1019 --out benchmarks/results/tracing_rough_hexapods.jsonl.gz
    python benchmarks/tracing_rough.py --summary benchmarks/results/tracing_rough.jsonl.gz    also the operating characteristic

Balances alone, no simulated refit. One line of JSON a machine, scored at once; a machine in the file is not run again.
Seeds below 1000 are for tuning. right: named, its leg too, its number within 15 %; number off: named, its number further
off; tie: tied with the first name; wrong: any name that is not in the machine.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import binomtest

if TYPE_CHECKING:
    from hexsim.tracing.state import Trace
    from hexsim.tracing.steps.dominant import Sure

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "tracing"), str(ROOT / "benchmarks")]
from journal import RESULTS, append, lines_of  # noqa: E402

DECLARED_MASS_KG, PLATFORM_KG = 40.0, 600.0
NUMBER = 0.15  # a named effect's number is right within this share


def run_one(seed: int, dominant: str | None, hexapod: bool = False) -> dict:
    """Write one machine, look for its sure effects. judged: the evidence for all that was judged, a round a list."""
    import rough_hexapods
    import rough_machines
    from tracing_evaluation import commit

    from hexsim.tracing.steps.dominant import sure_effects

    effects, name, leg = (
        rough_hexapods.draw(seed, dominant) if hexapod else (*rough_machines.draw(seed, dominant), None)
    )
    started = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        found = sure_effects(begun_trace(folder, seed, effects, hexapod), lambda doing: None)
    judged = [[asdict(own) | {"candidate": own.label} for own in tried] for tried in found.tried]
    line = {"seed": seed, "dominant": name, "leg": leg, "effects": effects, "named": named_of(found)}
    line |= {"hexapod": hexapod, "rest": found.best.sizes.tolist()}
    line |= {"judged": judged, "seconds": round(time.process_time() - started, 1), "commit": commit()}
    return line | {"score": score(line)}


def begun_trace(folder: str, seed: int, effects: dict[str, float], hexapod: bool = False) -> Trace:
    """The trace of one machine, written into this folder, up to what its balances and shapes say."""
    from other_plant import write_machine

    from hexsim.tracing.steps import shapes, violations
    from hexsim.tracing.steps.logs import begin

    runs = (["fit"], ["validate_heave", "validate_roll"]) if hexapod else (["fit", "sweep"], ["validate"])
    write_machine(folder, seed, effects, "hexapod" if hexapod else "bench")
    trace = begin(folder, *runs)
    for step in (violations.STEP, shapes.STEP):
        trace = step.run(trace, lambda doing: None)
    return trace


def named_of(found: Sure) -> list[dict]:
    """What a trace names, with its numbers."""
    from hexsim.tracing.fitting.rest_evidence import values_in_leg

    return [
        {
            "name": own.candidate.effect.name,
            "where": own.candidate.where,
            "values": values_in_leg(found.best.fit, own.candidate),
            "tied": own.tied,
        }
        for own in found.named
    ]


def there(line: dict) -> set[str]:
    """Names of the library that are in the machine, small ones too."""
    from other_effects import LIBRARY_NAMES
    from tracing_evaluation import RIGHT

    keys = {key.partition("@")[0] for key in line["effects"]}
    small = [name.removeprefix("small_") for name in keys if name != line["dominant"]]
    return RIGHT.get(line["dominant"], set()) | {
        LIBRARY_NAMES.get(name, name) for name in (*small, *(SAME_AS.get(name, name) for name in small))
    }


SAME_AS = {
    "air": "entrained_air",
    "seal_friction": "pressure_dependent_friction",
    "friction_of_position": "position_dependent_friction",
}


def score(line: dict) -> str:
    """quiet, named; right, number off, tie, wrong, missed."""
    from tracing_evaluation import RIGHT

    names = [own["name"] for own in line["named"]]
    if line["dominant"] is None:
        return "named" if names else "quiet"
    place = f" in leg {line['leg']}" if line.get("leg") else ""
    right = {name + place for name in RIGHT[line["dominant"]]}
    foreign = set(names) - there(line)
    for own in line["named"]:
        if label(own) in right:
            return "wrong" if foreign else "right" if number_right(own, line) else "number off"
    if not names:
        return "missed"
    return "wrong" if set(names[1:]) - there(line) or not right & set(line["named"][0]["tied"]) else "tie"


def label(own: dict) -> str:
    """A named effect with its leg."""
    where = own.get("where", "all legs")
    return f"{own['name']} in {where}" if where.startswith("leg") else own["name"]


def number_right(own: dict, line: dict) -> bool:
    """Is its first number within the share?"""
    from rough_machines import number_of

    key = line["dominant"] if not line.get("leg") else f"{line['dominant']}@{line['leg']}"
    found, true = next(iter(own["values"].values())), number_of(line["dominant"], line["effects"][key])
    if line.get("hexapod") and line["dominant"] == "mass":
        true *= PLATFORM_KG / DECLARED_MASS_KG
    if line["dominant"] == "leg_differs":
        true = -true
    return abs(found - true) < NUMBER * abs(true)


def summarise(lines: list[dict]) -> None:
    """Counts with 95 % bounds (Clopper-Pearson), then false and missed names as the limits move."""
    for large in (True, False):
        scores = Counter(line["score"] for line in lines if (line["dominant"] is not None) == large)
        n = sum(scores.values())
        print("with a large effect" if large else "without", n)
        for name, k in scores.most_common():
            bound = binomtest(k, n).proportion_ci(0.95, "exact")
            print(f"  {name:12s} {k:4d}  {k / n:6.1%}  ({bound.low:.1%} to {bound.high:.1%})")
    print("names by the rules of now", dict(judged_now(lines)))
    for rule, values in LIMITS.items():
        print(
            f"| {rule} | false names, of {len(lines)} | missed, of {sum(line['dominant'] is not None for line in lines)} |"
        )
        for value in values:
            names = [(line, named_at(line, **{rule: value})) for line in lines]
            false = sum(bool(found - there(line)) for line, found in names)
            missed = sum(line["dominant"] is not None and not found for line, found in names)
            print(f"| {value} | {false} | {missed} |")


LIMITS = {"share": (0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95), "size": (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)}


def named_at(line: dict, share: float | None = None, size: float = 1.0) -> set[str]:
    """What of the kept evidence would be named at another least share, or another least size.

    A share replaces the rule of the own balance too. After a name that was not given no further round was looked at.
    """
    from hexsim.tracing import rules

    usual = rules.EXPLAINS, rules.RESTORES
    if share is not None:
        rules.EXPLAINS, rules.RESTORES = share, np.inf
    found = {own["candidate"].split(" in ")[0] for own in sure_of(line) if own["remarkable"] > size}
    rules.EXPLAINS, rules.RESTORES = usual
    return found


def sure_of(line: dict) -> list[dict]:
    """The kept evidence that the rules of now call sure, of each round what was judged last: of a tie the first name."""
    from hexsim.tracing.fitting.rest_evidence import Evidence, sure

    known = {field.name for field in fields(Evidence)}
    rounds = [
        [own for own in tried if sure(Evidence(**{key: own[key] for key in known & own.keys()}))]
        for tried in line["judged"]
    ]
    return [passed[-1] for passed in rounds if passed]


def judged_now(lines: list[dict]) -> Counter:
    """Names by the rules of now: true (in the machine), tied with what is, false."""
    from tracing_evaluation import RIGHT

    found = Counter()
    for line in lines:
        place = f" in leg {line['leg']}" if line.get("leg") else ""
        right, small = {name + place for name in RIGHT.get(line["dominant"], set())}, there(line)
        for own in sure_of(line):
            tied = {name for label_ in own["tied"] for name in (label_, label_.split(" in ")[0])}
            is_there = own["candidate"] in right or own["candidate"].split(" in ")[0] in small
            if own["remarkable"] > 1.0:
                found["true" if is_there else "tied" if tied & (right | small) else "false"] += 1
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1000-1009")
    parser.add_argument("--none", action="store_true", help="machines without a large effect")
    parser.add_argument("--hexapods", action="store_true")
    parser.add_argument("--out", type=Path, default=RESULTS / "tracing_rough.jsonl.gz")
    parser.add_argument("--summary", type=Path, nargs="+")
    options = parser.parse_args()
    from tracing_evaluation import seeds_of

    if options.summary:
        summarise([line for file in options.summary for line in lines_of(file)])
        return
    done = {(line["seed"], line["dominant"] is None) for line in lines_of(options.out)}
    for seed in seeds_of(options.seeds):
        if (seed, options.none) in done:
            continue
        line = run_one(seed, None if options.none else "any", options.hexapods)
        append(line, options.out)
        print(line["score"], seed, line["dominant"], line["leg"], line["named"], line["seconds"], flush=True)


if __name__ == "__main__":
    main()
