"""`hexsim trace`: measured logs against the model."""

from __future__ import annotations

import json as json_module
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hexsim.cli import completion, explain_effects, options, own_machine
from hexsim.cli.console import output, print_json, terminated_like_interrupted, text_table
from hexsim.cli.errors import say
from hexsim.cli.work import doing, interruptible, leave, made
from hexsim.errors import HexsimError, Interrupted

if TYPE_CHECKING:
    from hexsim.files.run_folder import RunFolder
    from hexsim.tracing.state import Trace
    from hexsim.tracing.store import Asked

    Show = Callable[[str, float], None]
    Keep = Callable[[Trace], None]

VERDICT_STYLE = {"explained": "green", "nothing missing": "green", "partly": "yellow", "unexplained": "yellow"}


def register(app: typer.Typer) -> None:
    app.command("trace")(trace)


def trace(
    machine: Annotated[
        Path | None, typer.Argument(help="Folder with machine.toml, or model.toml, and the machine's logs.")
    ] = None,
    fit: Annotated[
        list[str] | None, typer.Option(help="Log to fit on, name or path; repeat for more. Default fit.")
    ] = None,
    validate: Annotated[
        list[str] | None, typer.Option(help="Held-out log, name or path; repeat for more. Default validate.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder to write; default runs/<time>-trace-<machine>.")
    ] = None,
    next_file: Annotated[
        Path | None,
        typer.Option("--next", help="Scenario file to write: the motion that tells most about what stays open."),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(
            min=0.001, help="What people can put on the machine [kg]; --next may ask for it. Default: its machine file."
        ),
    ] = None,
    loaded: Annotated[
        list[str] | None, typer.Option(help="Log that was taken with this load on; repeat for more.")
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(help="Folder of a trace that did not come to its end: go on there; the result is the same."),
    ] = None,
    mapping: options.Mapping = None,
    recording: options.Recording = True,
    explain: Annotated[
        str | None,
        typer.Option(
            help="What an effect is, its signature, what to check and how to mend it; then end.",
            autocompletion=completion.effects,
        ),
    ] = None,
    list_effects: Annotated[
        bool, typer.Option("--list", help="The library of effects with signatures; then end.")
    ] = False,
    json: options.Json = False,
) -> None:
    """Identify the physical effect that the declared machine is missing in measured logs, if it is missing one."""
    from hexsim.own.files import model_file

    if list_effects:
        return explain_effects.print_library(json)
    if explain is not None:
        return explain_effects.print_explanation(explain, out, json)
    if resume is not None:
        if machine is not None or fit or validate or out is not None or load is not None or loaded or mapping:
            raise HexsimError(
                "--resume FOLDER goes on with the machine, logs and options that the trace there began with: give it alone"
            )
        if own_machine.is_unfinished(resume):
            if next_file is not None:
                raise HexsimError(
                    "--next designs a motion for a machine with machine.toml: this trace is of a machine of your own"
                )
            return own_machine.resume(resume, json)
        return told(*resumed(resume, next_file, recording), json)
    if machine is None:
        raise HexsimError("trace needs the folder of a machine; --list shows the effects, --explain EFFECT one of them")
    if model_file(machine) is not None:
        if mapping is not None:
            raise HexsimError("a machine with balances of its own has its mapping.toml in its folder: put it there")
        return own_machine.trace(machine, fit or [], validate or [], out, json)
    carried = (load, loaded or [])
    names = (fit or ["fit"], validate or ["validate"])
    told(*trace_machine(machine, *names, out, next_file, recording, carried, mapping), json)


def told(report: dict[str, Any], final: Path, json: bool) -> None:
    """Print what a trace has found."""
    if json:
        return print_json(report)
    print_trace(report, final)
    for line in report.get("next", {}).get("lines", []):
        output().print(f"next     {line}", soft_wrap=True)


def trace_machine(
    machine: Path,
    fit: list[str],
    validate: list[str],
    out: Path | None,
    next_file: Path | None,
    recording: bool,
    carried: tuple[float | None, list[str]],
    mapping: Path | None = None,
) -> tuple[dict[str, Any], Path]:
    """The report of a machine's trace, and the folder it is in. carried: a load [kg], and the logs taken with it."""
    from hexsim.files.run_folder import default_folder
    from hexsim.machine.files import find_machine_file
    from hexsim.tracing.store import Asked

    place = find_machine_file(machine).resolve()
    asked = Asked(
        machine=str(machine.resolve() if machine.exists() else machine),
        fit=tuple(fit),
        validate=tuple(validate),
        load_kg=carried[0],
        loaded=tuple(carried[1]),
        mapping=None if mapping is None else str(mapping.resolve()),
    )
    out = out or default_folder(f"trace-{place.parent.name}")

    def work(folder: Path, show: Show, keep: Keep) -> Trace:
        from hexsim.tracing.trace import trace as run

        return run(machine, fit, validate, folder, show, *carried, keep=keep, mapping=mapping)

    return traced(work, asked, out, next_file, recording)


