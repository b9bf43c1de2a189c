"""Plots of a page that can be looked at closely hold the run's own values, and a page without them is a page as before."""

import base64
import json
import re

import numpy as np
import polars as pl
import pytest
from made_up_run import made_up_run

from hexsim.recording import report, zoom
from hexsim.recording.signals import Signals

PNG = b"\x89PNG"


def read(part: str) -> list[tuple[str, np.ndarray, dict[str, np.ndarray]]]:
    """Title, time and curves of each panel, by the format that the script in the page reads."""
    found = []
    for panel in json.loads(re.search(r'<script type="application/json">(.*?)</script>', part)[1])["panels"]:
        curves: dict[str, np.ndarray] = {}
        for one in panel["series"]:
            numbers = np.frombuffer(base64.b64decode(one["data"]), "<i2").astype(float)
            curves[one["label"]] = np.where(numbers == -32768, np.nan, one["middle"] + one["step"] * numbers)
        steps = panel["step"] * np.arange(len(numbers))
        time = np.frombuffer(base64.b64decode(panel["time"]), "<f4") if "time" in panel else steps
        found.append((panel["title"], panel["start"] + time, curves))
    return found


def test_a_short_run_is_whole_and_a_long_one_keeps_its_peaks():
    """Up to the limit every sample is there to 1.5e-5 of the range; of a million, the one sample that is off, at its place, and no
    more values than the limit by more than a bin; where there is no value there is none."""
    wave = lambda time: np.sin(7.0 * time)  # noqa: E731
    short = np.linspace(3.0, 5.0, 2000)
    gap = np.where((short > 4.0) & (short < 4.1), np.nan, wave(short))
    both = [zoom.Curve("a", wave(short), "#000000"), zoom.Curve("b", gap, "#000000")]
    [(title, time, curves)] = read(zoom.zoomable([zoom.Panel("speed [m/s]", short, both)], PNG, ""))
    assert title == "speed [m/s]"
    assert time == pytest.approx(short, abs=1e-6)
    assert curves["a"] == pytest.approx(wave(short), abs=4e-5)
    assert np.array_equal(np.isnan(curves["b"]), np.isnan(gap))
    uneven = np.r_[0.0, np.cumsum(np.linspace(0.1, 1.0, 50))]
    [(_, time, _)] = read(zoom.zoomable([zoom.Panel("", uneven, [zoom.Curve("", uneven, "#000000")])], PNG, ""))
    assert time == pytest.approx(uneven, abs=1e-5)
    long = np.linspace(0.0, 1000.0, 1_000_000)
    spike = wave(long)
    spike[123_456] = 5.0
    part = zoom.zoomable(
        [zoom.Panel("x [m]", long, [zoom.Curve("spike", spike, "#000000"), zoom.Curve("slow", long, "#000000")])],
        PNG,
        "",
    )
    [(_, time, curves)] = read(part)
    assert len(time) * 2 <= zoom.MOST_VALUES + 4 and np.all(np.diff(time) > 0)
    assert curves["spike"].max() == pytest.approx(5.0, abs=2e-4)
    assert time[np.argmax(curves["spike"])] == pytest.approx(long[123_456], abs=0.1)
    assert curves["slow"] == pytest.approx(time, abs=0.15)
    assert len(part) < 200_000


def test_the_page_of_a_run_has_its_acceleration_legs_and_volts():
    """Panels with units hold what the log has; what the log lacks is left out, down to the picture alone, and nothing fails."""
    run = made_up_run()
    page = report.run_report(run, {"motion": PNG, "acceleration": PNG, "spectrum": PNG})
    motion, acceleration = (part for part in page.split("<figure") if 'class="zoom"' in part)
    motion = {title: (time, curves) for title, time, curves in read(motion)}
    assert list(motion) == ["heave [mm]", "leg positions [mm]", "tracking error [mm]", "valve [V]"]
    time, curves = motion["valve [V]"]
    volts = np.interp(time, run.log["time_s"], run.log["valve_3_V"])
    assert curves["leg 3"] == pytest.approx(volts, abs=0.02 * np.ptp(volts))
    titles = [title for title, *_ in read(acceleration)]
    assert titles == ["acceleration, heave [m/s²]", "deviation, heave [m/s²]"]
    assert page.count("<img") == 3 and page.count("uPlot=function") == 1

    lacks = made_up_run()
    lacks.log = lacks.log.drop([name for name in lacks.log.columns if "acceleration" in name or "valve" in name])
    page = report.run_report(lacks, {"motion": PNG, "acceleration": PNG})
    assert page.count('<figure class="zoom"') == 1 and "valve [V]" not in page
    gone = pl.DataFrame({"time_s": lacks.log["time_s"]})
    lacks.log = gone
    page = report.run_report(lacks, {"motion": PNG, "acceleration": PNG})
    assert "uPlot" not in page and page.count("<img") == 2
    assert Signals.of_run(lacks).deviation("z") is None


def test_a_name_ends_no_script():
    """A label with a closing tag in it stays a label of the data."""
    name = "</script><b>x</b>"
    part = zoom.zoomable([zoom.Panel(name, np.arange(3.0), [zoom.Curve(name, np.arange(3.0), "#000000")])], PNG, name)
    assert part.count("</script>") == 1
    [(title, _, curves)] = read(part)
    assert title == name and list(curves) == [name]
