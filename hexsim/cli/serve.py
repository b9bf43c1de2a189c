"""`hexsim serve`: the machine in real time, driven over UDP by a host."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hexsim.cli import flown, options
from hexsim.cli.console import compiling_said, output, print_json, stop_when_signalled, terminated_like_interrupted
from hexsim.errors import HexsimError, shortened
from hexsim.packets import HOST_PORT

if TYPE_CHECKING:
    from hexsim.simulation.serve_status import Status


def register(app: typer.Typer) -> None:
    app.command("serve")(serve)


def serve(
    machine: options.MachineName = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; only this computer unless you say otherwise.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="UDP port; 0 takes a free one.")] = HOST_PORT,
    compensator: options.CompensatorName = "none",
    scenario: Annotated[str | None, typer.Option(help="What manual mode plays; default heave.")] = None,
    start: Annotated[str, typer.Option(help="neutral (mid stroke, pressure up) or off (on its stops).")] = "neutral",
    timestep: options.TimeStep = None,
    telemetry: Annotated[
        bool, typer.Option("--telemetry", help="Send the host what the sensors read, at the log rate.")
    ] = False,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="Machine time follows the host's packets, not the clock.")
    ] = False,
    source: flown.Source = None,
    washout: flown.WashoutName = "classical",
    strict: Annotated[
        bool, typer.Option("--strict", help="Of --from: a simulator that is silent for 0.5 s is a fault, not a pause.")
    ] = False,
    buffer_ms: Annotated[
        float | None,
        typer.Option(min=0.0, max=500.0, help="Latency given away so that less is predicted; default: the machine's."),
    ] = None,
    stream: options.StreamTo = None,
    duration: Annotated[float | None, options.EndAfter] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder to write at the end, as `run` does: the first 10 minutes."),
    ] = None,
    json: options.Json = False,
    allow_native: options.AllowNative = False,
) -> None:
    """Run the machine in real time with its host interface over UDP; shows its lag behind real time."""
    with_machine, what = options.prepare(
        scenario or "heave", options.Motion(machine=machine), allow_native=allow_native
    )
    from hexsim.cli.run import keep
    from hexsim.cueing.washout import washout_of
    from hexsim.files.run_folder import run_folder
    from hexsim.simulation.serve import HostInput, Server

    if washout != "classical" and not source:
        raise HexsimError("--washout acts on the packets of a simulator: give --from too")
    if strict and not source:
        raise HexsimError(
            "--strict acts on the packets of a simulator: give --from too (a host of its own is held to it always)"
        )
    if source and lockstep:
        raise HexsimError("--from and --lockstep exclude each other: a vehicle's packets hold no machine time")

    host_input = HostInput(
        buffer_s=None if buffer_ms is None else 1e-3 * buffer_ms,
        vehicle=flown.vehicle_of(source, strict) if source else None,
        washout=washout_of(washout),
    )
    looker = options.stream_of(stream)
    longest_s = 600.0  # of a log that is kept: 2 GB of a hexapod at 1 kHz at most
    with run_folder(out) if out else nullcontext() as folder, terminated_like_interrupted():
        with compiling_said(tell):
            server = Server(
                with_machine,
                host,
                port,
                compensator=compensator,
                scenario=what,
                start=start,
                timestep=timestep,
                telemetry=telemetry,
                lockstep=lockstep,
                host_input=host_input,
                stream=looker,
                record_s=min(duration or longest_s, longest_s) if out else 0.0,
            )
        address = f"{server.address[0]}:{server.address[1]}"
        with server, stop_when_signalled() as stop:  # before it says that it listens: whoever reads that may signal
            tell(f"{with_machine.name} listens on udp://{address}, state {start}; Ctrl-C stops it")
            teller = Teller()
            status = server.run(duration, stop=stop, report=teller)
            teller.warn(status)
        if folder and server.record:
            tell(f"stopped; writing {out} (Ctrl-C leaves it)")
            place = keep(
                server.record.run(), folder, lambda name: None, log_format="parquet", recording=True, report=True
            )
            tell(f"written to {place}")
    if json:
        print_json({"address": address, **asdict(status)})
    else:
        print_status(status)


class Teller:
    """Says the line of a status, and each warning once."""

    def __init__(self) -> None:
        self.said = 0

    def __call__(self, status: Status) -> None:
        self.warn(status)
        tell(line_of(status))

    def warn(self, status: Status) -> None:
        for text in status.new_warnings(self.said):
            tell(f"warning: {text}")
        self.said = status.cavitated


def line_of(status: Status) -> str:
    """The line of a status, with what the compensator does."""
    from hexsim.recording.summary_table import compensation_texts

    return "; ".join([status.line(), *(shortened(text, 160) for text in compensation_texts(status.compensation))])


def tell(text: str) -> None:
    """A line on stderr."""
    typer.echo(text, err=True)


def print_status(status: Status) -> None:
    """The last line, and how late what is felt came."""
    output().print(f"{line_of(status)}, at most {1e3 * status.worst_behind_s:.1f} ms behind")
    if status.latency_ms:
        found = ", ".join(f"{axis} {ms:.1f} ms" for axis, ms in status.latency_ms.items())
        output().print(f"latency from packet to felt acceleration: {found}")
