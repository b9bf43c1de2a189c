"""After a trace that leaves something open: one designed run of 20 s, against one more multisine of the same length.

    python benchmarks/next_measurement.py --seeds 3082-3141 --out benchmarks/results/next_measurement.jsonl.gz
    python benchmarks/next_measurement.py --summary benchmarks/results/next_measurement.jsonl.gz
    python benchmarks/next_measurement.py --first --seeds 3200-3331 --out benchmarks/results/rough_coverage.jsonl.gz   rough, one trace

Machines of the second plant: even seeds rough (`rough_machines.draw`), odd seeds clean with one effect of the library, of
0.05 to 1 of its typical size. The first trace has the multisine of 20 s to fit and a sine held out. A machine that it
leaves right and sharp, or in which it sees nothing missing, is a line without `designed`. One line of JSON a machine; a
machine in the file is not run again.
Rough machines are traced by the balances alone, which decide there; clean ones from end to end.
People can put 60 kg on, weighed to 0.5 %: the design may ask for it. Beside it one more multisine without, and one with it.

right     the effect that was put in is named (of a rough machine: it, or a nuisance effect that is there), and nothing else
          a pump whose largest flow no motion inside the limits takes has its line alone: right is a supply droop
          a spool whose speed limit no log of a trace takes is one of first order, 477 Hz: right is a spool lag
sharp     no tie, every number of it known to 10 %, and within 15 % of the truth where the library has the same number; one
          that says that there is nothing is known
one term  the same of a term that has two names in the report, each with its number: a hose and a dead volume. Nothing is left
          that a log could tell; counted by itself
in all    the right name, alone, its number not sharp or off, and what it makes with the declared parameters that it adds to
          known to 10 % and within 15 % of the truth: the sums that the report says. Counted by itself, not as sharp
honest    the design's first line says that no motion does it, and the right name is in that line; a hose and a dead volume
          are one term of the balances, that no log takes apart: counted in the same line
ceiling   no run can make it sharp: a number of the right name that all motions which the design tried, one after the other,
          leave known to worse than 10 %, because a declared parameter is known no better
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "tracing"), str(ROOT / "benchmarks")]
from journal import RESULTS, append, lines_of  # noqa: E402
from next_measurement_score import (  # noqa: E402
    ONE_TERM,
    SHARP_SCORES,
    known_in_all,
    never_taken,
    right_names,
    scale_of,
    score,
)

LOAD_kg, LOAD_KNOWN = 60.0, 0.005


def draw(seed: int) -> tuple[dict[str, float], str]:
    """Effects of the machine of a seed, and the name of the one that is looked for."""
    from other_effects import EFFECTS
    from rough_machines import DOMINANT, INVERSE
    from rough_machines import draw as rough

    name = DOMINANT[(seed // 2) % len(DOMINANT)]
    if seed % 2 == 0:
        return rough(seed, name)[0], name
    share = np.exp(np.random.default_rng([seed, 78]).uniform(np.log(0.05), 0.0))
    size = EFFECTS[name].typical
    return {name: float(size * share if name not in INVERSE else size / share)}, name


def with_load(plant: Any, seed: int) -> Any:
    """The true plant with the load on it, as heavy as it really is."""
    load = LOAD_kg * (1.0 + LOAD_KNOWN * np.random.default_rng([seed, 60]).uniform(-1.0, 1.0))
    rig = plant.rig.copy()
    rig["mass"] += load
    return replace(plant, rig=rig)


def write_driven(folder: Path, plant: Any, name: str, tables: dict[str, Any], seed: int) -> None:
    """The log of a designed motion on the true plant."""
    import polars as pl
    from other_plant import driven, measured

    from hexsim.scenarios.scenario import scenario_from_dict

    scenario = scenario_from_dict(tables)
    rng = np.random.default_rng([seed, *name.encode()])
    t = np.arange(round(scenario.duration_s * 1000)) * 1e-3
    held = np.floor(t * 500 + 1e-6) / 500
    setpoint = scenario.evaluate(held)[0][:, :1] + 0.5 * plant.legs["stroke"][0]
    pl.DataFrame(measured(plant, driven(plant, setpoint), rng)).write_csv(folder / f"{name}.csv")


def write_loaded(folder: Path, plant: Any, seed: int) -> None:
    """The log of the second multisine with the load on."""
    import polars as pl
    from other_plant import measured, simulate

    rng = np.random.default_rng([seed, 2, *b"fit_more_loaded"])
    log = measured(plant, simulate(with_load(plant, seed), "fit_more", seed), rng)
    pl.DataFrame(log).write_csv(folder / "fit_more_loaded.csv")


def run_one(seed: int, tell: Callable[[str], None], first_alone: bool = False) -> dict[str, Any]:
    """The first trace; where it leaves something open, the designed run and the multisine beside it, unless `first_alone`."""
    from other_plant import write_machine

    from hexsim.errors import HexsimError
    from hexsim.tracing.design import next_measurement
    from hexsim.tracing.trace import trace

    effects, name = draw(seed)

    def traced(fit: list[str], loaded: list[str]) -> tuple[Any, dict[str, Any]]:
        if seed % 2 == 0:
            found = traced_in_balances(folder, fit, loaded)
        else:
            found = trace(folder, fit, ["validate"], load_kg=LOAD_kg, loaded=loaded)
        return found, outcome(found, line, [folder / f"{log}.csv" for log in [*fit, "validate"]])

    line: dict[str, Any] = {"seed": seed, "rough": seed % 2 == 0, "effect": name, "effects": effects}
    began = time.process_time()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        plant = write_machine(folder, seed, effects, runs=("fit", "fit_more", "validate"), suffix=".csv")
        line["true"] = true_parameters(plant)
        try:
            first, line["first"] = traced(["fit"], [])
            tell(f"first {line['first']}")
            if left_open(line["first"]) and not first_alone:
                design = next_measurement(first)
                tell(design.purpose)
                loaded = design.load_kg is not None
                line["design"] = design.to_json() | {"scenario": design.tables["axes"]}
                write_driven(folder, with_load(plant, seed) if loaded else plant, "designed", design.tables, seed)
                write_loaded(folder, plant, seed)
                for key, run in {
                    "designed": "designed",
                    "multisine": "fit_more",
                    "with_load": "fit_more_loaded",
                }.items():
                    on = [run] if key == "with_load" or (key == "designed" and loaded) else []
                    line[key] = traced(["fit", run], on)[1]
                    tell(f"{key} {line[key]}")
        except HexsimError as error:
            line["refused"] = str(error)
    return line | {"seconds": round(time.process_time() - began)}


def true_parameters(plant: Any) -> dict[str, float]:
    """What the machine file declares, as the machine of a seed has it with its effects."""
    from other_plant import UNCERTAIN_LEG

    own = {key: float(plant.legs[field][0]) for field, key in UNCERTAIN_LEG.items()}
    return own | {"moving_mass_kg": float(plant.rig["mass"][0])}


def traced_in_balances(folder: Path, fit: list[str], loaded: list[str]) -> Any:
    """A trace up to the sure effects, without a simulated refit."""
    from hexsim.tracing.steps import dominant, shapes, ties, violations
    from hexsim.tracing.steps.logs import begin

    state = begin(folder, fit, ["validate"], LOAD_kg, loaded)
    for step in (violations.STEP, shapes.STEP, dominant.STEP, ties.STEP):
        state = step.run(state, lambda doing: None)
    return state


def left_open(first: dict[str, Any]) -> bool:
    """Has the trace left something open? Where it sees nothing there is nothing to ask."""
    return first["score"] not in SHARP_SCORES and first["verdict"] != "nothing missing"


def outcome(result: Any, line: dict[str, Any], logs: list[Path]) -> dict[str, Any]:
    """Verdict, names with numbers and errors, and the score. logs: of the trace."""
    from hexsim.tracing.fitting.fitted_numbers import totals_of

    named = [
        [
            e.candidate.effect.name,
            e.values,
            e.standard_errors,
            list(e.tied_with),
            [[own.candidate.effect.name, own.values, own.standard_errors] for own in e.readings],
        ]
        for e in result.effects
    ]
    never = {"never_taken": True} if never_taken(line, logs) else {}
    sums = [own for e in result.effects for own in totals_of(result.final, e.candidate)]
    in_all = {"in_all": {own.key: [own.value, own.standard_error] for own in sums}} if sums else {}
    return {"verdict": result.verdict, "named": named, "score": score(line, named, bool(never))} | never | in_all


def summarise(lines: list[dict[str, Any]]) -> None:
    """Counts, and the ratio of predicted to reached errors. Scores are those of the present rules."""
    for line in lines:
        for own in (line[key] for key in ("first", "designed", "multisine", "with_load") if key in line):
            own["score"] = score(line, own["named"], own.get("never_taken", False))
    for kind in ("rough", "clean"):
        own = [line for line in lines if line["rough"] == (kind == "rough") and "first" in line]
        opened = [line for line in own if "multisine" in line and left_open(line["first"])]
        print(f"{kind}: nothing missing {sum(line['first']['verdict'] == 'nothing missing' for line in own)}")
        good = {
            key: sum(line[key]["score"] in SHARP_SCORES for line in opened if key in line)
            for key in ("designed", "multisine", "with_load")
        }
        terms = [
            line["seed"] for line in own if ONE_TERM in (line["first"]["score"], line.get("designed", {}).get("score"))
        ]
        print(f"{kind}: {len(own)} machines, {len(opened)} left open; right and sharp after it: {good}")
        honest = [line["seed"] for line in opened if answered_honestly(line)]
        alike = [line["seed"] for line in opened if "one term" in line["design"]["purpose"]]
        most = {line["seed"]: line["designed"]["score"] for line in opened if beyond_the_ceiling(line)}
        made = [seed for seed, own in most.items() if own == "right and sharp"]
        print(f"  of one term with two names: {terms}")
        for key in ("first", "designed", "multisine", "with_load"):
            sums = [line["seed"] for line in opened if key in line and known_in_all(line, line[key])]
            print(f"  not sharp, and known in all with what is declared, {key}: {sums}")
        print(
            f"  the design says that no run makes it sharp: {len(most)} {list(most)}, and it was all the same: {made}"
        )
        print(f"  no motion does it, and the right name is told: {len(honest)} {honest}; of them one term: {alike}")
    ratios = np.array([ratio for line in lines if "designed" in line for ratio in error_ratios(line)])
    if len(ratios):
        inside = np.mean(np.abs(np.log(ratios)) <= np.log(1.5))
        median = np.median(ratios)
        print(f"predicted over reached error: {len(ratios)} numbers, median {median:.2f}, within 1.5: {inside:.2f}")


def answered_honestly(line: dict[str, Any]) -> bool:
    """Does the design's first line say that no motion does it, of the right name?"""
    said = line["design"]["purpose"]
    return said.startswith("no motion") and any(name in said for name in right_names(line, never_at_first(line)))


