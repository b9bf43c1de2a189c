"""What an identification keeps: its rounds, how it ended, and what it found."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hexsim.declaration import Machine
from hexsim.identification.bump import Bump


@dataclass(frozen=True, kw_only=True)
class Round:
    """A finished round in words and numbers for the story."""

    number: int
    purpose: str
    log: str
    verdict: str
    sentences: tuple[str, ...]
    effects: list[dict[str, Any]]
    error: dict[str, Any]
    budget: list[dict[str, Any]] = field(default_factory=list)
    expected: dict[str, Any] = field(default_factory=dict)


@dataclass(kw_only=True)
class Story:
    """What happened: the rounds, why it ended, the machine that it ended with, and its bump.

    failed: the machine, the link to it, or the host's watch ended it.  interrupted: the user did.
    learned: start parameters for the compensator, an entry a leg.
    machine_s: machine time used, interrupted identifications of the same folder included.
    """

    machine: Machine
    folder: Path
    rounds: list[Round] = field(default_factory=list)
    ended: str = ""
    failed: bool = False
    interrupted: bool = False
    fitted: Machine | None = None
    learned: list[dict[str, Any]] = field(default_factory=list)
    bump: Bump | None = None
    no_bump: str = ""
    machine_s: float = 0.0

    def to_json(self) -> dict[str, Any]:
        return {
            "machine": self.machine.name,
            "ended": self.ended,
            "failed": self.failed,
            "machine_s": self.machine_s,
            "verdict": self.rounds[-1].verdict if self.rounds else None,
            "rounds": [vars(one) | {"sentences": list(one.sentences)} for one in self.rounds],
            "bump": self.bump.to_json() if self.bump else self.no_bump or None,
        }
