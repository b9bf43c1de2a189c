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

from dataclasses import dataclass


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
    "dead_band": Element(keys={"lower": None, "upper": None}, gives="max(({of}) - ({upper}), 0) - max(({lower}) - ({of}), 0)"),
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
}  # fmt: skip
SLIDING = "(({coulomb}) + (({static}) - ({coulomb})) * exp(-(({of}) / ({stribeck}))**2))"
