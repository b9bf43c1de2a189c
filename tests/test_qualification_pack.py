"""`hexsim qualify --pack`: the conditions of the rule, OMCT against the washout's own transfer functions, the manifest."""

import hashlib
import json
import math
import re

import numpy as np
import polars as pl
import pytest

from hexsim import Scenario, qualification
from hexsim.cueing import washout as washouts
from hexsim.files import run_folder as run_folders
from hexsim.machine import load_machine
from hexsim.qualification import omct as omct_tests
from hexsim.qualification import pack, part60
from hexsim.qualification import rows as pack_limits
from hexsim.setpoints import signals

G = 9.81
W = (0.631, 3.981)  # of OMCT's frequencies, below and above the washout's corners


def points(washout, w):
    """OMCT at a frequency, of a machine that does what it is asked."""
    return {
        point.test: point.modulus * np.exp(1j * np.radians(point.phase_deg))
        for point in omct_tests.omct(washout, 500.0, lambda axis, w: 1.0 + 0.0j, (w,))
    }


def quick(washout, k, s):
    """Displacement by acceleration: the translation's high pass."""
    w = washout.high_pass_rad_s[k]
    return s / ((s**2 + 2.0 * w * s + w**2) * (s + washout.back_rad_s))


def lean(washout, s):
    w = washout.low_pass_rad_s
    return w**2 / (s**2 + 2.0 * w * s + w**2) / (washouts.SMOOTHING_S * s + 1.0) ** 2


@pytest.mark.parametrize("w", [pytest.param(W[0], marks=pytest.mark.slow), W[1]])
def test_omct_is_the_washouts_transfer_function(w):
    """Slow enough in tilt for no rate limit: heave, surge with its leaning, pitch by surge, yaw, and surge force that pitch
    leaves: modulus and phase of the written equations within 2 % and 2 deg (the filters are sampled at 500 Hz)."""
    washout = washouts.Washout(tilt_rate_rad_s=10.0)
    found = points(washout, w)
    s, scale = 1j * w, washout.scale
    turn = s * s / ((s + washout.turn_rad_s) * (s + washout.back_rad_s))  # rate from rate
    expected = {
        "10 heave from heave": scale * s**2 * quick(washout, 2, s),
        "6 surge from surge": scale * (s**2 * quick(washout, 0, s) + lean(washout, s)),
        "7 pitch from surge": -scale * s * lean(washout, s) / G,
        "9 roll from sway": scale * s * lean(washout, s) / G,
        "5 yaw from yaw": scale * turn,
        "2 surge force from pitch": -G * scale * turn / s,
    }
    for title, value in expected.items():
        assert abs(found[title] / value - 1.0) < 0.03, title


def test_omct_has_the_published_frequencies_and_ten_tests():
    """Twelve frequencies, five a decade (a factor of 10^0.2 each), from 0.1 rad/s; ten tests."""
    ratios = np.diff(np.log10(omct_tests.FREQUENCIES_rad_s))
    assert (
        omct_tests.FREQUENCIES_rad_s[0] == 0.1
        and ratios == pytest.approx([0.2] * 11, abs=2e-3)
        and len(omct_tests.TESTS) == 10
    )


def test_the_machines_response_comes_in_by_its_describing_function():
    """Of a lag of 50 ms: gain and phase at a tested frequency, between two within 3 %; at a tenth of the lowest to half a
    per cent."""
    frequency = [0.5, 1.0, 2.0, 5.0]
    lag = [1.0 / (1.0 + 0.05j * 2.0 * math.pi * f) for f in frequency]
    curve = {
        "frequency_Hz": frequency,
        "gain_dB": [20.0 * math.log10(abs(one)) for one in lag],
        "phase_deg": [math.degrees(np.angle(one)) for one in lag],
    }
    found = omct_tests.machine_response({"z": curve})
    for f, tolerance in ((1.0, 1e-6), (1.4, 0.03), (0.05, 0.005)):
        assert abs(found("z", 2.0 * math.pi * f) - 1.0 / (1.0 + 0.1j * math.pi * f)) < tolerance


