"""Elements with a memory, one row a kind: what a model file may name under [memory].

Each is written in the language of the model file itself: states with a rate, or with a step that is taken after each time step of
length step_s (exactly where the rate would be stiff or has no slope: friction at rest, backlash, rate limits, end stops), and what
the element gives out. `{of}` is its input, `{name}` its own name, the other braces are its keys.

| kind | equation | source |
|---|---|---|
| lag | tau dy/dt = x - y; begins at x | |
| warm_up | the same; begins at 0 | |
| rate_limit | dy/dt = x - y, at most `most` a second | |
| backlash | y stays within half the width of x (play) | Krasnosel'skii and Pokrovskii 1989 |
| dead_band | max(x - upper, 0) - max(lower - x, 0) | |
| dahl | dz/dt = v (1 - sign(v) z / Fc); the force reaches Fc over the distance Fc / stiffness | Dahl 1968 |
| lugre | dz/dt = v - |v| z / g(v); force = stiffness z + damping dz/dt | Canudas de Wit et al. 1995 |
| bouc_wen | dz/dt = alpha v - beta (gamma |v| z + delta v |z|) | Bouc 1967, Wen 1976 |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hexsim.errors import HexsimError
from hexsim.own.declaration import MemoryTable, ModelTables, StateTable


@dataclass(frozen=True, kw_only=True)
class Element:
    """One kind. keys: its own formulas, with a default or None (must be given). rate or after: of its state. gives: the formula of its
    name, where it is not the state. start: of the state."""

    keys: dict[str, str | None]
    rate: str | None = None
    after: str | None = None
    gives: str | None = None
    start: str = "0"


APPROACH = "exp(-abs({of}) * step_s / ({reach}))"  # of a bristle to where it slides, over a time step

ELEMENTS: dict[str, Element] = {
    "lag": Element(keys={"time_s": None}, rate="(({of}) - {state}) / ({time_s})", start="{of}"),
    "warm_up": Element(keys={"time_s": None}, rate="(({of}) - {state}) / ({time_s})"),
    "rate_limit": Element(
        keys={"most": None},
        after="{state} + max(-({most}) * step_s, min(({most}) * step_s, ({of}) - {state}))",
        start="{of}",
    ),
    "backlash": Element(
        keys={"width": None},
        after="max(({of}) - 0.5 * ({width}), min(({of}) + 0.5 * ({width}), {state}))",
        start="{of}",
    ),
    "dead_band": Element(
        keys={"lower": None, "upper": None}, gives="max(({of}) - ({upper}), 0) - max(({lower}) - ({of}), 0)"
    ),
    "dahl": Element(
        keys={"coulomb": None, "stiffness": None},
        after="sign({of}) * ({coulomb}) + ({state} - sign({of}) * ({coulomb})) * "
        + APPROACH.replace("{reach}", "({coulomb}) / ({stiffness})"),
    ),
    "lugre": Element(
        keys={"coulomb": None, "static": None, "stribeck": None, "stiffness": None, "damping": "0"},
        after="sign({of}) * ({sliding}) + ({state} - sign({of}) * ({sliding})) * "
        + APPROACH.replace("{reach}", "({sliding}) / ({stiffness})"),
        gives="{state} + ({damping}) * (({of}) - abs({of}) * {state} / ({sliding}))",
    ),
    "bouc_wen": Element(
        keys={"alpha": None, "beta": "1", "gamma": None, "delta": None},
        rate="({alpha}) * ({of}) - ({beta}) * (({gamma}) * abs({of}) * {state} + ({delta}) * ({of}) * abs({state}))",
    ),
}
SLIDING = "(({coulomb}) + (({static}) - ({coulomb})) * exp(-(({of}) / ({stribeck}))**2))"


def memory_states(tables: ModelTables, where: str) -> tuple[dict[str, tuple[StateTable, str | None]], dict[str, str]]:
    """States of the elements with what each time step does to them, and the formulas of names that are not states."""
    states: dict[str, tuple[StateTable, str | None]] = {}
    given: dict[str, str] = {}
    for name, table in tables.memory.items():
        place = f"{where} [memory.{name}]"
        if table.kind not in ELEMENTS:
            raise HexsimError(f"{place}: {table.kind[:40]!r} is no kind of memory; there are {', '.join(ELEMENTS)}")
        element, keys = ELEMENTS[table.kind], keys_of(table, place)
        stateless = element.rate is None and element.after is None
        state = name if stateless or element.gives is None else f"{name}__state"
        fill = lambda text, keys=keys, state=state: None if text is None else filled(text, keys | {"state": state})  # noqa: E731
        if not stateless:
            start = table.start or fill(element.start) or "0"
            states[state] = StateTable(rate=fill(element.rate), start=start), fill(element.after)
        if element.gives is not None:
            given[name] = fill(element.gives) or ""
    return states, given


def keys_of(table: MemoryTable, place: str) -> dict[str, str]:
    """Formulas of an element's keys, defaults put in. Raises HexsimError for a key that is missing or unknown."""
    element, extra = ELEMENTS[table.kind], dict(table.__pydantic_extra__ or {})
    unknown = [key for key in extra if key not in element.keys]
    missing = [key for key, default in element.keys.items() if default is None and key not in extra]
    if unknown or missing:
        raise HexsimError(
            f"{place}: {table.kind} has the keys {', '.join(('of', *element.keys))}; "
            + (f"{unknown[0]!r} is none" if unknown else f"{missing[0]} is missing")
        )
    return {"of": table.of} | {key: str(extra.get(key, default)) for key, default in element.keys.items()}


def filled(text: str, keys: Mapping[str, str]) -> str:
    text = text.replace("({sliding})", SLIDING)
    for key, value in keys.items():
        text = text.replace("{" + key + "}", value)
    return text
