"""What the machine file declares of spool and transducers is what the compensator works with, and it says what keeps it out."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from compensation import Context
from compensation.adaptive import Adaptive
from compensation.adaptive.delay import found_delay_s
from compensation.spool_model import free_motion
from hexsim.cli import app
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer.data_sheet import compensator_context
from hexsim.recording.summary_table import facts
from hexsim.scenarios import load_scenario
from hexsim.simulation import Run, simulate


def bench_run(
    duration_s: float = 16.0, compensator: str = "adaptive", amplitude_m: float = 0.05, **changes: float
) -> Run:
    """Heave on the bench with a machine file changed so; figures of its last 4 s."""
    machine = changed(load_machine("bench"), {name.replace("__", "."): value for name, value in changes.items()})
    scenario = load_scenario("heave", duration_s=duration_s, amplitude=amplitude_m)
    return simulate(machine, dataclasses.replace(scenario, figures_from_s=0.75 * duration_s), compensator=compensator)


def peak(run: Run) -> float:
    return run.summary["axes"]["leg"]["peak_band_m_s2"]


ALSO = [
    ("valve__spool_damping", 0.5),
    ("valve__spool_damping", 1.0),
    ("valve__spool_frequency_Hz", 200.0),
    ("sensors__position_noise_m", 1e-6),
]


@pytest.mark.parametrize(
    ("declared", "value"),
    [
        ("valve__spool_damping", 1.4),
        ("sensors__position_resolution_m", 1.2e-5),
        ("friction__stribeck_velocity_m_s", 2e-3),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in ALSO),
    ],
)
def test_what_is_declared_is_compensated(declared: str, value: float) -> None:
    """Spools of other damping or speed, quieter and coarser transducers, friction that falls more steeply: a bench's bump of 0.53 m/s2
    is an eighth or less, and the leg has engaged by 6 s. (Damping taken for 0.7 left a half; a quiet coarse position was "frozen".)"""
    run = bench_run(**{declared: value})
    assert peak(run) < 0.53 / 8.0
    (leg,) = run.summary["compensation"]
    assert leg["engaged"] and leg["reason"] == "" and leg["engaged_at_s"] < 6.0


@pytest.mark.slow
def test_a_noisy_position_is_compensated_and_an_absurd_one_is_said() -> None:
    """10 um of declared position noise: engaged, a quarter of plain control's bump or less. 200 um: not engaged, and the sentence
    names what is uncertain and the noise; console and report have it."""
    run = bench_run(24.0, sensors__position_noise_m=1e-5)
    assert run.summary["compensation"][0]["engaged"] and peak(run) < 0.53 / 4.0
    run = bench_run(8.0, sensors__position_noise_m=2e-4)
    (leg,) = run.summary["compensation"]
    assert not leg["engaged"] and leg["engaged_at_s"] is None and leg["engaged_share"] == 0.0
    assert "um" in leg["reason"] and "noise" in leg["reason"]
    assert ("compensation", f"leg 1: not engaged: {leg['reason']}") in facts(run.summary, run)


@pytest.mark.parametrize(("amplitude_m", "words"), [(5e-4, ("gentler", "windows")), (0.0, ("windows",))])
def test_motion_that_tells_nothing_is_said(amplitude_m: float, words: tuple[str, ...]) -> None:
    """0.5 mm, and no motion: a sentence with what was seen and what is needed."""
    (leg,) = bench_run(8.0, amplitude_m=amplitude_m).summary["compensation"]
    assert not leg["engaged"] and any(word in leg["reason"] for word in words)


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


def test_every_estimator_has_its_noise_from_the_data_sheet() -> None:
    """Declared 3 um, counts of 3 um, 4 kPa: 5 um a window and a passage, 7 um a leak's, 3.3 um an oil displacement, 2 kPa a window's
    load, as legs with that noise showed. Ten times the noise: each grows, none more than tenfold."""
    names = (
        ("valve.edges", 0, "noise_m", 5e-6), ("rounding", None, "noise_m", 5e-6), ("leak", None, "noise_m", 7e-6),
        ("delay", None, "noise_m", 3.3e-6), ("friction.presliding", None, "noise_m", 3.3e-6),
        ("friction.presliding", None, "noise_Pa", 4e3), ("friction", None, "noise_MPa", 2e-3), ("trust", None, "noise_Pa", 4e3),
        ("monitor", None, "noise_m", 3.12e-6), ("friction.stribeck", None, "noise_Pa", 4e3),
    )  # fmt: skip

    def found(context: Context) -> list[float]:
        values = []
        for place, index, name, _ in names:
            record = Adaptive().start(context).numbers
            for part in place.split("."):
                record = record[part]
            values.append(float((record if index is None else record[index])[name]))
        return values

    usual = found(Context())
    assert usual == pytest.approx([expected for *_, expected in names], rel=0.02)
    loud = found(Context(position_noise_m=3e-5, position_resolution_m=3e-5, pressure_noise_Pa=4e4))
    assert all(1.5 < b / a <= 10.001 for a, b in zip(usual, loud, strict=True))


@pytest.mark.parametrize("damping", [0.3, 0.999999999, 1.0, 1.000000001, 1.4, 30.0])
def test_the_spool_is_that_of_its_equation(damping: float) -> None:
    """x'' + 2 zeta w x' + w^2 x = 0 from c = 1, s = 0: s' = c - zeta w s and c' = -zeta w c - w^2 (1 - zeta^2) s by central
    differences, under and over critical damping and next to it."""
    w, h = 2 * math.pi * 60.0, 1e-7
    for t in (1e-4, 2e-3, 8e-3):
        (c0, s0), (c, s), (c1, s1) = (np.array(free_motion(damping, w, t + d)) for d in (-h, 0.0, h))
        scale = 1.0 + damping
        assert (s1 - s0) / (2 * h) == pytest.approx(c - damping * w * s, abs=1e-5 * scale)
        assert (c1 - c0) / (2 * h * w) == pytest.approx(-damping * c - w * (1 - damping**2) * s, abs=1e-5 * scale**2)


def test_the_declared_spool_splits_the_lag_before_a_reversal_has() -> None:
    """A spool declared at 60 Hz, 0.7: of a lag of 5.7 ms, 2 ms are taken for delay within 0.5 ms. Not declared: anything."""
    delay = Adaptive().start(Context(spool_frequency_Hz=60.0)).numbers.delay
    assert found_delay_s(delay, 5.7e-3) == pytest.approx(2.0e-3, abs=9e-4)
    unknown = Adaptive().start(Context()).numbers.delay
    assert found_delay_s(unknown, 5.7e-3) > found_delay_s(delay, 5.7e-3)