def resumed(folder: Path, next_file: Path | None, recording: bool) -> tuple[dict[str, Any], Path]:
    """The report of a trace that goes on, and its folder."""
    from hexsim.tracing.store import Stored

    def work(place: Path, show: Show, keep: Keep) -> Trace:
        from hexsim.tracing.trace import resume

        return resume(folder, place, show, keep)

    return traced(work, Stored(folder).asked, folder, next_file, recording)


def traced(
    work: Callable[[Path, Show, Keep], Trace], asked: Asked, out: Path, next_file: Path | None, recording: bool
) -> tuple[dict[str, Any], Path]:
    """Do it, with the state of every step in `out`; whatever ends it early leaves a report of what is known there."""
    from hexsim.files.run_folder import run_folder
    from hexsim.tracing.trace import forget, kept_in

    with made(out), run_folder(out) as folder, doing() as show, terminated_like_interrupted():
        latest: list[Trace] = []

        def keep(state: Trace) -> None:
            latest[:] = [state]
            with writing:
                save(state)

        writing, save = threading.Lock(), kept_in(out, asked)
        try:
            result = interruptible(lambda: work(folder.path, show, keep))
        except KeyboardInterrupt:
            leave(interrupted(latest, folder, writing))
            raise
        except Exception as error:
            if not latest:
                raise
            known = f"what is known until then is in {folder.finish()}; hexsim trace --resume {out} goes on there"
            if isinstance(error, HexsimError):
                raise HexsimError(f"{error}; {known}") from error
            say(f"the trace failed; {known}")
            raise
        report = json_module.loads((folder.path / "report.json").read_text(encoding="utf-8"))
        final = folder.finish()  # what was found is safe; recordings come to it
        forget(out)
        if recording:
            show("recording", 0.98)
            record(asked, result, final, markdown(report))
        if next_file is not None:
            report["next"] = design_next(result, next_file, show)
    return report, final


def interrupted(latest: list[Trace], folder: RunFolder, writing: threading.Lock) -> str:
    """The report of what is known, at once; what there is to say."""
    if not latest:
        folder.discard()
        with suppress(OSError):
            folder.out.rmdir()
        return "interrupted by the user; nothing was known yet and nothing was kept"
    from hexsim.tracing.report.incomplete import write_incomplete

    write_incomplete(latest[0], folder.path, "it was interrupted")
    place = folder.finish()
    writing.acquire(timeout=1.0)  # a state that is being written
    return (
        f"interrupted by the user after the step {latest[0].steps[-1].name}; what is known is in {place}; "
        f"hexsim trace --resume {place} goes on there"
    )


def design_next(result: Trace, place: Path, show: Callable[[str, float], None]) -> dict[str, Any]:
    """Write the scenario of the next measurement; returns what it is expected to give."""
    from hexsim.files.atomic import write_text
    from hexsim.tracing.design import next_measurement

    found = next_measurement(result, tell=show)
    write_text(place, found.text())
    return found.to_json() | {"lines": found.lines(), "file": str(place)}


def record(asked: Asked, result: Trace, final: Path, text: str) -> None:
    """Recordings beside the report. Interrupted by the user: the report is whole all the same."""
    from hexsim.machine.files import find_machine_file
    from hexsim.tracing.report.recording import write_trace_recordings

    logs = find_machine_file(asked.machine).parent
    try:
        write_trace_recordings(logs, asked.validate, result.machine, result.fitted, final, text, asked.mapping_file)
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted while the recordings were written; the report is whole in {final}") from None


