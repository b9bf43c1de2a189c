"""Compensators side by side: same motion, same noise, one folder."""

import json
import re

import polars as pl
import pytest
from typer.testing import CliRunner

import hexsim as hx
from hexsim.cli import app
from hexsim.recording.signals import Signals
from hexsim.simulation import simulate


@pytest.fixture(scope="module")
def runs():
    """Plain control and the known inverse on the bench, long enough for one whole period after the fade-in."""
    return hx.compare("heave", ["none", "exact"], "bench", {"scenario.duration_s": 4.5}, fast=True, seed=3)


def test_unknown_names_are_refused_before_the_first_run(tmp_path, monkeypatch):
    """One unknown name of several is refused with the list of those there are; an empty list too. A name that is given twice runs once;
    without names all run."""
    monkeypatch.chdir(tmp_path)

    def compared(names: str):
        short = ("-m", "bench", "--fast", "--duration", "0.05", "--out", "both")
        return CliRunner().invoke(app, ["run", "heave", *short, "--compensator", names])

    for names, said in (("none,nothing", r"'nothing'.*none.*buffered"), (" , ", "--compensators? is empty")):
        refused = compared(names)
        assert refused.exit_code == 2 and re.search(said, refused.stderr), refused.output
    assert list(tmp_path.iterdir()) == []
    ran = []

    def run(*args, compensator, **options):
        ran.append(compensator)
        return simulate(*args, compensator=compensator, **options)

    monkeypatch.setattr("hexsim.studies.compare.simulate", run)
    assert compared("buffered, none,buffered").exit_code == 0 and ran == ["buffered", "none"]
    assert list(json.loads((tmp_path / "both" / "compare.json").read_text())["compensators"]) == ran
    everything = hx.compare("heave", None, "bench", {"scenario.duration_s": 0.05}, fast=True)
    assert {"none", "exact", "iterative", "buffered"} <= set(everything)


def test_runs_differ_in_the_compensator_alone(runs):
    """Setpoints and the sensor noise of the resting start are the same to the bit; the valve volts are not."""
    plain, inverse = runs["none"].log, runs["exact"].log
    assert plain["setpoint_m"].equals(inverse["setpoint_m"])
    assert plain["position_m"][0] == inverse["position_m"][0]
    assert not plain["valve_V"].equals(inverse["valve_V"])
    assert plain["compensation_V"].abs().max() == 0.0 < inverse["compensation_V"].abs().max()


def test_the_ratio_is_to_the_first_run(runs):
    """The table's column `of first` is the peak over the first run's peak, as the summaries hold them."""
    first, second = runs.table.to_dicts()
    peaks = [runs[name].summary["axes"]["leg"]["peak_band_m_s2"] for name in ("none", "exact")]
    assert first["ratio"] == 1.0
    assert second["ratio"] == pytest.approx(peaks[1] / peaks[0], rel=1e-12)
    assert second["peak_band"] == peaks[1]


def test_the_folder_holds_all_runs(runs, tmp_path):
    """compare.json has the form that others read, each run its log, and there is one figure, report and recording."""
    runs.to_folder(tmp_path)
    tables = json.loads((tmp_path / "compare.json").read_text())
    assert set(tables) == {"scenario", "compensators"} and list(tables["compensators"]) == ["none", "exact"]
    assert tables["compensators"]["exact"]["axes"] == runs["exact"].summary["axes"]
    assert pl.read_parquet(tmp_path / "logs" / "exact.parquet").equals(runs["exact"].log)
    for name in ("report.html", "run.rrd", "config.toml", "figures/comparison_leg.png"):
        assert (tmp_path / name).stat().st_size > 0
    page = (tmp_path / "report.html").read_text()
    assert "exact" in page and 'src="data:image/png;base64,' in page


def ending(monkeypatch, which: str, **ends):
    """A comparison in which the run of one compensator ends as said."""

    def run(*args, compensator, **options):
        done = simulate(*args, compensator=compensator, **options)
        for name, value in ends.items() if compensator == which else ():
            setattr(done, name, value)
        return done

    monkeypatch.setattr("hexsim.studies.compare.simulate", run)
    return hx.compare("heave", ["none", "exact"], "bench", {"scenario.duration_s": 1.0}, fast=True)


def test_a_diverged_run_stays_in_the_comparison(monkeypatch, tmp_path):
    """A run that ended early is marked with its reason and is not taken for the best."""
    both = ending(monkeypatch, "exact", complete=False, reason="the simulation diverged at t = 0.9 s in leg 1")
    both.to_folder(tmp_path / "both", recording=False)
    table = json.loads((tmp_path / "both" / "compare.json").read_text())["compensators"]
    assert table["exact"]["partial"] is True and "diverged" in table["exact"]["reason"]
    assert both.table.to_dicts()[1]["note"].startswith("the simulation diverged")


def test_an_interruption_ends_the_comparison(monkeypatch):
    """After Ctrl-C in the first run the second is not begun; a run that failed ends nothing, whatever its reason says."""
    for interrupted, reason, begun in (
        (True, "stopped at t = 0.1 s", ["none"]),
        (False, "payload interrupted.fmu says: interrupted (at t = 0.1 s)", ["none", "exact"]),
    ):
        assert list(ending(monkeypatch, "none", complete=False, interrupted=interrupted, reason=reason)) == begun


def test_signals_carry_the_compensators_name(runs):
    """Plots and recordings call a run by its compensator."""
    assert Signals.of_run(runs["exact"], "exact").label == "exact"


def test_plots_show_the_peak_of_the_table(runs):
    """The largest deviation drawn after the start of the figures is the table's peak in the band, to 2 %.

    The table continues the motion by its own period where the plot reflects it at the end of the record.
    """
    for run in runs.values():
        found = Signals.of_run(run).deviation("leg")
        late = found.time_s >= run.scenario.figures_start_s
        peak = abs(found.band[late]).max()
        assert peak == pytest.approx(run.summary["axes"]["leg"]["peak_band_m_s2"], rel=0.02)
