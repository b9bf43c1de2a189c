"""One threshold of perception for every figure that uses it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from made_up_run import made_up_run

from hexsim import load_scenario
from hexsim.qualification import rows
from hexsim.recording import report, summary_table
from hexsim.simulation import recent_motion
from hexsim.smoothness import threshold


def test_run_compare_live_and_qualify_have_one_threshold(monkeypatch):
    """Heave's is 0.154 m/s2 (Benson 1986), a bench's leg counts as heave; another value reaches every place that uses it."""
    assert threshold.times_threshold("z", 0.308) == pytest.approx(2.0) == threshold.times_threshold("leg", 0.308)
    assert threshold.times_threshold("roll", 1.0) is None
    run: Any = made_up_run(duration_s=10.0)
    asked, time = run.log["commanded_z_m"].to_numpy(), run.log["time_s"].to_numpy()
    run.log = run.log.with_columns(commanded_velocity_z_m_s=pl.Series(np.gradient(asked, time)))
    peak = run.summary["axes"]["z"]["peak_band_m_s2"]
    acceleration = run.log["true_acceleration_z_m_s2"].to_numpy()
    motion: Any = SimpleNamespace(time_s=time, acceleration={"z": acceleration})
    for value in (0.154, 2.0 * peak):
        monkeypatch.setitem(threshold.PERCEPTION_m_s2, "z", value)
        assert f"{summary_table.number(peak / value, 2)} times the threshold of perception" in report.run_sentence(
            run.summary, ("z",)
        )
        assert summary_table.comparison_rows({"none": run}, "z")[0]["times_threshold"] == pytest.approx(peak / value)
        assert [row.limit for row in rows.half_hertz_rows("z", motion, 4.0) if row.limit is not None] == [value]
        live = recent_motion.motion_figures(load_scenario("heave"), ("z",), run.log)
        assert live.times_threshold == pytest.approx(live.peak / value)
