"""A host without a future: what is predicted of its packets, and what the machine makes of them."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from hexsim import HexsimError
from hexsim.machine import load_machine
from hexsim.motion_computer import host_packet
from hexsim.motion_computer.host_buffer import HostBuffer
from hexsim.simulation import hosted

BENCH = load_machine("bench")
TICK = 0.002


def sent(buffer: HostBuffer, times: np.ndarray, values: np.ndarray) -> None:
    """Packets that arrive as they are sent, with six setpoints each: values (n, 6)."""
    for k, (time, row) in enumerate(zip(times.tolist(), values.tolist(), strict=True)):
        buffer.add(host_packet.HostCommand(sequence=k, time_s=time, setpoints=tuple(row)), time)


def test_a_polynomial_is_continued_exactly() -> None:
    """A quintic in each axis, at uneven times: 40 ms beyond the newest of 60 setpoints position within the
    predictors' floor of 2e-7 m, velocity 2e-5 m/s and acceleration 2e-3 m/s2: low orders keep a weight where they do as well."""
    rng, buffer = np.random.default_rng(0), HostBuffer(0.0, 0.04)
    powers = rng.normal(0.0, 0.05, (6, 6))
    times = np.cumsum(rng.uniform(0.01, 0.024, 60))
    truth = [np.polynomial.Polynomial(row) for row in powers]
    sent(buffer, times, np.column_stack([one(times) for one in truth]))
    found = buffer.target(times[-1])
    for row, tolerance in enumerate((2e-7, 2e-5, 2e-3)):
        expected = [one.deriv(row)(times[-1] + 0.04) if row else one(times[-1] + 0.04) for one in truth]
        assert found[row] == pytest.approx(expected, abs=tolerance)


def heave(time):
    """Five sines between 0.13 and 0.97 Hz, faded in over 2 s: (n, 6)."""
    out = np.zeros((len(time), 6))
    for f, phase in zip((0.13, 0.31, 0.47, 0.71, 0.97), (0.3, 2.0, 4.1, 1.2, 5.5), strict=True):
        out[:, 2] += 0.0072 / f**0.8 * np.sin(2 * np.pi * f * time + phase) * np.minimum(time / 2.0, 1.0)
    return out


@pytest.mark.parametrize(
    ("rate_Hz", "buffer_s"), [pytest.param(500.0, 0.0, marks=pytest.mark.slow), (60.0, 0.0), (60.0, 0.02)]
)
def test_setpoints_ahead_of_the_packets_follow_the_host(rate_Hz: float, buffer_s: float) -> None:
    """Irregular motion, packets late by a fifth of a period and 2 % lost, 28 ms ahead: within 0.8 mm of the host's own
    motion `buffer_s` ago, and its acceleration within 0.03 m/s2 rms."""
    host = hosted.Host(rate_Hz=rate_Hz, jitter=0.2, loss=0.02, buffer_s=buffer_s, seed=7)
    made = hosted.played(BENCH, heave, host, 6000, 15)[1500:6000, 0]
    time = np.arange(1500, 6000) * TICK - buffer_s
    asked = 0.1 + heave(time)[:, 2]
    assert np.abs(made - asked).max() < 8e-4
    assert np.diff(made - asked, 2).std() / TICK**2 < 0.03


def bump_deviation(host):
    """From rest a bump of 0.6 m/s2 in 0.3 s, 28 ms ahead: the acceleration less the host's, means over 10 ms."""
    fine = np.arange(0.0, 4.0, 1e-3)
    shape = 0.6 * np.sin(np.pi * np.clip((fine - 2.0) / 0.3, 0.0, 1.0)) ** 2
    shape -= 0.3 * np.sin(np.pi * np.clip((fine - 2.3) / 0.6, 0.0, 1.0)) ** 2
    place = CubicSpline(fine, np.cumsum(np.cumsum(shape)) * 1e-6)

    def bump(time):
        return np.column_stack([np.zeros((len(time), 2)), place(time), np.zeros((len(time), 3))])

    time = np.arange(1900) * TICK
    made = hosted.played(BENCH, bump, host, 1900, 15)[:1900, 0]
    off = np.diff(made - bump(time)[:, 2], 2) / TICK**2
    return np.convolve(off, np.full(5, 0.2), "same")[800:]


