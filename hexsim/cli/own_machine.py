"""`hexsim trace` and `hexsim run` of the folder of a machine of one's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hexsim.cli.console import output, print_json, terminated_like_interrupted, text_table
from hexsim.cli.errors import say
from hexsim.cli.work import doing, interruptible, leave, made
from hexsim.errors import HexsimError

if TYPE_CHECKING:
    from hexsim.files.run_folder import RunFolder
    from hexsim.own.state_file import StateFile


def trace(folder: Path, fit: list[str], validate: list[str], out: Path | None, json: bool) -> None:
    """A machine of one's own: with states or outputs it is simulated, else its balances are formed."""
    from hexsim.files.run_folder import default_folder
    from hexsim.own.state_file import Asked, StateFile

    out = out or default_folder(f"trace-{folder.resolve().name}")
    asked = Asked(folder=str(folder.resolve()), fit=tuple(fit), validate=tuple(validate))
    told(*traced(StateFile(out, asked), out), json)


def is_unfinished(place: Path) -> bool:
    """Whether a trace of a machine of one's own has stopped in this folder."""
    from hexsim.own.state_file import FILE

    return (place / FILE).is_file()


def resume(place: Path, json: bool) -> None:
    """Go on with a trace in its folder; the result is the same."""
    from hexsim.own.state_file import StateFile

    state = StateFile.of(place)
    if not Path(state.asked.folder).is_dir():
        raise HexsimError(
            f"{state.asked.folder}, whose trace is in {place}, is not there any more: start the trace anew"
        )
    told(*traced(state, place), json)


def traced(state: StateFile, out: Path) -> tuple[dict[str, Any], Path]:
    """The report and its folder; whatever ends it early leaves what is known there, and the state."""
    from hexsim.files.run_folder import run_folder
    from hexsim.own.folder import is_simulated
    from hexsim.own.trace_files import trace_simulated
    from hexsim.tracing.own.trace import trace_folder

    folder, asked = Path(state.asked.folder), state.asked
    with made(out), run_folder(out) as place, doing() as show, terminated_like_interrupted():
        known: dict[str, Any] = {}

        def work() -> dict[str, Any]:
            run = trace_simulated if is_simulated(folder) else trace_folder
            return run(folder, asked.fit, asked.validate, place.path, show, state=state, keep=known.update)[-1]

        try:
            report = interruptible(work)
        except KeyboardInterrupt:
            leave(f"interrupted by the user; {ended_early(known, state, place, 'it was interrupted')}")
            raise
        except Exception as error:
            if not known:
                raise
            kept = ended_early(known, state, place, f"it failed: {type(error).__name__}: {error}")
            if isinstance(error, HexsimError):
                raise HexsimError(f"{error}; {kept}") from error
            say(f"the trace failed; {kept}")
            raise
        final = place.finish()
        state.forget()
    return report, final


def ended_early(known: dict[str, Any], state: StateFile, place: RunFolder, why: str) -> str:
    """Keep what is known; what there is to say."""
    from hexsim.files.atomic import write_text
    from hexsim.files.json_files import write_json
    from hexsim.own.trace_files import write_incomplete
    from hexsim.tracing.own.page import incomplete_page

    state.settle()
    if not known:
        place.discard()
        if state.entries:
            return f"nothing new was known yet; hexsim trace --resume {place.out} goes on there"
        with suppress(OSError):
            place.out.rmdir()
        return "nothing was known yet and nothing was kept"
    if "numbers" in known:
        write_incomplete(known, place.path, why)
    else:
        write_json(place.path / "report.json", known | {"incomplete": {"why": why}})
        write_text(place.path / "report.html", incomplete_page(known, why))
    final = place.finish()
    return f"what is known is in {final}; hexsim trace --resume {final} goes on there"


def told(report: dict[str, Any], final: Path, json: bool) -> None:
    """Print what was found."""
    if json:
        return print_json(report)
    console = output()
    if "balances" in report:
        print_own(report, console)
    else:
        print_candidates(report, console)
        print_simulated(report, console)
    console.print(f"files    {final}")


def print_candidates(report: Mapping[str, Any], console: Any) -> None:
    """Verdict and candidates of a machine that is simulated."""
    console.print(f"verdict  {report['verdict']}")
    rows = [
        (
            one["effect"],
            one["verdict"],
            f"{one['nats']:.1f}",
            name,
            f"{of['before']:.3g}",
            f"{of['after']:.3g}",
            one["why"],
        )
        for one in report["candidates"]
        for name, of in one["held_out"].items()
    ]
    header = ("effect", "judgment", "gain [nats]", "output", "held out before", "with it", "why")
    console.print(text_table("Candidates that were fitted", header, rows))
    for line in report["remarks"]:
        console.print(f"  {line}")


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
        for run, of in report["runs"].items()
        for name, rms in of["rms"].items()
    ]
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


OWN_STEPS = ("declared", "refit", "with_terms")
