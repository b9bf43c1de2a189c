"""The examples of compensation run."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest
from leg_plant import run

import compensation

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture
def examples_on_path(monkeypatch):
    """Examples importable by name, as with PYTHONPATH=examples."""
    monkeypatch.syspath_prepend(str(EXAMPLES))


def test_own_compensator_is_short_and_loads(examples_on_path) -> None:
    """Loaded by module:Class, under 60 lines, and it adds its +-45 mV."""
    made = compensation.create("own_compensator:SetpointDirection")
    assert len((EXAMPLES / "own_compensator.py").read_text().splitlines()) < 60
    record = run(made, duration_s=6.0)
    assert record.added_V.max() == pytest.approx(0.045)
    assert record.added_V.min() == pytest.approx(-0.045)


@pytest.mark.slow
def test_report_chapter5_draws_its_figures(examples_on_path, tmp_path) -> None:
    """A short run draws the peaks and the functions."""
    module = importlib.import_module("report_chapter5")
    records = {name: module.drive(made, 8.0) for name, made in module.algorithms().items()}
    module.draw_peaks(records, tmp_path)
    module.draw_functions(records, tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"peaks.png", "functions.png"}
    sys.modules.pop("report_chapter5", None)
