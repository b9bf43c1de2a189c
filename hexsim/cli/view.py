"""`hexsim view`: open a recording in Rerun's viewer."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from hexsim.errors import HexsimError


def register(app: typer.Typer) -> None:
    app.command("view")(view)


def view(
    folder: Annotated[Path, typer.Argument(help="Folder of a run, comparison or trace, or a .rrd file.")],
    web: Annotated[
        bool, typer.Option("--web", help="In the web browser instead of a window; this computer only.")
    ] = False,
) -> None:
    """Open the recording of a run in Rerun's viewer. Nothing but this computer can reach it.

    Rerun's usage statistics are switched off first; `rerun analytics enable` switches them on.
    """
    recordings = find_recordings(folder)
    rerun = [sys.executable, "-m", "rerun"]
    subprocess.run([*rerun, "analytics", "disable"], check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    command = [*rerun, *map(str, recordings), "--bind", "127.0.0.1"]
    if web:
        command.append("--web-viewer")
    ended = subprocess.run(command, check=False)
    if ended.returncode != 0:
        raise HexsimError(f"Rerun's viewer ended with code {ended.returncode} on {folder}: without a screen, try --web")


def find_recordings(folder: Path) -> list[Path]:
    """The recordings of a folder, or the file itself."""
    if folder.is_file() and folder.suffix == ".rrd":
        return [folder]
    if not folder.is_dir():
        raise HexsimError(f"{folder} is no folder: give the folder of a run, as `hexsim run` prints it")
    recordings = sorted(folder.glob("*.rrd"))
    if not recordings:
        raise HexsimError(f"{folder} holds no recording (.rrd): run again without --no-recording")
    return recordings
