"""What an engineer should know of an effect: its signature, what to check first on the machine, how to mend it.

The texts are the table `effects/advice.toml`, one entry an effect. An effect of another package has none unless its
description says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from hexsim.files.toml_files import read_toml

TABLE = Path(__file__).parent / "effects" / "advice.toml"


@dataclass(frozen=True, kw_only=True)
class Advice:
    """signature: what it looks like in the logs. check: on the machine. mend: what to do about it.

    shown_in, over: balance and signal of its picture, where they are not left to the picture.
    """

    signature: str = "no signature is written for this effect: see its description"
    check: str = "no check is written for this effect"
    mend: str = "–"
    shown_in: str = ""
    over: str = ""


@cache
def advice() -> dict[str, Advice]:
    """By name of the effect."""
    return {name: Advice(**texts) for name, texts in read_toml(TABLE).items()}


def advice_of(name: str) -> Advice:
    """Of one effect; what is known of any where nothing is written."""
    return advice().get(name, Advice())
