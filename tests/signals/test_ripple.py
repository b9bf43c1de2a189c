"""The cyclic error of a scale, and what stands behind a reading."""

import numpy as np
import pytest

from hexsim.hydraulics.resolve import resolve
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.sensors.bank import SensorBank
from hexsim.signals import ripple as ripples


@pytest.mark.parametrize("amplitude", [0.0, 4e-6, 8e-5])
def test_a_reading_leads_back_to_where_the_scale_stands(amplitude):
    """To 1e-12 m up to half of the steepest wave that can be undone; without a wave to the bit."""
    y = np.linspace(0.0, 0.2, 5001)
    back = ripples.unrippled(ripples.rippled(y, amplitude, 1e-3, 0.7), amplitude, 1e-3, 0.7)
    np.testing.assert_allclose(back, y, rtol=0.0, atol=1e-12 if amplitude else 0.0)


def test_log_and_controller_read_the_same_wave():
    """A rippled position, a tick at a time and as a whole column: y + A sin(2 pi y/L + phase) of an ideal transducer."""
    ripple = {"amplitude_m": 2e-5, "pitch_m": 2e-3, "phase_rad": 0.4}
    ideal = {"sensors.position_noise_m": 0.0, "sensors.position_resolution_m": 0.0}
    resolved = resolve(changed(load_machine("bench"), ideal | {"effects.position_ripple": ripple}))
    sensor = SensorBank(resolved, 30, 1e-3, 1)["position"]
    y = np.linspace(0.1, 0.104, 30)[:, None]
    column = sensor.rows(y)
    np.testing.assert_allclose(column, y + 2e-5 * np.sin(np.pi * y / 1e-3 + 0.4), rtol=0.0, atol=1e-15)
    ticks = [sensor.at(k, y[: k + 1]) for k in range(30)]
    np.testing.assert_array_equal(np.array(ticks), column)
    assert not sensor.is_direct


def test_a_wave_beside_a_wave_of_its_pitch_adds_up():
    """What any machine has of it and what one is asked for stand in two tables: 5 and 30 um are 35 um, not the last one."""
    waves = [{"amplitude_m": size, "pitch_m": 2e-3, "phase_rad": 0.4} for size in (5e-6, 3e-5)]
    resolved = resolve(changed(load_machine("bench"), {"effects.position_ripple": waves}))
    assert resolved.position_ripple[0] == pytest.approx([3.5e-5, 2e-3, 0.4], rel=1e-12)


def test_a_scale_counts_its_lines():
    """With a position gain of 3 % the wave keeps its pitch in the reading, whose lines are 1/1.03 as long on the machine: a fifth of a
    metre later it has the phase that the reading says, and is off by six waves by the pitch on the machine."""
    tables = {"position_ripple": {"amplitude_m": 2e-5, "pitch_m": 1e-3}, "position_gain": {"relative_change": 0.03}}
    ideal = {"sensors.position_noise_m": 0.0, "sensors.position_resolution_m": 0.0}
    resolved = resolve(changed(load_machine("bench"), ideal | {"effects": tables}))
    y = np.linspace(0.0, 0.2, 4001)[:, None]
    shown = SensorBank(resolved, len(y), 1e-3, 1)["position"].rows(y)
    wave = shown / 1.03 - y
    np.testing.assert_allclose(wave, 2e-5 * np.sin(2.0 * np.pi * 1.03 * y / 1e-3), rtol=0.0, atol=1e-12)
