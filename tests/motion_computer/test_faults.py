"""Faults of a scenario: each is detected, the platform comes down, and no piston runs through an end stop."""

import dataclasses

import numpy as np
import pytest

from benchmarks.fault_table import Outcome, outcome
from hexsim import HexsimError, load_scenario
from hexsim.machine import load_machine
from hexsim.simulation import simulate

MACHINE = load_machine("micro_motion_system")
TIME_s = 3.3  # heave at half its velocity, downwards
HEAVE = load_scenario("heave", duration_s=9.0)

# kind and keys; seconds to detection, m/s2 at most, legs that come down. The bounds are safety claims of docs/faults.md
# with about a third to spare, not copies of a run.
CASES = [
    (dict(kind="valve_stuck", leg=1, at="open"), 0.15, 150.0, (2, 3, 4, 5, 6)),
    (dict(kind="valve_stuck", leg=1, at=-10.0), 0.15, 200.0, (1, 2, 3, 4, 5, 6)),
    (dict(kind="valve_stuck", leg=1, at="shut"), 0.4, 15.0, (2, 3, 4, 5, 6)),
    (dict(kind="spool_lag", leg=2, frequency_Hz=1.0), 1.5, 5.0, (1, 2, 3, 4, 5, 6)),
    (dict(kind="position_sensor", leg=1, how="nan"), 0.01, 1.5, (1, 2, 3, 4, 5, 6)),
    (dict(kind="position_sensor", leg=3, how="frozen"), 0.15, 8.0, (1, 2, 3, 4, 5, 6)),
    (dict(kind="position_sensor", leg=6, how="jump"), 0.01, 1.5, (1, 2, 3, 4, 5, 6)),
    (dict(kind="leg_blind", leg=4), 0.01, 1.5, (1, 2, 3, 4, 5, 6)),
    (dict(kind="pressure_loss"), 0.2, 1.5, (1, 2, 3, 4, 5, 6)),
    (dict(kind="pump_trip"), 0.01, 1.5, (1, 2, 3, 4, 5, 6)),
    (dict(kind="hose_burst", leg=1), 0.5, 8.0, (1, 2, 3, 4, 5, 6)),
    (dict(kind="power_loss"), 0.01, 1.5, (1, 2, 3, 4, 5, 6)),
    (dict(kind="power_loss", buffered=False), 0.01, 60.0, ()),
    (dict(kind="host_silence"), 0.27, 1.5, (1, 2, 3, 4, 5, 6)),
]


def faulty(*faults: dict, scenario=HEAVE, **options):
    return simulate(MACHINE, dataclasses.replace(scenario, faults=faults), fast=True, **options)


def result(fault: dict, **options) -> Outcome:
    return outcome(faulty(fault | {"time_s": TIME_s}, **options), TIME_s)


# a run of five seconds each: the others are like one of these
IN_CI = (
    "valve_stuck open",
    "position_sensor frozen",
    "power_loss",
)


def case(fault: dict, *claims):
    name = " ".join(str(fault[key]) for key in ("kind", "at", "how", "buffered") if key in fault)
    return pytest.param(fault, *claims, id=name, marks=() if name in IN_CI else pytest.mark.slow)


@pytest.mark.parametrize(
    ("fault", "detection_s", "peak", "down"),
    [case(*one) for one in CASES],
)
def test_a_fault_is_detected_and_the_platform_comes_down(fault, detection_s, peak, down) -> None:
    """Detected in time, state fault, acceleration bounded, at rest within 5 s, the legs that can be moved down on their
    stops, and no piston deeper in an end stop than the cushion is long."""
    found = result(fault)
    assert found.detected_s is not None and found.detected_s <= detection_s
    assert found.state == "fault"
    assert found.peak_acceleration_m_s2 < peak
    assert found.rest_s is not None and found.rest_s < 5.0
    assert all(found.final_m[leg - 1] < MACHINE.cylinder.cushion_length_m for leg in down)
    assert found.lowest_m > 0.0 and found.highest_m < MACHINE.cylinder.stroke_m


