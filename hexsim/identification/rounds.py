"""Rounds of identification: measure, trace, design the next motion, measure it, until nothing more can be told.

    round 1    a small motion, then a rich one; another kind of motion is kept to judge on
    round k    the motion that `tracing.design` asks for after round k - 1

A folder holds machine.toml as declared, `logs/`, a trace a round, and the story. Rounds that are there already are taken
as they are, so that an interrupted identification goes on where it ended.
"""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.files.json_files import write_json
from hexsim.files.log_files import write_log
from hexsim.identification import bump
from hexsim.identification.host import Host, MachineFault
from hexsim.identification.plan import HELD_OUT, SMALL_s, draw, planned
from hexsim.identification.record import Round, Story
from hexsim.identification.telemetry_log import log_of
from hexsim.machine.files import find_machine_file, load_machine, save_machine
from hexsim.motion_computer.host_limiter import setpoints_of
from hexsim.motion_computer.states import State
from hexsim.tracing import rules
from hexsim.tracing.design import next_measurement
from hexsim.tracing.design.information import KNOWING, says_nothing
from hexsim.tracing.design.next_measurement import surviving
from hexsim.tracing.design.words import one_term_words
from hexsim.tracing.state import Trace
from hexsim.tracing.trace import trace

Array = NDArray[np.float64]
Show = Callable[[str, float], None]
LOWERING = "lowering the machine"
BESIDE = "beside the named effects more than noise is left"


def identify(
    machine_file: Path | str,
    address: tuple[str, int],
    minutes: float,
    out: Path,
    show: Show | None = None,
    *,
    compensate: bool = False,
    largest: float = 1.0,
) -> Story:
    """Identify the machine behind `address` against its declaration; `out` gets logs, traces and the story.

    minutes: machine time that may be used by the rounds. compensate: measure the bump before and after compensation.
    largest: share of the limits in [host_limits] that motions may use.
    Raises HexsimError where nobody answers, or where the first measurement cannot be trusted. A fault of the machine or
    of the link, what the host sees while it drives, or Ctrl-C, ends it with what there is so far and the machine settled.
    """
    tell = show or (lambda doing, share: None)
    out = Path(out)
    machine = declared(machine_file, out)
    before_s = _used_before(out)
    story = Story(machine=machine, folder=out, machine_s=before_s)
    with Host(address, machine, largest=largest) as host:
        try:
            _rounds(host, machine, 60.0 * minutes, story, tell, largest)
            _compensation(host, story, compensate, tell)
        except KeyboardInterrupt:
            story.ended, story.interrupted = "interrupted by the user", True
        except HexsimError as error:
            if not isinstance(error, MachineFault) and not story.rounds:
                raise
            story.ended, story.failed = str(error), True
        finally:
            _settle(host, story, tell)
            story.machine_s = before_s + host.time_s
            _keep_broken_off(host, machine, out)
    write_json(out / "story.json", story.to_json())
    if story.fitted is not None:
        save_machine(story.fitted, out / "fitted.toml", machine_file)
    return story


def declared(machine_file: Path | str, out: Path) -> Machine:
    """The declared machine, kept in the folder; another one than the folder's is refused."""
    (out / "logs").mkdir(parents=True, exist_ok=True)
    place, kept = find_machine_file(machine_file), out / "machine.toml"
    if not kept.exists():
        shutil.copy(place, kept)
    elif kept.read_bytes() != place.read_bytes():
        raise HexsimError(f"{out} holds the identification of another declaration than {place}: give another --out")
    return load_machine(kept)


def _used_before(out: Path) -> float:
    """Machine time [s] that an identification of the same folder has used before it ended."""
    place = out / "story.json"
    return float(json.loads(place.read_text(encoding="utf-8"))["machine_s"]) if place.is_file() else 0.0


