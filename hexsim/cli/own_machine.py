"""`hexsim trace` of a folder with balances of its own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hexsim.cli.console import doing_of, output, print_json, progress, terminated_like_interrupted, text_table


def trace_own_folder(folder: Path, fit: list[str], validate: list[str], out: Path | None, json: bool) -> None:
    """A machine with balances of its own: balances.toml or balances.py."""
    from hexsim.files.run_folder import default_folder, run_folder
    from hexsim.tracing.own.trace import trace_folder

    with (
        run_folder(out or default_folder(f"trace-{folder.resolve().name}")) as place,
        progress() as bar,
        terminated_like_interrupted() as check,
    ):
        _, _, report = trace_folder(folder, fit, validate, place.path, doing_of(bar, check))
        final = place.finish()
    if json:
        print_json(report)
        return
    console = output()
    print_own(report, console)
    console.print(f"files    {final}")


def print_own(report: Mapping[str, Any], console: Any) -> None:
    """Verdict, remarks, budget and numbers of each balance."""
    from rich.text import Text

    logs = [(run, one) for run, said in report["findings"].items() for one in said]
    if logs:
        console.print(text_table("What was read, repaired and moved", ("run", ""), logs))
    for balance in report["balances"]:
        console.print()
        console.print(Text.assemble((f"{balance['name']}  ", "bold"), balance["verdict"]))
        pulses = [f"run {run}: {text}" for run, text in balance["pulses"].items()]
        for line in (
            *balance["remarks"],
            *pulses,
            *balance["extremes"],
            *balance["refused"],
            f"next: {balance['next']}",
        ):
            console.print(Text(f"  {line}"))
        rows = [
            (row["run"], " + ".join(row.get("chosen", [])) or "–", *(f"{row[key]:.3g}" for key in OWN_STEPS))
            for row in balance["budget"]
        ]
        title = f"rms of the rest [{balance['unit']}], each run held out"
        console.print(
            text_table(title, ("run", "chosen without it", *(key.replace("_", " ") for key in OWN_STEPS)), rows)
        )
        numbers = []
        for name, number in balance["coefficients"].items():
            place = balance["places"].get(name)
            declared = "–" if number["declared"] is None else f"{number['declared']:.5g}"
            at = "" if place is None else f"{place['place']:.4g}"
            value = f"{number['value']:.5g} ± {number['standard_error']:.2g}"
            numbers.append((name, number["unit"], value, declared, at))
        console.print(text_table("Numbers", ("number", "unit", "value", "declared", "place"), numbers))


OWN_STEPS = ("declared", "refit", "with_terms")
