"""`--from` and `--washout`, of `serve` and `live`: a simulator that knows no motion base."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from hexsim.packets import address_of

if TYPE_CHECKING:
    from hexsim.simulation.vehicle_link import Vehicle

LOOPBACK = "127.0.0.1"

Source = Annotated[
    str | None,
    typer.Option(
        "--from",
        help="Packets of a simulator, washed out: flightgear, jsbsim, xplane, xplane12, xplane-rref, outsim, lfs, beamng "
        "or a TOML file.",
    ),
]
WashoutName = Annotated[str, typer.Option(help="Of --from: classical, adaptive, or a TOML file of its parameters.")]


def vehicle_of(source: str, strict: bool) -> Vehicle:
    """The simulator that --from names: a protocol, or xplane-rref@ADDRESS:PORT of X-Plane's own socket."""
    from hexsim.cueing.protocols import rref_requests
    from hexsim.cueing.toml_protocol import protocol
    from hexsim.simulation.vehicle_link import Vehicle

    name, at, where = source.partition("@")
    if name != "xplane-rref":
        return Vehicle(decode=protocol(source), name=source, strict=strict)
    allowed = "xplane-rref, or xplane-rref@ADDRESS or xplane-rref@ADDRESS:PORT"
    # where X-Plane takes packets, by its own documentation
    address = address_of(where if at else LOOPBACK, 49000, f"--from {source!r}", allowed)
    return Vehicle(
        decode=protocol(name),
        name=name,
        strict=strict,
        address=address,
        requests=tuple(rref_requests(60)),  # [Hz] it sends once a frame at most
        farewell=tuple(rref_requests(0)),
    )
