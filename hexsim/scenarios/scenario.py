"""A scenario: setpoint signals for the platform's degrees of freedom or for single actuators, with duration and fade.

    name = "heave"
    mode = "dof"                 # or "actuator"
    duration_s = 20.0
    fade_s = 2.0
    [axes.z]                     # x y z [m], roll pitch yaw [rad]; in actuator mode leg_1 .. leg_6 (bench: leg_1) [m]
    kind = "sine"                # see hexsim.setpoints.signals
    amplitude = 0.05
    frequency_Hz = 0.5
    [machine]                    # optional: what this scenario changes in the machine, dotted keys
    "valve.spool_frequency_Hz" = 0.0
    [[faults]]                   # optional, see hexsim.simulation.faults

Setpoints are relative to neutral (all actuators at half stroke).
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from hexsim.declaration import Name, Section, between
from hexsim.errors import HexsimError, one_of, refuse_missing_file, shortened
from hexsim.files.toml_files import read_toml, validation_sentence
from hexsim.setpoints.signal import Faded, Signal, faded
from hexsim.setpoints.signal_file import SampledSignal, read_setpoint_file
from hexsim.setpoints.signals import FmuSignal, SignalTable, signal_from_table, signal_to_dict

DOF_NAMES = ("x", "y", "z", "roll", "pitch", "yaw")
ROTATIONS = ("roll", "pitch", "yaw")
LEG_NAMES = tuple(f"leg_{i}" for i in range(1, 7))
FOLDER = Path(__file__).parent
DEFAULT_MACHINE = "micro_motion_system"


class ScenarioSettings(Section):
    """What a scenario file says besides its signals, its changes of the machine and its faults."""

    name: Name = Field("", min_length=0, description="as it stands in tables and folders; default the file's name")
    description: str = Field("", max_length=1000, description="what it asks, in a line")
    mode: Literal["dof", "actuator"] = Field("dof", description="axes of the platform, or single legs")
    duration_s: float = Field(20.0, gt=0.0, le=86_400.0, description="[s], at most a day")
    fade_s: float = between(0.0, 86_400.0, "the signals grow from nothing within this [s]", default=2.0)
    fade: Literal["linear", "smooth"] = Field("linear", description="how they grow")
    figures_from_s: float | None = between(0.0, 86_400.0, "the smoothness figures count from here [s]", default=None)
    machine_name: str = Field(DEFAULT_MACHINE, description="machine to take when the user names none")


class ScenarioFile(ScenarioSettings):
    """A scenario file. The faults are checked with the machine, see `hexsim.simulation.faults`."""

    axes: dict[str, SignalTable] = Field(description="x y z roll pitch yaw, or leg_1 .. leg_6: its signal")
    machine: dict[str, Any] = Field({}, description="what the scenario changes in the machine: keys as in machine.toml")
    faults: list[dict[str, Any]] = Field([], max_length=100, description="what breaks, and when")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """What is asked of the machine.

    signals: axis -> Signal without its fade, in mode "dof" x..yaw, in mode "actuator" leg_1..leg_6.
    machine_name: machine to take when the user names none. machine_changes: {"valve.overlap_m": value}.
    figures_from_s: the smoothness figures count from here; None = after three fade times and 60 % of the run, so that a
    compensator has had its time to learn, but leaving at least one period.
    """

    name: str
    mode: Literal["dof", "actuator"]
    signals: Mapping[str, Signal]
    duration_s: float = 20.0
    fade_s: float = 2.0
    fade: Literal["linear", "smooth"] = "linear"
    figures_from_s: float | None = None
    machine_name: str = DEFAULT_MACHINE
    machine_changes: Mapping[str, Any] = field(default_factory=dict)
    faults: tuple[Mapping[str, Any], ...] = ()
    description: str = ""

    def __post_init__(self) -> None:
        """Raise HexsimError for a setting out of bounds or an axis that the mode does not have."""
        where = f"scenario {shortened(str(self.name))}"
        try:
            ScenarioSettings.model_validate({key: getattr(self, key) for key in ScenarioSettings.model_fields})
        except ValidationError as error:
            raise HexsimError(f"{where}: {validation_sentence(error, ScenarioSettings)}") from None
        allowed = DOF_NAMES if self.mode == "dof" else LEG_NAMES
        for axis in self.signals:
            if axis not in allowed:
                raise HexsimError(
                    f"{where}: unknown axis {shortened(repr(axis))}; in mode '{self.mode}' give any of {', '.join(allowed)}"
                )

    def setpoint(self, axis: str) -> Signal:
        """The faded signal of an axis."""
        signal = self.signals[axis]
        return signal if isinstance(signal, Faded) else faded(signal, self.fade_s, self.fade)

    @property
    def allow_native(self) -> bool:
        """Whether one of its signals is a foreign FMU, which the user has allowed to run."""
        bare = [signal.signal if isinstance(signal, Faded) else signal for signal in self.signals.values()]
        return any(isinstance(signal, FmuSignal) for signal in bare)

    @property
    def frequency_Hz(self) -> float | None:
        """Basic harmonic, when all driven axes are sines of one frequency."""
        found = {signal.fundamental_Hz for signal in self.signals.values()}
        return found.pop() if len(found) == 1 else None

    @property
    def period_s(self) -> float | None:
        """Time after which all signals repeat, when they share one period."""
        found = {signal.period_s for signal in self.signals.values()}
        return found.pop() if len(found) == 1 else None

    @property
    def figures_start_s(self) -> float:
        """Where the smoothness figures begin."""
        if self.figures_from_s is not None and self.figures_from_s < self.duration_s:
            return self.figures_from_s
        start = min(max(3 * self.fade_s, 0.6 * self.duration_s), 0.8 * self.duration_s)
        if self.frequency_Hz:
            start = min(start, self.duration_s - 1.02 / self.frequency_Hz)
        return max(start, min(self.fade_s, 0.5 * self.duration_s))

    def evaluate(self, time_s: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Setpoint, velocity, acceleration (n, 6) relative to neutral; axes that are not driven stay at zero."""
        names = DOF_NAMES if self.mode == "dof" else LEG_NAMES
        out = np.zeros((3, len(time_s), 6))
        for axis in self.signals:
            signal = self.setpoint(axis)
            column = names.index(axis)
            out[:, :, column] = signal.value(time_s), signal.velocity(time_s), signal.acceleration(time_s)
        return out[0], out[1], out[2]

    def to_dict(self) -> dict[str, Any]:
        """The data that `scenario_from_dict` takes."""
        tables: dict[str, Any] = {
            "name": self.name,
            "description": self.description,
            "mode": self.mode,
            "duration_s": self.duration_s,
            "fade_s": self.fade_s,
            "fade": self.fade,
            "machine_name": self.machine_name,
        }
        if self.figures_from_s is not None:
            tables["figures_from_s"] = self.figures_from_s
        tables["axes"] = {axis: signal_to_dict(signal) for axis, signal in self.signals.items()}
        if self.machine_changes:
            tables["machine"] = dict(self.machine_changes)
        if self.faults:
            tables["faults"] = [dict(fault) for fault in self.faults]
        return tables