def test_a_sudden_bump_is_hardly_overshot() -> None:
    """60 packets a second: the acceleration is off by 0.4 m/s2 at most (0.53 with longer polynomials alone, sharply weighed)."""
    assert np.abs(bump_deviation(hosted.Host(rate_Hz=60.0, buffer_s=0.0))).max() < 0.4


def test_packets_with_derivatives_tell_a_bump_from_its_first_one_on() -> None:
    """The same with velocity and acceleration in each packet: at most two thirds as far off, rms and largest."""
    without, told = (
        bump_deviation(hosted.Host(rate_Hz=60.0, buffer_s=0.0, derivatives=with_them)) for with_them in (False, True)
    )
    assert told.std() < 0.67 * without.std()
    assert np.abs(told).max() < 0.67 * np.abs(without).max()


def test_wrong_derivatives_do_little_harm() -> None:
    """A host whose derivatives are ten times too large: setpoints 28 ms ahead within 1 mm of its motion, as in
    `test_setpoints_ahead_of_the_packets_follow_the_host`, for predictors without them stay in the mean."""
    buffer, most = HostBuffer(0.0, 0.028), 0.0
    for k in range(600):
        time = np.array([k / 60.0 - 1e-3, k / 60.0, k / 60.0 + 1e-3]).clip(0.0)
        before, here, after = heave(time)
        wrong = (
            tuple((10.0 * (after - before) / 2e-3).tolist()),
            tuple((10.0 * (after - 2 * here + before) / 1e-6).tolist()),
        )
        buffer.add(
            host_packet.HostCommand(sequence=k, time_s=k / 60.0, setpoints=tuple(here), derivatives=wrong), k / 60.0
        )
        if k > 180:
            ahead = heave(np.array([k / 60.0 + 0.028]))[0, 2]
            most = max(most, abs(buffer.target(k / 60.0)[0][2] - ahead))
    assert most < 1e-3


def test_nothing_that_was_shown_ahead_is_changed() -> None:
    """Setpoints shown for a tick to come are the ones that are given then, to the bit, whatever packets came since."""
    from hexsim.motion_computer.host_setpoints import HostSetpoints

    made, rng, shown = HostSetpoints(BENCH, 15), np.random.default_rng(1), []
    for k in range(400):
        if k % 7 == 0:
            pose = (0.0, 0.0, float(rng.normal(0.0, 0.01)), 0.0, 0.0, 0.0)
            made.buffer.add(host_packet.HostCommand(sequence=k, time_s=k * TICK, setpoints=pose), k * TICK)
        shown.append(made.rows(k * TICK))
    for k in range(385):
        assert np.array_equal(shown[k][1:], shown[k + 1][:-1])


def test_a_host_that_falls_silent_is_not_continued_for_long() -> None:
    """Packets end in the midst of a stroke of 0.2 m/s: the target stands still four periods later, 20 mm on at most."""
    buffer = HostBuffer(0.0)
    for k in range(100):
        buffer.add(
            host_packet.HostCommand(sequence=k, time_s=k * 0.01, setpoints=(0.0, 0.0, 0.002 * k, 0.0, 0.0, 0.0)),
            k * 0.01,
        )
    position, velocity, acceleration = buffer.target(1.2)
    assert velocity[2] == 0.0 and acceleration[2] == 0.0
    assert 0.198 <= position[2] < 0.218


def test_the_latency_is_the_declared_one() -> None:
    """A machine that declares 20 ms plays a sine 20 ms after the host's clock, to 0.3 ms."""
    machine = load_machine("bench").model_copy(
        update={"controller": BENCH.controller.model_copy(update={"host_buffer_s": 0.02})}
    )

    def sine(time):
        return np.column_stack([0.02 * np.sin(np.pi * time) * (k == 2) for k in range(6)])

    made = hosted.played(machine, sine, hosted.Host(rate_Hz=200.0), 3000, 1)[1000:3000, 0] - 0.1
    time = np.arange(1000, 3000) * TICK
    phase = np.angle(np.sum(made * np.exp(-1j * np.pi * time))) - np.angle(
        np.sum(np.sin(np.pi * time) * np.exp(-1j * np.pi * time))
    )
    assert -phase / np.pi == pytest.approx(0.02, abs=3e-4)


def test_a_host_that_cannot_be_is_refused() -> None:
    """A rate, jitter, loss or latency out of bounds: a sentence with the bounds."""
    with pytest.raises(HexsimError, match=r"host: rate_Hz is 5\.0; give a number from 10 to 2000"):
        hosted.Host(rate_Hz=5.0)
    with pytest.raises(HexsimError, match=r"host: loss is 1; give a number from 0 to 0\.9"):
        hosted.Host(loss=1)


