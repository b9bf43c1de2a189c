"""Of each kind of verdict how many were wrong on made-up machines, from the kept journals -> hexsim/inference/calibration.toml

    python benchmarks/stated_chances.py

Custom machines from the seeds on that nobody had looked at; hydraulic ones as they were scored once, with an effect of the library
or outside it, alone or beside small ones. A name is wrong if neither it nor anything that it is tied with is in the machine.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "tracing"), str(ROOT / "benchmarks")]
from journal import RESULTS, lines_of  # noqa: E402

from hexsim.inference.stated import WORDS, hydraulic  # noqa: E402

STATED = ROOT / "hexsim" / "inference" / "calibration.toml"
CUSTOM = ("own_calibration", "own_formulas")
CLEAN = tuple(f"tracing_{name}" for name in ("library_bench", "library_hexapod", "outside_bench", "four_way"))
ROUGH = ("tracing_rough", "tracing_rough_hexapods")
TRACED = ("rough_coverage", "rough_coverage_unseen", "next_measurement")
Verdicts = Iterator[tuple[str, bool]]  # kind, and whether it is wrong


def main() -> None:
    STATED.write_text(state(), encoding="utf-8")


def state() -> str:
    found: dict[str, list[bool]] = {kind: [] for kind in WORDS}
    for journals, verdicts in ((CUSTOM, of_custom), (CLEAN, of_clean), (ROUGH, of_rough), (TRACED, of_traced)):
        for name in journals:
            for line in lines_of(RESULTS / f"{name}.jsonl.gz"):
                for kind, wrong in verdicts(line):
                    found[kind].append(wrong)
    lines = [
        "# Verdicts on made-up machines, each scored once. Written by `python benchmarks/stated_chances.py`.",
        f"journals = {[*CUSTOM, *CLEAN, *ROUGH, *TRACED]}".replace("'", '"'),
        *(f"{key(kind)} = {{ wrong = {sum(own)}, of = {len(own)} }}" for kind, own in found.items()),
    ]
    return "\n".join(lines) + "\n"


def key(kind: str) -> str:
    return kind if kind.isalpha() else f'"{kind}"'


def of_custom(line: dict[str, Any]) -> Verdicts:
    from own_calibration import FORMULA, SEALED, SEALED_FORMULAS, verdicts_of

    is_formula = "truth" in line
    if line["seed"] < (SEALED_FORMULAS if is_formula else SEALED):
        return
    judged = verdicts_of(line["missing"], line["steps"], line.get("truth"))
    for step, verdict in zip(line["steps"], judged, strict=True):
        yield "tie" if step["tied"] else "name", verdict == "wrong"
    if line["stated"] is not None:
        yield "formula", line["stated"] not in FORMULA.get(line["missing"], [line.get("truth")])


def of_clean(line: dict[str, Any]) -> Verdicts:
    from four_edge_plant import EFFECTS
    from tracing_evaluation import RIGHT

    right = set(RIGHT.get(line["effect"], ())) | set(EFFECTS[line["effect"]][2] if line["effect"] in EFFECTS else ())
    for name, *where, _, tied in line["named"]:
        place = line.get("leg") is None or where == [f"leg {line['leg']}"]
        yield (
            hydraulic(line["verdict"], tied),
            not (name in right and place) and not any(map(right.__contains__, bare(tied))),
        )


def of_rough(line: dict[str, Any]) -> Verdicts:
    from tracing_evaluation import RIGHT
    from tracing_rough import label, there

    place, small = f" in leg {line['leg']}" if line.get("leg") else "", there(line) - RIGHT.get(line["dominant"], set())
    right = {name + place for name in RIGHT.get(line["dominant"], ())}
    for own in line["named"]:
        is_there = label(own) in right or own["name"] in small
        yield (
            hydraulic("partly", own["tied"]),
            not is_there and not right & set(own["tied"]) and not small & set(bare(own["tied"])),
        )


def of_traced(line: dict[str, Any]) -> Verdicts:
    from next_measurement_score import names_there, right_names

    first = line.get("first", {"named": []})
    right = right_names(line, first.get("never_taken", False)) | names_there(line["effects"])
    for name, _, _, tied, *_ in first["named"]:
        verdict = first.get("verdict", "partly" if line["rough"] else "explained")  # the first journals do not say it
        yield hydraulic(verdict, tied), name not in right and not right & set(bare(tied))


def bare(labels: list[str]) -> list[str]:
    """Without their legs."""
    return [label.split(" in ")[0] for label in labels]


if __name__ == "__main__":
    main()
