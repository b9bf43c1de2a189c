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
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.files.json_files import write_json
from hexsim.files.log_files import write_log
from hexsim.identify import bump
from hexsim.identify.host import Host, MachineFault
from hexsim.identify.motions import setpoints_of
from hexsim.identify.record import Round, Story
from hexsim.machine.files import find_machine_file, load_machine, save_machine
from hexsim.motion_computer.states import State
from hexsim.tracing.design import next_measurement
from hexsim.tracing.design.information import SHARP, says_nothing
from hexsim.tracing.design.motions import MotionFamily
from hexsim.tracing.design.next_measurement import surviving
from hexsim.tracing.design.words import NO_GAIN, one_term_words
from hexsim.tracing.state import Trace
from hexsim.tracing.trace import trace

Array = NDArray[np.float64]
Show = Callable[[str, float], None]
MOTION_s = 20.0  # of a round
SMALL_s = 5.0  # of the first, careful motion
SMALL_SHARE = 0.2  # of the first motion
SLOWEST_LOOP_s = 0.3  # by which a leg may follow later
ROUNDS = 6  # at most
GUIDED_s = 12.0  # machine time of a round besides its motion: to neutral and back
# kind, axis, size, two frequencies, slope, seed: see `MotionFamily.bounds`
FIRST = np.array([0, 0, 0.9, 0.2, 0.75, 0.5, 1])
HELD_OUT = {  # by the name of the log
    "held_out": np.array([2, 2, 0.8, 0.35, 0.6, 0.3, 2]),
    "held_out_2": np.array([0, 0, 0.7, 0.3, 0.7, 0.6, 11]),
}


def identify(
    machine_file: Path | str, address: tuple[str, int], minutes: float, out: Path, show: Show | None = None, *,
    compensate: bool = False,
) -> Story:  # fmt: skip
    """Identify the machine behind `address` against its declaration; `out` gets logs, traces and the story.

    minutes: machine time that may be used by the rounds. compensate: measure the bump before and after compensation.
    Raises HexsimError where nobody answers, or where the first measurement cannot be trusted. A fault of the machine or
    of the link, or Ctrl-C, ends it with what there is so far and the machine settled.
    """
    tell = show or (lambda doing, share: None)
    out = Path(out)
    machine = _declared(machine_file, out)
    before_s = _used_before(out)
    story = Story(machine=machine, folder=out, machine_s=before_s)
    with Host(address) as host:
        try:
            _rounds(host, machine, 60.0 * minutes, story, tell)
            _compensation(host, story, compensate, tell)
        except KeyboardInterrupt:
            story.ended = "interrupted by the user"
        except HexsimError as error:
            if not isinstance(error, MachineFault) and not story.rounds:
                raise
            story.ended, story.failed = str(error), True
        finally:
            _settle(host, tell)
            story.machine_s = before_s + host.time_s
    write_json(out / "story.json", story.to_json())
    if story.fitted is not None:
        save_machine(story.fitted, out / "fitted.toml")
    return story


def _declared(machine_file: Path | str, out: Path) -> Machine:
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


def _settle(host: Host, tell: Show) -> None:
    """Lower the machine; what cannot be reached any more is left as it is."""
    if host.reply is None or host.reply.state in (State.OFF, State.FAULT):
        return
    with contextlib.suppress(KeyboardInterrupt):  # a display that passes Ctrl-C on
        tell("lowering the machine", 1.0)
    with contextlib.suppress(HexsimError, KeyboardInterrupt):
        if host.reply.state == State.NORMAL:
            host.until(State.NEUTRAL, "return_neutral")
        host.until(State.OFF, "settle")


def _rounds(host: Host, machine: Machine, budget_s: float, story: Story, tell: Show) -> None:
    before_s = story.machine_s
    _to_neutral(host)
    family = MotionFamily(machine, MOTION_s)
    logs = story.folder / "logs"
    missing = {name: point for name, point in HELD_OUT.items() if not (logs / f"{name}.parquet").exists()}
    if missing:
        tell("a small motion", 0.0)
        careful = MotionFamily(machine, SMALL_s).scenario(FIRST)
        assert careful is not None
        check_careful(machine, host.drive(SMALL_SHARE * setpoints_of(machine, careful)))
    for name, point in missing.items():
        _measure(host, machine, family.scenario(point), logs / f"{name}.parquet", "measuring what is held out", tell)
        _keep(story, before_s + host.time_s)
    tables, purpose, expected = family.scenario(FIRST), "a rich motion, to begin with", {}
    fit: list[Path] = []
    for number in range(1, ROUNDS + 1):
        name = logs / f"round_{number}.parquet"
        if not name.exists():
            used_s = before_s + host.time_s
            if used_s + MOTION_s + GUIDED_s > budget_s:
                story.ended = f"the time is used: {used_s:.0f} of {budget_s:.0f} s"
                return
            _measure(host, machine, tables, name, f"round {number}: measuring", tell)
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
        design = next_measurement(result, MOTION_s, partial(_tell_round, tell, number), may_load=False)
        if not worth_a_run(design.to_json(), result.verdict == "unexplained"):
            why = design.purpose if design.purpose.startswith("no motion") else "; ".join(open_points(result))
            story.ended = f"no motion inside the machine's limits tells more: {why}"
            return
        tables, purpose, expected = design.tables, design.purpose, design.to_json()
    story.ended = f"{ROUNDS} rounds are done; still open: {'; '.join(open_points(result))}"


