"""Write the cases of HydraulicTraceBench: made-up hydraulic machines with logs, their truth apart in truth.json.

    python benchmarks/hydraulic_trace_bench/make_cases.py runs/bench                    all 200, three minutes
    python benchmarks/hydraulic_trace_bench/make_cases.py runs/bench --cases 1-40
    python benchmarks/hydraulic_trace_bench/make_cases.py runs/mine --first-seed 5000   200 others, for a private truth

Each case is held against cases.json: the same content on another processor, or a sentence and exit code 1. Only whoever
makes cases needs this repository (numpy, numba, polars); the machines are those of tests/tracing, which import nothing of
hexsim.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import json
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1] / "tests" / "tracing"))
import four_edge_plant  # noqa: E402
import other_plant  # noqa: E402
import rough_hexapods  # noqa: E402
import rough_machines  # noqa: E402
from other_effects import EFFECTS, LIBRARY_NAMES  # noqa: E402

FIRST_SEED = 910_001  # beyond every seed with which hexsim was developed or scored before
DURATION_S = 12.0  # two periods of the slowest sine of the multisine, 0.17 Hz
EVERY = 2  # rows: 500 Hz, the motion computer's rate, of the plants' 1 kHz
BLOCK = 50  # rows of one mean in the hash: 0.1 s
# of each column by how its name begins: [its unit], a quarter of the sensor's noise or less
STEPS = {"setpoint": 1e-6, "valve": 1e-4, "pressure": 1e3, "acceleration": 5e-3, "angular": 1e-2}
POSITION_STEP_M = {"bench": 3e-6, "four_way": 1e-6, "hexapod": 1e-6}  # [m] a bench's transducer has this resolution
RUNS = {"bench": ("fit", "sweep", "validate"), "hexapod": ("fit", "validate_heave")}
# group: how many machines have a large effect of the list, none, and one that is not in the list
GROUPS = {"clean": (36, 8, 6), "rough": (60, 10, 0), "four_way": (35, 5, 0), "hexapod": (34, 6, 0)}
SAME_AS = {
    "air": "entrained_air",
    "seal_friction": "pressure_dependent_friction",
    "friction_of_position": "position_dependent_friction",
}
OUTSIDE = tuple(
    name for name, own in EFFECTS.items() if not own.in_library and "bench" in own.kinds and name != "oil_warms_up"
)  # oil_warms_up has become an effect of the list's kind
SIZES = (0.7, 1.4)  # of a clean or four-way machine's effect, in typical sizes
NO_NUMBER = ("laminar_edge_merritt", "laminar_edge_wu")  # their law is another one than the list's


@dataclass(frozen=True)
class Case:
    """One machine to be made. cause: the second plant's name of its large effect, None for none."""

    name: str
    group: str
    seed: int
    cause: str | None

    @property
    def kind(self) -> str:
        """Which plant simulates it: bench, four_way or hexapod."""
        return self.group if self.group in ("four_way", "hexapod") else "bench"


def all_cases(first_seed: int = FIRST_SEED) -> list[Case]:
    """The 200 in their order, which is shuffled: a name says nothing of the group."""
    rng = np.random.default_rng(first_seed)
    drawn: list[tuple[str, str | None]] = []
    causes = {
        "clean": rough_machines.DOMINANT,
        "rough": rough_machines.DOMINANT,
        "four_way": tuple(name for name in four_edge_plant.EFFECTS if name != "none"),
        "hexapod": rough_hexapods.DOMINANT,
    }
    for group, (large, none, outside) in GROUPS.items():
        drawn += [(group, name) for name in dealt(causes[group], large, rng)]
        drawn += [(group, None)] * none
        drawn += [(group, name) for name in dealt(OUTSIDE, outside, rng)]
    order = rng.permutation(len(drawn))
    return [Case(f"case_{k + 1:03d}", drawn[i][0], first_seed + k, drawn[i][1]) for k, i in enumerate(order)]


