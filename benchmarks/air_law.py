"""Air that hexsim identifies on a second plant, by today's law and by the one before it: `python benchmarks/air_law.py`.

The second plant (tests/tracing/other_plant.py) has free air by Boyle with an adiabatic ripple. Until 772e2325 hexsim's air was
compressed adiabatically from the atmosphere on; a copy of the sources with that one line traces the same logs. Ten minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "tracing"))
BOYLE = "air = air_fraction * ATMOSPHERE / absolute\n"
ADIABATIC = "air = air_fraction * (ATMOSPHERE / absolute) ** (1.0 / 1.4)\n"
TRACE = """
import json, sys
import hexsim as hx
print(json.dumps(hx.trace(sys.argv[1], ["fit", "sweep"]).report["effects"]))
"""


def sources_before(place: Path) -> Path:
    """A copy of the packages with the law before, in `place`."""
    for package in ("hexsim", "compensation", "models"):
        shutil.copytree(ROOT / package, place / package, ignore=shutil.ignore_patterns("__pycache__"))
    law = place / "hexsim" / "hydraulics" / "chamber.py"
    text = law.read_text(encoding="utf-8")
    if BOYLE not in text:
        raise SystemExit(f"{law.name} has another law of air by now")
    law.write_text(text.replace(BOYLE, ADIABATIC), encoding="utf-8")
    return place


def found(sources: Path, folder: Path) -> str:
    """What a trace of `folder` names: effects with numbers and standard errors."""
    run = subprocess.run(
        [sys.executable, "-c", TRACE, folder],
        env=os.environ | {"PYTHONPATH": str(sources)},
        cwd=sources,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    named = [
        f"{effect['name']} {value:.3g} +- {effect['standard_error'][key]:.1g}"
        for effect in json.loads(run.stdout.splitlines()[-1])
        for key, value in effect["parameters"].items()
    ]
    return ", ".join(named) or "nothing"


def main() -> None:
    from other_plant import write_machine

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--air", type=float, nargs="+", default=[0.002, 0.007, 0.02], help="volume shares at one atmosphere"
    )
    parser.add_argument("--seed", type=int, default=840)
    arguments = parser.parse_args()
    table = Table("air of the bench", "by the law before", "by Boyle")
    with tempfile.TemporaryDirectory() as made:
        before = sources_before(Path(made) / "before")
        for i, air in enumerate(arguments.air):
            folder = Path(made) / f"air_{i}"
            write_machine(folder, arguments.seed + i, {"entrained_air": air})
            table.add_row(f"{air:g}", found(before, folder), found(ROOT, folder))
    Console().print(table)


if __name__ == "__main__":
    main()