def never_at_first(line: dict[str, Any]) -> bool:
    """Does no log of the first trace take the limit?"""
    return line["first"].get("never_taken", False)


def beyond_the_ceiling(line: dict[str, Any]) -> bool:
    """Does the design say that a number of the right name stays known to worse than 10 % after any run?"""
    return any(
        own["least"] > 0.1 * scale_of(own["parameter"], own["value"])
        for own in line["design"]["numbers"]
        if own["effect"].split(" in ")[0] in right_names(line, never_at_first(line)) and own.get("least") is not None
    )


def error_ratios(line: dict[str, Any]) -> list[float]:
    """Predicted over reached standard errors of the numbers that the last trace names as well."""
    reached = {(row[0], key): error for row in line["designed"]["named"] for key, error in row[2].items()}
    pairs = [
        (own["expected"], reached.get((own["effect"].split(" in ")[0], own["parameter"])))
        for own in line["design"]["numbers"]
    ]
    return [one / other for one, other in pairs if one and other]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="3000-3059")
    parser.add_argument("--out", type=Path, default=RESULTS / "next_measurement.jsonl.gz")
    parser.add_argument("--summary", type=Path)
    parser.add_argument("--first", action="store_true", help="even seeds alone, and their first trace")
    options = parser.parse_args()
    from tracing_evaluation import commit, seeds_of

    if options.summary:
        summarise(lines_of(options.summary))
        return
    done = {line["seed"] for line in lines_of(options.out)}
    for seed in seeds_of(options.seeds):
        if seed in done or (options.first and seed % 2):
            continue
        line = run_one(seed, lambda text, seed=seed: print(seed, text, flush=True), options.first) | {
            "commit": commit()
        }
        append(line, options.out)


if __name__ == "__main__":
    main()
