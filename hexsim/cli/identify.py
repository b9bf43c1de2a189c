"""`hexsim identify`: a machine behind its host interface, measured and traced until no further motion would help."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hexsim.cli import options
from hexsim.cli.console import doing_of, output, print_json, progress, terminated_like_interrupted, text_table
from hexsim.cli.errors import EXIT_CODE, INTERRUPTED
from hexsim.packets import HOST_PORT

if TYPE_CHECKING:
    from hexsim.identification import Story


def register(app: typer.Typer) -> None:
    app.command("identify")(identify)


def identify(
    machine: Annotated[Path, typer.Argument(help="The machine as declared: name, folder or TOML file.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for logs, traces and the story; goes on in an old one.")
    ],
    host: Annotated[str, typer.Option(help="ADDRESS:PORT of the machine's host interface.")] = f"127.0.0.1:{HOST_PORT}",
    minutes: Annotated[float, typer.Option(min=0.5, max=600.0, help="Machine time to use (min).")] = 5.0,
    compensate: Annotated[
        bool,
        typer.Option("--compensate", help="At the end: the machine's bump in heave before and after compensation."),
    ] = False,
    largest: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="Share of the limits in [host_limits] that motions may use.")
    ] = 1.0,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Draw every motion beside its limits into OUT/motions; drive nothing.")
    ] = False,
    recording: options.Recording = True,
    json: options.Json = False,
) -> None:
    """Measure the machine behind a host interface, trace it, design the next motion, until no further motion would help.

    Exit code 2 where a fault of the machine or of the link ended it, or where the host has stopped the machine; what was
    found by then is kept. Ctrl-C lowers the machine, within 10 s; a second one leaves it as it is.
    """
    from hexsim.identification.host import address_of

    address = address_of(host)
    if dry_run:
        _draw(machine, out, compensate, largest)
        return
    from hexsim.identification import identify as run
    from hexsim.identification.story import write_recordings, write_story

    with progress() as bar, terminated_like_interrupted() as check:
        show = _said(doing_of(bar, check), bar.disable)
        story = run(machine, address, minutes, out, show, compensate=compensate, largest=largest)
        place = write_story(story)
        if recording and story.rounds and not story.interrupted:
            show("writing recordings", 0.99)
            write_recordings(story)
    if json:
        print_json(story.to_json())
    else:
        _tell(story, place)
    if story.failed or story.interrupted:
        raise typer.Exit(EXIT_CODE if story.failed else INTERRUPTED)


def _said(show: Callable[[str, float], None], no_display: bool) -> Callable[[str, float], None]:
    """The same, and where a display would not say it: that the machine is being lowered, which may take its time."""
    from hexsim.identification.rounds import LOWERING

    def said(doing: str, share: float) -> None:
        if doing == LOWERING and no_display:
            typer.echo(f"{LOWERING}: up to 10 s; Ctrl-C leaves it as it is", err=True)
        show(doing, share)

    return said


def _draw(machine: Path, out: Path, compensate: bool, largest: float) -> None:
    """The motions that are known before anything is driven, as pictures and a table."""
    from hexsim.identification.plan import draw, planned
    from hexsim.identification.rounds import declared
    from hexsim.motion_computer.host_limiter import HostLimiter

    known, rows = declared(machine, out), []
    limiter = HostLimiter(known, largest)
    for name, setpoints in planned(known, largest, compensate).items():
        place = draw(known, setpoints, name, out, largest)
        legs = limiter.motion(setpoints)["leg"]
        rows.append(
            (
                name.replace("_", " "),
                f"{len(setpoints) * limiter.period_s:.1f}",
                f"{1e3 * abs(legs[0]).max():.1f}",
                f"{1e3 * abs(legs[1]).max():.0f}",
                f"{abs(legs[2]).max():.2f}",
                f"{abs(legs[3]).max():.0f}",
                str(place),
            )
        )
    header = ("motion", "s", "leg mm", "mm/s", "m/s2", "m/s3", "picture")
    output().print(text_table("Motions that would be driven; nothing was", header, rows))
    output().print(
        "Later motions are designed from what is measured, within the same limits; each is drawn there before it is driven.",
        soft_wrap=True,
    )


def _tell(story: Story, place: Path) -> None:
    """What came of it, in the terminal."""
    console = output()
    for one in story.rounds:
        console.print(
            f"round {one.number}  {one.verdict}: {'; '.join(one.sentences) or 'nothing left open'}", soft_wrap=True
        )
    console.print(f"ended    {story.ended}", soft_wrap=True)
    if story.bump:
        console.print(f"bump     {story.bump.before:.3f} m/s2 with plain control, {story.bump.after:.3f} compensated")
    elif story.no_bump:
        console.print(f"bump     {story.no_bump}", soft_wrap=True)
    console.print(f"story    {place}")
