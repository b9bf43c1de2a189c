"""Smooth paths: continuous, within their limits, and they arrive."""

import numpy as np
import pytest

from hexsim.motion_computer.paths import stop_and_move

LIMITS = dict(velocity_max=0.05, acceleration_max=0.2, stop_acceleration_max=1.0)


def sampled(path, step=1e-4):
    time = np.arange(path.start_s, path.end_s + 0.05, step)
    values = np.array([path.value(t) for t in time])
    return time, values, np.gradient(values, step, axis=0), np.gradient(np.gradient(values, step, axis=0), step, axis=0)


@pytest.mark.parametrize("seed", range(5))
def test_a_path_continues_the_motion_and_arrives(seed: int) -> None:
    """Position and velocity start as given, acceleration as given; the path ends at the target, at rest."""
    random = np.random.default_rng(seed)
    start, target = random.uniform(0.05, 0.15, 6), random.uniform(0, 0.2, 6)
    velocity, acceleration = random.uniform(-0.2, 0.2, 6), random.uniform(-0.5, 0.5, 6)
    path = stop_and_move(3.0, start, velocity, acceleration, target, **LIMITS)
    h = 1e-5
    y = np.array([path.value(3.0 + k * h) for k in range(3)])
    assert np.allclose(y[0], start, atol=1e-15)
    assert np.allclose((y[1] - y[0]) / h, velocity, atol=2e-5)  # h a / 2 of the difference
    assert np.allclose((y[2] - 2 * y[1] + y[0]) / h**2, acceleration, atol=1e-3)  # h times jerk
    assert np.allclose(path.value(path.end_s), target, atol=1e-15)
    assert np.allclose(path.value(path.end_s + 9), target, atol=1e-15)


@pytest.mark.parametrize("seed", range(5))
def test_limits_hold_and_are_reached(seed: int) -> None:
    """After the stop no coordinate exceeds velocity or acceleration limits, and one of them touches a limit."""
    random = np.random.default_rng(seed)
    path = stop_and_move(0.0, random.uniform(0, 0.2, 6), 0.0, 0.0, random.uniform(0, 0.2, 6), **LIMITS)
    _, _, velocity, acceleration = sampled(path, 1e-3)
    used = max(np.abs(velocity).max() / 0.05, np.abs(acceleration).max() / 0.2)
    assert 0.995 < used < 1.001  # sampled at 1 ms: the peak may fall between samples


def test_a_stop_keeps_its_acceleration() -> None:
    """From steady motion at v0 the braking peaks at the limit, 1.5 v0/T, and the stop covers v0 T/2."""
    path = stop_and_move(0.0, [0.1], [0.2], [0.0], None, **LIMITS)
    _, _, _, acceleration = sampled(path)
    assert path.stop_s == pytest.approx(0.3)
    assert np.abs(acceleration).max() == pytest.approx(1.0, rel=2e-3)
    assert path.value(path.end_s)[0] == pytest.approx(0.1 + 0.2 * 0.3 / 2)


def test_velocity_and_acceleration_never_jump() -> None:
    """Between two samples 0.1 ms apart the velocity changes by no more than the peak acceleration allows."""
    path = stop_and_move(0.0, [0.1, 0.05], [0.15, -0.1], [0.2, 0.0], [0.0, 0.19], **LIMITS)
    _, _, velocity, acceleration = sampled(path)
    assert np.abs(np.diff(velocity, axis=0)).max() < 1.2e-4  # 1.2 m/s2 times 0.1 ms
    assert np.abs(np.diff(acceleration[2:], axis=0)).max() < 0.01  # jerk below 100 m/s3: no step


def test_a_stop_near_the_end_of_the_stroke_is_shorter() -> None:
    """Within the bounds the stop may need more acceleration, but it does not leave the stroke."""
    path = stop_and_move(0.0, [0.19], [0.2], [0.0], None, **LIMITS, bounds=(0.0, 0.2))
    _, values, _, _ = sampled(path)
    assert values.max() <= 0.2
    assert stop_and_move(0.0, [0.19], [0.2], [0.0], None, **LIMITS).value(9.0)[0] > 0.2  # what the bound prevents
