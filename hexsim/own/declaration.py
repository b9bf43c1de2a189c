"""What a model.toml or balances.toml may say: a machine of one's own that is simulated, balances of one, or both.

[runs]
folder = "../data"                        # where the logs are; default: the folder itself
fit = ["one", "two", "three"]             # default: all logs of the folder that are not held out
validate = ["four"]                       # scored once with the final numbers
window_s = 0.2                            # half width of the balances' window
short_window_s = 0.05                     # of rates inside a product; default: the same

# A machine that is simulated

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
parameters = { stop_N_m = { sign = 1, scale = 1000.0 } }

[simulation]
scheme = "rk4"                            # or "heun", "euler"
steps = 4                                 # between two samples
first_samples = 20                        # that first(...) and free starts may use; scored after them
anew_s = 2.0                              # fits begin anew from what is measured, so often: for what drifts; default: never

# Balances alone: sums of terms that are formulas of logged columns
[align.motor_speed_rad_s]                 # this channel is late, by another time in each part of each run
reference = "velocity_m_s"                # what it must follow; its balances then say by how much it is late
channel = "motor_speed_rad_s"             # what of it, default the channel
window_s = 0.15
constant = true                           # one delay for the whole run; default: one for each quarter

[[balances]]
name = "flow"
unit = "m3/s"
target = "4.9e-7 * motor_speed_rad_s"
terms = [{name = "area", unit = "m2", column = "-velocity_m_s", declared = 8.87e-4, uncertainty = 2e-5}]
candidates = [
    {name = "leakage", unit = "m3/s/Pa", column = "-pressure_Pa", sign = -1},
    {name = "relief", unit = "m3/s/Pa", above = "pressure_Pa"},     # max(x - place, 0): the place is found
    {name = "bypass", unit = "m3/s", step = "velocity_m_s"},        # 1 where x > place; column = "..." is its factor
    {name = "delay", unit = "s", late = "motor_speed_rad_s"},       # what a delay of that channel would do
]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, StringConstraints

from hexsim.readers.mapping import Section

Scheme = Literal["rk4", "heun", "euler"]
Quantity = Literal[
    "force",
    "torque",
    "velocity",
    "speed",
    "position",
    "angle",
    "pressure",
    "flow",
    "level",
    "current",
    "voltage",
    "temperature",
    "signal",
]
MOST = 64  # states, parameters, outputs, elements, effects: each
# a formula's name and unit hold up to four names of 80 characters
Composed = Annotated[str, StringConstraints(max_length=400)]


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
    unit: Composed = ""
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
    unit: Composed = ""


class MemoryTable(Section):
    """[memory.NAME]; further keys are those of its kind."""

    model_config = ConfigDict(frozen=True, extra="allow", strict=True)
    __pydantic_extra__: dict[str, str | float]  # pyright: ignore[reportIncompatibleVariableOverride]

    kind: str
    of: str
    start: str | None = None

    def changed(self, swap: Callable[[str], str]) -> MemoryTable:
        """With other texts for its formulas."""
        extra = {key: swap(str(value)) for key, value in (self.__pydantic_extra__ or {}).items()}
        return self.model_copy(update={"of": swap(self.of), **extra})


class OutputTable(Section):
    """[outputs.COLUMN]"""

    formula: str
    noise: float | None = Field(default=None, gt=0.0, allow_inf_nan=False)
    quantity: Quantity | None = None
    unit: Composed = ""


class EffectNumber(Section):
    """A number of an effect; sizes may be formulas of the sizes of signals (effects.toml)."""

    start: float | str | None = None
    low: float | str | None = None
    high: float | str | None = None
    scale: float | str | None = None
    sign: int = Field(default=0, ge=-1, le=1)
    unit: str = ""
    tries: list[float | str] = Field(default_factory=list, max_length=8)


class EffectRow(Section):
    """A row of effects.toml, or [[effects]] of a model file, where `on` says where."""

    name: Composed = Field(min_length=1)
    what: Literal["sum", "input", "output"] = "sum"
    of: list[Quantity] = Field(default_factory=list)
    state: Quantity | None = None
    on: str | None = None
    adds: str | None = None
    elsewhere: str | None = None
    forwards: str | None = None
    backwards: str | None = None
    becomes: str | None = None
    storage: str | None = None
    switch: bool = False
    over: list[str] = Field(default_factory=list, max_length=2)
    corners: int = Field(default=5, ge=3, le=20)
    rival: bool = False
    even: bool = False
    memory: MemoryTable | None = None
    parameters: dict[str, EffectNumber] = Field(default_factory=dict, max_length=MOST)
    source: str = ""


class SimulationTable(Section):
    """[simulation]"""

    scheme: Scheme = "rk4"
    steps: int = Field(default=4, ge=1, le=200)
    first_samples: int = Field(default=1, ge=1, le=10_000)
    starts: int = Field(default=1, ge=1, le=50, description="searches from numbers drawn about the start")
    anew_s: float | None = Field(
        default=None,
        gt=0.0,
        le=1e5,
        description="fits and candidates: a free run begins anew from what is measured, so often",
    )
    fit_by: Literal["likelihood", "error"] = Field(
        default="likelihood",
        description="error: least rms of the simulation, for long free runs of a model that is not quite right",
    )
    from_s: float = Field(default=0.0, ge=0.0, le=1e5, description="the fit and the score begin here")
    average_s: float | None = Field(
        default=None, gt=0.0, le=1e5, description="samples are means over so long: noise of inputs in a slow test"
    )


class ModelTables(Section):
    """The part of a model file that is simulated."""

    signals: dict[str, SignalTable] = Field(default_factory=dict, max_length=MOST)
    constants: dict[str, str | float] = Field(default_factory=dict, max_length=4 * MOST)
    parameters: dict[str, ParameterTable] = Field(default_factory=dict, max_length=MOST)
    states: dict[str, StateTable] = Field(default_factory=dict, max_length=MOST)
    memory: dict[str, MemoryTable] = Field(default_factory=dict, max_length=MOST)
    outputs: dict[str, OutputTable] = Field(default_factory=dict, max_length=MOST)
    effects: list[EffectRow] = Field(default_factory=list, max_length=4 * MOST)
    simulation: SimulationTable = SimulationTable()


class Runs(Section):
    """[runs]"""

    folder: str = "."
    fit: list[str] = Field(default_factory=list)
    validate_on: list[str] = Field(default_factory=list, alias="validate")
    window_s: float = Field(default=0.05, gt=0.0, le=10.0)
    short_window_s: float | None = Field(default=None, gt=0.0, le=10.0)


class Align(Section):
    """[align.CHANNEL]"""

    reference: str
    channel: str | None = None
    constant: bool = False
    window_s: float = Field(default=0.1, gt=0.0, le=10.0)


class TermTable(Section):
    """A term or a candidate."""

    name: str = Field(min_length=1, max_length=80)
    unit: str
    column: str = "1"
    declared: float | None = Field(default=None, allow_inf_nan=False)
    uncertainty: float = Field(default=0.0, ge=0.0, allow_inf_nan=False)
    sign: int = Field(default=0, ge=-1, le=1)
    above: str | None = None
    below: str | None = None
    step: str | None = None
    late: str | None = None
    place: float | None = Field(default=None, allow_inf_nan=False)


class BalanceTable(Section):
    """[[balances]]"""

    name: str = Field(min_length=1, max_length=80)
    unit: str
    target: str
    terms: list[TermTable] = Field(default_factory=list)
    candidates: list[TermTable] = Field(default_factory=list)
    valid: str | None = None


class Declaration(ModelTables):
    """A model.toml or balances.toml."""

    name: str | None = None
    runs: Runs = Runs()
    align: dict[str, Align] = Field(default_factory=dict)
    balances: list[BalanceTable] = Field(default_factory=list, max_length=MOST)

    @property
    def simulated(self) -> bool:
        """Can it be simulated, or are there balances only?"""
        return bool(self.states or self.outputs)
