"""A measured log from a file: signals with their own stamps, whatever the format, on one clock and one grid.

1. clocks      when was each sample taken (sorted, unwrapped; stamps kept, or rows counted by evidence)
               a channel whose values are repeated has a clock of its own
2. damage      what is no measurement is missing
3. one grid    held or interpolated, missing in holes of 1.5 periods; a slower channel's own samples are marked
4. stretches   short gaps filled without weight, longer ones split the run
Each thing that was done is noted with its signal: one line a signal in `Log.losses`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hexsim.errors import HexsimError
from hexsim.machine import Machine
from hexsim.readers.assemble import assemble
from hexsim.readers.clock_group import ClockGroup
from hexsim.readers.clocks import settle
from hexsim.readers.faulty_values import blank_bad_values
from hexsim.readers.files import log_name, raw_log
from hexsim.readers.mapping import Mapping, load_mapping
from hexsim.readers.one_grid import GRID, Grid, fill, on_one_grid, stretches
from hexsim.readers.possible import possible_values
from hexsim.readers.reader import RawLog
from hexsim.readers.repeats import set_apart
from hexsim.signals.log import Log

MAPPING_NAME = "mapping.toml"  # beside the logs: used for all logs of the folder


def read_stretches(
    path: Path | str,
    mapping: Path | str | Mapping | None = None,
    machine: Machine | None = None,
    *,
    shortest_s: float = 0.5,  # [s] shorter logs are refused
) -> list[Log]:
    """All stretches of a log without a long gap, longest first. See `read_log`."""
    path = Path(path)
    beside = (path if path.is_dir() else path.parent) / MAPPING_NAME
    mapping = load_mapping(beside if mapping is None and beside.is_file() else mapping)
    raw = raw_log(path, mapping.file)
    if not any(len(signal.values) for signal in raw.signals):
        raise HexsimError(f"{path} has a header and no row of data{raw.unread()}")
    groups, kind = assemble(raw, mapping, path)
    possible = possible_values(machine)
    markers = {name: channel.missing for name, channel in mapping.columns.items()}
    for group in groups:
        settle(group)
    groups = [own for group in groups for own in set_apart(group)]
    for group in groups:
        blank_bad_values(group, possible, markers)
    groups = [group for group in groups if group.signals]
    if not groups:
        lost = [loss for loss in raw.losses if loss.endswith("left out")]
        raise HexsimError(f"{path} has no signal that is as long as its time: {'; '.join(lost[:3]) or 'it is damaged'}")
    slowest_Hz = GRID.slowest_own_Hz if kind == "own" else GRID.rates_Hz[0]
    grid = on_one_grid(groups, {name: channel.delay_s for name, channel in mapping.columns.items()}, slowest_Hz)
    fill(grid, {name for group in groups for name in group.held})
    losses = sentences(raw, groups, grid)
    parts = stretches(grid, shortest_s)
    if not parts:
        raise HexsimError(
            f"{path} has no stretch of {shortest_s:g} s without a missing value: {'; '.join(losses) or 'too short'}"
        )
    whole = Log(
        name=log_name(path),
        kind=kind,
        time=grid.time,
        rate=round(grid.rate, 6),
        columns=grid.columns,
        path=path,
        losses=losses,
        repaired=grid.repaired,
        sampled=grid.sampled,
    )
    return [used_part(whole, part, grid.slack) for part in parts]


def sentences(raw: RawLog, groups: Sequence[ClockGroup], grid: Grid) -> tuple[str, ...]:
    """What was done: of the file, then one line a clock and a signal."""
    lines = [*raw.losses, *grid.notes.pop("", [])]
    lines += ["; ".join(group.notes.pop("")) for group in groups if "" in group.notes]
    done: dict[str, list[str]] = {}
    for notes in (*(group.notes for group in groups), grid.notes):
        for name, said in notes.items():
            done.setdefault(name, []).extend(said)
    lines += [f"column {name}: {'; '.join(said)}" for name, said in done.items()]
    return tuple(dict.fromkeys(lines))


def used_part(log: Log, part: slice, slack: int) -> Log:
    """One stretch of a log, which says what it leaves out, but for fewer samples than the slowest clock's period at its ends."""
    if part.stop - part.start == log.n:
        return log
    if part.start <= slack and part.stop >= log.n - slack:
        return log.part(part)
    sentence = (
        f"used {(part.stop - part.start) / log.rate:.3f} s of {log.n / log.rate:.3f} s, from "
        f"{log.time[part.start]:.3f} s: the rest lies beyond missing values"
    )
    return log.part(part, losses=(*log.losses, sentence))


def read_log(path: Path | str, mapping: Path | str | Mapping | None = None, machine: Machine | None = None) -> Log:
    """Read one run: the longest stretch without a long gap, in SI units, on a uniform time base, every loss stated.

    path: a file of any format of `readers()`, text also as .gz. mapping: a TOML file for foreign names and units;
    default the file mapping.toml beside the log, if there is one. machine: what it cannot have is missing.
    Raises HexsimError that names file, column and row. Values are not judged here: see `hexsim.tracing.checks.checks`.
    """
    return read_stretches(path, mapping, machine)[0]
