"""What the logs of rough benches can tell at best: an oracle that knows the cause asks what it is worth in J.

    python benchmarks/tracing_rough_oracle.py benchmarks/results/tracing_rough.jsonl.gz --right 10 --quiet 10
    python benchmarks/tracing_rough_oracle.py --summary                         what is in --out

Of every machine of a journal that is not right, and of some that are. The declared parameters and the nuisance effects
are free, as a trace knows them; the fits begin where the trace begins and at the truth, and the lower end counts.

    fall     J of the best fit without the effect, less J with it
    lead     J of the best other effect of the library, refitted like the true one, less J of the true one
    least    the number at which J is least; number: J at the true number less that, all else refitted
    known    as fall, with all declared parameters and nuisance effects at their true values, nothing refitted

J is -2 log likelihood in units of what is left. Were its rest noise, a lead of 2 log 99 = 9.2 would be wrong once in a
hundred. Nuisance effects that no column holds add to that, and by how much is measured (`thresholds`): the largest fall that a
cause brings which is not in the machine, where nothing large is; the largest lead of such a cause over the true one. What is
ahead of a hidden cause and in the machine, a small wear, counts for neither. A machine can be told where its fall and its lead
are above these and where J is least within 15 % of the true number: no rule that reads these balances can prove more.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from journal import RESULTS, append, lines_of
from tracing_rough import NUMBER, begun_trace, named_of, score, there

from hexsim.tracing.fitting import rest_level
from hexsim.tracing.fitting.fit import Fit, coordinates_of, evaluate, fit_at, start_fit_at
from hexsim.tracing.fitting.parameters import Candidate, named, to_coordinate
from hexsim.tracing.fitting.rest_level import RestFit
from hexsim.tracing.problems.balance import BalanceProblem
from hexsim.tracing.steps.dominant import beside_small, contenders, rivals_of, sure_effects

OUT = RESULTS / "tracing_rough_oracle.jsonl.gz"
ONE_IN_HUNDRED = 2.0 * float(np.log(99.0))
SHAPE = {  # other numbers of the second plant's effects, in the library's names
    "supply_droop": {"accumulator_m3_Pa": 6e-12},
    "pump_limit": {"line_resistance_Pa_s_m3": 1e8, "accumulator_m3_Pa": 4e-11},
    "supply_accumulator": {"line_resistance_Pa_s_m3": 8e9, "polytropic_exponent": 1.3},
    "presliding": {"bristle_damping_N_s_m": 1e4},
    "friction_of_position": {"wavelength_m": 0.03},
    "flexible_payload": {"frequency_Hz": 8.0, "damping_ratio": 0.03},
    "outside_force": {"frequency_Hz": 7.3},
}


def asked(line: dict) -> dict:
    """What the machine of a journal's line can tell."""
    from rough_machines import number_of
    from tracing_evaluation import RIGHT

    seed, dominant = line["seed"], line["dominant"]
    with tempfile.TemporaryDirectory() as folder:
        trace = begun_trace(folder, seed, line["effects"])
        now = line | {"named": named_of(sure_effects(trace, lambda doing: None))}
        base, problem, unseen = beside_small(trace)
        base = with_ripple(base, line, problem)
        begun, _ = rivals_of(base, trace.candidates, problem, False)
        rivals = contenders(begun, base, problem)
    others = [own for own in rivals if own.fit.candidates[-1].effect.name not in RIGHT.get(dominant, set())]
    found = {
        "seed": seed,
        "dominant": dominant,
        "was": line["score"],
        "score": score(now),
        "N": rest_level.independent(problem),
    }
    if dominant is None:
        foreign = [own for own in others if own.fit.candidates[-1].effect.name not in there(line)]
        best = min(foreign, key=lambda own: own.cost, default=base)
        return found | {"rival": label_of(best), "fall": base.cost - best.cost}
    number = number_of(dominant, line["effects"][dominant])
    shape = SHAPE.get(dominant, {})
    own = [replace(c, shape=c.shape | shape) for c in trace.candidates if c.effect.name in RIGHT[dominant]]
    start = at_truth(base.fit, line, problem)
    held = min(
        (fit for c in own for fit in (held_at(base.fit, c, number, problem), held_at(start, c, number, problem))),
        key=lambda fit: fit.cost,
    )
    free = min(
        [refit(loosed(held.fit, own[0], problem), problem)]
        + [refit(o.fit, problem) for o in rivals if o not in others],
        key=lambda fit: fit.cost,
    )
    rival = min((refit(o.fit, problem) for o in others[:3]), key=lambda fit: fit.cost, default=base)
    J = {"base": base.cost, "truth": free.cost, "held": held.cost, "rival": rival.cost}
    held_out = {k: unseen_cost(o.fit, unseen) for k, o in (("base", base), ("truth", free), ("rival", rival))}
    first = free.fit.candidates[-1].effect.parameters[0].name
    place = len(coordinates_of(free.fit)) - len(free.fit.candidates[-1].free())
    sd = float(np.sqrt(rest_level.sandwich(free, problem)[place, place]))
    return found | {
        "rival": label_of(rival),
        "rival_there": rival.fit.candidates[-1].effect.name in there(line),
        "fall": J["base"] - J["truth"],
        "lead": J["rival"] - J["truth"],
        "number": held.cost - free.cost,
        "known": known_fall(start, own[0], number, problem),
        "J": J,
        "held_out": held_out,
        "put": number,
        "least": free.fit.values[-1][first],
        "relative_error": sd / abs(rest_level.size_of(free.fit)),
        "named": [[own["name"], next(iter(own["values"].values())), own["tied"]] for own in now["named"]],
    }


