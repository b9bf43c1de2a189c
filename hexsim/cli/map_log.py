"""`hexsim map`: a mapping file proposed for a foreign log, with a picture of its signals."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hexsim.cli import completion
from hexsim.cli.console import output
from hexsim.errors import HexsimError

if TYPE_CHECKING:
    from hexsim.readers.propose import Guess, Proposal


def register(app: typer.Typer) -> None:
    app.command("map")(propose_mapping)


def propose_mapping(
    log: Annotated[Path, typer.Argument(help="A log of any format.")],
    machine: Annotated[
        str,
        typer.Option(
            "--machine", "-m", help="Name, folder or TOML file of a machine.", autocompletion=completion.machines
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="File to write; default: mapping.toml beside the log. The picture stands beside it."
        ),
    ] = None,
) -> None:
    """Propose which column of a foreign log is which signal of the machine: a mapping.toml to be read and corrected."""
    from rich.table import Table

    from hexsim.files.atomic import written_whole
    from hexsim.machine import load_machine
    from hexsim.readers.files import raw_log
    from hexsim.readers.propose import as_toml, propose

    place = out or (log if log.is_dir() else log.parent) / "mapping.toml"
    if place.exists():
        raise HexsimError(f"{place} is there already: remove it, or give another file with --out")
    declared = load_machine(machine)
    raw = raw_log(log)
    proposal = propose(raw, declared)
    if not proposal.guesses:
        names = ", ".join(signal.name for signal in raw.signals[:40])
        raise HexsimError(f"no signal of {log} is like one of machine {declared.name}: it has {names}{raw.unread()}")
    picture = place.with_suffix(".png")
    for path, content in ((picture, drawn(proposal)), (place, as_toml(proposal, declared, log.name).encode())):
        with written_whole(path) as partial:
            partial.write_bytes(content)
    shown = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("signal", "column of the file", "unit", "because"):
        shown.add_column(name)
    for guess in ([proposal.time] if proposal.time else []) + proposal.guesses:
        shown.add_row(guess.column, guess.signal.name, guess.unit, "; ".join(guess.reasons))
    console = output()
    console.print(shown)
    for text, names in (("not found", proposal.missing), ("not used", proposal.unused)):
        if names:
            console.print(f"{text:<9} {', '.join(names)}", highlight=False, markup=False)
    console.print(f"files     {place}, {picture}", highlight=False, markup=False)


def drawn(proposal: Proposal) -> bytes:
    """The proposed signals over their samples, a panel a kind, in SI units."""
    from hexsim.recording.figure_style import legend, new_figure, png, styled
    from hexsim.signals.table import places

    kinds: dict[str, list[Guess]] = {}
    for guess in proposal.guesses:
        kinds.setdefault(places()[guess.column][0].kind, []).append(guess)

    @styled
    def figure() -> bytes:
        figure, plots = new_figure(len(kinds), "Signals as they were understood")
        for plot, guesses in zip(plots, kinds.values(), strict=True):
            signal = places()[guesses[0].column][0]
            for guess in guesses:
                step = max(len(guess.values) // 4000, 1)  # about as many points as a figure shows
                plot.plot(
                    range(0, len(guess.values), step),
                    guess.values[::step],
                    linewidth=0.8,
                    label=guess.signal.name[-28:],
                )
            plot.set_ylabel(f"{signal.label} [{signal.unit}]", fontsize=8)
            legend(plot)
        plots[-1].set_xlabel("sample")
        return png(figure)

    return figure()