def jolt(frequency_Hz: float, host: hosted.Host, preview: int = 1) -> float:
    """A sine of 1 m/s2 as it is played: the acceleration's largest deviation from its fundamental in 50 Hz [m/s2]."""
    place = 1.0 / (2 * np.pi * frequency_Hz) ** 2

    def sine(time):
        value = place * np.minimum(time / 2.0, 1.0) * np.sin(2 * np.pi * frequency_Hz * time)
        return np.column_stack([value * (k == 2) for k in range(6)])

    made = hosted.played(BENCH, sine, host, 4600, preview)[:4600, 0]
    acceleration = np.gradient(np.gradient(made, TICK), TICK)
    low = sosfiltfilt(butter(2, 50.0, fs=1.0 / TICK, output="sos"), acceleration)[2000:4500]
    angle = 2 * np.pi * frequency_Hz * TICK * np.arange(len(low))
    wave = np.column_stack([np.sin(angle), np.cos(angle), np.ones(len(low))])
    return float(np.abs(low - wave @ np.linalg.lstsq(wave, low, rcond=None)[0]).max())


@pytest.mark.parametrize(
    ("frequency_Hz", "most"),
    [(3.0, 0.02), *(pytest.param(*one, marks=pytest.mark.slow) for one in ((1.0, 0.012), (4.0, 0.03)))],
)
def test_sixty_packets_a_second_put_no_jolt_into_a_sine(frequency_Hz: float, most: float) -> None:
    """Late by a fifth of a period, 2 % lost, two draws: at most so much, and half of it 33 ms behind the host (0.371, 0.823 and,
    behind, 0.102, 0.185 m/s2 at 3 and 4 Hz with polynomials alone; 0.020, 0.039
    with processes that take setpoints for rounded to 2 um)."""
    for buffer_s, bound in ((0.0, most), (0.033, 0.5 * most)):
        for seed in (0, 2):
            host = hosted.Host(rate_Hz=60.0, jitter=0.2, loss=0.02, buffer_s=buffer_s, seed=seed)
            assert jolt(frequency_Hz, host) < bound


@pytest.mark.parametrize("ahead_s", [0.0, 0.02])
def test_what_is_predicted_goes_through_the_newest_setpoint_and_has_its_own_slopes(ahead_s: float) -> None:
    """Of sines: the newest setpoint is what it is, to the processes' nugget; velocity and acceleration are the differences of the
    position, there and 20 ms on."""
    rng, buffer = np.random.default_rng(2), HostBuffer(0.0, ahead_s)
    times = np.cumsum(rng.uniform(0.01, 0.03, 20))
    places = np.column_stack([np.sin(2 * np.pi * f * times) + f for f in (0.3, 0.5, 0.7, 1.0, 1.5, 2.0)])
    sent(buffer, times, places)
    h = 1e-4
    before, here, after = (buffer.target(times[-1] + k * h) for k in (-1, 0, 1))
    assert ahead_s or here[0] == pytest.approx(places[-1], abs=1e-4)
    assert here[1] == pytest.approx((after[0] - before[0]) / (2 * h), rel=1e-4, abs=1e-4)
    assert here[2] == pytest.approx((after[1] - before[1]) / (2 * h), rel=1e-4, abs=1e-3)


def test_a_clock_that_is_found_earlier_moves_nothing_at_once() -> None:
    """After 2 s of packets that are all 8 ms late one comes at once, in a motion of 0.2 m/s: the target goes on within 0.1 mm of
    where the late ones led it, and half a second of prompt packets later it has gained 5 to 8 ms."""
    buffer, late = HostBuffer(0.0), 0.008

    def send(k: int, late_s: float) -> float:
        place = (0.0, 0.0, 0.2 * k / 60.0, 0.0, 0.0, 0.0)
        buffer.add(host_packet.HostCommand(sequence=k, time_s=k / 60.0, setpoints=place), k / 60.0 + late_s)
        return buffer.target(k / 60.0 + 0.01)[0][2] - 0.2 * (k / 60.0 + 0.01 - late)

    assert max(abs(send(k, late)) for k in range(60, 120)) < 5e-4
    assert abs(send(120, 0.0)) < 1e-4
    for k in range(121, 151):
        gained = send(k, 0.0)
    assert 0.2 * 0.005 < gained < 0.2 * 0.008