def with_ripple(base: RestFit, line: dict, problem: BalanceProblem) -> RestFit:
    """The base with the friction that ripples along the stroke, where the machine has it: a trace fits it unnamed."""
    size = line["effects"].get("small_friction_of_position")
    if size is None:
        return base
    ripple = named("position_dependent_friction", wavelength_m=0.03)
    start = np.append(coordinates_of(base.fit), size / 20.0)
    return refit(rest_level.initialise(base.fit, ripple, start, problem), problem)


def at_truth(fit: Fit, line: dict, problem: BalanceProblem) -> Fit:
    """The base with its declared parameters and nuisance effects where they truly are, as far as it holds them."""
    from other_effects import EFFECTS
    from other_plant import DECLARED_LEG, UNCERTAIN_LEG, true_machine
    from rough_machines import number_of
    from tracing_evaluation import RIGHT

    plant, _ = true_machine("bench", line["seed"], {})
    true = {key: plant.legs[field][0] / DECLARED_LEG[field] - 1.0 for field, key in UNCERTAIN_LEG.items()}
    true |= {"moving_mass_kg": plant.rig["mass"][0] / 40.0 - 1.0}
    true |= {"supply_pressure_Pa": plant.rig["supply_pressure"][0] / 7e6 - 1.0}
    small = {}
    for key, size in line["effects"].items():
        name = "entrained_air" if key == "small_air" else key.removeprefix("small_")
        if key != line["dominant"] and name in EFFECTS:
            small[next(iter(RIGHT[name]))] = number_of(name, size)
    values = []
    for candidate in fit.candidates:
        number = candidate.effect.parameters[0]
        low, high = number.bounds
        value = min(max(small.get(candidate.effect.name, number.neutral), low), high)
        values.append(candidate.start() | {number.name: value})
    deviations = np.array([true[prior.key] for prior in fit.priors])
    return evaluate(replace(fit, deviations=deviations, values=tuple(values), columns=None), problem)


def held_at(fit: Fit, candidate: Candidate, number: float, problem: BalanceProblem) -> RestFit:
    """This fit with the effect at this number, all else refitted."""
    size = candidate.effect.parameters[0]
    fixed = replace(size, bounds=(number, number))
    effect = replace(candidate.effect, parameters=(fixed, *candidate.effect.parameters[1:]))
    bare, _ = rest_level.without_nuisance(RestFit(fit=fit, columns=[], cost=0.0), candidate)
    start = np.append(coordinates_of(bare), to_coordinate(size, number))
    begun = rest_level.initialise(bare, replace(candidate, effect=effect), start, problem)
    return refit(refit(begun, problem.slow_alone()).fit, problem)


def loosed(fit: Fit, candidate: Candidate, problem: BalanceProblem) -> Fit:
    """A held fit whose effect is free again."""
    return evaluate(replace(fit, candidates=(*fit.candidates[:-1], candidate)), problem)


def refit(fit: Fit, problem: BalanceProblem) -> RestFit:
    """To the end, all columns anew."""
    return rest_level.refined(start_fit_at(fit, problem), problem, steps=12)


