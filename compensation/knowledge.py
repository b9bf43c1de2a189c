"""What a compensator knows of its leg, for people: values with standard errors, and the bump that is expected."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """value and its standard error in `unit`; before: the error before any motion was seen."""

    name: str
    unit: str
    value: float
    error: float
    before: float


@dataclass(frozen=True, kw_only=True)
class Knowledge:
    """Of one leg. expected_m_s2: bump with the compensator's volts, its doubt included; plain_m_s2: with plain control; both from the
    model, nan before the first reversal. engages_m_s2: expectation below which it engages, 0 for a leg that its model does not
    describe. share: of its volts that is added, 0 to 1.
    """

    estimates: tuple[Estimate, ...]
    expected_m_s2: float
    plain_m_s2: float
    engages_m_s2: float
    share: float