def _compensation(host: Host, story: Story, measure: bool, tell: Show) -> None:
    """Start parameters for the compensator from the identified twin; the bump before and after, where asked for."""
    if story.fitted is None:
        return
    story.learned = bump.start_parameters(
        story.fitted, lambda share: tell("teaching the compensator on the identified twin", share)
    )
    write_json(story.folder / "compensator.json", {"compensator": bump.ALGORITHM, "legs": story.learned})
    if not measure:
        return
    logs = story.folder / "logs"
    try:
        bump.measure_bump(host, story.machine, story.learned, logs, tell)
        story.bump = bump.bump_of(story.machine, logs)
    except MachineFault:
        raise
    except HexsimError as error:
        story.no_bump = str(error)


def _to_neutral(host: Host) -> None:
    """From whatever the machine is doing."""
    state = host.exchange().state
    if state == State.SETTLING:
        host.until(State.OFF)
    starts = {
        State.OFF: "start",
        State.SETTLING: "start",
        State.MANUAL: "return_neutral",
        State.NORMAL: "return_neutral",
    }
    host.until(State.NEUTRAL, starts.get(state, "none"))
    host.rest()


def _settle(host: Host, story: Story, tell: Show) -> None:
    """Lower the machine; what cannot be reached any more is asked to, and left."""
    if host.reply is None or host.reply.state in (State.OFF, State.FAULT):
        return
    with contextlib.suppress(KeyboardInterrupt):  # a display that passes Ctrl-C on
        tell(LOWERING, 1.0)
    try:
        why = host.settle()
    except KeyboardInterrupt:
        why = "left while it was being lowered"
    story.ended += f"; {why}" if why else ""


def _keep_broken_off(host: Host, machine: Machine, out: Path) -> None:
    """What was measured of a motion that was broken off, where it is a measurement."""
    if host.measured:
        with contextlib.suppress(HexsimError):
            write_log(log_of(host.measured, machine), out / "logs" / "broken_off.parquet")


def _rounds(
    host: Host,
    machine: Machine,
    budget_s: float,
    story: Story,
    tell: Show,
    largest: float,
    *,
    most_rounds: int = 6,  # at most
    guided_s: float = 12.0,  # machine time of a round besides its motion: to neutral and back
) -> None:
    before_s, plan = story.machine_s, planned(machine, largest)
    _to_neutral(host)
    measure = partial(_measure, host, machine, story.folder, tell, largest)
    logs = story.folder / "logs"
    missing = [name for name in HELD_OUT if not (logs / f"{name}.parquet").exists()]
    if missing:
        check_careful(measure("small", plan["small"], "a small motion"))
    for name in missing:
        write_log(measure(name, plan[name], "measuring what is held out"), logs / f"{name}.parquet")
        _keep(story, before_s + host.time_s)
    rows, purpose, expected = plan["round_1"], "a rich motion, to begin with", {}
    fit: list[Path] = []
    for number in range(1, most_rounds + 1):
        name = logs / f"round_{number}.parquet"
        if not name.exists():
            used_s = before_s + host.time_s
            if used_s + rules.MOTION_S + guided_s > budget_s:
                story.ended = f"the time is used: {used_s:.0f} of {budget_s:.0f} s"
                return
            write_log(measure(name.stem, rows, f"round {number}: measuring"), name)
            _keep(story, before_s + host.time_s)
        fit.append(name)
        result = _trace(story, fit, number, tell)
        story.rounds.append(_round(number, purpose, name.stem, result, expected))
        story.fitted = result.fitted
        _keep(story, before_s + host.time_s)
        if not open_points(result):
            terms = [f"; {one_term_words(effect)}" for effect in result.effects if effect.readings]
            story.ended = (
                f"{result.verdict}: nothing is left to be told apart, and every number is sharp{''.join(terms)}"
            )
            return
        design = next_measurement(
            result, rules.MOTION_S, partial(_tell_round, tell, number), may_load=False, largest=largest
        )
        if not worth_a_run(design.to_json(), result.verdict in ("unexplained", "partly")):
            why = design.purpose if design.purpose.startswith("no motion") else "; ".join(open_points(result))
            story.ended = f"no motion inside the machine's limits tells more: {why}"
            return
        rows, purpose, expected = setpoints_of(machine, design.tables), design.purpose, design.to_json()
    story.ended = f"{most_rounds} rounds are done; still open: {'; '.join(open_points(result))}"