def known_fall(start: Fit, candidate: Candidate, number: float, problem: BalanceProblem) -> float:
    """Fall of J by the effect, everything else at the truth."""
    size = candidate.effect.parameters[0]
    bare, _ = rest_level.without_nuisance(RestFit(fit=start, columns=[], cost=0.0), candidate)
    bare = evaluate(fit_at(bare, coordinates_of(bare)), problem)
    there = rest_level.initialise(
        bare, candidate, np.append(coordinates_of(bare), to_coordinate(size, number)), problem
    )
    return rest_level.cost_of_rows(bare, problem) - rest_level.cost_of_rows(there, problem)


def unseen_cost(fit: Fit, unseen: BalanceProblem) -> float:
    return rest_level.cost_of_rows(start_fit_at(fit, unseen), unseen)


def label_of(own: RestFit) -> str:
    return own.fit.candidates[-1].label


def chosen(lines: Sequence[dict], right: int, quiet: int) -> list[dict]:
    """All that is not right, and so many of the right and the quiet ones, drawn evenly."""
    rng = np.random.default_rng(0)
    found = [line for line in lines if line["score"] not in ("right", "quiet")]
    for kind, count in (("right", right), ("quiet", quiet)):
        possible = [line for line in lines if line["score"] == kind]
        places = rng.choice(len(possible), size=min(count, len(possible)), replace=False) if possible else []
        found += [possible[k] for k in sorted(places)]
    return found


def thresholds(lines: Sequence[dict]) -> tuple[float, float]:
    """(fall, lead) of J above which a cause is there, and is that one."""
    quiet = [line["fall"] for line in lines if line["dominant"] is None]
    behind = [-line["lead"] for line in lines if line["dominant"] is not None and not line.get("rival_there")]
    return max([ONE_IN_HUNDRED, *quiet]), max([ONE_IN_HUNDRED, *behind])


def verdict(line: dict, fall: float, lead: float) -> str:
    """Can these logs tell the machine, and if not why."""
    if line["fall"] <= fall:
        return "hidden"  # nuisance effects do as much
    if line["lead"] <= -ONE_IN_HUNDRED:
        return "another is ahead"
    if line["lead"] <= lead:
        return "coin toss" if line["lead"] <= ONE_IN_HUNDRED else "not sure"
    return "told" if abs(line["least"] / line["put"] - 1.0) < NUMBER else "number elsewhere"


def summarise(lines: Sequence[dict]) -> None:
    """A line a machine that is not right by the rules as they stand, then how many of each can be told."""
    fall, lead = thresholds(lines)
    quiet = [line["fall"] for line in lines if line["dominant"] is None]
    print(f"needed: fall {fall:.0f} (of {len(quiet)} without a large effect), lead {lead:.0f}")
    large = [line for line in lines if line["dominant"] is not None]
    for line in large:
        if line["score"] != "right":
            off = line["least"] / line["put"] - 1.0
            print(
                f"| {line['seed']} | {line['dominant'].replace('_', ' ')} | {line['score']} | {line['fall']:.0f} | "
                f"{line['known']:.0f} | {line['lead']:.0f} | {line['rival'].replace('_', ' ')} | {off:+.0%} | "
                f"{line['relative_error']:.0%} | {verdict(line, fall, lead)} |"
            )
    for right in (False, True):
        own = [verdict(line, fall, lead) for line in large if (line["score"] == "right") == right]
        print("right" if right else "not right", len(own), dict(Counter(own).most_common()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("journals", nargs="*", type=Path)
    parser.add_argument("--right", type=int, default=0, help="so many of the right ones of a journal besides")
    parser.add_argument("--quiet", type=int, default=0, help="so many without a large effect")
    parser.add_argument("--seeds", default="", help="only these, separated by commas")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--summary", action="store_true", help="of what is in --out")
    options = parser.parse_args()

    if options.summary:
        summarise(lines_of(options.out))
        return

    done = {(line["seed"], line["dominant"]) for line in lines_of(options.out)}
    only = {int(seed) for seed in options.seeds.split(",") if seed}
    for journal in options.journals:
        for line in chosen(lines_of(journal), options.right, options.quiet):
            if (line["seed"], line["dominant"]) in done or (only and line["seed"] not in only):
                continue
            found = asked(line) | {"journal": journal.name}
            append(found, options.out)
            print({k: v for k, v in found.items() if k != "J"}, flush=True)


if __name__ == "__main__":
    main()
