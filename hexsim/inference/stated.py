"""The stated chance of being wrong: how often verdicts of each kind were, on made-up machines (calibration.toml)."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from scipy.special import betaincinv

# Kind -> words. Of a custom machine: name, tie, formula. Of a hydraulic one: how much is left beside the name, alone or tied.
WORDS = {
    "name": "names alone",
    "tie": "ties",
    "formula": "formulas",
    "explained": "names alone that leave noise",
    "explained, tied": "ties that leave noise",
    "partly": "names alone beside a residual",
    "partly, tied": "ties beside a residual",
}


@cache
def counts() -> dict[str, tuple[int, int]]:
    """Kind of verdict -> (wrong, all)."""
    table = tomllib.loads(files("hexsim.inference").joinpath("calibration.toml").read_text(encoding="utf-8"))
    return {kind: (int(table[kind]["wrong"]), int(table[kind]["of"])) for kind in WORDS}


def at_most(
    wrong: int,
    of: int,
    *,
    sure: float = 0.95,  # of the upper bound
) -> float:
    """Upper bound of the chance (Clopper and Pearson 1934)."""
    return float(betaincinv(wrong + 1, of - wrong, sure)) if wrong < of else 1.0


def hydraulic(verdict: str, tied: Sequence[str]) -> str:
    """The kind of a name of a hydraulic machine's trace."""
    return f"{verdict}, tied" if tied else verdict


def stated(kind: str) -> str:
    """In words."""
    wrong, of = counts()[kind]
    return f"wrong on made-up machines: {wrong} of {of} {WORDS[kind]}, at most {100 * at_most(wrong, of):.0f} % at 95 %"


def chance(kind: str) -> dict[str, Any]:
    """For report.json."""
    wrong, of = counts()[kind]
    return {"wrong": {"machines": of, "wrong": wrong, "at_most": at_most(wrong, of)}}
