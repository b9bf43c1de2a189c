"""What a model file may say beyond balances: a machine that can be simulated.

[signals.command_V]                       # a logged column; needs no table where nothing is to be said of it
quantity = "voltage"                      # what it is: the general effects are offered from it
hold = true                               # keeps its value between samples; default: a straight line

[constants]                               # numbers, and formulas with a name
force_N = "35.15 * command_V"

[parameters.mass_kg]                      # a number that is fitted
start = 100.0                             # where the search begins
low = 1.0                                 # bounds; sign = 1: not below 0
declared = 95.0                           # with uncertainty: a Gaussian prior
uncertainty = 5.0
each = "run"                              # a constant of each run (payload, zero); default: one of the machine

[states.position_m]                       # measured where a column has the name, hidden where none has
rate = "velocity_m_s"
start = "first(position_m)"               # a number, a formula of parameters, first(COLUMN), first_rate(COLUMN), or "free"

[states.velocity_m_s]                     # or as a balance: storage * rate = sum
sum = "force_N - viscous_N_s_m * velocity_m_s"
storage = "mass_kg"
quantity = "force"                        # of the sum: which general effects may be missing in it
dry = ["coulomb_N", "coulomb_N"]          # friction that holds at rest: forwards, backwards
start = "first_rate(position_m)"

[memory.friction_N]                       # elements with a memory: see hexsim.own.elements
kind = "dahl"
of = "velocity_m_s"
coulomb = "coulomb_N"
stiffness = "stiffness_N_m"

[outputs.position_m]                      # what is compared with the column of this name
formula = "position_m"
noise = 1e-6                              # of a sample, one standard deviation; default: from what is left

[[effects]]                               # candidates of one's own, beside the general ones
name = "end stop"
on = "velocity_m_s"                       # joins the sum of this state
adds = "-stop_N_m * max(position_m - 0.25, 0)"
parameters = { stop_N_m = { sign = 1, start = 1000.0 } }

[simulation]
scheme = "rk4"                            # or "heun", "euler"
steps = 4                                 # between two samples
first_samples = 20                        # that first(...) and free starts may use; scored after them
"""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict, Field

from hexsim.readers.mapping import Section

Scheme = Literal["rk4", "heun", "euler"]
Quantity = Literal[
    "force", "torque", "velocity", "speed", "position", "angle", "pressure", "flow", "level", "current", "voltage",
    "temperature", "signal",
]  # fmt: skip
MOST = 64  # states, parameters, outputs, elements, effects: each


class SignalTable(Section):
    """[signals.COLUMN]"""

    quantity: Quantity | None = None
    hold: bool = False
    delay: str | None = Field(default=None, description="formula of parameters [s]: this input acts later by it")


class ParameterTable(Section):
    """[parameters.NAME]"""

    start: float | None = Field(default=None, allow_inf_nan=False)
    low: float | None = Field(default=None, allow_inf_nan=False)
    high: float | None = Field(default=None, allow_inf_nan=False)
    sign: int = Field(default=0, ge=-1, le=1)
    declared: float | None = Field(default=None, allow_inf_nan=False)
    uncertainty: float | None = Field(default=None, gt=0.0, allow_inf_nan=False)
    scale: float | None = Field(default=None, gt=0.0, allow_inf_nan=False)
    unit: str = Field(default="", max_length=30)
    each: Literal["machine", "run"] = "machine"


class StateTable(Section):
    """[states.NAME]"""

    rate: str | None = None
    sum: str | None = None
    storage: str = "1"
    quantity: Quantity | None = None
    dry: list[str] = Field(default_factory=list, max_length=2)
    low: str | None = None
    high: str | None = None
    start: float | str = 0.0
    guess: float = Field(default=0.0, allow_inf_nan=False, description="of a free start")
    unit: str = Field(default="", max_length=30)


class MemoryTable(Section):
    """[memory.NAME]; further keys are those of its kind."""

    model_config = ConfigDict(frozen=True, extra="allow", strict=True)
    __pydantic_extra__: dict[str, str | float]  # pyright: ignore[reportIncompatibleVariableOverride]

    kind: str
    of: str


class OutputTable(Section):
    """[outputs.COLUMN]"""

    formula: str
    noise: float | None = Field(default=None, gt=0.0, allow_inf_nan=False)
    quantity: Quantity | None = None
    unit: str = Field(default="", max_length=30)


class EffectTable(Section):
    """[[effects]]: what joins a model. on: a state's sum (adds), an input or an output (becomes)."""

    name: str = Field(min_length=1, max_length=80)
    on: str
    adds: str | None = None
    becomes: str | None = None
    parameters: dict[str, ParameterTable] = Field(default_factory=dict, max_length=MOST)
    memory: dict[str, MemoryTable] = Field(default_factory=dict, max_length=MOST)


class SimulationTable(Section):
    """[simulation]"""

    scheme: Scheme = "rk4"
    steps: int = Field(default=4, ge=1, le=200)
    first_samples: int = Field(default=1, ge=1, le=10_000)
    shooting_s: float | None = Field(default=None, gt=0.0, le=1e4)
    starts: int = Field(default=1, ge=1, le=50, description="searches from numbers drawn about the start")
    from_s: float = Field(default=0.0, ge=0.0, le=1e5, description="the fit and the score begin here")


class ModelTables(Section):
    """The part of a model file that is simulated."""

    signals: dict[str, SignalTable] = Field(default_factory=dict, max_length=MOST)
    constants: dict[str, str | float] = Field(default_factory=dict, max_length=4 * MOST)
    parameters: dict[str, ParameterTable] = Field(default_factory=dict, max_length=MOST)
    states: dict[str, StateTable] = Field(default_factory=dict, max_length=MOST)
    memory: dict[str, MemoryTable] = Field(default_factory=dict, max_length=MOST)
    outputs: dict[str, OutputTable] = Field(default_factory=dict, max_length=MOST)
    effects: list[EffectTable] = Field(default_factory=list, max_length=4 * MOST)
    simulation: SimulationTable = SimulationTable()
