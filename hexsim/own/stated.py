"""The stated chance of being wrong: how often verdicts of each kind were, on made-up machines that were sealed (calibration.toml)."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files

from scipy.special import betaincinv

from hexsim.inference.verdict import Judgment

WORDS = {"name": "names alone", "tie": "ties", "formula": "formulas"}


@cache
def counts() -> dict[str, tuple[int, int]]:
    """Kind of verdict -> (wrong, all)."""
    table = tomllib.loads(files("hexsim.own").joinpath("calibration.toml").read_text(encoding="utf-8"))
    return {kind: (int(table[kind]["wrong"]), int(table[kind]["of"])) for kind in WORDS}


def kind_of(step: Judgment) -> str:
    return "tie" if step.tied else "name"


def at_most(
    wrong: int,
    of: int,
    *,
    sure: float = 0.95,  # of the upper bound
) -> float:
    """Upper bound of the chance (Clopper and Pearson 1934)."""
    return float(betaincinv(wrong + 1, of - wrong, sure)) if wrong < of else 1.0


def stated(kind: str) -> str:
    """In words."""
    wrong, of = counts()[kind]
    return f"wrong on made-up machines: {wrong} of {of} {WORDS[kind]}, at most {100 * at_most(wrong, of):.0f} % at 95 %"
