"""A valve's delay of a broken number of ticks: the volts change within a tick."""

import numpy as np
import pytest

from hexsim.hydraulics import valve
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant


def responses(rate_Hz: float, delays_s: list[float], model: str = "full", name: str = "bench") -> np.ndarray:
    """States (30 ms, n) at every millisecond under volts that step at 5 and at 11 ms, with a delay of each leg."""
    effects = {f"legs.{i + 1}.valve_delay.delay_s": delay for i, delay in enumerate(delays_s)}
    machine = load_machine(name)
    if len(delays_s) == 1:
        effects = {"effects.valve_delay.delay_s": delays_s[0]}
    plant = Plant(changed(machine, effects), model=model, timestep=2.5e-5)
    every = round(rate_Hz / 1000.0)
    plant.prepare(rate_Hz, 30 * every)
    for k in range(30 * every):
        ms = k / every
        plant.tick(np.full(plant.n_legs, 0.0 if ms < 5 else 2.0 if ms < 11 else -1.0))
    return plant.record.act[::every]


@pytest.mark.parametrize("delay_s", [2e-4, 1.4e-3, 1.5e-3, 4.9e-3])
@pytest.mark.parametrize("name", ["bench", "micro_motion_system"])
def test_a_delay_is_not_rounded_to_ticks(delay_s, name):
    """Ticks of 1 ms with a delay of 1.4 of them move as ticks of 0.1 ms with 14: within 1e-5 of the motion.

    Rounded to a tick, the spool of the slower one is 0.4 ms early: 10 % of its motion.
    """
    model = "full" if name == "bench" else "tendon"
    slow, fast = (responses(rate, [delay_s], model, name) for rate in (1e3, 1e4))
    moved = np.ptp(fast, axis=0)
    assert (np.abs(slow - fast).max(axis=0) < 1e-5 * moved + 1e-12).all()


def test_whole_ticks_and_the_rest():
    """1.4 ms are one tick and 0.4 ms; a rest that is rounding is none; no delay is none."""
    whole, rest = valve.delay_in_ticks(np.array([0.0, 1.4e-3, 3e-3, 0.1 + 0.2]), 1e-3)
    assert whole.tolist() == [0, 1, 3, 300]
    np.testing.assert_allclose(rest, [0.0, 4e-4, 0.0, 0.0], atol=1e-15)


def test_the_log_says_what_reaches_the_spool_at_its_instant():
    """A step of the volts at 5 ms, 1.4 ms late: at 6 ms the spool still has the old volts, at 7 ms the new ones."""
    plant = Plant(changed(load_machine("bench"), {"effects.valve_delay.delay_s": 1.4e-3}))
    plant.prepare(1e3, 10)
    for k in range(10):
        plant.tick(np.array([2.0 if k >= 5 else 0.5]))
    assert plant.record.spool_volts[:, 0].tolist() == [0.5] * 7 + [2.0] * 3
