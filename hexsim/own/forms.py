"""Formulas over a machine's signals: products of at most two factors, each a power, abs, sign, sin, tanh or one-sided form of a signal.

A formula is an effect row as a person writes it under [[effects]]; its coefficient has the unit that makes the term fit the sum, and what
stands inside a function is made dimensionless by a number of its own. Its length is the log of how many formulas can be written with as
many choices: a prior, so that a larger one must predict better by what its choices are worth.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from hexsim.inference.verdict import GATES
from hexsim.own.declaration import EffectNumber, EffectRow, MemoryTable, ModelTables, ParameterTable
from hexsim.own.effects import UNITS, Candidate, Sizes, candidates, known_unit, place_of, span_of, with_values


class Starts(NamedTuple):
    """Starts of the search: exponents that laws have, and where fitted numbers begin."""

    # exponents of laws: roots, areas, weirs and contacts, kinetic pressure, cubes
    standard: tuple[float, ...] = (0.5, 1.0, 1.5, 2.0, 3.0)
    knees: tuple[float, ...] = (-0.6, -0.3, 0.0, 0.3, 0.6)  # of half the range: starts of a knee
    widths: tuple[float, ...] = (0.05, 0.2, 0.6)  # of half the range: starts of tanh's width
    exponents: tuple[float, ...] = (0.7, 1.3, 1.7, 2.5)  # starts of a fitted exponent
    # widths, of half the range of a place; 2 would never be filled
    plays: tuple[float, ...] = (0.1, 0.25, 0.5, 1.0, 1.5)


STARTS = Starts()


@dataclass(frozen=True, kw_only=True)
class Signal:
    """size: rms. middle, half: of its range. waves: half waves over it, of the finest sine that shows."""

    name: str
    unit: str
    size: float
    middle: float
    half: float
    waves: int

    @property
    def positive(self) -> bool:
        return self.middle - self.half >= 0.0


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A form of one signal. kind: what it is, for every start of its numbers. never_negative: for friction. twin: of a sine, its
    cosine. standard: of a fitted exponent, the kinds of those that are forms of their own."""

    kind: str
    text: str
    size: float
    unit: str = ""
    numbers: dict[str, EffectNumber] = field(default_factory=dict)
    twin: str = ""
    never_negative: bool = False
    start: str = ""
    standard: dict[float, str] = field(default_factory=dict)


def powers(s: Signal, exponents: Sequence[float]) -> Iterator[Factor]:
    """|s|^p, and with the sign of s where it has two."""
    for p in exponents:
        even = {0.5: f"sqrt(abs({s.name}))", 1.0: f"abs({s.name})"}.get(p, f"abs({s.name})**{p:g}")
        even = f"{s.name}**2" if p == 2.0 else even
        odd = {0.5: f"root({s.name})", 1.0: s.name, 3.0: f"{s.name}**3"}.get(p, f"{s.name} * abs({s.name})**{p - 1:g}")
        odd = f"{s.name} * abs({s.name})" if p == 2.0 else odd
        unit = s.unit if p == 1.0 else f"({s.unit}){p:g}" if "/" in s.unit else f"{s.unit}{p:g}"
        known = {"size": s.size**p, "unit": unit}
        if s.positive:
            text = {0.5: f"sqrt({s.name})", 1.0: s.name}.get(p, f"{s.name}**{p:g}")
            yield Factor(kind=text, text=text, never_negative=True, **known)
            continue
        yield Factor(kind=odd, text=odd, **known)
        yield Factor(kind=even, text=even, never_negative=True, **known)


def side_of(s: Signal) -> Iterator[Factor]:
    if not s.positive:
        yield Factor(kind=f"sign({s.name})", text=f"sign({s.name})", size=1.0)


def sines(s: Signal) -> Iterator[Factor]:
    for k in range(1, s.waves + 1):
        wave = EffectNumber(start=0.5 * math.pi * k / s.half, low=0.0, scale=0.05 / s.half, unit=f"rad/{s.unit}")
        yield Factor(
            kind=f"sin(k * {s.name})",
            text=f"sin(form_wave * {s.name})",
            twin=f"cos(form_wave * {s.name})",
            size=0.7,
            numbers={"form_wave": wave},
            start=f"wave {k}",
        )


