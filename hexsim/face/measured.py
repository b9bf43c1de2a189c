"""Measured logs against a machine, machines behind packets, and the motion tests of the field."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from hexsim.declaration import Machine as DeclaredMachine
from hexsim.errors import HexsimError
from hexsim.face.given import (
    Machine,
    compensator_of,
    faced,
    is_number,
    load_machine,
    names_in,
    path_of,
    prepared,
    shown,
)
from hexsim.face.runs import AnyCompensator, AnyMachine
from hexsim.face.show import Picture, chosen, html_table
from hexsim.files.run_folder import default_folder, run_folder
from hexsim.recording.quantity import split_key, with_error
from hexsim.recording.summary_table import number

if TYPE_CHECKING:
    from hexsim import identification
    from hexsim.qualification import Findings
    from hexsim.tracing import state

Progress = Callable[[str, float], None]
AnyPath = str | Path


def load_log(path: AnyPath, mapping: AnyPath | None = None, machine: AnyMachine | None = None) -> pl.DataFrame:
    """A measured log of any format that is read, as a table in SI units on a uniform time base.

    mapping: file for foreign names and units; None: mapping.toml beside the log, if there is one.
    machine: what it cannot have is missing. Raises HexsimError that names file, column and row.

    >>> log = hx.load_log("tests/data/bench_leakage/fit.csv.gz")
    >>> log.height, log.columns[:3]
    (20000, ['time_s', 'setpoint_m', 'position_m'])
    """
    from hexsim.readers import read_log

    with_machine = None if machine is None else load_machine(machine)
    units = None if mapping is None else path_of(mapping, "mapping", "mapping.toml")
    return read_log(path_of(path, "a log", "fit.parquet"), units, with_machine).table


class TraceResult:
    """What measured logs say of a declared machine.

    verdict: "nothing missing", "explained", "partly" or "unexplained". effects: a row a number of each effect that the
    machine lacks: effect, where, number, value, standard_error (SI units), tied_with. budget: a row a step and channel, how
    far each model is off on held-out runs. machine, fitted: as declared, and with the fitted numbers and effects.
    report: all that report.json holds.
    """

    def __init__(self, result: state.Trace, declared: Path) -> None:
        self._result, self._declared = result, declared
        self.verdict: str = result.verdict
        self.report: dict[str, Any] = result.report
        self.machine: Machine = faced(result.machine)
        self.fitted: Machine = faced(result.fitted)

    @property
    def effects(self) -> pl.DataFrame:
        rows = [
            {
                "effect": effect["name"],
                "where": effect["where"],
                "number": name,
                "value": value,
                "standard_error": effect.get("standard_error", {}).get(name),
                "tied_with": ", ".join(effect.get("tied_with", [])),
            }
            for effect in self.report["effects"]
            for name, value in effect.get("parameters", {}).items()
        ]
        kinds = {
            "effect": pl.String,
            "where": pl.String,
            "number": pl.String,
            "value": pl.Float64,
            "standard_error": pl.Float64,
            "tied_with": pl.String,
        }
        return pl.DataFrame(rows, schema=kinds)

    @property
    def budget(self) -> pl.DataFrame:
        return pl.DataFrame(self.report["budget"], infer_schema_length=None)

    def plot(self, what: str = "budget") -> Picture:
        """A picture: "budget", the error that each step leaves, or "balances", the residuals before and after."""
        from hexsim.tracing.report import balance_figure, budget

        there = {
            "budget": lambda: budget.waterfall(self._result),
            "balances": lambda: balance_figure.balances(self._result),
        }
        return Picture(chosen(what, there))

    def to_folder(self, path: AnyPath | None = None) -> Path:
        """Write report.html, report.json, machine.toml as fitted and separating scenarios; the folder.

        path: None: `runs/<time>-trace-<machine>`. Raises HexsimError where it cannot be written.
        """
        from hexsim.tracing.report.content import write_report

        with run_folder(Path(path) if path is not None else default_folder(f"trace-{self.machine.name}")) as folder:
            write_report(self._result, folder.path, self._declared)
            return folder.finish()

    def __repr__(self) -> str:
        names = dict.fromkeys(f"{effect['name']} in {effect['where']}" for effect in self.report["effects"])
        return f"<TraceResult of {self.machine.name}: {self.verdict}{': ' if names else ''}{', '.join(names)}>"

    def _repr_html_(self) -> str:
        from hexsim.tracing.report.page import sentence

        rows = [
            (
                row["effect"].replace("_", " "),
                row["where"],
                split_key(row["number"])[0],
                with_error(row["value"], row["standard_error"], split_key(row["number"])[1]),
                row["tied_with"],
            )
            for row in self.effects.iter_rows(named=True)
        ]
        return html_table(
            ("effect", "where", "number", "value", "tied with"), rows, self.verdict, [sentence(self._result)]
        )


def trace(
    folder: AnyPath,
    fit: AnyPath | Iterable[AnyPath] = "fit",
    validate: AnyPath | Iterable[AnyPath] = "validate",
    *,
    mapping: AnyPath | None = None,
    load_kg: float | None = None,
    loaded: Iterable[AnyPath] = (),
    progress: Progress | None = None,
) -> TraceResult:
    """Identify the physical effect that the declared machine of a folder is missing in its measured logs.

    fit: logs that everything is fitted on, names in the folder or paths; validate: held-out logs, which judge. mapping: file
    for foreign names and units of all logs. load_kg: what people can put on the machine; loaded: logs taken with it on.
    progress(what is done, fraction). A minute for logs of a bench, more for a hexapod.
    Raises HexsimError for bad data, with file, column and row, and for a folder with balances of its own (`hexsim trace`).

    >>> result = hx.trace("tests/data/bench_leakage", fit=["fit", "sweep"])  # doctest: +SKIP
    >>> result  # doctest: +SKIP
    <TraceResult of bench_leakage: explained: leakage_supply_to_chamber in leg 1>
    """
    from hexsim.own.files import model_file
    from hexsim.tracing.trace import trace as run_trace

    place = Path(path_of(folder, "the folder of a machine", "tests/data/bench_leakage"))
    if model_file(place) is not None:
        raise HexsimError(f"{place} has balances of its own: trace it with `hexsim trace {place}`")
    if load_kg is not None and not is_number(load_kg):
        raise HexsimError(f"load_kg is {shown(load_kg)}: give a mass in kg")
    with_load = names_in(loaded, "loaded") if loaded else []
    done = run_trace(
        place,
        names_in(fit, "fit"),
        names_in(validate, "validate"),
        None,
        progress,
        load_kg,
        with_load,
        mapping=None if mapping is None else Path(path_of(mapping, "mapping", "mapping.toml")),
    )
    return TraceResult(done, place)


class Identification:
    """What an identification behind packets found: the rounds, why it ended, the machine that it ended with.

    rounds: a row a round: number, verdict, purpose, open (what it leaves open). fitted: None where nothing was measured.
    story: all that story.json holds. folder: logs, traces and the story.
    """

    def __init__(self, story: identification.Story) -> None:
        self._story = story
        self.machine: Machine = faced(story.machine)
        self.fitted: Machine | None = None if story.fitted is None else faced(story.fitted)
        self.ended: str = story.ended
        self.failed: bool = story.failed
        self.folder: Path = story.folder
        self.story: dict[str, Any] = story.to_json()

    @property
    def rounds(self) -> pl.DataFrame:
        kinds = {"number": pl.Int64, "verdict": pl.String, "purpose": pl.String, "open": pl.String}
        rows = [(one.number, one.verdict, one.purpose, "; ".join(one.sentences)) for one in self._story.rounds]
        return pl.DataFrame(rows, schema=kinds, orient="row")

    def plot(self) -> Picture:
        """The story in one picture: what each step of the last trace leaves, and the bump before and after."""
        from hexsim.identification.story import headline, story_figure
        from hexsim.recording.figure_style import png

        if not self._story.rounds or not self._story.rounds[-1].budget:
            raise HexsimError("there is nothing to draw: no round was finished")
        figure = story_figure(headline(self._story), self._story.rounds[-1].budget, self._story.bump)
        return Picture(png(figure), figure)

    def to_folder(self) -> Path:
        """Write the story as report.html into its folder, beside logs and traces; the folder."""
        from hexsim.identification.story import write_story

        return write_story(self._story).parent

    def __repr__(self) -> str:
        return f"<Identification of {self.machine.name}: {len(self._story.rounds)} rounds; {self.ended}>"

    def _repr_html_(self) -> str:
        rows = [tuple(map(str, row)) for row in self.rounds.iter_rows()]
        return html_table(("round", "verdict", "purpose", "open"), rows, repr(self)[1:-1])


def identify(
    machine: AnyMachine,
    out: AnyPath,
    host: str = "127.0.0.1:47110",
    *,
    minutes: float = 5.0,
    compensate: bool = False,
    largest: float = 1.0,
    progress: Progress | None = None,
) -> Identification:
    """Measure the machine behind a host interface, trace it, design the next motion, until no further motion would help.

    It MOVES the machine at `host` ("ADDRESS:PORT"), within the limits of [host_limits] times `largest`. out: folder of logs
    and traces; goes on in an old one. minutes: machine time to use. compensate: at the end the bump in heave before and
    after compensation. Ctrl-C lowers the machine.
    Raises HexsimError where nobody answers, or where the first measurement cannot be trusted.

    >>> hx.identify("bench", "runs/mine", "192.168.0.7:47110", minutes=2)  # doctest: +SKIP
    """
    from hexsim.identification import identify as run
    from hexsim.identification.host import address_of

    address = address_of(host)
    for name, value, low, high in (("minutes", minutes, 0.5, 600.0), ("largest", largest, 0.01, 1.0)):
        if not is_number(value) or not low <= value <= high:
            raise HexsimError(f"{name} is {shown(value)}: give {low:g} to {high:g}")
    with tempfile.TemporaryDirectory(prefix="hexsim-") as made:
        file: AnyPath = machine if isinstance(machine, str | Path) else load_machine(machine).to_folder(made)
        return Identification(run(file, address, minutes, Path(out), progress, compensate=compensate, largest=largest))


class Qualification:
    """Figures of the motion tests. rows: test, axis, figure, value, unit, limit, source, passed (null: no limit known).

    passed: whether every limit is kept. result: all that qualify.json holds.
    """

    def __init__(self, result: dict[str, Any], found: Findings, machine: DeclaredMachine) -> None:
        self._found = found
        self.result = result
        self.machine: Machine = faced(machine)
        self.passed: bool = result["passed"]

    @property
    def rows(self) -> pl.DataFrame:
        return pl.DataFrame(self.result["rows"], infer_schema_length=None)

    def plot(self, what: str = "frequency response") -> Picture:
        """A picture: half-hertz, frequency response, turn-around, dynamic threshold, linearity and hysteresis, leg balance."""
        from hexsim.qualification.plots import pictures

        drawn = pictures(self._found.curves)
        return Picture(chosen(what, {name: lambda data=data: data for name, data in drawn.items()}))

    def to_folder(self, path: AnyPath | None = None) -> Path:
        """Write report.html and qualify.json, as `hexsim qualify` does; the folder. path: None: `runs/<time>-qualify-<machine>`."""
        from hexsim.qualification import write_qualification

        with run_folder(Path(path) if path is not None else default_folder(f"qualify-{self.machine.name}")) as folder:
            write_qualification(self.result, self._found, self.machine, folder.path)
            return folder.finish()

    def __repr__(self) -> str:
        judged = [row["passed"] for row in self.result["rows"] if row["passed"] is not None]
        return f"<Qualification of {self.machine.name}: {sum(judged)} of {len(judged)} limits kept>"

    def _repr_html_(self) -> str:
        judgement = {None: "", True: "kept", False: "exceeded"}
        rows = [
            (
                row["test"],
                row["axis"],
                row["figure"],
                number(row["value"]),
                row["unit"],
                number(row["limit"]),
                judgement[row["passed"]],
            )
            for row in self.result["rows"]
        ]
        return html_table(("test", "axis", "figure", "value", "unit", "limit", ""), rows, repr(self)[1:-1])


def qualify(
    machine: AnyMachine,
    compensator: AnyCompensator = "none",
    set: Mapping[str, Any] | None = None,
    *,
    quick: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Qualification:
    """The motion tests of flight simulators on a machine: half-hertz noise, describing function, turn-around and more.

    quick: fewer and shorter motions, under a minute. set: values of the machine by dotted key. progress(fraction).
    Raises HexsimError where the machine cannot do a motion.

    >>> hx.qualify("bench", quick=True)  # doctest: +SKIP
    <Qualification of bench: 1 of 3 limits kept>
    """
    from hexsim.qualification import judged

    with_machine, _ = prepared("heave", machine, set)
    result, found = judged(with_machine, quick, progress, compensator_of(compensator))
    return Qualification(result, found, with_machine)