def available_scenarios() -> list[str]:
    """Names of the scenarios that travel with hexsim."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def scenario_from_dict(tables: Mapping[str, Any], source: str = "scenario", *, allow_native: bool = False) -> Scenario:
    """Make a scenario from its tables. allow_native: foreign FMUs in it may run. Raises HexsimError that names the key."""
    given = {"name": Path(source).stem[:100], **tables}
    if "says" in given:  # the key's name in older files
        given["description"] = given.pop("says")
    try:
        checked = ScenarioFile.model_validate(given)
    except ValidationError as error:
        raise HexsimError(f"{source}: {validation_sentence(error, ScenarioFile)}") from None
    return Scenario(
        signals={
            axis: signal_from_table(table, f"{source}: [axes.{axis}]", allow_native=allow_native)
            for axis, table in checked.axes.items()
        },
        machine_changes=_dotted(checked.machine),
        faults=tuple(checked.faults),
        **{key: getattr(checked, key) for key in ScenarioSettings.model_fields},
    )


def _dotted(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            flat |= _dotted(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def load_scenario(
    name_or_path: str | Path,
    *,
    amplitude: float | None = None,
    frequency_Hz: float | None = None,
    duration_s: float | None = None,
    allow_native: bool = False,
) -> Scenario:
    """A scenario by name or from a TOML file; amplitude in m or DEGREES for rotations, as people say them.

    allow_native: foreign FMUs in it may run their code.
    """
    path = FOLDER / f"{name_or_path}.toml"
    if not os.path.isfile(path):  # unlike Path's, false for a name that no file can have
        path = Path(name_or_path)
        if path.suffix not in (".toml", ".csv", ".gz", ".parquet") or not os.path.isfile(path):
            refuse_missing_file("scenario", str(name_or_path))
            raise HexsimError(
                f"unknown scenario {shortened(repr(str(name_or_path)))}: "
                f"{one_of(str(name_or_path), available_scenarios())}, a TOML file, or a CSV or Parquet file of setpoints"
            )
    scenario = (
        scenario_from_dict(read_toml(path), str(path), allow_native=allow_native)
        if path.suffix == ".toml"
        else file_scenario(path)
    )
    if amplitude is not None or frequency_Hz is not None:
        signals = {
            axis: _restyled(signal, axis, amplitude, frequency_Hz, scenario.name)
            for axis, signal in scenario.signals.items()
        }
        scenario = dataclasses.replace(scenario, signals=signals)
    return scenario if duration_s is None else dataclasses.replace(scenario, duration_s=duration_s, figures_from_s=None)


def _restyled(signal: Signal, axis: str, amplitude: float | None, frequency_Hz: float | None, name: str) -> Signal:
    """The signal with another amplitude (m or deg) or frequency."""
    changes: dict[str, float] = {}
    fields = {item.name for item in dataclasses.fields(signal)}  # type: ignore[arg-type]
    if amplitude is not None:
        changes["amplitude"] = math.radians(amplitude) if axis in ROTATIONS else amplitude
    if frequency_Hz is not None:
        changes["frequency_Hz"] = frequency_Hz
    for key in changes:
        if key not in fields:
            raise HexsimError(
                f"scenario {name}: axis {axis} is a {signal.kind} and has no {key}: write a scenario file instead"
            )
    return dataclasses.replace(signal, **changes)  # type: ignore[type-var]


def file_scenario(path: Path) -> Scenario:
    """Setpoints from a user's CSV or Parquet file; leg columns hold piston positions, so neutral is subtracted later."""
    columns = read_setpoint_file(path)
    last = float(columns["time_s"][-1])
    names = [name for name in columns if name != "time_s"]
    if names[0].startswith("setpoint"):
        raise HexsimError(
            f"{path}: piston setpoints are replayed with `replay_scenario`, which needs the machine's stroke"
        )
    axes = {name.rsplit("_", 1)[0]: SampledSignal(path=str(path), column=name) for name in names}
    return Scenario(name=path.stem.split(".")[0][:100], mode="dof", signals=axes, duration_s=last, fade_s=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldSamples(Signal):
    """Measured setpoints, held between their samples as the motion computer held them."""

    kind = "held"
    time_s: NDArray
    values: NDArray

    def __post_init__(self) -> None:
        """Arrays are taken as they are."""

    def value(self, time_s) -> NDArray:
        index = np.searchsorted(self.time_s, np.asarray(time_s, dtype=float) + 1e-9, side="right") - 1
        return self.values[np.clip(index, 0, len(self.values) - 1)]

    def velocity(self, time_s) -> NDArray:
        return np.zeros_like(np.asarray(time_s, dtype=float))

    acceleration = velocity


def replay_scenario(name: str, time_s: NDArray, setpoints_m: NDArray, stroke_m: float) -> Scenario:
    """Play measured piston setpoints (n, n_legs) [m from full retraction] to the machine again, actuator by actuator."""
    legs = np.asarray(setpoints_m, dtype=float).reshape(len(time_s), -1) - stroke_m / 2
    start = float(time_s[0])
    relative = np.asarray(time_s, dtype=float) - start
    signals = {LEG_NAMES[i]: HeldSamples(time_s=relative, values=legs[:, i]) for i in range(legs.shape[1])}
    duration = float(time_s[-1] - start + (time_s[-1] - time_s[-2]))
    return Scenario(name=name, mode="actuator", signals=signals, duration_s=duration, fade_s=0.0, figures_from_s=0.0)