def _keep(story: Story, used_s: float) -> None:
    """The story so far, with its machine time: what a killed identification goes on from."""
    story.machine_s = used_s
    write_json(story.folder / "story.json", story.to_json())


def _measure(
    host: Host, machine: Machine, folder: Path, tell: Show, largest: float, name: str, rows: Array, doing: str
) -> pl.DataFrame:
    """Draw the motion, then drive it: its log."""
    tell(doing, 0.0)
    draw(machine, rows, name, folder, largest)
    return host.drive(rows, lambda share: tell(doing, share))


def check_careful(
    log: Any,
    *,
    slowest_s: float = 0.3,  # by which a leg may follow later
) -> None:
    """The small motion: the machine that answers moves the way it is told."""
    for name in [name for name in log.columns if name.startswith("position")]:
        told, done = log[name.replace("position", "setpoint")].to_numpy(), log[name].to_numpy()
        late = [round(shift * len(log) / SMALL_s) for shift in np.arange(0.0, slowest_s, 0.02)]
        if np.ptp(done) == 0.0 or max(np.corrcoef(told[: len(told) - k], done[k:])[0, 1] for k in late) < 0.5:
            raise HexsimError(
                f"{name} does not follow its setpoint in a small motion: check wiring and signs before going on"
            )


def _trace(story: Story, fit: list[Path], number: int, tell: Show) -> Trace:
    held_out = [story.folder / "logs" / f"{name}.parquet" for name in HELD_OUT]
    return trace(
        story.folder,
        [str(path) for path in fit],
        [str(path) for path in held_out],
        story.folder / f"round_{number}",
        partial(_tell_round, tell, number),
    )


def _tell_round(tell: Show, number: int, doing: str, share: float) -> None:
    tell(f"round {number}: {doing}", share)


def _round(number: int, purpose: str, log: str, result: Trace, expected: dict[str, Any]) -> Round:
    return Round(
        number=number,
        purpose=purpose,
        log=log,
        verdict=result.verdict,
        sentences=tuple(open_points(result)),
        effects=result.report.get("effects", []),
        error=result.report.get("error", {}),
        budget=result.report.get("budget", []),
        expected=expected,
    )


def open_points(result: Trace) -> list[str]:
    """What a trace leaves open and a measurement may tell: ties, an unexplained rest, numbers that are not sharp."""
    found = []
    if result.predicted:
        found.append(f"every channel is at its noise, and {result.predicted[0].sentence}")
    elif result.verdict == "unexplained":
        labels = [label for label, _ in surviving(result)]
        found.append(" or ".join(labels) if len(labels) > 1 else "the rest is unexplained")
    elif result.verdict == "partly":
        found.append(BESIDE)
    for effect in result.effects:
        if effect.apart:
            found.append(" or ".join((effect.candidate.label, *effect.apart)))
        for name, value in effect.values.items():
            error = effect.standard_errors.get(name, float("nan"))
            if not says_nothing(effect.candidate.effect, name, value) and not error <= KNOWING.sharp * abs(value):
                found.append(f"{name} of {effect.candidate.label} is known to {100 * error / abs(value):.0f} %")
    return found


def worth_a_run(design: dict[str, Any], more_is_left: bool) -> bool:
    """Does a design promise to separate something, to sharpen a number that is not sharp, or, of a machine of which more than
    noise is left, to know its declared numbers better on average? What hides beside them then shows."""
    if any(pair.get("chi2", 0.0) > 10.0 or pair.get("separated", False) for pair in design["separations"]):
        return True
    if more_is_left and np.exp(-0.5 * design["information"]) < rules.SHARPENED:
        return True
    return any(
        number["expected"] < rules.SHARPENED * number["standard_error"]
        and number["standard_error"] > KNOWING.sharp * abs(number["value"] or 1.0)
        for number in design["numbers"]
    )
