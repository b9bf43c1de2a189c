"""A mapping proposed for a foreign log: which signal of the file is which of the machine, by name, unit, range and relation.

Each pair of signal and column has a score, the logarithm of how much more often such a signal is that column than another:
    word      a word of its name is one that people use for the column; a word of another column counts against it
    span      how far it is from the usual one
    unit      the stated unit is of the column's kind (another kind: never); without one, the commonest unit in which the
              values lie within what the machine can have
    leg       its number is the leg's
The best one-to-one assignment (Hungarian method) is taken. Then relations decide what names left open: of two that follow
each other the later one is the position and the earlier one its setpoint; volts go with the position's rate.
It is a proposal: whoever measured reads and corrects it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from hexsim.declaration import ATMOSPHERE_Pa, Machine
from hexsim.readers.mapping import LEG, LEG0
from hexsim.readers.reader import RawLog, RawSignal
from hexsim.signals.table import measured_columns, places, table
from hexsim.signals.units import UNITS, canonical, unit_of_name

Array = np.ndarray
DRIVES = 0.4  # correlation of volts with the position's rate
WORDS = {
    "time": "time t timestamp zeit clock stamp",
    "position": "position pos actual act ist stroke enc encoder travel weg length displacement lvdt y x axis",
    "setpoint": "setpoint set sp soll target desired reference ref cmd command commanded demand goal pos position y x axis",
    "valve": "valve volt volts voltage spool servo u drive ctrl control output ventil",
    "pressure_bottom": "pressure press p druck bottom cap bore piston a p1 pa cyl chamber",
    "pressure_top": "pressure press druck p top rod annulus b p2 pb",
    "pressure_supply": "pressure press druck p supply ps pump system source hpu",
    "acceleration": "acceleration acc accel imu a beschleunigung linear",
    "angular_acceleration": "angular acceleration alpha rotational",
}
OWN = {  # words that no other column shares
    stem: frozenset(words.split())
    - frozenset(w for other, more in WORDS.items() if other != stem for w in more.split())
    for stem, words in WORDS.items()
}
USUAL = {  # units without being told, the commonest first
    "s": ("s", "ms", "us"),
    "m": ("m", "mm", "cm", "in", "um"),
    "V": ("V", "mV"),
    "Pa": ("Pa", "bar", "MPa", "psi", "kPa"),
    "m_s2": ("m_s2", "g", "mm_s2"),
    "rad_s2": ("rad_s2", "deg_s2"),
}


@dataclass(kw_only=True)
class Guess:
    """A signal of the file for a column of the machine. unit: "" where the file or the name states it already."""

    column: str
    signal: RawSignal
    unit: str
    stated: bool
    score: float
    reasons: list[str] = field(default_factory=list)

    @property
    def values(self) -> Array:
        """In SI units."""
        factor, offset, _ = UNITS[self.unit]
        return self.signal.values * factor + offset


@dataclass(kw_only=True)
class Proposal:
    """What was found. time: where the file has a column of it."""

    guesses: list[Guess]
    time: Guess | None
    unused: list[str]
    missing: list[str]


def words_of(name: str) -> list[str]:
    """Words of a name, numbers apart: AxisPos_3 -> axis, pos, 3."""
    parts = re.sub(r"([a-z])([A-Z])", r"\1 \2", unit_of_name(name)[0])
    return [word.lower() for word in re.findall(r"[A-Za-z]+\d?(?![A-Za-z])|[A-Za-z]+|\d+", parts)]


def numbers_of(name: str) -> list[int]:
    """Whole numbers in a name."""
    return [int(number) for number in re.findall(r"\d{1,3}", unit_of_name(name)[0])]


def limits_of(stem: str, machine: Machine) -> tuple[float, float, float, float]:
    """(low, high, least span, usual span) in SI of what the machine has: most of its samples lie there."""
    stroke, volts = max(machine.of_legs("cylinder", "stroke_m")), max(machine.of_legs("valve", "voltage_max_V"))
    supply = machine.supply.pressure_Pa
    travel = (-0.1 * stroke, 1.1 * stroke, 1e-3 * stroke, 0.3 * stroke)
    found = {
        "position": travel,
        "setpoint": travel,
        "valve": (-1.05 * volts, 1.05 * volts, 1e-3 * volts, 0.2 * volts),
        "pressure_bottom": (-ATMOSPHERE_Pa, 1.3 * supply, 1e-4 * supply, 0.1 * supply),
        "pressure_top": (-ATMOSPHERE_Pa, 1.5 * supply, 1e-4 * supply, 0.1 * supply),
        "pressure_supply": (0.6 * supply, 1.2 * supply, 0.0, 0.03 * supply),
        "acceleration": (-60.0, 60.0, 1e-4, 2.0),
        "angular_acceleration": (-300.0, 300.0, 1e-4, 5.0),
    }
    return found[stem]


def score(
    raw: RawSignal,
    column: str,
    machine: Machine,
    first: int = 1,
    *,
    spread: float = 1.5,  # standard deviation of the logarithm of a signal's span about the usual one: a factor of 4.5
    strange_score: float = -4.0,  # score that a span can lose, at most
    rarer_score: float = 0.4,  # score that each unit further down the list loses
    word_score: float = 3.0,  # scores: e^3 is 20 to 1
    other_word_score: float = -3.0,  # a word of another column
    stated_score: float = 2.0,  # a unit that is stated
) -> Guess | None:
    """How well a signal fits a column; None where it cannot be it. first: number of the first leg in names."""
    signal, place = places()[column]
    stem = signal.stem
    guess = Guess(column=column, signal=raw, unit=signal.unit, stated=False, score=0.0)
    words = words_of(raw.name)
    if named := [word for word in words if word in WORDS[stem].split()]:
        guess.score += word_score + min(len(set(named)) - 1, 1)
        guess.reasons.append(f"its name says {named[-1]}")
    if any(word in OWN[other] for word in words for other in OWN if other != stem):
        guess.score += other_word_score
    if machine.n_legs > 1 and signal.scope in ("leg", "translation", "rotation"):
        guess.score += place_score(raw.name, words, signal.scope, place + (first if signal.scope == "leg" else 0))
    unit = canonical(raw.unit) or canonical(unit_of_name(raw.short)[1] or "")
    kind = UNITS[signal.unit][2]
    inside = raw.values[np.isfinite(raw.values)]
    if len(inside) < 3:
        return None
    if unit is not None:
        if UNITS[unit][2] != kind:
            return None
        guess.unit, guess.stated = unit, True
        guess.score += stated_score
        guess.reasons.append(f"it is in {unit}")
        usual = (unit,)
    else:
        usual = USUAL[kind]
    low, high, span, usual_span = limits_of(stem, machine)
    for k, name in enumerate(usual):
        factor, offset, _ = UNITS[name]
        a, b = np.quantile(inside, [0.02, 0.98]) * factor + offset
        if low <= a and b <= high and b - a >= span:
            guess.unit = name
            guess.score -= rarer_score * k
            guess.score += max(-0.5 * (np.log(max(b - a, 1e-12) / usual_span) / spread) ** 2, strange_score)
            guess.reasons.append(f"{a:.3g} to {b:.3g} {signal.unit} is what the machine can have")
            return guess
    return None


def place_score(
    name: str,
    words: Sequence[str],
    scope: str,
    place: int,
    *,
    number_score: float = 2.0,  # e^2 is 7 to 1
    other_number_score: float = -6.0,  # of another leg or axis
) -> float:
    """By the leg's number or the axis' letter in a name. place: the leg as names count it, or the axis from 0."""
    if scope == "leg":
        numbers = numbers_of(name)
        return number_score if place in numbers else other_number_score if numbers else 0.0
    letters = [word[0] for word in words if re.fullmatch("[xyz]|roll|pitch|yaw", word)]
    axis = ("xyz", "rpy")["roll" in words or "pitch" in words or "yaw" in words][place % 3]
    return number_score if axis in letters else other_number_score if letters else 0.0


def propose(
    raw: RawLog,
    machine: Machine,
    *,
    least_score: float = -1.5,  # score below which a signal is rather none of the machine's
    never_score: float = -1e6,  # of a signal that cannot be the column
) -> Proposal:
    """Which signal is which. HexsimError is left to the reader of the mapping: a proposal may be empty."""
    columns = list(measured_columns(machine.n_legs))
    if machine.cylinder.rod_side == "valve":
        columns += table()["pressure_top"].columns(machine.n_legs)
    time = time_of(raw)
    signals = [signal for signal in raw.signals if time is None or signal is not time.signal]
    seen = {number for signal in signals for number in numbers_of(signal.name)}
    first = 0 if 0 in seen and 6 not in seen else 1
    fits = [[score(signal, column, machine, first) for column in columns] for signal in signals]
    gain = np.array([[never_score if one is None else one.score for one in row] for row in fits]).reshape(
        len(signals), -1
    )
    free = np.full((len(signals), len(signals)), least_score)  # rather none
    rows, places_taken = scipy.optimize.linear_sum_assignment(np.hstack([gain, free]), maximize=True)
    guesses = [
        one for row, k in zip(rows, places_taken, strict=True) if k < len(columns) and (one := fits[row][k]) is not None
    ]
    driven(guesses, machine)
    guesses = by_relation(guesses, machine)
    used = {id(one.signal) for one in guesses}
    return Proposal(
        guesses=sorted(guesses, key=lambda one: columns.index(one.column)),
        time=time,
        unused=[signal.name for signal in signals if id(signal) not in used],
        missing=[column for column in columns if column not in {one.column for one in guesses}],
    )


def time_of(raw: RawLog) -> Guess | None:
    """The column of time: named so, and rising. None where signals have stamps of their own, or nothing rises."""
    if raw.signals and all(signal.stamps for signal in raw.signals):
        return None
    found: list[tuple[float, RawSignal]] = []
    for signal in raw.signals:
        inside = signal.values[np.isfinite(signal.values)]
        rising = len(inside) > 2 and np.mean(np.diff(inside) > 0) > 0.9
        named = any(word in WORDS["time"].split() for word in words_of(signal.name))
        stated = canonical(signal.unit or unit_of_name(signal.short)[1] or "")
        of_time = stated is not None and UNITS[stated][2] == "s"
        steps = np.diff(inside)
        even = rising and float(np.std(steps)) < 0.01 * float(np.mean(steps))
        if rising and (named or of_time or even):
            found.append((named + 2.0 * of_time + 0.5 * even, signal))
    if not found:
        return None
    signal = max(found, key=lambda one: one[0])[1]
    stated = canonical(signal.unit or unit_of_name(signal.short)[1] or "")
    unit = stated if stated is not None and UNITS[stated][2] == "s" else ""
    if not unit:
        step = float(np.nanmedian(np.diff(signal.values)))
        unit = "s" if step < 0.5 else "ms" if step < 500.0 else "us"
    return Guess(
        column="time_s", signal=signal, unit=unit, stated=bool(stated), score=0.0, reasons=["it rises from row to row"]
    )


def driven(
    guesses: list[Guess],
    machine: Machine,
    *,
    better: float = 0.2,  # correlation by which another signal must go better with it
) -> None:
    """Exchange a leg's volts with another signal without a telling name where the position's rate goes with that one."""
    for leg in range(machine.n_legs):
        of_leg = {stem: places_column(stem, leg, machine.n_legs) for stem in ("position", "valve")}
        position, valve = (next((one for one in guesses if one.column == of_leg[s]), None) for s in of_leg)
        if position is None or valve is None or named_for(valve):
            continue
        rate = smooth(np.gradient(np.nan_to_num(position.values)))

        def alike(one: Guess, rate: Array = rate) -> float:
            return abs(lag_of(np.nan_to_num(one.values), rate)[1]) if len(one.values) == len(rate) else 0.0

        others = [one for one in guesses if one is not valve and one is not position and not named_for(one)]
        others = [one for one in others if score(one.signal, valve.column, machine) and one.column[:8] != "setpoint"]
        best = max(others, key=alike, default=None)
        if best is not None and alike(best) > max(DRIVES, alike(valve) + better):
            a, b = score(best.signal, valve.column, machine), score(valve.signal, best.column, machine)
            if a is not None and b is not None:
                guesses[guesses.index(best)], guesses[guesses.index(valve)] = b, a


def by_relation(guesses: list[Guess], machine: Machine) -> list[Guess]:
    """Setpoint and position told apart by who follows whom; volts by the rate that they make."""
    follows = 0.9  # correlation of a position with its setpoint
    by_column = {one.column: one for one in guesses}
    for leg in range(machine.n_legs):
        position, setpoint, valve = (
            by_column.get(places_column(stem, leg, machine.n_legs)) for stem in ("position", "setpoint", "valve")
        )
        if position and setpoint and len(position.values) == len(setpoint.values):
            lag, alike = lag_of(setpoint.values, position.values)
            if alike > follows and lag < 0 and not (named_for(position) or named_for(setpoint)):
                position.column, setpoint.column = setpoint.column, position.column
                position, setpoint = setpoint, position
                lag = -lag
            if alike > follows:
                position.reasons.append(f"it follows {setpoint.signal.name} by {lag} samples")
        if position and valve and len(position.values) == len(valve.values):
            rate = np.gradient(np.nan_to_num(position.values))
            alike = lag_of(np.nan_to_num(valve.values), smooth(rate))[1]
            if abs(alike) > DRIVES:
                valve.reasons.append(
                    f"the rate of {position.signal.name} goes with it (correlation {alike:.2f})"
                    + ("; its sign is turned" if alike < 0 else "")
                )
    return guesses


def named_for(guess: Guess) -> bool:
    """Does its name hold a word of its own column alone?"""
    return any(word in OWN[places()[guess.column][0].stem] for word in words_of(guess.signal.name))


def places_column(stem: str, leg: int, n_legs: int) -> str:
    """Column of a leg, from 0."""
    return next(
        name
        for name, (signal, place) in places().items()
        if signal.stem == stem and name in signal.columns(n_legs) and (n_legs == 1 or place == leg)
    )


def smooth(values: Array) -> Array:
    """Mean over 25 samples."""
    return np.convolve(values, np.ones(25) / 25, "same")


def lag_of(
    first: Array,
    second: Array,
    *,
    longest_lag: int = 200,  # samples in which one follows the other
) -> tuple[int, float]:
    """(samples by which `second` is later, correlation there), within longest_lag either way."""
    a, b = (np.nan_to_num(x - np.nanmean(x)) for x in (first, second))
    size = float(np.sqrt(np.sum(a**2) * np.sum(b**2)))
    if size == 0.0:
        return 0, 0.0
    n = 1 << (len(a) + longest_lag - 1).bit_length()
    both = np.fft.irfft(np.conj(np.fft.rfft(a, n)) * np.fft.rfft(b, n), n)
    near = np.r_[both[-longest_lag:], both[: longest_lag + 1]] / size
    k = int(np.argmax(np.abs(near)))
    return k - longest_lag, float(near[k])


def as_toml(proposal: Proposal, machine: Machine, source: str) -> str:
    """The mapping file, a line a column with what speaks for it, all six legs in one where they are named alike."""
    lines = [
        f"# Proposed by `hexsim map` from {source}: read it, correct it, and put it beside the logs.",
        f'kind = "{"hexapod" if machine.is_hexapod else "bench"}"',
        "[columns]",
    ]
    if proposal.time is not None:
        lines.append(line(proposal.time, "time_s", proposal.time.signal))
    done: set[str] = set()
    by_column = {one.column: one for one in proposal.guesses}
    for guess in proposal.guesses:
        if guess.column in done:
            continue
        if machine.is_hexapod and (pattern := of_all_legs(guess, by_column)) is not None:
            column, source_name, members = pattern
            done |= set(members)
            lines.append(
                f"{quoted(column)} = {{from = {quoted(source_name)}{unit_key(guess)}}}  # {'; '.join(guess.reasons)}"
            )
        else:
            done.add(guess.column)
            lines.append(line(guess, guess.column, guess.signal))
    lines += [f"# {column}: not found" for column in proposal.missing]
    lines += [f"# not used: {name}" for name in proposal.unused]
    return "\n".join(lines) + "\n"


def line(guess: Guess, column: str, signal: RawSignal) -> str:
    return f"{quoted(column)} = {{from = {quoted(signal.name)}{unit_key(guess)}}}  # {'; '.join(guess.reasons)}"


def unit_key(guess: Guess) -> str:
    return f", unit = {quoted(guess.unit)}"


def quoted(text: str) -> str:
    """A TOML string; a bare key where that is enough."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def of_all_legs(guess: Guess, by_column: dict[str, Guess]) -> tuple[str, str, list[str]] | None:
    """(column with {leg}, name with {leg} or {leg0}, the six columns) where all six are named alike, in one unit."""
    signal, _ = places()[guess.column]
    columns = signal.columns(6)
    if signal.scope != "leg" or not all(column in by_column for column in columns):
        return None
    six = [by_column[column] for column in columns]
    names = [one.signal.name for one in six]
    if len({one.unit for one in six}) > 1:
        return None
    for mark, first in ((LEG, 1), (LEG0, 0)):
        for place in re.finditer(r"\d+", names[0]):
            if place[0] == str(first):
                pattern = names[0][: place.start()] + mark + names[0][place.end() :]
                if names == [pattern.replace(mark, str(first + k)) for k in range(6)]:
                    return signal.column(LEG), pattern, list(columns)
    return None