def dealt(names: tuple[str, ...], number: int, rng: np.random.Generator) -> list[str]:
    """So many of these, each once before one comes again."""
    rounds = [rng.permutation(len(names)) for _ in range(-(-number // len(names)))]
    return [names[i] for one in rounds for i in one][:number]


def effects_of(case: Case) -> tuple[dict[str, float], int | None]:
    """What the plant is given, by its own names ("name@3": in leg 3), and the leg of the large one."""
    if case.group == "rough":
        return rough_machines.draw(case.seed, case.cause)[0], None
    if case.group == "hexapod":
        effects, _, leg = rough_hexapods.draw(case.seed, case.cause)
        return effects, leg
    if case.cause is None:
        return {}, None
    share = float(np.random.default_rng([case.seed, 79]).uniform(*SIZES))
    if case.group == "four_way":
        return {case.cause: four_edge_plant.EFFECTS[case.cause][0] * share}, None
    return {case.cause: EFFECTS[case.cause].typical * share}, None


def truth_of(case: Case) -> dict:
    """What the case's machine has and its file does not say, in the names of effects.json."""
    effects, leg = effects_of(case)
    key = case.cause if leg is None else f"{case.cause}@{leg}"
    truth: dict = {"group": case.group, "large": None, "outside": None}
    if case.cause in OUTSIDE:
        truth["outside"] = EFFECTS[case.cause].description
    elif case.cause is not None:
        truth["large"] = large_of(case, effects[key], leg)
    small = {}
    for name, size in effects.items():
        if name != key:
            bare, _, place = name.partition("@")
            small[listed(bare) + (f" in leg {place}" if place else "")] = rounded(size)
    return truth | {"small": small}


def large_of(case: Case, size: float, leg: int | None) -> dict:
    """The large effect with its accepted names, its leg and its number in the list's unit."""
    cause = str(case.cause)
    if case.kind == "four_way":
        _, _, names, _ = four_edge_plant.EFFECTS[cause]
        return {"names": list(names), "where": "leg 1", "value": rounded(size)}
    value: float | None = None if cause in NO_NUMBER else rough_machines.number_of(cause, size)
    if case.kind == "hexapod" and value is not None:
        mass = float(other_plant.declared_plant("hexapod").rig["mass"][0])
        value = size * mass if cause == "mass" else -size if cause == "leg_differs" else value
    where = f"leg {leg}" if leg else "leg 1" if EFFECTS[cause].place == "leg" else "machine"
    return {"names": [listed(cause)], "where": where, "value": None if value is None else rounded(value)}


def listed(cause: str) -> str:
    """Name in effects.json of an effect of the second plant."""
    bare = cause.removeprefix("small_")
    bare = SAME_AS.get(bare, bare)
    return LIBRARY_NAMES.get(bare, bare)


def rounded(value: float) -> float:
    """Six digits: the same on every processor."""
    return float(f"{value:.6g}")


def write_case(case: Case, folder: Path, duration_s: float = DURATION_S) -> str:
    """Write folder/case.name with machine.toml and logs, whole or not at all; returns the hash of its content."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        made, raw = Path(temporary) / "made" / case.name, Path(temporary) / "raw" / case.name
        made.mkdir(parents=True)
        simulate(case, raw, duration_s)
        (made / "machine.toml").write_bytes((raw / "machine.toml").read_bytes())
        for log in sorted(raw.glob("*.parquet")):
            steps = STEPS | {"position": POSITION_STEP_M[case.kind]}
            text = in_steps(pl.read_parquet(log).gather_every(EVERY), steps).write_csv()
            name = "validate" if log.stem.startswith("validate") else log.stem
            (made / f"{name}.csv.gz").write_bytes(gzip.compress(text.encode(), 9, mtime=0))
        shutil.rmtree(folder / case.name, ignore_errors=True)
        made.rename(folder / case.name)
    return content_hash(folder / case.name)


def simulate(case: Case, raw: Path, duration_s: float) -> None:
    """The plant's own files: Parquet at 1 kHz."""
    effects, _ = effects_of(case)
    if case.kind == "four_way":
        size = effects.get(str(case.cause))
        four_edge_plant.write_machine(raw, case.seed, case.cause or "none", size, duration_s)
    else:
        other_plant.write_machine(
            raw, case.seed, effects, case.kind, runs=RUNS[case.kind], duration_s=duration_s, suffix=".parquet"
        )


def step_of(column: str, steps: dict[str, float]) -> float | None:
    """Resolution of a column; None for the time."""
    return next((step for begin, step in steps.items() if column.startswith(begin)), None)


def in_steps(log: pl.DataFrame, steps: dict[str, float]) -> pl.DataFrame:
    """Every column in whole steps of its resolution."""
    columns = {}
    for name in log.columns:
        values, step = log[name].to_numpy(), step_of(name, steps)
        columns[name] = values.round(3) if step is None else (np.round(values / step) * step).round(7)
    return pl.DataFrame(columns)


def content_hash(folder: Path) -> str:
    """SHA-256 of machine.toml and of the means of 50 rows of every column, in steps.

    A sample that another processor rounds the other way changes a mean by a fiftieth of a step.
    """
    lines = [(folder / "machine.toml").read_text(encoding="utf-8")]
    steps = STEPS | {"position": 3e-6}
    for path in sorted(folder.glob("*.csv.gz")):
        log = pl.read_csv(gzip.decompress(path.read_bytes()))
        for name in log.columns[1:]:
            step = step_of(name, steps)
            if step is None:
                raise ValueError(f"{path}: unknown column {name}")
            rows = log[name].to_numpy()
            blocks = rows[: len(rows) // BLOCK * BLOCK].reshape(-1, BLOCK)
            numbers = " ".join(str(round(mean / step)) for mean in blocks.mean(axis=1))
            lines.append(f"{path.name} {name} {len(rows)} {numbers}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def hash_of_truth(truth: dict) -> str:
    """SHA-256 of one case's truth."""
    return hashlib.sha256(json.dumps(truth, sort_keys=True).encode()).hexdigest()


def chosen(text: str, cases: list[Case]) -> Iterator[Case]:
    """1-40 or 3,7 of the cases."""
    for part in text.split(","):
        first, _, last = part.partition("-")
        yield from cases[int(first) - 1 : int(last or first)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="gets cases/ and truth.json")
    parser.add_argument("--cases", default="1-200")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--manifest", action="store_true", help="write cases.json instead of comparing with it")
    options = parser.parse_args()
    known = {} if options.manifest else json.loads((HERE / "cases.json").read_text(encoding="utf-8"))["cases"]
    made, truths, differing = {}, {}, []
    for case in chosen(options.cases, all_cases(options.first_seed)):
        truths[case.name] = truth_of(case)
        made[case.name] = {
            "seed": case.seed,
            "content_sha256": write_case(case, options.out / "cases"),
            "truth_sha256": hash_of_truth(truths[case.name]),
        }
        if options.first_seed == FIRST_SEED and known and made[case.name] != known[case.name]:
            differing.append(case.name)
    (options.out / "truth.json").write_text(json.dumps(truths, indent=1) + "\n", encoding="utf-8")
    if options.manifest:
        text = json.dumps({"version": 1, "cases": made}, indent=1) + "\n"
        (HERE / "cases.json").write_text(text, encoding="utf-8")
    print(f"{len(made)} cases in {options.out / 'cases'}")
    if differing:
        print(f"other content than cases.json says, so do not compare scores: {', '.join(differing)}", file=sys.stderr)
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
