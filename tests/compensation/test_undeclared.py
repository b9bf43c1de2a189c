"""What real machines have and no data sheet says: delays, leaks, an offset null, soft oil, presliding, a host without future."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from leg_plant import Leg, Spoil, run
from scipy.signal import butter, sosfiltfilt

import compensation
from compensation import Sample

# Of plain control's bump of some 0.5 m/s2. With a delay single periods keep 0.15 m/s2 for as long as it runs.
LATE, OTHERS = 1 / 3, 1 / 5
LEGS: dict[str, tuple[dict[str, Any], float]] = {
    "valve 6 ms late": ({"valve_delay_s": 6e-3}, LATE),
    "leak from the supply": ({"leak_supply_m3_s_Pa": 2.5e-12}, OTHERS),
    "7 % of air": ({"air": 0.07}, OTHERS),
    "position 2 ms late": ({"position_delay_s": 2e-3}, LATE),
    "valve 2 ms late": ({"valve_delay_s": 2e-3}, LATE),
    "leak to the tank": ({"leak_tank_m3_s_Pa": 2.5e-12}, OTHERS),
    "null offset": ({"null_V": -0.15}, OTHERS),
    "presliding over 60 um": ({"bristle_N_m": 1e6}, OTHERS),
    "presliding over 6 um": ({"bristle_N_m": 1e7}, OTHERS),
    "2 % of air": ({"air": 0.02}, OTHERS),
}
DAILY = 1


@pytest.mark.parametrize(
    "name", [*list(LEGS)[:DAILY], *(pytest.param(n, marks=pytest.mark.slow) for n in list(LEGS)[DAILY:])]
)
def test_what_is_not_declared_is_compensated(name) -> None:
    """0.05 m at 0.5 Hz, 40 kg, nothing known of it: from 12 s on a fifth of plain control's bump is left, a third where something is
    late; no period before is worse than plain control by more than a tenth."""
    changes, left = LEGS[name]
    bump = run(compensation.create("none"), Leg(**changes), duration_s=8.0).peak(4.0, 8.0)
    peaks = run(compensation.create("adaptive"), Leg(**changes), duration_s=20.0).peaks()
    assert peaks[5:].max() <= left * bump
    assert peaks.max() <= 1.1 * bump


def test_volts_come_in_where_they_are_not_felt() -> None:
    """A dead band ten times the usual, whose numbers are found as the piston stands in it: no period is worse than plain control by more
    than a tenth, and a third is left where the volts are in. Volts that came in at once made a bump of 2.7 times plain control's."""
    leg = Leg(overlap_m=50e-6)
    bump = run(compensation.create("none"), leg, duration_s=8.0).peak(4.0, 8.0)
    peaks = run(compensation.create("adaptive"), leg, duration_s=16.0, seed=1).peaks()
    assert peaks.max() <= 1.1 * bump
    assert peaks[-1] <= bump / 3.0


def jittering() -> Spoil:
    """Readings up to 0.3 ms early or late."""
    draw, last = np.random.default_rng(31), [0.1]

    def spoil(time_s: float, sample: Sample) -> None:
        late_m = (sample.position_m - last[0]) * draw.uniform(-0.15, 0.15)
        last[0] = sample.position_m
        sample.position_m += late_m
        sample.control_V -= 50.0 * late_m

    return spoil


def filtered() -> Spoil:
    """8 um of noise that a transducer's filter has coloured: 0.6 from tick to tick."""
    draw, noise_m = np.random.default_rng(32), [0.0]

    def spoil(time_s: float, sample: Sample) -> None:
        noise_m[0] = 0.6 * noise_m[0] + 0.8 * draw.normal(0.0, 8e-6)
        sample.position_m += noise_m[0]
        sample.control_V -= 50.0 * noise_m[0]

    return spoil


@pytest.mark.parametrize("noise", [jittering, pytest.param(filtered, marks=pytest.mark.slow)])
def test_noise_is_what_it_is(noise) -> None:
    """Noise that grows with the speed and noise that is not white are no misfit: the volts come in before the sixth second, and a fifth
    of the bump is left from the twelfth on."""
    bump = run(compensation.create("none"), duration_s=8.0, spoil=noise()).peak(4.0, 8.0)
    made = run(compensation.create("adaptive"), duration_s=16.0, spoil=noise())
    assert np.abs(made.added_V[:3000]).max() > 0.05
    assert made.peaks()[5:].max() <= bump / 5.0


def test_without_preview() -> None:
    """A host that gives the present setpoint alone, 500 Hz: at most 0.06 m/s2 from 16 s on, where plain control has 0.53."""
    made = compensation.create("adaptive", preview_s=0.0)
    assert run(made, duration_s=20.0).peak(16.0, 20.0) <= 0.06


def five_sines(t: np.ndarray) -> np.ndarray:
    """Irregular motion: five sines between 0.13 and 0.97 Hz, phases drawn."""
    f = np.array([0.13, 0.31, 0.47, 0.71, 0.97])
    phases = np.random.default_rng(9005).uniform(0.0, 2 * np.pi, 5)
    waves = 0.0072 / f**0.8 * np.sin(2 * np.pi * f * np.asarray(t)[..., None] + phases)
    return 0.1 + np.minimum(t / 2.0, 1.0) * waves.sum(-1)


@pytest.mark.slow  # test_the_oil_column_is_damped_and_no_other_mode_is_fed
def test_light_leg_behind_a_late_valve_does_not_oscillate() -> None:
    """4 ms of valve delay, 40 kg, irregular: in 50 Hz the deviation from what is asked for is from 15 s on at most a quarter of plain
    control's. A damping that knew no delay fed the oil column at 97 Hz there until the ride was 5.8 m/s2."""
    late = slice(150_000, 238_000)
    asked = np.gradient(np.gradient(five_sines(np.arange(240_000) * 1e-4), 1e-4), 1e-4)
    off = {}
    for name in ("none", "adaptive"):
        made = run(compensation.create(name), Leg(valve_delay_s=4e-3), five_sines, 24.0, period_s=None, seed=9005)
        low = sosfiltfilt(butter(4, 50.0, fs=1e4, output="sos"), made.acceleration_m_s2)
        off[name] = np.abs(low - asked)[late].max()
    assert off["adaptive"] < off["none"] / 4
