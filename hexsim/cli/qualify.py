"""`hexsim test`: the motion tests of the field on a machine (also `hexsim qualify`) or a log; a valve on its test stand."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hexsim.cli import options
from hexsim.cli.console import fraction_of, output, print_json, progress, terminated_like_interrupted
from hexsim.cli.valve import valve
from hexsim.errors import HexsimError

if TYPE_CHECKING:
    from hexsim.declaration import Machine
    from hexsim.qualification import Findings

PILOT = "1.5,0.5,1.0"  # an example: the applicant has one
Strict = Annotated[bool, typer.Option("--strict", help="Exit code 1 where a limit is exceeded.")]


def register(app: typer.Typer) -> None:
    app.command("qualify", hidden=True)(qualify)
    group = typer.Typer(
        help="Tests of a machine's motion, of a measured log, of a declared valve.", no_args_is_help=True
    )
    for name, command in (("motion", qualify), ("log", measure), ("valve", valve)):
        group.command(name)(command)
    app.add_typer(group, name="test")


def qualify(
    machine: options.MachineName = None,
    out: options.Out = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer and shorter motions: under a minute.")] = False,
    compensator: options.CompensatorName = "none",
    settings: options.Set = None,
    pack: Annotated[
        bool,
        typer.Option("--pack", help="Also 14 CFR Part 60's conditions, OMCT, raw traces, and a manifest with hashes."),
    ] = False,
    washout: Annotated[
        str, typer.Option(help="Of --pack, in flight: classical, adaptive, or a TOML file.")
    ] = "classical",
    ground: Annotated[
        str | None, typer.Option(help="Of --pack, on the ground; default: as in flight, one mode.")
    ] = None,
    pilot: Annotated[
        str, typer.Option(help="Of --pack: pilot's place from the vehicle's centre of gravity, forward, left, up (m).")
    ] = PILOT,
    json: options.Json = False,
    strict: Strict = False,
) -> None:
    """Motion tests of flight simulators on a machine: half-hertz noise, describing function, turn-around and more."""
    from hexsim.files.run_folder import default_folder, run_folder

    if not pack and (washout != "classical" or ground or pilot != PILOT):
        raise HexsimError("--washout, --ground and --pilot are of the pack: give --pack too")
    with_machine, _ = options.prepare("heave", options.Motion(machine=machine), settings)
    if pack and not with_machine.mechanics.has_platform:
        raise HexsimError(f"machine {with_machine.name} has no platform: a pack is filed for one that carries people")
    with (
        run_folder(out or default_folder(f"qualify-{with_machine.name}")) as folder,
        progress() as bar,
        terminated_like_interrupted(),
    ):
        from hexsim.qualification import judged, write_qualification

        report = fraction_of(bar, f"qualifying {with_machine.name}")
        share, kept = (0.5, _recorded(folder.path)) if pack else (1.0, {})
        result, found = judged(with_machine, quick, lambda fraction: report(share * fraction), compensator, **kept)
        write_qualification(result, found, with_machine, folder.path)
        if pack:
            filed = _pack(with_machine, found, folder.path, compensator, washout, ground, pilot, report)
            result |= {"rows": filed["rows"], "omct": filed["omct"]}
            result["passed"] = all(row["passed"] is not False for row in filed["rows"])
        place = folder.finish()
    if json:
        print_json(result)
    else:
        print_qualification(result, place)
    end_strictly(result, strict)


def _recorded(folder: Path) -> dict[str, Any]:
    """The battery's motions go into the pack."""
    from hexsim.qualification.pack import recorder

    return {"record": recorder(folder)}


def _pack(
    machine: Machine,
    found: Findings,
    folder: Path,
    compensator: str,
    washout: str,
    ground: str | None,
    pilot: str,
    report: Callable[[float], None],
) -> dict[str, Any]:
    """The tests of the pack beyond the battery's, and its files."""
    from hexsim.cueing.washout import washout_of
    from hexsim.qualification.pack import write_pack

    return write_pack(
        machine,
        found,
        folder,
        compensator=compensator,
        flight=washout_of(washout),
        ground=washout_of(ground) if ground else None,
        pilot_m=_three(pilot, "--pilot"),
        progress=lambda fraction: report(0.5 + 0.5 * fraction),
    )


