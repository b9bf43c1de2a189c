"""`hexsim tune`: start parameters of a compensator, learned on the machine's simulated twin."""

from __future__ import annotations

from typing import Annotated

import typer

from hexsim.cli import options
from hexsim.cli.console import fraction_of, output, print_json, progress, terminated_like_interrupted


def register(app: typer.Typer) -> None:
    app.command("tune")(tune)


def tune(
    machine: Annotated[str, typer.Argument(help="Name, folder or TOML file: declared, or fitted by `hexsim trace`.")],
    compensator: Annotated[str, typer.Option("--compensator", "-c", help="Algorithm that learns.")] = "adaptive",
    out: options.Out = None,
    settings: options.Set = None,
    json: options.Json = False,
) -> None:
    """Learn start parameters on the simulated twin, so that a machine is compensated from its second reversal on."""
    from hexsim.files.run_folder import default_folder, run_folder

    twin, _ = options.prepare("heave", options.Motion(machine=machine), settings)
    with (
        run_folder(out or default_folder(f"tune-{twin.name}")) as folder,
        progress() as bar,
        terminated_like_interrupted(),
    ):
        from hexsim.studies.tune_start import FILE, teach

        taught = teach(twin, folder.path, compensator, fraction_of(bar, f"teaching {compensator} on {twin.name}"))
        place = folder.finish() / FILE
    if json:
        print_json(taught.to_json())
        return
    plain = max(bump for _, bump in taught.plain_m_s2)
    console = output()
    console.print(
        f"bump at the second reversal {taught.second_m_s2:.3f} m/s2, at the last ones {taught.final_m_s2:.3f}; "
        f"plain control {plain:.3f} (peak to peak, 50 Hz, on the twin)"
    )
    console.print(f"start with it: hexsim run heave --machine {machine} --compensator {place}")