def test_a_shifted_payload_is_found_from_the_pressures() -> None:
    """150 kg that slide by 0.4 m move the centre by 100 mm: found within 3 s; 15 kg move it by 10 mm: not found."""
    brief = dataclasses.replace(HEAVE, duration_s=TIME_s + 3.2)
    heavy, light = (result(dict(kind="payload_shift", mass_kg=kg, x_m=0.4), scenario=brief) for kg in (150.0, 15.0))
    assert heavy.detected_s is not None and 0.1 < heavy.detected_s < 3.0
    assert "load shifted" in heavy.description
    assert light.detected_s is None and light.state == "manual"


PULSE_m_s2, TRAVEL_m = 0.6, 0.095


@pytest.fixture(scope="module")
def pulses(tmp_path_factory):
    """Up by half of 95 mm, down by all of it and up again, each with 0.6 m/s2 and then -0.6 m/s2."""
    time = np.arange(0.0, 8.0, 0.002)
    asked = np.zeros_like(time)
    for start, travel in ((1.2, 0.5 * TRAVEL_m), (3.6, -TRAVEL_m), (6.0, 0.5 * TRAVEL_m)):
        half = np.sqrt(abs(travel) / PULSE_m_s2)
        gone = np.clip(time - start, 0.0, 2 * half)
        asked += np.sign(travel) * PULSE_m_s2 * (0.5 * gone**2 - np.maximum(gone - half, 0.0) ** 2)
    path = tmp_path_factory.mktemp("pulses") / "pulses.csv"
    np.savetxt(path, np.stack([time, asked], axis=1), delimiter=",", header="time_s,z_m", comments="")
    return load_scenario(str(path))


@pytest.mark.parametrize(
    ("more_kg", "found"), [(50.0, False), (-75.0, True), pytest.param(75.0, True, marks=pytest.mark.slow)]
)
def test_a_load_shifts_and_its_motion_does_not(pulses, more_kg, found) -> None:
    """Accelerating down asks less of the legs, and friction up more: no load has shifted. 10 % of the weight are 61 kg
    (platform 600 kg, of the legs 11): 75 kg more or less are found in the same motion within 3 s, 50 kg are not."""
    fault = dict(kind="effect", effect="mass_change", parameters={"mass_kg": more_kg}, time_s=4.0)
    run = faulty(fault, scenario=pulses)
    texts = [(time, text) for time, _, text in run.summary["motion_computer"]["found"]]
    assert bool(texts) is found
    if found:
        assert 4.0 < texts[0][0] < 7.0
        assert texts[0][1] == f"load shifted: the load changed by {10 if more_kg > 0 else -10} %"


@pytest.mark.parametrize(
    "name",
    [
        "multisine",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("combined", "heave", "roll", "yaw", "sweep")),
    ],
)
def test_a_sound_machine_raises_no_error(name: str) -> None:
    """With the monitors on and nothing broken (a lag of 1000 Hz), no scenario ends in fault."""
    scenario = load_scenario(name, duration_s=8.0)
    run = faulty(dict(kind="spool_lag", leg=1, frequency_Hz=100.0, time_s=7.9), scenario=scenario)
    assert run.summary["motion_computer"]["found"] == []
    assert run.summary["motion_computer"]["state"] == "manual"


def test_a_fault_yet_to_come_changes_nothing() -> None:
    """Until the fault the run is the run without faults, to the bit: monitors look on, sensors draw the same noise."""
    scenario = load_scenario("heave", duration_s=2.0)
    plain = simulate(MACHINE, scenario, fast=True, seed=3).log
    guarded = faulty(dict(kind="leg_blind", leg=1, time_s=1.5), scenario=scenario, seed=3).log
    early = plain["time_s"].to_numpy() < 1.5
    for column in (
        "true_position_1_m",
        "position_1_m",
        "valve_4_V",
        "true_acceleration_z_m_s2",
        "pressure_bottom_2_Pa",
    ):
        assert np.array_equal(plain[column].to_numpy()[early], guarded[column].to_numpy()[early]), column


def test_the_log_shows_what_the_motion_computer_saw() -> None:
    """A lost transducer is NaN in the log from then on; the true position is not; the setpoint is the one held."""
    log = faulty(dict(kind="position_sensor", leg=1, time_s=TIME_s)).log
    late = log["time_s"].to_numpy() >= TIME_s
    assert np.isnan(log["position_1_m"].to_numpy()[late]).all()
    assert np.isfinite(log["position_1_m"].to_numpy()[~late]).all()
    assert np.isfinite(log["true_position_1_m"].to_numpy()).all()
    assert log["setpoint_1_m"].to_numpy()[-1] == 0.0


