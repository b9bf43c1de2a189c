"""`hexsim trace` and `hexsim run` of the folder of a machine of one's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hexsim.cli.console import output, print_json, terminated_like_interrupted, text_table
from hexsim.cli.work import doing, interruptible, leave

if TYPE_CHECKING:
    from hexsim.files.run_folder import RunFolder


def trace_own_folder(folder: Path, fit: list[str], validate: list[str], out: Path | None, json: bool) -> None:
    """A machine with balances of its own: balances.toml or balances.py."""
    from hexsim.files.run_folder import default_folder, run_folder
    from hexsim.tracing.own.trace import trace_folder

    with (
        run_folder(out or default_folder(f"trace-{folder.resolve().name}")) as place,
        doing() as show,
        terminated_like_interrupted(),
    ):
        known: dict[str, Any] = {}
        try:
            _, _, report = interruptible(
                lambda: trace_folder(folder, fit, validate, place.path, show, lambda report: known.update(report))
            )
        except KeyboardInterrupt:
            leave(ended_early(known, place))
            raise
        final = place.finish()
    if json:
        print_json(report)
        return
    console = output()
    print_own(report, console)
    console.print(f"files    {final}")


def trace_free_run_folder(folder: Path, fit: list[str], validate: list[str], out: Path | None, json: bool) -> None:
    """A machine of one's own that is simulated: model.toml with states or outputs."""
    from hexsim.own.trace_files import trace_simulated

    name = f"trace-{folder.resolve().name}"
    (_, report), final = whole_or_nothing(
        out, name, lambda place, show: trace_simulated(folder, fit, validate, place, show)
    )
    if json:
        return print_json(report)
    console = output()
    console.print(f"verdict  {report['verdict']}")
    rows = [
        (one["effect"], one["verdict"], f"{one['nats']:.1f}", name, f"{of['before']:.3g}", f"{of['after']:.3g}", one["why"])
        for one in report["candidates"] for name, of in one["held_out"].items()
    ]  # fmt: skip
    header = ("effect", "judgment", "gain [nats]", "output", "held out before", "with it", "why")
    console.print(text_table("Candidates that were fitted", header, rows))
    for line in report["remarks"]:
        console.print(f"  {line}")
    print_simulated(report, console)
    console.print(f"files    {final}")


def run_own_folder(folder: Path, out: Path | None, json: bool) -> None:
    """Fit a machine of one's own and simulate its runs from their inputs."""
    from hexsim.own.folder import load_simulated
    from hexsim.own.run import run_folder_of

    name = folder.resolve().name
    report, final = whole_or_nothing(out, name, lambda place, show: run_folder_of(load_simulated(folder), place, show))
    if json:
        return print_json(report)
    console = output()
    print_simulated(report, console)
    console.print(f"files    {final}")


def whole_or_nothing(
    out: Path | None, name: str, work: Callable[[Path, Callable[[str, float], None]], Any]
) -> tuple[Any, Path]:
    """What work(folder, show) gives, and the folder that it has filled; nothing is kept where it is interrupted."""
    from hexsim.files.run_folder import default_folder, run_folder

    with run_folder(out or default_folder(name)) as place, doing() as show, terminated_like_interrupted():
        try:
            done = interruptible(lambda: work(place.path, show))
        except KeyboardInterrupt:
            place.discard()
            leave("interrupted by the user; nothing was kept")
            raise
        return done, place.finish()


def print_simulated(report: Mapping[str, Any], console: Any) -> None:
    """Residuals of free runs, and numbers."""
    rows = [
        (run, "never seen" if of["held_out"] else "fitted", name, f"{rms:.4g} {of['unit'].get(name, '')}")
        for run, of in report["runs"].items() for name, rms in of["rms"].items()
    ]  # fmt: skip
    console.print(text_table("Free runs from recorded inputs", ("run", "", "output", "rms of the residual"), rows))
    numbers = [
        (
            name,
            number["unit"],
            f"{number['value']:.5g} ± {number['standard_error']:.2g}",
            "at its bound" if number["at_bound"] else "",
        )
        for name, number in report["numbers"].items()
    ]
    console.print(text_table("Numbers", ("number", "unit", "value", ""), numbers))


def print_own(report: Mapping[str, Any], console: Any) -> None:
    """Verdict, remarks, budget and numbers of each balance."""
    from rich.text import Text

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
    logs = [(run, one) for run, said in report["findings"].items() for one in said]
    if logs:
        console.print()
        console.print(text_table("What was read, repaired and moved", ("run", ""), logs))


def ended_early(known: dict[str, Any], place: RunFolder) -> str:
    """Keep the balances that are traced; what there is to say."""
    from hexsim.files.json_files import write_json

    if not known.get("balances"):
        place.discard()
        return "interrupted by the user; no balance was traced yet and nothing was kept"
    names = ", ".join(balance["name"] for balance in known["balances"])
    write_json(place.path / "report.json", known | {"incomplete": {"why": "it was interrupted"}})
    return f"interrupted by the user; what is known of {names} is in report.json in {place.finish()}"


OWN_STEPS = ("declared", "refit", "with_terms")
