"""What a balances.toml may say.

[runs]
folder = "../data"                        # where the logs are; default: the folder itself
fit = ["one", "two", "three"]             # default: all logs of the folder that are not held out
validate = ["four"]                       # scored once with the final numbers
window_s = 0.2                            # half width of the balances' window
short_window_s = 0.05                     # of rates inside a product; default: the same

[constants]                               # numbers and formulas with a name
area_m2 = 8.87e-4
pressure_Pa = "pressure_lower_Pa - pressure_upper_Pa"

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

from pydantic import Field

from hexsim.readers.mapping import Section


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


class Declaration(Section):
    """A balances.toml."""

    name: str | None = None
    runs: Runs = Runs()
    constants: dict[str, str | float] = Field(default_factory=dict)
    align: dict[str, Align] = Field(default_factory=dict)
    balances: list[BalanceTable] = Field(min_length=1)