def measure(
    log: Annotated[Path, typer.Argument(help="Log of one run: CSV, Parquet, MAT, MDF, MCAP, ROS 2 bag.")],
    machine: options.MachineName = None,
    mapping: Annotated[Path | None, typer.Option(help="Mapping file for foreign names and units.")] = None,
    imu_offset: Annotated[
        str, typer.Option(help="Place of the accelerometers from the platform's origin (m).")
    ] = "0,0,0",
    imu_turn: Annotated[str, typer.Option(help="Roll, pitch and yaw of their axes (deg).")] = "0,0,0",
    imu_gravity: Annotated[bool, typer.Option("--imu-gravity", help="They measure gravity too.")] = False,
    imu_bandwidth: Annotated[float | None, typer.Option(min=1.0, help="Their bandwidth (Hz).")] = None,
    sensors: Annotated[bool, typer.Option("--sensors", help="Judge a simulated log by its sensors.")] = False,
    out: options.Out = None,
    settings: options.Set = None,
    json: options.Json = False,
    strict: Strict = False,
) -> None:
    """The figures of `test motion` from a log: noise, turn-around, leg balance, perception, describing function."""
    from hexsim.files.run_folder import default_folder, run_folder
    from hexsim.qualification import Imu
    from hexsim.qualification import measure as run
    from hexsim.readers import read_log

    record = read_log(log, mapping)
    kind = {"bench": "bench", "hexapod": "micro_motion_system"}.get(record.kind, "bench")
    with_machine, _ = options.prepare("heave", options.Motion(machine=machine or kind), settings)
    imu = Imu(
        offset_m=_three(imu_offset, "--imu-offset"),
        turn_deg=_three(imu_turn, "--imu-turn"),
        has_gravity=imu_gravity,
        bandwidth_Hz=imu_bandwidth or math.inf,
    )
    with run_folder(out or default_folder(f"measure-{record.name}")) as folder, terminated_like_interrupted():
        result = run(record, with_machine, folder.path, imu if sensors or imu != Imu() else None)
        place = folder.finish()
    if json:
        print_json(result)
    else:
        print_qualification(result, place)
        for note in result["notes"]:
            typer.echo(note)
    end_strictly(result, strict)


def end_strictly(result: dict[str, Any], strict: bool) -> None:
    """With --strict: exit code 1, and which limits are exceeded, where it is not passed."""
    from hexsim.cli.errors import say

    if not strict or result["passed"]:
        return
    judged = [row for row in result["rows"] if row["passed"] is not None]
    failed = [f"{row['test']} {row['axis']}" for row in judged if not row["passed"]]
    say(
        f"{len(failed)} of {len(judged)} limits exceeded: {', '.join(dict.fromkeys(failed))}"
        if judged
        else "no limit is for the motion of this log: nothing was judged"
    )
    raise typer.Exit(1)


def _three(text: str, option: str) -> tuple[float, float, float]:
    """Three numbers with commas between them."""
    try:
        x, y, z = (float(part) for part in text.split(","))
        if math.isfinite(x + y + z):
            return x, y, z
    except ValueError:
        pass
    raise HexsimError(f"{option} {text!r}: three numbers are needed, as 0,0,0.15")


def print_qualification(result: dict[str, Any], place: Path) -> None:
    """Every row that has a limit, then how many were reported without one."""
    from rich.table import Table

    from hexsim.recording.summary_table import number

    console = output()
    what = f"compensator {result['compensator']}" if "compensator" in result else f"log {result['log']}"
    verdict = {True: "passed", False: "NOT passed", None: "no limit is for this motion"}[result["passed"]]
    title = f"{result['machine']}, {what}: {verdict}"
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, header_style="dim")
    for index, name in enumerate(("test", "axis", "figure", "value", "limit", "unit", "")):
        table.add_column(name, justify="right" if index in (3, 4) else "left")
    judged = [row for row in result["rows"] if row["passed"] is not None]
    for row in judged:
        style = None if row["passed"] else "red"
        cells = (row["test"], row["axis"], row["figure"], number(row["value"]), number(row["limit"]), row["unit"])
        table.add_row(*cells, "pass" if row["passed"] else "fail", style=style)
    console.print(table)
    console.print()
    console.print(f"{len(result['rows']) - len(judged)} more figures without a limit are in the report")
    console.print(f"files    {place}")