@pytest.mark.parametrize("axis", part60.AXES)
def test_the_signal_has_the_rules_amplitudes_before_the_pilots_place(axis):
    """At the centre of gravity at least 0.3 g, or 10 deg/s with 5 deg/s2; at the pilot a turn adds dw/dt x r + w x (w x r)."""
    time, force, turn, change = part60.signal_of(axis, 500.0, (1.5, 0.5, 1.0))
    k = part60.AXES.index(axis)
    if k < 3:
        assert np.abs(force[:, k]).max() >= 0.3 * G and not turn.any()
        return
    rates, changes = np.abs(turn[:, k - 3]).max(), np.abs(change[:, k - 3]).max()
    assert math.degrees(rates) >= 10.0 and math.degrees(changes) >= 5.0
    numerical = np.gradient(turn[:, k - 3], time)
    assert np.abs(numerical - change[:, k - 3])[1:-1].max() < 1e-3 * changes
    arm, w, a = np.array([1.5, 0.5, 1.0]), turn[2000], change[2000]
    assert force[2000] == pytest.approx(np.cross(a, arm) + w * (w @ arm) - arm * (w @ w), abs=1e-12)


def test_the_record_goes_on_behind_what_is_judged():
    """Surge through the washout: what is asked in the last 50 ms that are judged and the 100 ms after them, which compensators
    look ahead, has no acceleration beyond the largest before; the end of the record would be a stop of many times that."""
    machine = load_machine("micro_motion_system")
    scenario = part60.washed_out(washouts.Washout(), "x", machine, (1.5, 0.5, 1.0))
    time = np.arange(0.0, part60.TRIAL.length_s + 0.1, 1e-3)
    asked = np.abs(np.diff(scenario.signals["x"].value(time), 2)) / 1e-6
    ahead = time[1:-1] > part60.TRIAL.length_s - 0.05
    assert asked[ahead].max() <= 1.01 * asked[~ahead].max()


@pytest.fixture(scope="module")
def machine():
    return load_machine("micro_motion_system")


def test_repeatability_of_a_simulated_machine(machine):
    """Heave under the rule's conditions: two runs differ by their sensors' noise, below 0.05 g and not by nothing; the trace
    holds both."""
    rows, traces = part60.repeatability(qualification.MachineRig(machine), washouts.Washout(), "flight", axes=("z",))
    value = rows[0].value
    assert value is not None and 0.0 < value < 0.05 and rows[0].passed and "3.d" in rows[0].source
    columns = traces[0].columns
    assert np.abs(columns["first_z_m_s2"] - columns["second_z_m_s2"]).max() > 0.0
    assert np.abs(columns["first_z_m_s2"]).max() > 0.3  # it moves: 0.3 of 0.3 g through the washout at 1 Hz


def test_onset_after_a_packet(machine):
    """Heave and roll set in after their packet and within a quarter of a second (plain control, with overlap); the asked
    acceleration itself reaches the share at asin(0.1)/2 pi of a second, and the platform not before."""
    rows, traces = part60.onset(machine, axes=("z", "roll"))
    least = 1e3 * math.asin(part60.TRIAL.onset_share) / (2.0 * math.pi)
    assert [row.limit for row in rows] == [150.0, 100.0] * 2
    assert all(row.value is not None and least < row.value < 250.0 for row in rows)
    assert set(traces[1].columns) == {"time_s", "asked_rad_s2", "platform_rad_s2"}


def test_an_axis_that_never_sets_in_is_outside(machine, monkeypatch):
    """Of a share that no platform reaches the rows have a limit and are not passed."""
    monkeypatch.setattr(part60, "TRIAL", part60.TRIAL._replace(onset_share=5.0))
    rows, _ = part60.onset(machine, axes=("z",))
    assert [row.passed for row in rows] == [False, False] and "not within" in rows[0].figure


