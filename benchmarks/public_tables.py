"""Public tables: EMPS, cascaded tanks, Bouc-Wen, by free runs of declared models -> docs/results/public_tables.md

    python benchmarks/public_tables.py [--data ../shared/measured] [--work runs/public_tables] [--out docs/results/public_tables.md]

Each table is a folder of its own in --work (model.toml of examples/own_machines, logs as CSV) that `hexsim run` and `hexsim trace` take
as well. Fits and names see the estimation records alone; the test records are simulated once, from their inputs and first samples.
"""

from __future__ import annotations

import argparse
import json
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from own_calibration import JOURNAL, SEALED, rows_of, verdict_of
from scipy.io import loadmat

from hexsim.files.atomic import write_text
from hexsim.files.json_files import write_json
from hexsim.files.log_files import write_log
from hexsim.inference.likelihood import Fit, fit
from hexsim.inference.stated import stated
from hexsim.own.folder import OwnFolder, load_simulated
from hexsim.own.model import model_of
from hexsim.own.problem import fit_own, problem_of
from hexsim.own.run import simulated
from hexsim.own.trace import OwnTrace
from hexsim.own.trace_files import trace_simulated

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples" / "own_machines"
BOUC_WEN_HZ, BOUC_WEN_PERIOD = 750.0, 8192
PERIODS = 2  # of the multisine to fit; the first one settles and is not scored


def prepared(name: str, work: Path, logs: dict[str, dict[str, np.ndarray]]) -> Path:
    """A folder with the model and these logs."""
    folder = work / name
    folder.mkdir(parents=True, exist_ok=True)
    text = (EXAMPLES / name / "model.toml").read_text(encoding="utf-8")
    write_text(folder / "model.toml", text.replace('"../../../../shared/measured/emps"', '"."'))
    for run, columns in logs.items():
        write_log(pl.DataFrame(columns), folder / f"{run}.csv")
    return folder


def emps(data: Path, work: Path) -> dict[str, Path]:
    """1 kHz; what the models need of both records."""
    logs = {}
    for run in ("DATA_EMPS", "DATA_EMPS_PULSES"):
        read: dict[str, Any] = loadmat(data / "emps" / f"{run}.mat")
        n = len(read["t"])
        logs[run] = {"time_s": np.arange(n) * 1e-3, "position_m": read["qm"][:, 0], "command_V": read["vir"][:, 0]}
    return {"declared": prepared("emps_simulated", work, logs), "entry": prepared("emps_asymmetric", work, logs)}


def cascaded_tanks(data: Path, work: Path) -> dict[str, Path]:
    """4 s a sample."""
    table = np.genfromtxt(data / "cascaded_tanks" / "dataBenchmark.csv", delimiter=",", skip_header=1)
    clock = np.arange(len(table)) * 4.0
    logs = {
        "estimation": {"time_s": clock, "pump_V": table[:, 0], "level_V": table[:, 2]},
        "validation": {"time_s": clock, "pump_V": table[:, 1], "level_V": table[:, 3]},
    }
    return {
        name: prepared(folder, work, logs)
        for name, folder in (("declared", "cascaded_tanks"), ("entry", "cascaded_tanks_overflow"))
    }


def bouc_wen(data: Path, work: Path) -> dict[str, Path]:
    """The official multisine is in steady state: three periods are simulated, the last one is scored."""
    import h5py

    with h5py.File(data / "bouc_wen" / "train.h5") as file:
        force, position = (np.asarray(file[f"multisine/{key}"])[: PERIODS * BOUC_WEN_PERIOD, 0] for key in "uy")
    official = {
        key: loadmat(data / "bouc_wen" / f"{key}.mat")[key][0]
        for key in ("uval_multisine", "yval_multisine", "uval_sinesweep", "yval_sinesweep")
    }
    runs = {
        "train": (force, position),
        "multisine": (np.tile(official["uval_multisine"], 3), np.tile(official["yval_multisine"], 3)),
        "sweep": (official["uval_sinesweep"], official["yval_sinesweep"]),
    }
    logs = {
        run: {"time_s": np.arange(len(u)) / BOUC_WEN_HZ, "force_N": u, "position_m": y} for run, (u, y) in runs.items()
    }
    return {"declared": prepared("bouc_wen", work, logs)}


TABLES: dict[str, tuple[Callable[[Path, Path], dict[str, Path]], str, float, str, str, str]] = {
    "EMPS": (emps, "DATA_EMPS_PULSES", 1e3, "mm", "dynoNet 2.64", "asymmetric friction"),
    "Cascaded tanks": (cascaded_tanks, "validation", 1.0, "V", "GRU 0.396", "overflow"),
    "Bouc-Wen, multisine": (bouc_wen, "multisine", 1e6, "um", "PNLSS 18.7", "hysteresis"),
}
SAMPLES = {
    "EMPS": slice(20, None),
    "Cascaded tanks": slice(5, None),
    "Bouc-Wen, multisine": slice(2 * BOUC_WEN_PERIOD, None),
}


def scored(fitted, folder: OwnFolder, run: str, samples: slice) -> float:
    """Rms of a free run over a test record, by the table's rule."""
    log = next(log for log in folder.validate if log.name == run)
    table, _ = simulated(fitted, log, folder.where)
    output = fitted.problem.channels[0]
    rest = (table[f"simulated_{output}"] - table[output]).to_numpy()[samples]
    return float(np.sqrt(np.mean(rest**2)))


def fitted_of(folder: OwnFolder):
    return fit_own(problem_of(folder.model, folder.fit, folder.where))


