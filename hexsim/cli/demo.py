"""`hexsim demo`: what hexsim does, in two minutes and one page."""

from __future__ import annotations

import typer

from hexsim.cli import options
from hexsim.cli.console import doing_of, output, progress, terminated_like_interrupted


def register(app: typer.Typer) -> None:
    app.command("demo")(demo)


def demo(out: options.Out = None) -> None:
    """Four acts on one page: a bump, the bump compensated, a hidden effect traced, the machine live in the browser."""
    from hexsim.demo import demo as play
    from hexsim.files.run_folder import default_folder, run_folder

    with run_folder(out or default_folder("demo")) as folder, progress() as bar, terminated_like_interrupted() as check:
        acts = play(folder.path, doing_of(bar, check))
        place = folder.finish()
    for number, act in enumerate(acts, start=1):
        output().print(f"{number}. {act.title}: {act.sentence}", soft_wrap=True)
        output().print(f"   {act.command}\n", soft_wrap=True)
    output().print(f"page     {place / 'index.html'}", soft_wrap=True)
