"""The chance that a verdict is wrong is a count of the kept journals."""

import runpy
from pathlib import Path

import pytest

from hexsim.inference import stated
from hexsim.tracing.report.tables import chances


def test_the_stated_chance_is_a_count(monkeypatch):
    """None wrong of 59 is at most 5 % (0.95^59 = 0.0485); all wrong is 1; the sentence of a name says the counts of its kind."""
    assert stated.at_most(0, 59) == pytest.approx(1 - 0.05 ** (1 / 59))
    assert stated.at_most(3, 3) == 1.0
    monkeypatch.setattr(stated, "counts", lambda: {"name": (0, 59)})
    assert stated.stated("name") == "wrong on made-up machines: 0 of 59 names alone, at most 5 % at 95 %"


def test_the_counts_are_those_of_the_journals():
    """calibration.toml is what its command makes of the journals of made-up machines."""
    script = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "stated_chances.py"))
    assert script["STATED"].read_text(encoding="utf-8") == script["state"]()


def test_a_hydraulic_name_has_the_chance_of_its_kind(monkeypatch):
    """A name beside a residual and a tied one each have the counts of their own kind, a learned curve none."""
    monkeypatch.setattr(stated, "counts", lambda: {"partly": (1, 100), "partly, tied": (0, 20)})
    named = [{"name": "a", "tied_with": []}, {"name": "b", "tied_with": ["c"]}, {"name": "", "tied_with": []}]
    alone, tied = chances({"verdict": "partly", "effects": named})
    assert alone == "wrong on made-up machines: 1 of 100 names alone beside a residual, at most 5 % at 95 %"
    assert "0 of 20 ties beside a residual, at most 14 %" in tied