def bends(s: Signal) -> Iterator[Factor]:
    """tanh, a knee, and a fitted exponent."""
    for w in () if s.positive else STARTS.widths:
        width = EffectNumber(start=w * s.half, low=1e-3 * s.half, high=10.0 * s.half, scale=0.1 * s.half, unit=s.unit)
        yield Factor(
            kind=f"tanh({s.name} / w)",
            text=f"tanh({s.name} / form_width)",
            size=0.7,
            numbers={"form_width": width},
            start=f"width {w}",
        )
    for c, up in itertools.product(STARTS.knees, (True, False)):
        knee = EffectNumber(
            start=s.middle + c * s.half, low=s.middle - s.half, high=s.middle + s.half, scale=0.1 * s.half, unit=s.unit
        )
        kind = f"max({s.name} - c, 0)" if up else f"max(c - {s.name}, 0)"
        text = kind.replace("c -", "form_knee -").replace("- c", "- form_knee")
        yield Factor(
            kind=kind,
            text=text,
            size=0.5 * s.half,
            unit=s.unit,
            numbers={"form_knee": knee},
            never_negative=True,
            start=f"knee {c}",
        )
    whole, ways = list(powers(s, STARTS.standard)), 1 if s.positive else 2
    odd, even = ({p: whole[ways * k + j].kind for k, p in enumerate(STARTS.standard)} for j in (0, ways - 1))
    for n in STARTS.exponents:
        exponent = EffectNumber(start=n, low=0.0, high=8.0, scale=0.3, unit="1")
        known = {
            "size": s.size**n,
            "unit": f"{s.unit}^n",
            "numbers": {"form_exponent": exponent},
            "start": f"exponent {n}",
        }
        text = f"abs({s.name})**form_exponent"
        yield Factor(kind=f"abs({s.name})**n", text=text, never_negative=True, standard=even, **known)
        if not s.positive:
            kind = f"sign({s.name}) * abs({s.name})**n"
            yield Factor(kind=kind, text=f"sign({s.name}) * {text}", standard=odd, **known)


def alone(s: Signal) -> list[Factor]:
    return [*powers(s, STARTS.standard), *side_of(s), *sines(s), *bends(s)]


def first_of(s: Signal) -> list[Factor]:
    """Of a product."""
    return [*powers(s, (0.5, 1.0, 2.0)), *side_of(s)]


def length_of(one: Factor, every: Sequence[Factor]) -> float:
    """Log of how many kinds there are, and of the starts that this one has: each is another look."""
    kinds = [factor.kind for factor in every]
    return math.log(len(set(kinds))) + math.log(kinds.count(one.kind))


def products(signals: Sequence[Signal], with_one_of: set[str]) -> Iterator[tuple[tuple[Factor, ...], float]]:
    """(factors, length in nats). with_one_of: signals of which one must be in it."""
    for s in signals:
        if s.name in with_one_of:
            every = alone(s)
            yield from (((one,), math.log(len(signals)) + length_of(one, every)) for one in every)
    for a, b in itertools.combinations(signals, 2):
        if not {a.name, b.name} & with_one_of:
            continue
        one, other = first_of(a), first_of(b)
        which = 2.0 * math.log(len(signals))
        yield from (
            (pair, which + length_of(pair[0], one) + length_of(pair[1], other))
            for pair in itertools.product(one, other)
        )
        for wavy, plain in ((a, other), (b, one)):
            every = [*first_of(wavy), *sines(wavy)]
            for wave, factor in itertools.product(sines(wavy), plain):
                if factor.kind in (a.name, b.name) or factor.kind.startswith("sign("):
                    yield (wave, factor), which + length_of(wave, every) + length_of(factor, plain)


def row_of(factors: Sequence[Factor], on: str, what: str, size: float, unit: str) -> EffectRow | None:
    """The formula as an effect. size, unit: of the sum (or input, output) that it joins. None where it cannot be written."""
    text, name = " * ".join(one.text for one in factors), " * ".join(one.kind for one in factors)
    scale = 0.1 * size / (math.prod(one.size for one in factors) or 1.0)
    below = " ".join(one.unit for one in factors if one.unit)
    amount = EffectNumber(scale=scale, unit=f"{unit}/({below})" if below else unit)
    numbers = {"form_amount": amount}
    twin = next((one for one in factors if one.twin), None)
    if twin is not None:
        numbers["form_other"] = amount
        text = f"form_amount * {text} + form_other * {text.replace(twin.text, twin.twin)}"
    else:
        text = f"form_amount * {text}"
    for one in factors:
        numbers |= one.numbers
    known: dict = {"name": name, "what": what, "on": on}
    if what != "sum":
        return EffectRow(**known, becomes=f"{{y}} + {text}", parameters=numbers)
    side = next((one for one in factors if one.kind == f"sign({on})"), None)
    if side is None:
        return EffectRow(**known, adds=f"-({text})", parameters=numbers)
    others = [one for one in factors if one is not side]
    if twin is not None or not all(one.never_negative for one in others):
        return None  # a force that turns at rest and drives there is no friction
    dry = " * ".join(["form_amount", *(one.text for one in others)])
    numbers["form_amount"] = amount.model_copy(update={"sign": 1})
    return EffectRow(**known, forwards=dry, backwards=dry, parameters=numbers)


