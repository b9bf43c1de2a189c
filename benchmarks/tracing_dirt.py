"""Verdicts on a bench's logs with ordinary dirt in them (tests/tracing/dirt.py): one line a case.

python benchmarks/tracing_dirt.py ../shared/measured/bench_leakage [--cases "100 Hz,7 missing rows"] [--seed 100]
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
import traceback
import zlib
from pathlib import Path

import numpy as np
import polars as pl

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "tracing")]
from dirt import CASES  # noqa: E402  the tests' dirt

from hexsim.errors import HexsimError  # noqa: E402
from hexsim.tracing.trace import trace  # noqa: E402

LOGS = ("fit", "sweep", "validate")


def dirty_folder(source: Path, folder: Path, case: str, seed: int) -> None:
    """The machine and its logs with dirt."""
    shutil.copy(source / "machine.toml", folder / "machine.toml")
    rng = np.random.default_rng([seed, zlib.crc32(case.encode())])
    for name in LOGS:
        CASES[case](pl.read_csv(source / f"{name}.csv.gz"), rng).write_csv(folder / f"{name}.csv")


def line_of(source: Path, case: str, seed: int) -> dict[str, object]:
    """What the trace says of one case."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        dirty_folder(source, Path(folder), case, seed)
        try:
            report = trace(folder, fit=LOGS[:2], validate=LOGS[2:]).report
        except HexsimError as error:
            said = {"verdict": "refused", "sentence": str(error).replace(folder, "")}
        except Exception:
            said = {"verdict": "TRACEBACK", "sentence": traceback.format_exc()[-600:]}
        else:
            effects = {effect["name"]: effect["parameters"] for effect in report["effects"]}
            repairs = [found["description"] for found in report["findings"]["fit"] if found["severity"] == "notice"]
            said = {"verdict": report["verdict"], "effects": effects, "repairs": repairs}
    return {"set": source.name, "case": case, "seed": seed, **said, "seconds": round(time.perf_counter() - started, 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sources", nargs="+", type=Path)
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--seed", type=int, default=100)
    asked = parser.parse_args()
    for source in asked.sources:
        for case in asked.cases.split(","):
            print(json.dumps(line_of(source, case, asked.seed)), flush=True)


if __name__ == "__main__":
    main()
