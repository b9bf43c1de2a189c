"""What a person feels: ISO 2631-1 weightings, shares above the thresholds, delay, jerk."""

import numpy as np
import pytest

from hexsim.smoothness import perception

TIME = np.arange(0.0, 20.0, 1e-3)
W = 2 * np.pi * 0.5


@pytest.mark.parametrize(
    ("kind", "frequency_Hz", "factor"),
    [
        ("k", 1.0, 0.482),
        ("k", 4.0, 0.967),
        ("k", 8.0, 1.036),
        ("k", 16.0, 0.768),
        ("k", 31.5, 0.405),
        ("d", 1.0, 1.011),
        ("d", 2.0, 0.890),
        ("d", 4.0, 0.512),
        ("d", 8.0, 0.253),
    ],
)
def test_weightings_are_those_of_the_standard(kind: str, frequency_Hz: float, factor: float) -> None:
    """ISO 2631-1:1997, table 3, within 1 % (its frequencies are third octaves, rounded)."""
    assert abs(perception.weighting(kind, frequency_Hz)) == pytest.approx(factor, rel=0.01)


def test_a_sine_is_weighted_by_its_factor() -> None:
    """2 m/s2 at 8 Hz in heave: 2/sqrt(2) times 1.036."""
    assert perception.weighted_rms(TIME, 2.0 * np.sin(2 * np.pi * 8.0 * TIME), "k") == pytest.approx(
        2**0.5 * 1.036, rel=5e-3
    )


@pytest.mark.parametrize("kind", ["k", "d", "e"])
def test_nothing_is_felt_before_it_happens(kind: str) -> None:
    """The filters are causal: before a shock of 0.1 s the weighted acceleration is below 1 % of its largest."""
    found = np.abs(perception.weighted(TIME, (np.abs(TIME - 10.0) < 0.05) * 1.0, kind))
    assert found[TIME < 9.9].max() < 0.01 * found.max()


def test_shocks_count_by_their_running_second_and_by_the_fourth_power() -> None:
    """2 m/s2 at 8 Hz for 20 s: MTVV is the rms, VDV 2.072 (3/8 20 s)^(1/4). For one second of the 20: MTVV is that of the
    second and sqrt(20) times the rms (3 % for what rings on), VDV 20^(1/4) less; the record's length changes the rms alone."""
    steady = 2.0 * np.sin(2 * np.pi * 8.0 * TIME)
    shock = steady * (np.abs(TIME - 10.0) < 0.5)
    assert perception.mtvv(TIME, steady, "k") == pytest.approx(perception.weighted_rms(TIME, steady, "k"), rel=1e-3)
    assert perception.vibration_dose(TIME, steady, "k") == pytest.approx(2.072 * (3 / 8 * 20.0) ** 0.25, rel=5e-3)
    assert perception.mtvv(TIME, shock, "k") == pytest.approx(2**0.5 * 1.036, rel=0.03)
    assert perception.mtvv(TIME, shock, "k") / perception.weighted_rms(TIME, shock, "k") == pytest.approx(
        20**0.5, rel=0.03
    )
    assert perception.vibration_dose(TIME, shock, "k") == pytest.approx(2.072 * (3 / 8) ** 0.25, rel=0.03)


def felt(acceleration, axis="z", position=None):
    asked = 0.05 * np.sin(W * TIME)
    return perception.felt_figures(
        TIME, axis, acceleration, -W * W * asked, asked if position is None else position, asked
    )


def test_a_perfect_response_is_not_felt_and_only_late() -> None:
    """The command 40 ms late: delay found to 1 ms, nothing above a threshold; jerk rms is w^3 of the sine."""
    found = felt(-W * W * 0.05 * np.sin(W * (TIME - 0.04)))
    assert found["delay_ms"] == pytest.approx(40.0, abs=1.0)
    assert found["time_felt"] == found["reversals_felt"] == 0.0
    assert found["jerk_rms"] == pytest.approx(W**3 * 0.05 / 2**0.5, rel=0.01)
    assert found["weighted_rms_unwanted"] < 0.02 * found["weighted_rms"]


def test_bumps_above_the_threshold_are_counted_by_reversals_and_by_time() -> None:
    """A bell of 0.4 m/s2 and 0.1 s at every other reversal: felt (0.154) at half of them, for some 3 % of the time."""
    bump = np.zeros_like(TIME)
    for k in range(0, 20, 2):
        bump += 0.4 * np.exp(-(((TIME - k - 0.5) / 0.03) ** 2))
    found = felt(-W * W * 0.05 * np.sin(W * TIME) + bump)
    assert found["reversals_felt"] == pytest.approx(0.5, abs=0.06)
    assert found["time_felt"] == pytest.approx(10 * 2 * 0.03 * np.sqrt(np.log(0.4 / 0.154)) / 20.0, rel=0.15)


def test_bumps_of_a_late_response_belong_to_their_reversals() -> None:
    """150 ms behind the command with a bell at every reversal of the response: each is felt, though 300 ms off none would be near one."""
    late = 0.15
    bump = sum(0.4 * np.exp(-(((TIME - late - k - 0.5) / 0.03) ** 2)) for k in range(20))
    found = felt(-W * W * 0.05 * np.sin(W * (TIME - late)) + bump)
    assert found["delay_ms"] == pytest.approx(1e3 * late, abs=10.0)
    assert found["reversals_felt"] > 0.9


def test_rotations_are_felt_by_their_rate() -> None:
    """3 deg/s more than asked for, for a second in five: a fifth of the time above 2.05 deg/s in roll, none in heave."""
    wrong = np.radians(3.0) * (np.mod(TIME, 5.0) < 1.0)
    position = 0.05 * np.sin(W * TIME) + np.cumsum(wrong - wrong.mean()) * 1e-3
    acceleration = -W * W * 0.05 * np.sin(W * TIME)
    assert felt(acceleration, "roll", position)["time_felt"] == pytest.approx(0.2, abs=0.02)
    assert felt(acceleration, "z", position)["time_felt"] == 0.0
