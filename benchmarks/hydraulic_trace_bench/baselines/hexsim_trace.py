"""Baseline: hexsim's own tracer, `hx.trace` with its defaults.

    python baselines/hexsim_trace.py CASES_FOLDER answers/hexsim.json --numbers 1-40 --kind legs

A case that is answered in the file is not run again. A case that hexsim refuses is answered with nothing.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import hexsim as hx

TRANSLATED = {"platform": "machine", "all legs": "machine"}


def findings(report: dict) -> list[dict]:
    """What a trace's report.json names, as answers; a violated balance without a name is "unknown"."""
    found = []
    for effect in report["effects"]:
        if not effect["name"]:
            continue
        tied = [label.split(" in ")[0] for label in effect["tied_with"]]
        names = list(dict.fromkeys([effect["name"], *tied]))
        value = next(iter(effect["parameters"].values()), None)
        found.append({"names": names, "where": TRANSLATED.get(effect["where"], effect["where"]), "value": value})
    if not found and report["verdict"] != "nothing missing":
        return [{"names": ["unknown"]}]
    return found


def answer(folder: Path) -> list[dict]:
    """The answer to one case."""
    fit = [name for name in ("fit", "sweep") if (folder / f"{name}.csv.gz").is_file()]
    return findings(hx.trace(folder, fit=fit, validate="validate").report)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--numbers", default="1-200", help="such as 1-40")
    parser.add_argument(
        "--kind", choices=["legs", "hexapods", "all"], default="all", help="a hexapod takes five minutes"
    )
    options = parser.parse_args()
    first, _, last = options.numbers.partition("-")
    answers = json.loads(options.answers.read_text(encoding="utf-8")) if options.answers.is_file() else {}
    for k in range(int(first), int(last or first) + 1):
        name, started = f"case_{k:03d}", time.process_time()
        hexapod = not (options.cases / name / "sweep.csv.gz").is_file()
        if name in answers or options.kind == ("legs" if hexapod else "hexapods"):
            continue
        try:
            answers[name] = answer(options.cases / name)
        except hx.HexsimError as error:
            answers[name] = []
            print(f"{name} refused: {error}", file=sys.stderr)
        options.answers.write_text(json.dumps(answers, indent=1) + "\n", encoding="utf-8")
        print(f"{name} {time.process_time() - started:.1f} s {json.dumps(answers[name])}", flush=True)


if __name__ == "__main__":
    main()
