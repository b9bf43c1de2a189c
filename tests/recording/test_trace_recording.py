"""Measured, declared and fitted on one time line."""

from pathlib import Path

import numpy as np
import polars as pl
from test_rerun_recording import Recording

from hexsim.machine import load_machine
from hexsim.signals.log import Log
from hexsim.tracing.report import recording as trace_recording

BENCH = Path(__file__).parents[1] / "data" / "bench_none"


def test_all_three_lie_on_one_time_line_and_the_deviation_is_from_the_measured_one(tmp_path):
    """The replayed machine follows the measured setpoints; its deviation is its acceleration less the measured one."""
    machine = load_machine(BENCH)
    (path,) = trace_recording.write_trace_recordings(BENCH, ["validate"], machine, machine, tmp_path, "verdict: **x**")
    assert path == tmp_path / "validate.rrd"
    recording = Recording(path)
    ends = {
        root: recording.read(f"/{root}/acceleration/leg/within_band", "Scalars:scalars")
        for root in ("measured", "declared")
    }
    time, measured = ends["measured"]
    again, declared = ends["declared"]
    assert np.array_equal(time, again)
    _, deviation = recording.read("/declared/deviation/leg/within_band", "Scalars:scalars")
    inner = slice(200, -200)  # the band filter leans on padding within 0.1 s of either end
    assert np.allclose(deviation[inner], (declared - measured)[inner], rtol=0, atol=1e-6)
    # the log's own writer and this simulator agree on a machine that lacks nothing: parameter errors of a few % remain.
    # Noise alone is 0.006 m/s2 in the band; accelerations averaged over a tick would be 5 % off beside it, 0.017 m/s2
    assert np.sqrt(np.mean(deviation[inner] ** 2)) < 0.012
    assert "/measured/summary" in recording.entities(moving=False)


def test_a_log_without_setpoints_stands_alone():
    """What was not logged cannot be replayed; the measured signals are shown all the same."""
    machine = load_machine(BENCH)
    log = pl.read_csv(BENCH / "validate.csv.gz").head(2000).drop("setpoint_m")
    assert list(trace_recording.replayed(Log.of_table("validate", log, "bench"), {"declared": machine})) == ["measured"]
