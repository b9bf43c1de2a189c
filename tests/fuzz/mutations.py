"""Strategies: files as people and accidents write them, made from good ones."""

import copy
import math
from typing import Any

import tomli_w
from hypothesis import strategies as st

NASTY_NUMBERS = [
    0, -0.0, 1, -1, 1e-300, 5e-324, -1e-300, 1e300, -1e300, 1.8e308, math.nan, math.inf, -math.inf, 2**31, 2**63 - 1,
    -(2**63), 1e-12, 1e12, 0.1, 10_000, 1e6,
]  # fmt: skip
NASTY_TEXTS = [
    "",
    " ",
    "7",
    "nan",
    "[/red]",
    "[red]",
    "../../x",
    "a/b",
    "a\\b",
    "ä" * 40,
    "x" * 300,
    "a\u202eb",
    "\x1b[31m",
    "🦀",
    "NUL",
    "-",
    "--help",
]

numbers = st.one_of(
    st.sampled_from(NASTY_NUMBERS), st.floats(), st.integers(-(2**63), 2**63 - 1), st.floats(-10.0, 10.0)
)
texts = st.one_of(st.sampled_from(NASTY_TEXTS), st.text(max_size=20))
leaves = st.one_of(numbers, st.booleans(), texts)
values = st.recursive(
    leaves,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(texts, inner, max_size=3)),
    max_leaves=6,
)


def places(tables: Any, path: tuple = ()) -> list[tuple]:
    """Every place of nested tables and lists."""
    found = []
    for key, value in tables.items() if isinstance(tables, dict) else enumerate(tables):
        found.append((*path, key))
        if isinstance(value, (dict, list)):
            found += places(value, (*path, key))
    return found


@st.composite
def mutated(draw, good: list[dict[str, Any]]) -> dict[str, Any]:
    """One of the good tables with one to four changes: a key gone, renamed or new, a value of another size or kind."""
    tables = copy.deepcopy(draw(st.sampled_from(good)))
    for _ in range(draw(st.integers(1, 4))):
        found = places(tables)
        if not found:
            break
        *path, key = draw(st.sampled_from(found))
        parent: Any = tables
        for part in path:
            parent = parent[part]
        change = draw(st.sampled_from(["scale", "scale", "value", "value", "drop", "rename", "add"]))
        value = parent[key]
        if change == "scale" and isinstance(value, (int, float)) and not isinstance(value, bool):
            parent[key] = value * 10.0 ** draw(st.floats(-6.0, 6.0))
        elif change == "drop":
            del parent[key]
        elif change == "rename" and isinstance(parent, dict):
            parent[draw(texts)] = parent.pop(key)
        elif change == "add" and isinstance(parent, dict):
            parent[draw(texts)] = draw(values)
        else:
            parent[key] = draw(values)
    return tables


@st.composite
def torn(draw, text: str) -> bytes:
    """Text with a piece cut out, doubled, or overwritten with bytes of any kind."""
    data = text.encode()
    for _ in range(draw(st.integers(1, 3))):
        first = draw(st.integers(0, max(len(data) - 1, 0)))
        last = min(len(data), first + draw(st.integers(0, 40)))
        piece = draw(
            st.sampled_from(
                [
                    b"",
                    b"[" * 3000,
                    b"9" * 5000,
                    b"\x00",
                    b"\xff\xfe",
                    b"\n[[",
                    b'"""',
                    b"= =",
                    b",,,;",
                    data[first:last] * 3,
                ]
            )
        )
        data = data[:first] + piece + data[last:]
    return data


def as_toml(tables: dict[str, Any]) -> str:
    return tomli_w.dumps(tables)


@st.composite
def at_bounds(draw, good: list[dict[str, Any]], ranges: dict[tuple[str, str], tuple[float, float]]) -> dict[str, Any]:
    """One of the good machines with one to six numbers at the ends of what is possible, or anywhere between."""
    tables = copy.deepcopy(draw(st.sampled_from(good)))
    known = sorted(place for place in ranges if place[0] in tables)
    for table, key in draw(st.lists(st.sampled_from(known), min_size=1, max_size=6)):
        low, high = ranges[table, key]
        share = draw(st.floats(0.0, 1.0))
        between = low * (high / low) ** share if low > 0 else low + share * (high - low)
        tables[table][key] = draw(st.sampled_from([low, high, between, between]))
    return tables