def print_trace(report: Mapping[str, Any], place: Path) -> None:
    """Verdict, effects with numbers and errors, what is unexplained, and the error before and after."""
    from rich.text import Text

    from hexsim.tracing.report.readings import term_sentence, total_sentence
    from hexsim.tracing.report.tables import chances, checks_of

    console = output()
    verdict = report["verdict"]
    console.print(Text.assemble("verdict  ", (verdict, f"bold {VERDICT_STYLE.get(verdict, '')}".strip())))
    for said in chances(report):
        console.print(f"chance   {said}")
    for remark in report.get("remarks", []):
        console.print(f"note     {remark}")
    for line in report.get("would_show", []):
        console.print(f"hidden   {line}")
    console.print()
    for title, header, rows in (
        _effects(report),
        _unexplained(report),
        _budget(report),
        _errors(report),
        _steps(report),
        _findings(report),
    ):
        if rows:
            console.print(text_table(title, header, rows))
            console.print()
    for effect in report.get("effects", []):
        for said in filter(None, (term_sentence(effect), total_sentence(effect))):
            console.print(f"known    {said}")
        for name, check in checks_of(effect):
            console.print(f"check    {name.replace('_', ' ')}: {check}")
    console.print(f"files    {place}")


def markdown(report: Mapping[str, Any]) -> str:
    """Verdict, effects and unexplained residuals for the text panel of the recording."""
    from hexsim.tracing.report.tables import effect_rows, unexplained_rows

    lines = [f"verdict: **{report['verdict']}**", ""]
    for effect in effect_rows(report):
        numbers = "; ".join(f"{name} {value}" for name, value in effect["values"])
        lines.append(f"- **{effect['title']}**, {effect['where']}: {numbers or effect['description']}")
    lines += [
        f"- unexplained residual in the {rest['balance']} balance of {rest['place']}: {rest['description']}"
        for rest in unexplained_rows(report)
    ]
    return "\n".join(lines)


def _findings(report: Mapping[str, Any]) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    rows = [(log, found["description"]) for log, own in report.get("findings", {}).items() for found in own]
    return "What was found and repaired in the logs", ("log", "finding"), rows


def _steps(report: Mapping[str, Any]) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    rows = [(step["name"], step["sentence"], f"{step['seconds']:.1f}") for step in report.get("steps", [])]
    return "What was done", ("step", "decided", "s"), rows


def _effects(report: Mapping[str, Any]) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    from hexsim.recording.summary_table import number
    from hexsim.tracing.report.readings import without_error

    rows = []
    for effect in report.get("effects", []):
        values = [
            f"{key} = {value:.3g}, {why}"
            if (why := without_error(effect, key))
            else f"{key} = {value:.3g} ± {effect.get('standard_error', {}).get(key, float('nan')):.1g}"
            for key, value in effect.get("parameters", {}).items()
        ]
        name = effect["name"] or "learned term"
        tied = ", ".join(effect.get("tied_with", [])) or "–"
        gain = number(effect.get("evidence", {}).get("block_cv_gain"))
        rows.append((name, effect["where"], "\n".join(values), tied, gain))
    return "What the model is missing", ("effect", "where", "parameters", "tied with", "gain"), rows


def _unexplained(report: Mapping[str, Any]) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    from hexsim.recording.summary_table import number

    rows = [
        (
            item["balance"],
            item["where"],
            f"{number(item['rms'])} {item['unit']}",
            str(item.get("depends_on") or "–"),
            number(item.get("r2_cv")),
        )
        for item in report.get("unexplained", [])
    ]
    return "Unexplained residuals", ("balance", "where", "rms", "depends on", "R²"), rows


def _budget(report: Mapping[str, Any]) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    """Step by step the largest multiple of the noise of each kind of signal."""
    from hexsim.signals.channels import kind_of

    table: dict[str, dict[str, float]] = {}
    for row in report.get("budget", []):
        own, kind = table.setdefault(row["step"], {}), kind_of(row["channel"])
        value = row["multiple_of_noise"]
        own[kind] = max(own.get(kind, 0.0), float("inf") if value is None else value)
    kinds = list(dict.fromkeys(kind for own in table.values() for kind in own))
    rows = [(step, *(f"{own.get(kind, float('nan')):.3g}" for kind in kinds)) for step, own in table.items()]
    return "Error budget on held-out motion, times the noise", ("step", *kinds), rows


def _errors(report: Mapping[str, Any]) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    rows = []
    for log, channels in report.get("error", {}).items():
        for channel, errors in channels.items():
            cells = [f"{errors[key]:.3g}" if errors.get(key) is not None else "–" for key in ERROR_COLUMNS]
            rows.append((log, channel, *cells))
    return "Error on held-out motion, rms", ("log", "signal", *(name.replace("_", " ") for name in ERROR_COLUMNS)), rows


ERROR_COLUMNS = ("declared", "refit", "with_effect", "noise")