@dataclass(frozen=True, kw_only=True)
class Form:
    """A formula at its place: as a row, as a candidate, its length [nats], the numbers that are searched beside its size."""

    row: EffectRow
    candidate: Candidate
    length: float
    standard: dict[float, str] = field(default_factory=dict)

    @property
    def exponent(self) -> str | None:
        return next((name for name in self.candidate.numbers if name.startswith("form_exponent")), None)

    @property
    def title(self) -> str:
        return self.candidate.title


def forms(tables: ModelTables, inputs: Sequence[str], sizes: Callable[[str, str], Sizes]) -> list[Form]:
    """Every formula at every place of a machine, once for each start of its numbers."""
    states = [signal_of(tables, name, sizes("sum", name), "sum") for name in tables.states]
    driven = [signal_of(tables, name, sizes("input", name), "input") for name in inputs]
    sums = [name for name, state in tables.states.items() if state.sum is not None]
    ends = [("input", one) for one in driven if one.name in tables.signals and tables.signals[one.name].quantity]
    ends += [("output", signal_of(tables, name, sizes("output", name), "output")) for name in tables.outputs]
    where, found = math.log(len(sums) + len(ends)), []
    for on in sums:
        size, unit = sizes("sum", on), UNITS.get(tables.states[on].quantity or "", "S")
        for factors, length in products([*states, *driven], {one.name for one in states}):
            found += made(tables, factors, on, "sum", size, size.S, unit, where + length)
    for what, signal in ends:
        size = sizes(what, signal.name)
        own = alone(replace(signal, name="{y}"))
        for factor in own:
            length = where + length_of(factor, own)
            found += made(tables, (factor,), signal.name, what, size, size.Y, signal.unit, length)
    return found


def made(
    tables: ModelTables,
    factors: Sequence[Factor],
    on: str,
    what: str,
    sizes: Sizes,
    size: float,
    unit: str,
    length: float,
) -> list[Form]:
    row = row_of(factors, on, what, size, unit)
    if row is None:
        return []
    start = " ".join(one.start for one in factors if one.start)
    before = {"input": f"{on} + ", "output": f"({tables.outputs[on].formula}) + " if what == "output" else ""}.get(
        what, ""
    )
    name = row.name.replace("{y}", on)
    candidate = replace(candidates(row, on, None, tables, sizes)[0], shape=start, name=name, unchanged=before)
    row = row.model_copy(update={"name": candidate.name})
    standard = {p: f"{kind.replace('{y}', on)} in {on}" for one in factors for p, kind in one.standard.items()}
    return [Form(row=row, candidate=candidate, length=length, standard=standard)]


def as_effect(form: Form, fitted: Mapping[str, float]) -> dict[str, Any]:
    """The formula as [[effects]] of a model file, with the numbers inside its functions as fitted."""
    numbers = {}
    for (key, number), name in zip(form.row.parameters.items(), form.candidate.numbers, strict=True):
        inside = name not in form.candidate.amplitude
        numbers[key] = number.model_copy(update={"start": float(fitted[name])}) if inside else number
    row = form.row.model_copy(update={"parameters": numbers})
    return {"effects": [row.model_dump(exclude_none=True, exclude_defaults=True)]}


def signal_of(tables: ModelTables, name: str, sizes: Sizes, what: str) -> Signal:
    half, middle = (sizes.H, sizes.C) if what == "sum" else (sizes.P, sizes.M)
    return Signal(
        name=name,
        unit=known_unit(tables, name) or f"[{name}]",
        size=sizes.X if what == "sum" else sizes.Y,
        middle=middle,
        half=half or 1.0,
        waves=math.ceil(sizes.N),
    )