def test_rows_say_whose_their_limits_are():
    """The applicant's own, no published number, and the repeatability of the battery left out."""
    rows = [
        qualification.Row(
            test="turn-around",
            axis="heave z",
            figure="a",
            value=1.0,
            unit="m/s²",
            limit=2.0,
            source=pack_limits.COMMON_TURN,
        ),
        qualification.Row(
            test="describing function", axis="x", figure="a", value=1.0, unit="Hz", source=pack_limits.APPLICANT
        ),
        qualification.Row(test="linearity", axis="z", figure="a", value=1.0, unit="%", source=pack_limits.NO_LIMIT),
        qualification.Row(test="repeatability", axis="z", figure="a", value=1.0, unit="m/s²", limit=0.5),
    ]
    filed = pack.pack_rows(qualification.Findings(rows=rows))
    assert [row.test for row in filed] == ["turn-around", "describing function", "linearity"]
    assert "3.c" in filed[0].source and "applicant's own" in filed[0].source and filed[0].limit == 2.0
    assert filed[2].source == "no published number"
    result = {"machine": "<b>", "compensator": "none", "one_mode": True, "pilot_m": [1, 2, 3]}
    assert "1 of 1 figures with a limit are within it.<" in pack.page(result, filed, [])
    late = qualification.Row(test="4.a", axis="heave z", figure="a", value=106.0, unit="ms", limit=100.0)
    assert "1 of 2 figures with a limit are within it. Outside: 4.a, heave z, limit 100 ms.<" in pack.page(
        result, [*filed, late], []
    )
    assert re.search(r">106 ms</td><td[^>]*>100 ms</td><td[^>]*><b>outside</b></td>", pack.page(result, [late], []))
    assert re.search(r">1 %</td><td[^>]*></td><td[^>]*>reported</td>", pack.page(result, filed, []))
    assert "&lt;b&gt;" in pack.page(result, filed, []) and "<b>," not in pack.page(result, filed, [])


@pytest.mark.parametrize(("name", "axis", "more"), [("half-hertz roll", "roll", True), ("x at 0.1 Hz", "x", False)])
def test_every_motion_is_recorded(tmp_path, name, axis, more):
    """A rig gives each motion that it plays on, and its file holds it to 1e-9: the driven axis, all accelerations, of a
    half-hertz motion the legs; written again it is the same to the byte."""
    kept = []
    rig = qualification.MachineRig(
        load_machine("micro_motion_system"), record=lambda scenario, motion: kept.append((scenario, motion))
    )
    sine = signals.Sine(amplitude=0.01, frequency_Hz=0.5)
    motion = rig.play(Scenario(name=name, mode="dof", signals={axis: sine}, duration_s=0.3, fade_s=0.1, fade="smooth"))
    [(scenario, same)] = kept
    assert same is motion
    pack.recorder(tmp_path)(scenario, motion)
    [path] = (tmp_path / "traces").iterdir()
    table = pl.read_csv(path)
    unit = "rad" if axis == "roll" else "m"
    assert table[f"platform_{axis}_{unit}"].to_numpy() == pytest.approx(motion.response[axis], abs=1e-9)
    assert table["acceleration_roll_rad_s2"].to_numpy() == pytest.approx(motion.acceleration["roll"], abs=1e-9)
    assert ("position_6_m" in table.columns) is more and table.height == len(motion.time_s)
    before = path.read_bytes()
    pack.recorder(tmp_path)(scenario, motion)
    assert path.read_bytes() == before and path.name == f"{name.replace(' ', '_')}.csv.gz"


def test_the_manifest_names_every_file_with_its_hash(tmp_path):
    """Whoever files the pack can tell what was changed: name, size and SHA-256 of each file, but of the lock of its making."""
    with run_folders.run_folder(tmp_path / "made") as folder:
        for name in ("pack.json", "traces/a.csv", "traces/b.csv"):
            path = folder.path / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(name)
        pack.write_manifest(folder.path)
        made = folder.finish()
    assert json.loads((made / "manifest.json").read_text())["files"] == {
        name: {"bytes": len(name), "sha256": hashlib.sha256(name.encode()).hexdigest()}
        for name in ("pack.json", "traces/a.csv", "traces/b.csv")
    }
