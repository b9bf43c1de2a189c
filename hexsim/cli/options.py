"""Options that several commands share."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from hexsim.cli import completion
from hexsim.errors import HexsimError, shortened

if TYPE_CHECKING:
    from hexsim.machine import Machine
    from hexsim.scenarios import Scenario
    from hexsim.simulation.hosted import Host
    from hexsim.simulation.stream import Stream

ScenarioName = Annotated[
    str,
    typer.Argument(
        help="Name (see `hexsim list scenarios`), TOML file, or a file of setpoints.",
        autocompletion=completion.scenarios,
    ),
]
AnyScenario = Annotated[
    str | None,
    typer.Argument(
        help="Name, TOML file, or a file of setpoints; without it: what there is.", autocompletion=completion.scenarios
    ),
]
MachineName = Annotated[
    str | None,
    typer.Option(
        "--machine",
        "-m",
        help="Name, folder or TOML file; default: the scenario's.",
        autocompletion=completion.machines,
    ),
]
GivenMachine = Annotated[
    str, typer.Argument(help="Name, folder or TOML file of a machine.", autocompletion=completion.machines)
]
CompensatorName = Annotated[
    str,
    typer.Option(
        "--compensator",
        "-c",
        help="Name (see `hexsim list compensators`) or package.module:Class.",
        autocompletion=completion.compensators,
    ),
]
CompensatorNames = Annotated[
    str,
    typer.Option(
        "--compensator",
        "--compensators",
        "-c",
        help="Name (see `hexsim list compensators`) or package.module:Class. Several with "
        "commas, or all: side by side.",
        autocompletion=completion.several(completion.compensators),
    ),
]
Amplitude = Annotated[float | None, typer.Option(help="Amplitude of the driven axes (m, or degrees for rotations).")]
Frequency = Annotated[float | None, typer.Option(help="Frequency of the driven axes (Hz).")]
Duration = Annotated[float | None, typer.Option(help="Simulated time (s).")]
EndAfter = typer.Option("--duration", "--seconds", min=1e-3, max=1e9, help="End after this time (s); default: Ctrl-C.")
Seed = Annotated[int, typer.Option(min=0, help="Seed of the sensor noise; same seed, same log to the bit.")]
Fast = Annotated[bool, typer.Option("--fast", help="Tendon model: the legs' inertia lumped into the platform.")]
TimeStep = Annotated[
    float | None,
    typer.Option("--timestep", min=1e-6, max=1e-3, help="Constant time step (s); default: chosen from the machine."),
]
Out = Annotated[Path | None, typer.Option("--out", "-o", help="Folder to write; default runs/<time>-<scenario>.")]
Packets = Annotated[
    str | None,
    typer.Option(
        "--host",
        help="A host that knows no future drives: packets a second, and more as in 60,jitter=0.2,loss=0.02,buffer=0.02 or "
        "60,derivatives, where packets carry velocities and accelerations.",
    ),
]
Recording = Annotated[bool, typer.Option("--recording/--no-recording", help="Write recordings for Rerun.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON on stdout and nothing else there.")]
StreamTo = Annotated[
    str | None,
    typer.Option(
        "--stream",
        help="Who looks on: ADDRESS:PORT takes JSON by UDP (PlotJuggler: 127.0.0.1:9870); foxglove://127.0.0.1:8765 listens for "
        "Foxglove; rerun+http://127.0.0.1:9876/proxy is a Rerun viewer.",
    ),
]
AllowNative = Annotated[
    bool, typer.Option("--allow-native", help="Run the native code of foreign FMUs: only of people whom you trust.")
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", help="Change a value: valve.overlap_m=20e-6, or scenario.fade_s=1. Repeat for more."),
]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="Change a value: valve.overlap_m=20e-6. Repeat for more. Several with commas: a run for each."
    ),
]


def parse_value(text: str) -> Any:
    """A number, true/false, quoted text or list as TOML reads it; else the text itself."""
    from hexsim.files.toml_files import parse_toml

    try:
        return parse_toml(f"value = {text}")["value"]
    except ValueError:
        return text


def parse_changes(settings: list[str] | None) -> dict[str, str]:
    """`key=value` pairs as key -> text."""
    changes = {}
    for setting in settings or []:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip() or not value.strip():
            raise HexsimError(
                f"--set {shortened(repr(setting))} is not key=value: give for example --set valve.overlap_m=20e-6"
            )
        changes[key.strip()] = value.strip()
    return changes


@dataclass(frozen=True, kw_only=True)
class Motion:
    """The options that choose machine and motion."""

    machine: MachineName = None
    amplitude: Amplitude = None
    frequency: Frequency = None
    duration: Duration = None


AS_DECLARED = Motion()


def flattened(command: Callable[..., None]) -> Callable[..., None]:
    """The command with each parameter that is a dataclass of options in place of its fields, as Typer reads them."""
    parameters: list[inspect.Parameter] = []
    groups: dict[str, Any] = {}
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        fields: Any = [parameter]
        if dataclasses.is_dataclass(parameter.annotation):
            groups[parameter.name] = parameter.annotation
            hints = get_type_hints(parameter.annotation, include_extras=True)
            fields = [
                parameter.replace(name=field.name, default=field.default, annotation=hints[field.name])
                for field in dataclasses.fields(parameter.annotation)
            ]
        parameters += [field.replace(kind=inspect.Parameter.KEYWORD_ONLY) for field in fields]

    @functools.wraps(command)
    def called(**values: Any) -> None:
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in dataclasses.fields(group)})
        command(**values)

    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return called


def stream_of(text: str | None) -> Stream | None:
    """What takes the signals; says which layout Foxglove can import."""
    if not text:
        return None
    from hexsim.simulation.stream import FOXGLOVE, LAYOUT, open_stream

    stream = open_stream(text)
    if text.startswith(FOXGLOVE):
        typer.echo(f"Foxglove: open the connection ws://{text.removeprefix(FOXGLOVE)}; layout: {LAYOUT}", err=True)
    return stream


def host_of(packets: str | None) -> Host | None:
    """The host that `--host` describes."""
    from hexsim.simulation.hosted import Host

    return None if packets is None else Host.parse(packets)


def prepare(
    scenario_name: str, motion: Motion, settings: list[str] | None = None, *, allow_native: bool = False
) -> tuple[Machine, Scenario]:
    """Machine and scenario with everything the options change."""
    from hexsim.scenarios.settings import apply_settings, scenario_and_machine

    scenario, machine = scenario_and_machine(
        scenario_name,
        motion.machine,
        amplitude=motion.amplitude,
        frequency_Hz=motion.frequency,
        duration_s=motion.duration,
        allow_native=allow_native,
    )
    changes = {key: parse_value(text) for key, text in parse_changes(settings).items()}
    scenario, machine = apply_settings(scenario, machine, changes, source="--set", allow_native=allow_native)
    return machine, scenario


Mapping = Annotated[
    Path | None,
    typer.Option(help="Mapping file for foreign names and units; default: mapping.toml beside the log."),
]