def _keep(story: Story, used_s: float) -> None:
    """The story so far, with its machine time: what a killed identification goes on from."""
    story.machine_s = used_s
    write_json(story.folder / "story.json", story.to_json())


def _measure(host: Host, machine: Machine, tables: dict[str, Any] | None, place: Path, doing: str, tell: Show) -> None:
    if tables is None:
        raise HexsimError(f"machine {machine.name}: no motion fits inside its limits; check stroke and cushions")
    tell(doing, 0.0)
    log = host.drive(setpoints_of(machine, tables), lambda share: tell(doing, share))
    write_log(log, place)


def check_careful(machine: Machine, log: Any) -> None:
    """The small motion: the machine that answers has the declared legs, and moves the way it is told."""
    legs = [name for name in log.columns if name.startswith("position")]
    if len(legs) != machine.n_legs:
        raise HexsimError(f"the machine sends {len(legs)} legs, and {machine.name} is declared with {machine.n_legs}")
    for name in legs:
        if name.replace("position", "setpoint") not in log.columns:
            raise HexsimError(f"the machine sends {name} and no setpoint beside it: its telemetry must carry both")
        told, done = log[name.replace("position", "setpoint")].to_numpy(), log[name].to_numpy()
        late = [round(shift * len(log) / SMALL_s) for shift in np.arange(0.0, SLOWEST_LOOP_s, 0.02)]
        if np.ptp(done) == 0.0 or max(np.corrcoef(told[: len(told) - k], done[k:])[0, 1] for k in late) < 0.5:
            raise HexsimError(
                f"{name} does not follow its setpoint in a small motion: check wiring and signs before going on"
            )


def _trace(story: Story, fit: list[Path], number: int, tell: Show) -> Trace:
    held_out = [story.folder / "logs" / f"{name}.parquet" for name in HELD_OUT]
    return trace(
        story.folder, [str(path) for path in fit], [str(path) for path in held_out], story.folder / f"round_{number}",
        partial(_tell_round, tell, number),
    )  # fmt: skip


def _tell_round(tell: Show, number: int, doing: str, share: float) -> None:
    tell(f"round {number}: {doing}", share)


def _round(number: int, purpose: str, log: str, result: Trace, expected: dict[str, Any]) -> Round:
    return Round(
        number=number, purpose=purpose, log=log, verdict=result.verdict, sentences=tuple(open_points(result)),
        effects=result.report.get("effects", []), error=result.report.get("error", {}),
        budget=result.report.get("budget", []), expected=expected,
    )  # fmt: skip


def open_points(result: Trace) -> list[str]:
    """What a trace leaves open and a measurement may tell: ties, an unexplained rest, numbers that are not sharp."""
    found = []
    if result.predicted:
        found.append(f"every channel is at its noise, and {result.predicted[0].sentence}")
    elif result.verdict == "unexplained":
        labels = [label for label, _ in surviving(result)]
        found.append(" or ".join(labels) if len(labels) > 1 else "the rest is unexplained")
    for effect in result.effects:
        if effect.apart:
            found.append(" or ".join((effect.candidate.label, *effect.apart)))
        for name, value in effect.values.items():
            error = effect.standard_errors.get(name, float("nan"))
            if not says_nothing(effect.candidate.effect, name, value) and not error <= SHARP * abs(value):
                found.append(f"{name} of {effect.candidate.label} is known to {100 * error / abs(value):.0f} %")
    return found


def worth_a_run(design: dict[str, Any], unexplained: bool) -> bool:
    """Does a design promise to separate something, to sharpen a number that is not sharp, or, of an unexplained machine
    without a hypothesis, to know its declared numbers better on average? What hides beside them then shows."""
    if any(pair.get("chi2", 0.0) > 10.0 or pair.get("separated", False) for pair in design["separations"]):
        return True
    if unexplained and np.exp(-0.5 * design["information"]) < NO_GAIN:
        return True
    return any(
        number["expected"] < NO_GAIN * number["standard_error"]
        and number["standard_error"] > SHARP * abs(number["value"] or 1.0)
        for number in design["numbers"]
    )