def test_supply_pressure_in_the_log_is_that_of_its_time() -> None:
    """After a pressure loss the log holds 70 bar before and 20 bar after, not one value for the whole run."""
    loss = dict(kind="pressure_loss", pressure_Pa=2.0e6, within_s=0.3, time_s=TIME_s)
    log = faulty(loss, scenario=dataclasses.replace(HEAVE, duration_s=4.0)).log
    time, supply = log["time_s"].to_numpy(), log["true_pressure_supply_Pa"].to_numpy()
    assert np.all(supply[time < TIME_s] == 7.0e6)
    assert np.allclose(supply[time > TIME_s + 0.31], 2.0e6)
    assert supply[np.searchsorted(time, TIME_s + 0.15)] == pytest.approx(4.5e6, rel=0.02)


def test_faults_on_a_bench() -> None:
    """One leg on a bench: a lost transducer is found and the load comes down without a look at its position."""
    bench = load_machine("bench")
    scenario = dataclasses.replace(HEAVE, faults=(dict(kind="position_sensor", leg=1, time_s=TIME_s),), duration_s=10.0)
    found = outcome(simulate(bench, scenario, fast=True), TIME_s)
    assert found.detected_s == pytest.approx(0.004, abs=0.003)
    assert found.final_m[0] < bench.cylinder.cushion_length_m
    assert found.lowest_m > 0.0


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        (dict(kind="meteor", time_s=1.0), "kind = 'meteor': allowed are valve_stuck"),
        (dict(kind="valve_stuck", time_s=1.0), "leg is missing: add it"),
        (dict(kind="valve_stuck", time_s=1.0, leg=7), "leg is 7; machine micro_motion_system has legs 1 to 6"),
        (
            dict(kind="valve_stuck", time_s=1.0, leg=1, at="ajar"),
            "at = 'ajar': input should be 'open', 'shut' or 'present'",
        ),
        (dict(kind="pump_trip", time_s=-1.0), r"time_s = -1\.0: .*0 to 86400 is possible"),
        (dict(kind="pump_trip", time_s="soon"), "time_s = 'soon': a number is needed, without quotes"),
        (
            dict(kind="hose_burst", leg=1, time_s=1.0, diameter=2),
            "diameter is not a known key: allowed are kind, time_s, leg",
        ),
        (dict(kind="hose_burst", leg=1.0, time_s=1.0), r"leg = 1\.0: input should be a valid integer"),
        (dict(kind="valve_stuck", leg=1, time_s=1.0, at={}), r"\[at\]: .*'open', 'shut' or 'present'"),
        (dict(kind=["pump_trip"], time_s=1.0), r"kind = \['pump_trip'\]: allowed are valve_stuck"),
        ("x", r"fault 1: the file = 'x': must be a table"),
    ],
)
def test_a_wrong_fault_is_refused_before_the_run(fault, sentence) -> None:
    """The sentence names fault, key, what was given and what is allowed."""
    with pytest.raises(HexsimError, match=sentence):
        faulty(fault)


def test_a_wide_open_valve_does_not_upset_rk4() -> None:
    """At little pressure drop a fully open valve is far faster than the time step: RK4 with
    the step chosen and with 20 us agree on where the piston stops, and no pressure leaves the range that the load can explain."""
    bench = load_machine("bench")
    fault = dict(kind="valve_stuck", leg=1, at=-10.0, time_s=1.0)
    scenario = dataclasses.replace(load_scenario("heave", duration_s=1.6), faults=(fault,))
    logs = [simulate(bench, scenario, timestep=step).log for step in (None, 2e-5)]
    lowest = [log["true_position_m"].min() for log in logs]
    assert lowest[0] == pytest.approx(lowest[1], abs=2e-4)  # m, of a stop at more than 1 m/s
    assert 0.0 < lowest[0] < bench.cylinder.cushion_length_m
    assert logs[0]["true_pressure_bottom_Pa"].max() < 2e7