def memories(
    tables: ModelTables,
    effect: Candidate,
    fitted: Mapping[str, float],
    sizes: Callable[[str, str], Sizes],
    *,
    first_samples: float = 2.0,  # samples: shortest time constant by which a memory is looked for; the longest is a tenth of a run
    later_ratio: float = 3.0,  # from one time constant to the next: a lag between two differs from one of them by 0.27 at most
) -> list[list[Candidate]]:
    """What follows the effect or a signal of its sum late, damps by what was, or plays over the place: each with every time constant or
    width. A force that remembers is in none of its signals."""
    on, text, at = effect.on, effect.formulas.get("adds"), place_of(effect.on, tables)
    if effect.what != "sum":
        return []
    own = sizes("sum", on)
    asked = [(name, name, "{memory}", 1.0 / sizes("sum", name).X) for name in tables.states]
    asked += [
        (f"{name}**2", f"{name}**2", "{x} * {memory}", 1.0 / own.X / sizes("sum", name).X ** 2)
        for name in tables.states
    ]
    if text is not None and effect.memory is None and effect.curve is None:
        values = {name: f"({float(fitted[name])!r})" for name in effect.numbers}
        asked.append((effect.name, with_values(text, values), "{memory}", 1.0 / own.S))
    count = max(int(math.log(0.1 * own.D / (first_samples * own.T)) / math.log(later_ratio)), 0) + 1
    late = [{"kind": "lag", "time_s": first_samples * own.T * later_ratio**k} for k in range(count)]
    kinds = [(name, adds, scale, [{"of": of, **one} for one in late]) for name, of, adds, scale in asked]
    if at is not None:
        plays = [{"kind": "backlash", "of": at, "width": width * own.P} for width in STARTS.plays]
        kinds.append((f"{at} with play", "{memory}", 1.0 / own.P, plays))
    return [
        [some_memory(tables, on, name, adds, scale, one, own, k) for k, one in enumerate(tries)]
        for name, adds, scale, tries in kinds
    ]


def loosened(tables: ModelTables, effect: Candidate, sizes: Callable[[str, str], Sizes]) -> Candidate:
    """The effect where its form is not quite right: what it does times 1 + slope, bend and sides over each of its own signals,
    numbers that are 0 but for a share. Itself where it has no signals, and so no form."""
    own = effect.signals | effect.names_in([effect.memory[1].of] if effect.memory else [])
    spans = {name: span_of(sizes("sum", name)) for name in tables.states if name in own}
    if effect.what == "input":
        spans[effect.on] = (sizes("input", effect.on).M, sizes("input", effect.on).P)
    size = [*effect.amplitude, *([effect.switch] if effect.switch else [])]
    numbers, factor = {}, "1"
    for k, (name, (middle, half)) in enumerate(spans.items()):
        z = f"(({name} - ({middle:.7g})) / {half:.7g})"
        # Legendre's, and 1 over their mean squares
        shapes = {"slope": (z, 3.0), "bend": (f"(1.5 * {z}**2 - 0.5)", 5.0), "side": (f"sign({name})", 1.0)}
        shapes = {key: shapes[key] for key in ("slope", "bend", *(("side",) if abs(middle) < half else ()))}
        for shape, (text, square) in shapes.items():
            number = f"form_{shape}_{k}_{size[0]}"
            error = GATES.form * math.sqrt(square / len(shapes) / len(spans))
            numbers[number] = ParameterTable(declared=0.0, uncertainty=error)
            factor += f" + {number} * {text}"
    formulas = {}
    for key, text in effect.formulas.items():
        without = effect.on if effect.what == "input" else f"({with_values(text, {name: '0' for name in size})})"
        whole = key not in ("becomes", "storage")
        formulas[key] = f"({text}) * ({factor})" if whole else f"{without} + (({text}) - {without}) * ({factor})"
    return replace(effect, formulas=formulas, numbers=effect.numbers | numbers) if spans else effect


def some_memory(
    tables: ModelTables, on: str, name: str, adds: str, scale: float, memory: dict, own: Sizes, k: int
) -> Candidate:
    row = EffectRow(
        name=f"some memory of {name}"[:80],
        on=on,
        adds=f"form_late * {adds}",
        memory=MemoryTable.model_validate(memory),
        parameters={"form_late": EffectNumber(scale=0.05 * own.S * scale)},
    )
    return replace(candidates(row, on, None, tables, own)[0], shape=f"{k + 1}")
