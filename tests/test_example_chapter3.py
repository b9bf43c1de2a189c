"""The example that draws chapter 3 of the report runs as its first lines say."""

import runpy
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[1] / "examples" / "report_chapter3.py"


@pytest.mark.slow  # the same peaks are in test_report.py
def test_the_figures_are_drawn_and_the_peaks_stand_beside_the_independent_ones(tmp_path, monkeypatch, capsys):
    """Two pictures a valve, and peaks within 2 % of the independent calculation, warnings being errors."""
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), "--duration", "9", "--out", str(tmp_path)])
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    pictures = sorted(path.name for path in tmp_path.iterdir())
    assert pictures == sorted(
        f"{v}_{w}.png" for v in ("overlap", "quadratic", "zero_lap") for w in ("results", "acceleration")
    )
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if "no band limit" in line]
    peaks = {line[0]: (float(line[-3]), float(line[-2])) for line in lines}
    assert set(peaks) == {"overlap", "quadratic", "zero"}
    for value, independent in peaks.values():
        assert abs(value / independent - 1) < 0.02
