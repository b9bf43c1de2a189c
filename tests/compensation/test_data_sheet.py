"""What the machine file declares of spool and transducers is compensated, and the compensator says what keeps it out."""

from __future__ import annotations

import dataclasses
import json
import math

import pytest
from typer.testing import CliRunner

from hexsim import load_scenario
from hexsim.cli import app
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer.data_sheet import compensator_context
from hexsim.recording import summary_table
from hexsim.simulation import simulate


def bench_run(duration_s: float = 16.0, compensator: str = "adaptive", amplitude_m: float = 0.05, **changes: float):
    """Heave on the bench with a machine file changed so; figures of its last 4 s."""
    machine = changed(load_machine("bench"), {name.replace("__", "."): value for name, value in changes.items()})
    scenario = load_scenario("heave", duration_s=duration_s, amplitude=amplitude_m)
    return simulate(machine, dataclasses.replace(scenario, figures_from_s=0.75 * duration_s), compensator=compensator)


def peak(run) -> float:
    return run.summary["axes"]["leg"]["peak_band_m_s2"]


DECLARED = [
    ("valve__spool_damping", 1.4),
    ("sensors__position_resolution_m", 1.2e-5),
    ("friction__stribeck_velocity_m_s", 2e-3),
    ("valve__spool_damping", 0.5),
    ("valve__spool_frequency_Hz", 200.0),
    ("sensors__position_noise_m", 1e-6),
    ("sensors__position_noise_m", 1e-5),
]


@pytest.mark.parametrize(
    ("declared", "value"),
    [pytest.param(*one, marks=pytest.mark.slow) for one in DECLARED],
)
def test_what_is_declared_is_compensated(declared: str, value: float) -> None:
    """Spools of other damping or speed, quieter, louder and coarser transducers, friction that falls more steeply: a bench's bump of
    0.53 m/s2 is a sixth or less, and the leg has engaged by 8 s."""
    run = bench_run(**{declared: value})
    assert peak(run) < 0.53 / 6.0
    (leg,) = run.summary["compensation"]
    assert leg["engaged"] and leg["reason"] == "" and leg["engaged_at_s"] < 8.0


@pytest.mark.parametrize(
    ("amplitude_m", "noise_m"),
    [(5e-4, 3e-6), pytest.param(0.05, 2e-4, marks=pytest.mark.slow)],
    ids=["gentle", "noisy"],
)
def test_motion_that_tells_nothing_is_said(amplitude_m: float, noise_m: float) -> None:
    """0.5 mm of motion, and 200 um of declared position noise: not engaged, and a sentence with what was seen and what is needed, in
    the report's table too."""
    run = bench_run(8.0, amplitude_m=amplitude_m, sensors__position_noise_m=noise_m)
    (leg,) = run.summary["compensation"]
    assert not leg["engaged"] and leg["engaged_at_s"] is None and leg["engaged_share"] == 0.0
    assert "windows of motion seen" in leg["reason"]
    assert ("compensation", f"leg 1: not engaged: {leg['reason']}") in summary_table.facts(run.summary, run)


def test_algorithms_that_say_nothing_are_engaged_from_their_first_volts() -> None:
    """One of the report's: since when it has added volts. Plain control: nothing is said."""
    (leg,) = bench_run(4.0, "exact").summary["compensation"]
    assert leg["engaged"] and leg["engaged_at_s"] < 0.1 and leg["engaged_share"] > 0.9
    assert "compensation" not in bench_run(1.0, "none").summary


def test_the_console_says_it(tmp_path) -> None:
    """`hexsim run` of a motion too short to learn: one line, and the same in summary.json."""
    asked = [
        "run",
        "heave",
        "-m",
        "bench",
        "-c",
        "adaptive",
        "--duration",
        "3",
        "--no-recording",
        "--no-report",
        "--out",
        str(tmp_path / "r"),
    ]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0
    (leg,) = json.loads((tmp_path / "r" / "summary.json").read_text())["compensation"]
    assert not leg["engaged"]
    assert f"leg 1: not engaged: {leg['reason']}" in " ".join(done.output.split())


def test_the_data_sheet_comes_from_the_machine_file() -> None:
    """Noise, counts, spool and Stribeck velocity as declared, small-signal figures included; and what overlap, leak and friction
    can ask of the bench's valve: 45 mV of overlap, and 240 kPa of friction's step on 6.7e-11 m/Pa of oil in 3 ms."""
    machine = changed(load_machine("bench"), {
        "sensors.pressure_resolution_Pa": 700.0, "valve.spool_damping": 1.1, "friction.stribeck_velocity_m_s": 2e-3,
    })  # fmt: skip
    context = compensator_context(machine, None)
    assert (context.pressure_resolution_Pa, context.spool_damping, context.stribeck_velocity_m_s) == (700.0, 1.1, 2e-3)
    assert context.spool_frequency_Hz == pytest.approx(60.0)
    friction = machine.friction
    step_Pa = (
        friction.coulomb_extend_N + friction.static_extend_N + friction.coulomb_retract_N + friction.static_retract_N
    ) / context.area_bottom_m2
    overlap_V = machine.valve.overlap_m / machine.valve.spool_travel_max_m * machine.valve.voltage_max_V
    oil_V = context.compliance_m_Pa(0.5 * context.stroke_m) * step_Pa / 3e-3 / context.velocity_gain_m_s_V
    leak_V = (
        machine.cylinder.piston_leakage_m3_s_Pa
        * context.supply_pressure_Pa
        / context.area_bottom_m2
        / context.velocity_gain_m_s_V
    )
    assert context.edge_V == pytest.approx(overlap_V + oil_V + leak_V, rel=1e-6)
    sheet = changed(load_machine("bench"), {
        "valve.spool_frequency_Hz": 0.0, "valve.small_signal_minus_90deg_Hz": 80.0, "valve.small_signal_minus_3dB_Hz": 80.0,
    })  # fmt: skip
    context = compensator_context(sheet, None)
    assert (context.spool_frequency_Hz, context.spool_damping) == pytest.approx((80.0, math.sqrt(0.5)))