def by_error(trace: OwnTrace, folder: OwnFolder) -> Fit:
    """The declaration with what was named in it, its numbers by the rms of the whole free run: what the tables score."""
    simulation = trace.declaration.simulation.model_copy(update={"anew_s": None})
    model = model_of(trace.declaration.model_copy(update={"simulation": simulation}), folder.where)
    problem = problem_of(model, folder.fit, folder.where)
    known = dict(zip(trace.final.names, trace.final.theta, strict=True))
    return fit(problem, begin=np.array([known.get(one.name, one.start) for one in problem.numbers]), by_error=True)


def row(name: str, data: Path, work: Path) -> tuple[list[str], list[str]]:
    """Lines of the tables of figures and of names."""
    make, run, factor, unit, published, known = TABLES[name]
    began, folders = time.process_time(), make(data, work)
    loaded = load_simulated(folders["declared"])
    before = factor * scored(fitted_of(loaded), loaded, run, SAMPLES[name])
    fit_s, began = time.process_time() - began, time.process_time()
    trace, report = trace_simulated(
        folders["declared"],
        out=work / f"{folders['declared'].name}_trace",
        progress=lambda what, share: print(f"{time.process_time():6.0f} s {what}", flush=True),
    )
    final = by_error(trace, loaded)
    with_names = factor * scored(final, loaded, run, SAMPLES[name])
    trace_s = time.process_time() - began
    entry = with_names
    if "entry" in folders:
        own = load_simulated(folders["entry"])
        entry = factor * scored(fitted_of(own), own, run, SAMPLES[name])
    figures = f"| {name} | {before:.3g} | {with_names:.3g} | **{entry:.3g}** {unit} | {published} | {fit_s:.0f} + {trace_s:.0f} |"
    if name.startswith("Bouc-Wen"):
        sweep = factor * scored(final, loaded, "sweep", slice(None))
        figures += f"\n| Bouc-Wen, sine sweep | | {sweep:.3g} | **{sweep:.3g}** {unit} | | |"
    lines = [f"| {name} | {known} | {re.split('[;:]', report['verdict'])[0]} |"]  # the names follow, a row each
    for one in report["candidates"]:
        if one["effect"] not in report["verdict"]:
            continue  # what the verdict does not speak of is in the report
        errors = "; ".join(
            f"{of['before'] * factor:.3g} -> {of['after'] * factor:.3g} {unit}" for of in one["held_out"].values()
        )
        lines.append(
            f"| | {one['verdict']} | {one['effect']}: held-out parts {errors}, {one['nats']:.0f} nats; {one['why']} |"
        )
    left = [
        part.removeprefix("left beside it: ")
        for part in report["verdict"].split("; ")
        if part.startswith("left beside it")
    ]
    return [figures], [*lines, *(f"| | left beside it | {part} |" for part in left)]


def wrong_names() -> str:
    """A table of the sealed rows of own_calibration.py by thousands of seeds, with 95 % intervals (Wilson 1927)."""
    rows = [row for row in rows_of(JOURNAL) if row["seed"] >= SEALED]
    kinds = ("right", "tied", "wrong", "nothing named")
    lines = [
        "| seeds | missing | machines | right | tied with the right one | wrong | no name | wrong, 95 % |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for thousand in sorted({row["seed"] // 1000 for row in rows}):
        own = [row for row in rows if row["seed"] // 1000 == thousand]
        seeds = f"{own[0]['seed']} to {own[-1]['seed']}"
        for sort, words in (
            ("none", "nothing"),
            ("library", "an effect of the library"),
            ("outside", "an effect outside it"),
        ):
            found = [verdict_of(row["missing"], row["steps"]) for row in own if row["sort"] == sort]
            if not found:
                continue
            counted = [found.count(kind) for kind in kinds]
            low, high = wilson(counted[2], len(found))
            share = f"{100 * max(low, 0.0):.0f} to {100 * high:.0f} %"
            lines.append(f"| {seeds} | {words} | {len(found)} | {' | '.join(map(str, counted))} | {share} |")
    return "\n".join(lines)


def wilson(k: int, n: int) -> tuple[float, float]:
    """95 % interval of a share k of n."""
    z, p = 1.96, k / max(n, 1)
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "measured")
    parser.add_argument("--work", type=Path, default=Path("runs/public_tables"))
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results" / "public_tables.md")
    parser.add_argument("--only", choices=list(TABLES), action="append")
    parser.add_argument("--page", action="store_true", help="write the page from the rows that are kept in --work")
    asked = parser.parse_args()
    asked.work.mkdir(parents=True, exist_ok=True)
    for name in () if asked.page else asked.only or TABLES:
        made, lines = row(name, asked.data, asked.work)
        write_json(asked.work / f"{name}.json", {"figures": made, "names": lines})
        print("\n".join([*made, *lines]), flush=True)
    rows = [
        json.loads(place.read_text(encoding="utf-8"))
        for name in TABLES
        if (place := asked.work / f"{name}.json").is_file()
    ]
    figures, names = ([line for row in rows for line in row[key]] for key in ("figures", "names"))
    template = (ROOT / "benchmarks" / "public_tables.md.in").read_text(encoding="utf-8")
    template = template.replace("@WRONG@", wrong_names())
    template = template.replace("@STATED@", "\n".join(f"- {stated(kind)}" for kind in ("name", "tie", "formula")))
    page = template.replace("@FIGURES@", "\n".join(figures)).replace("@NAMES@", "\n".join(names))
    write_text(asked.out, page)


if __name__ == "__main__":
    main()
