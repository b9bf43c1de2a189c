"""examples/report_chapter4.py: the differences of chapter 4, each with the number that theory asks for."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from hexsim.machine import load_machine

EXAMPLE = Path(__file__).parents[1] / "examples" / "report_chapter4.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("report_chapter4", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def found(example, tmp_path_factory):
    """(folder, {(difference, quantity): (simulation, with it)})."""
    folder = tmp_path_factory.mktemp("chapter4")
    table = example.main(folder, 6.0)
    return folder, {(what, quantity): (a, b) for what, quantity, a, b, _ in table}


def test_it_writes_its_figures_and_table(found):
    """Four figures and a table."""
    assert {path.name for path in found[0].iterdir()} == {
        "acceleration.png",
        "flow_curve.png",
        "inclination.png",
        "supply.png",
        "table.txt",
    }


@pytest.mark.parametrize("who", ["supply, one leg", "supply, six legs, heave"])
def test_bottom_pressure_follows_the_mean_supply(found, who):
    """4.3: with the power unit Ps sinks and swings, and the mean of P1 sinks by A2/A1 of it (to 2 %)."""
    table = found[1]
    sunk = {name: table[who, f"{name} mean"][0] - table[who, f"{name} mean"][1] for name in ("Ps", "P1")}
    cylinder = load_machine("bench").cylinder
    assert table[who, "Ps swing"][0] == 0.0 and table[who, "Ps swing"][1] > 0.5
    assert sunk["P1"] / sunk["Ps"] == pytest.approx(cylinder.area_top_m2 / cylinder.area_bottom_m2, rel=0.02)


def test_inclination_takes_weight_off_the_leg(found, example):
    """4.2: P1 sinks by M g (1 - cos angle)/A1 = 0.61 bar, and the bump of one leg hardly changes."""
    angle = example.leg_inclination()
    name = f"inclined by {np.degrees(angle):.0f} deg"
    before, after = found[1][name, "P1 mean"]
    expected = 40.0 * 9.8 * (1 - np.cos(angle)) / load_machine("bench").cylinder.area_bottom_m2 / 1e5
    assert before - after == pytest.approx(expected, rel=0.02)


def test_bump_of_the_machine_is_larger_at_the_top(found):
    """4.2: in the machine with one leg driven the peaks are larger at the top of the stroke, by a tenth or more."""
    name = "leg 1 of the 600 kg machine"
    assert found[1][name, "peak at the top"][1] > 1.1 * found[1][name, "peak at the bottom"][1]


def test_hysteresis_opens_the_flow_curve_and_the_filter_hides_the_dead_band(found):
    """4.4: the loop at v = 0 grows by the 80 mV of play, filtered or not; the filter hides the sharp valve's."""
    table = found[1]
    for which in ("true", "filtered"):
        sharp, wide = table["hysteresis", f"loop at v = 0, {which}"]
        assert wide - sharp == pytest.approx(80.0, abs=4.0)
    assert table["hysteresis", "loop at v = 0, filtered"][0] < 0.25 * table["hysteresis", "loop at v = 0, true"][0]


def test_rounded_edges_soften_the_bump(found):
    """Edges rounded by 2 um take more than 5 % off the peak at either end."""
    for end in ("top", "bottom"):
        sharp, rounded = found[1]["rounded edges", f"peak at the {end}"]
        assert rounded < 0.95 * sharp
