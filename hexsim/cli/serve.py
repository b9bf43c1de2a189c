"""`hexsim serve`: the machine in real time, driven over UDP by a host."""

from __future__ import annotations

import socket
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hexsim.cli import options
from hexsim.cli.console import compiling_said, output, print_json, stop_when_signalled, terminated_like_interrupted
from hexsim.errors import HexsimError

if TYPE_CHECKING:
    from hexsim.simulation import Run
    from hexsim.simulation.serve_status import Status
    from hexsim.simulation.vehicle_link import Vehicle

LONGEST_LOG_S = 600.0
LOOPBACK, XPLANE_PORT = "127.0.0.1", 49000  # where X-Plane takes packets, by its own documentation
RREF_RATE_Hz = 60  # that X-Plane is asked for; it sends once a frame at most
PORT = 47110  # of hexsim.simulation.serve; a test holds them together, because importing it loads the simulator


def register(app: typer.Typer) -> None:
    app.command("serve")(serve)


def serve(
    machine: options.MachineName = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; only this computer unless you say otherwise.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="UDP port; 0 takes a free one.")] = PORT,
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
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            help="Packets of a simulator, washed out: flightgear, xplane, xplane12, xplane-rref, outsim or a TOML file.",
        ),
    ] = None,
    washout: Annotated[
        str, typer.Option(help="Of --from: classical, adaptive, or a TOML file of its parameters.")
    ] = "classical",
    strict: Annotated[
        bool, typer.Option("--strict", help="Of --from: a simulator that is silent for 0.5 s is a fault, not a pause.")
    ] = False,
    buffer_ms: Annotated[
        float | None,
        typer.Option(min=0.0, max=500.0, help="Latency given away so that less is predicted; default: the machine's."),
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Stop after this time (s); default: Ctrl-C.")] = None,
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
    from hexsim.cueing.washout import washout_of
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
        buffer_s=None if buffer_ms is None else 1e-3 * buffer_ms, vehicle=vehicle_of(source, strict) if source else None,
        washout=washout_of(washout),
    )  # fmt: skip
    with compiling_said(tell), terminated_like_interrupted():
        server = Server(
            with_machine, host, port, compensator=compensator, scenario=what, start=start, timestep=timestep,
            telemetry=telemetry, lockstep=lockstep, host_input=host_input,
            record_s=min(duration or LONGEST_LOG_S, LONGEST_LOG_S) if out else 0.0,
        )  # fmt: skip
    address = f"{server.address[0]}:{server.address[1]}"
    tell(f"{with_machine.name} listens on udp://{address}, state {start}; Ctrl-C stops it")
    with server, stop_when_signalled() as stop:
        status = server.run(duration, stop=stop, report=lambda now: tell(now.line()))
    if out and server.record:
        tell(f"stopped; writing {out} (Ctrl-C leaves it)")
        write(server.record.run(), out)
    if json:
        print_json({"address": address, **asdict(status)})
    else:
        print_status(status)


def tell(text: str) -> None:
    """A line on stderr."""
    typer.echo(text, err=True)


def vehicle_of(source: str, strict: bool) -> Vehicle:
    """The simulator that --from names: a protocol, or xplane-rref@ADDRESS:PORT of X-Plane's own socket."""
    from hexsim.cueing.protocols import rref_requests
    from hexsim.cueing.toml_protocol import protocol
    from hexsim.simulation.vehicle_link import Vehicle

    name, at, where = source.partition("@")
    if name != "xplane-rref":
        return Vehicle(decode=protocol(source), name=source, strict=strict)
    host, colon, port = where.partition(":")
    if (at and not host) or (colon and not (port.isascii() and port.isdigit() and 0 < int(port) < 2**16)):
        raise HexsimError(f"--from {source!r}: give xplane-rref, or xplane-rref@ADDRESS or xplane-rref@ADDRESS:PORT")
    try:
        address = socket.gethostbyname(host or LOOPBACK)
    except (OSError, UnicodeError) as error:
        raise HexsimError(f"--from {source!r}: {host} is no address of a computer ({error})") from None
    return Vehicle(
        decode=protocol(name), name=name, strict=strict, address=(address, int(port or XPLANE_PORT)),
        requests=tuple(rref_requests(RREF_RATE_Hz)), farewell=tuple(rref_requests(0)),
    )  # fmt: skip


def write(run: Run, out: Path) -> None:
    """The run's folder, as `hexsim run` leaves it."""
    from hexsim.cli.run import keep
    from hexsim.files.run_folder import run_folder

    with run_folder(out) as folder:
        place = keep(run, folder, lambda name: None, log_format="parquet", recording=True, report=True)
    tell(f"written to {place}")


def print_status(status: Status) -> None:
    """The last line, and how late what is felt came."""
    output().print(f"{status.line()}, at most {1e3 * status.worst_behind_s:.1f} ms behind")
    if status.latency_ms:
        found = ", ".join(f"{axis} {ms:.1f} ms" for axis, ms in status.latency_ms.items())
        output().print(f"latency from packet to felt acceleration: {found}")
