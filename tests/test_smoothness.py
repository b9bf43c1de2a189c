"""Smoothness figures against signals whose figures are known by hand."""

import json

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from hexsim import HexsimError, smoothness
from hexsim.setpoints import signals

RATE_Hz = 1000.0
TIME = np.arange(0.0, 20.0, 1.0 / RATE_Hz)
W = 2.0 * np.pi * 0.5
HEAVE = signals.Sine(amplitude=0.05, frequency_Hz=0.5)
AMPLITUDE = 0.05 * W**2  # 0.493 m/s2
INNER = slice(200, -200)  # 0.2 s off the ends of the record, past the filter's padding


def pulses(time, centres, heights, width_s=0.02):
    """Bumps of known height: Gaussians of 20 ms, whose spectrum (8 Hz) lies inside the 50 Hz band."""
    return sum(
        height * np.exp(-0.5 * ((time - centre) / width_s) ** 2)
        for centre, height in zip(centres, heights, strict=True)
    )


# ---- the band --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frequency", "gain"), [(0.5, 1.0), (17.5, 0.99977), (50.0, 0.5), (100.0, 1.0 / 257.0), (200.0, 1.0 / 65537.0)]
)
def test_band_limit_has_the_gain_of_its_formula_and_no_phase(frequency, gain):
    """|H| = 1 / (1 + (f / 50)^8), sampled at 10 kHz (tangent warping: 2 % at 200 Hz); the wave does not move."""
    time = np.arange(0.0, 2.0, 1e-4)
    wave = np.sin(2.0 * np.pi * frequency * time + 0.7)
    assert smoothness.band_limit(time, wave)[3000:-3000] == pytest.approx(
        gain * wave[3000:-3000], abs=0.01 * gain + 1e-5
    )


@pytest.mark.parametrize(("order", "cut_off"), [(2, 0.003), (4, 0.05), (6, 0.3)])
def test_low_pass_is_that_of_scipy(order, cut_off):
    """An impulse in the middle of a record comes out as of scipy's Butterworth sections run forward and backward, to rounding."""
    impulse = np.zeros(20_001)
    impulse[10_000] = 1.0
    found = smoothness.band_limit(np.arange(20_001.0), impulse, cut_off, order=order)
    expected = sosfiltfilt(butter(order, cut_off, fs=1.0, output="sos"), impulse)
    assert found == pytest.approx(expected, abs=1e-9 * expected.max())


def test_delay_is_exact_where_the_command_is_linear_between_its_samples():
    """A response that is the command, interpolated linearly and moved by no whole number of samples, has that delay."""
    command = HEAVE.acceleration(TIME)
    for delay_s in (-0.01234, 0.05077):
        response = np.interp(TIME - delay_s, TIME, command)
        assert smoothness.response_delay_s(TIME, response, command) == pytest.approx(delay_s, abs=1e-9)


def test_band_limit_keeps_constants_and_straight_lines():
    """The padding continues a line: nothing happens to it, up to the very ends."""
    line = 3.0 - 2.0 * TIME
    assert smoothness.band_limit(TIME, line) == pytest.approx(line, abs=1e-7)


@pytest.mark.parametrize("frequency", [0.5, 5.0, 20.0, 60.0, 109.0, 300.0])
def test_band_limit_of_a_cut_record_is_that_of_the_whole_but_for_its_last_40_ms(frequency):
    """It differs by less than 0.5 % of the wave 40 ms inside the cut; at the cut by nearly all of it at the worst."""
    for phase in np.linspace(0.0, 2.0 * np.pi, 12):
        wave = np.sin(2.0 * np.pi * frequency * TIME + phase)
        error = np.abs(smoothness.band_limit(TIME[:10_000], wave[:10_000]) - smoothness.band_limit(TIME, wave)[:10_000])
        assert error[200:-40].max() < 0.005
        assert error[-40:].max() < 0.9


def test_band_limit_leaves_what_it_cannot_or_need_not_filter():
    """None means raw; a record at 80 Hz has nothing above 40 Hz to take away."""
    wave = np.sin(2.0 * np.pi * 300.0 * TIME)
    assert np.array_equal(smoothness.band_limit(TIME, wave, None), wave)
    slow = np.arange(0.0, 10.0, 1.0 / 80.0)
    assert np.array_equal(smoothness.band_limit(slow, np.cos(100.0 * slow)), np.cos(100.0 * slow))


@pytest.mark.parametrize(
    ("time", "signal", "message"),
    [
        ([0.0, 0.1, 0.3, 0.4], [0.0] * 4, r"not evenly sampled: row 2 comes 0.1 s after the row before, the mean step"),
        ([0.0, 0.1, 0.2], [0.0, np.nan, 0.0], r"not finite in row 2"),
        ([0.0, 0.1, 0.2], [0.0, 1.0], r"has 2 samples, time_s has 3"),
        ([0.0], [0.0], r"A record of 1 samples has no sample rate"),
    ],
)
def test_records_that_cannot_be_filtered_are_refused(time, signal, message):
    """Uneven, not finite, of unequal length, too short: row and size are named."""
    with pytest.raises(HexsimError, match=message):
        smoothness.band_limit(time, signal)


# ---- half-hertz noise ------------------------------------------------------------------------------------------------


def test_half_hertz_noise_of_known_harmonics():
    """Each sigma is that of the harmonics put in: A2, A3 low, A4, A9 high, a line between harmonics stochastic."""
    amplitudes = {2: 0.03, 3: 0.02, 4: 0.012, 9: 0.004}
    acceleration = (
        0.2 - AMPLITUDE * np.sin(W * TIME - 0.4) + 0.010 * np.sin(W * TIME * 32.0 / 7.0)
    )  # 7 periods analysed
    for k, a in amplitudes.items():
        acceleration = acceleration + a * np.cos(k * W * TIME + k)
    noise = smoothness.half_hertz_noise(TIME, acceleration, 0.5, start_s=6.0)
    assert noise.periods == 7
    assert noise.fundamental == pytest.approx(AMPLITUDE, rel=1e-9)
    assert noise.sigma_f == pytest.approx(AMPLITUDE / np.sqrt(2.0), rel=1e-9)
    assert noise.sigma_lf == pytest.approx(np.sqrt((0.03**2 + 0.02**2) / 2.0), rel=1e-4)
    assert noise.sigma_hf == pytest.approx(np.sqrt((0.012**2 + 0.004**2) / 2.0), rel=1e-4)
    assert noise.sigma_s == pytest.approx(0.010 / np.sqrt(2.0), rel=1e-3)
    total = np.sqrt(sum(a**2 for a in (*amplitudes.values(), 0.010)) / 2.0)
    assert noise.sigma_n == pytest.approx(total, rel=1e-4)
    assert noise.ratio_n == pytest.approx(total / noise.sigma_f, rel=1e-4)
    assert noise.ratio_lf == pytest.approx(noise.sigma_lf / noise.sigma_f)
    assert noise.ratio_hf == pytest.approx(noise.sigma_hf / noise.sigma_f)


def test_a_pure_sine_has_no_noise():
    """Whatever its phase and mean: peaks and noise vanish (1e-12: rounding)."""
    noise = smoothness.half_hertz_noise(TIME, 0.3 + AMPLITUDE * np.cos(W * TIME + 1.0), 0.5)
    assert noise.periods == 10
    assert noise.fundamental == pytest.approx(AMPLITUDE)
    assert max(noise.peak_raw, noise.peak_band, noise.sigma_n) < 1e-12


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_peak_is_the_largest_deviation_of_either_sign(sign):
    """One pulse of 0.2 m/s2 up or down in 7 periods: peak 0.2 less what it puts in the mean and the fundamental."""
    acceleration = -AMPLITUDE * np.sin(W * TIME) + pulses(TIME, [11.0], [sign * 0.2])
    noise = smoothness.half_hertz_noise(TIME, acceleration, 0.5, start_s=6.0)
    area = 0.2 * 0.02 * np.sqrt(2.0 * np.pi)  # of the pulse, over 14 s: mean 1/14, fundamental 2/14 of it
    assert noise.peak_band == pytest.approx(0.2 - area * 3.0 / 14.0, rel=2e-3)


def test_ringing_at_109_Hz_is_in_the_raw_peak_and_not_in_the_band():
    """0.5 m/s2 of 109 Hz: raw peak 0.5, in the band 0.5 / (1 + (109 / 50)^8) = 0.001."""
    noise = smoothness.half_hertz_noise(
        TIME, AMPLITUDE * np.sin(W * TIME) + 0.5 * np.sin(2 * np.pi * 109.0 * TIME), 0.5, start_s=6.0
    )
    assert noise.peak_raw == pytest.approx(0.5, rel=0.01)
    assert noise.peak_band < 0.01  # 0.001, and the padding at the end of the record
    assert noise.sigma_n == pytest.approx(0.5 / np.sqrt(2.0) / (1.0 + 2.18**8), rel=0.3)


def test_periods_need_not_fit_the_sample_rate():
    """0.195 Hz at 1 kHz, 5128.2 samples a period: fundamental and low harmonics still to 1e-3."""
    w = 2.0 * np.pi * 0.195
    noise = smoothness.half_hertz_noise(TIME, 0.4 * np.sin(w * TIME) + 0.02 * np.sin(2.0 * w * TIME + 1.0), 0.195)
    assert noise.periods == 3
    assert noise.fundamental == pytest.approx(0.4, rel=1e-3)
    assert noise.sigma_lf == pytest.approx(0.02 / np.sqrt(2.0), rel=1e-2)


def test_no_whole_period_is_refused():
    """1.5 s of a 2 s period: the message says how long a period is."""
    with pytest.raises(HexsimError, match=r"1\.\d+ s of record hold no whole period of 0.5 Hz \(2 s\)"):
        smoothness.half_hertz_noise(TIME, np.sin(W * TIME), 0.5, start_s=18.5)
    with pytest.raises(HexsimError, match=r"frequency_Hz is 0.0; it must be greater than 0"):
        smoothness.half_hertz_noise(TIME, np.sin(W * TIME), 0.0)


def test_motion_turns_at_the_extremes_of_its_harmonic():
    """A heave 0.4 rad late is at its top at (pi/2 + 0.4) / w + 2 k, at its bottom 1 s later; peaks are told apart."""
    tops = (0.5 * np.pi + 0.4) / W + 2.0 * np.arange(10)
    bottoms = tops + 1.0
    acceleration = -AMPLITUDE * np.sin(W * TIME - 0.4)
    acceleration = acceleration + pulses(TIME, tops, [0.10] * 10) + pulses(TIME, bottoms, [-0.04] * 10)
    part = smoothness.harmonic_deviation(TIME, acceleration, 0.5, start_s=6.0)
    times = {end: [r.time_s for r in part.reversals() if r.end == end] for end in ("top", "bottom")}
    assert times["top"] == pytest.approx(tops[3:], abs=1e-3)
    assert times["bottom"] == pytest.approx(bottoms[3:], abs=1e-3)
    peaks = part.peaks()
    moved = AMPLITUDE - part.amplitude  # what the pulses take from the fundamental, seen again at each reversal
    for peak in peaks:
        height = 0.10 - moved - part.mean if peak.end == "top" else -0.04 + moved - part.mean
        assert peak.signed == pytest.approx(height, abs=2e-3)
        assert peak.peak == abs(peak.signed)


def test_describing_function_is_gain_and_phase():
    """A response of 0.9, 0.3 rad late, with noise at other frequencies: 0.9 exp(-0.3 j)."""
    response = 0.9 * np.sin(W * TIME - 0.3) + 0.2 * np.sin(3.0 * W * TIME) + 0.5
    found = smoothness.describing_function(TIME, response, np.sin(W * TIME), 0.5)
    assert abs(found) == pytest.approx(0.9)
    assert np.angle(found) == pytest.approx(-0.3)
    with pytest.raises(HexsimError, match=r"command has no part at 0.5 Hz"):
        smoothness.describing_function(TIME, response, np.zeros_like(TIME), 0.5)


def test_turn_around_counts_the_missing_amplitude_when_told_the_command():
    """A response 10 % short deviates by 10 % of the command from the desired sine, and by nothing from its own."""
    response = -0.9 * AMPLITUDE * np.sin(W * TIME - 0.3)
    assert smoothness.turn_around_check(TIME, response, 0.5).peak_m_s2 < 1e-5
    told = smoothness.turn_around_check(TIME, response, 0.5, AMPLITUDE)
    assert told.peak_m_s2 == pytest.approx(0.1 * AMPLITUDE, rel=1e-4)
    assert told.passed


def test_turn_around_limit_is_0_49():
    """A pulse just below and just above 0.49 m/s2, up or down."""
    for height, passed in ((0.48, True), (0.52, False), (-0.48, True), (-0.52, False)):
        response = AMPLITUDE * np.sin(W * TIME) + pulses(TIME, [11.0], [height])
        assert smoothness.turn_around_check(TIME, response, 0.5).passed is passed


def test_parasitic_motion_is_all_of_it_about_its_mean():
    """0.03 at the driven frequency and 0.04 at 200 Hz: both raw, the first alone in the band; the start is cut off."""
    acceleration = 0.5 + 0.03 * np.sin(W * TIME) + 0.04 * np.sin(2.0 * np.pi * 200.0 * TIME + 0.2)
    acceleration[:1000] += 5.0  # the first second
    band, raw = (smoothness.parasitic(TIME, acceleration, band_Hz, start_s=2.0) for band_Hz in (50.0, None))
    assert raw == pytest.approx(0.07, rel=0.02)
    assert band == pytest.approx(0.03, rel=0.02)


# ---- reversals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ((0.0, -2.0, -4.0, -5.0), 2.0 * 2.0**0.5),
        ((-5.0, 1.0, -7.0, 0.0), 2.0 * 2.0**0.5),
        ((0.0, 1.0, -3.0, 0.0), None),
    ],
)
def test_the_frequency_at_which_a_response_falls_below_a_level(values, found):
    """Between two frequencies, on a logarithmic scale; where it comes from above, and none where it only reaches the level."""
    assert smoothness.frequency_below([1.0, 2.0, 4.0, 8.0], values, -3.0) == (found and pytest.approx(found))


def test_zero_crossings_of_a_sine_between_samples():
    """Velocity A w cos(wt - 0.4): top at (pi/2 + 0.4) / w to 1e-6 s, bottom 1 s later, and so on."""
    found = smoothness.reversals_of_velocity(TIME, np.cos(W * TIME - 0.4))
    assert [r.time_s for r in found] == pytest.approx((0.5 * np.pi + 0.4) / W + np.arange(20), abs=1e-6)
    assert [r.end for r in found[:3]] == ["top", "bottom", "top"]


def test_reversals_are_those_of_a_velocity_in_any_unit():
    """A hundred-millionth of the velocity turns at the same instants."""
    slow = smoothness.reversals_of_velocity(TIME, 1e-8 * np.cos(W * TIME - 0.4))
    assert [r.time_s for r in slow] == pytest.approx((0.5 * np.pi + 0.4) / W + np.arange(20), abs=1e-6)


def test_a_crossing_on_a_sample_counts_and_a_rest_does_not():
    """Velocity exactly 0 at a crossing sample: one reversal. A rest of 1 s between up and down, or at first: none."""
    triangle = np.concatenate([np.arange(5, -6, -1.0), np.arange(-4, 6, 1.0)])
    found = smoothness.reversals_of_velocity(np.arange(len(triangle)) * 0.01, triangle)
    assert [(r.end, round(r.time_s, 9)) for r in found] == [("top", 0.05), ("bottom", 0.15)]
    rest = np.concatenate([np.zeros(100), np.ones(50), np.zeros(100), -np.ones(50)])
    assert smoothness.reversals_of_velocity(np.arange(300) * 0.01, rest) == ()


@pytest.mark.parametrize("delay", [-0.05, 0.0, 0.0123, 0.127])
def test_delay_of_a_smaller_noisy_response_is_found(delay):
    """A sine at 0.8 of its size with noise of 0.02 m/s2: to 1 ms (one deviation is 0.2 ms)."""
    rng = np.random.default_rng(3)
    response = 0.8 * HEAVE.acceleration(TIME - delay) + 0.02 * rng.standard_normal(len(TIME)) + 0.1
    assert smoothness.response_delay_s(TIME, response, HEAVE.acceleration(TIME)) == pytest.approx(delay, abs=1e-3)
    assert smoothness.response_delay_s(TIME, response, np.zeros_like(TIME)) == 0.0


@pytest.mark.parametrize("delay", [0.0, 0.06])
def test_bumps_of_known_height_are_found_at_their_ends(delay):
    """Pulses of +0.10 m/s2 at the tops and -0.04 at the bottoms of a delayed sine: pp 0.10 and 0.04, signs apart."""
    tops, bottoms = 0.5 + 2.0 * np.arange(10) + delay, 1.5 + 2.0 * np.arange(10) + delay
    acceleration = HEAVE.acceleration(TIME - delay) + 0.3
    acceleration = acceleration + pulses(TIME, tops, [0.10] * 10) + pulses(TIME, bottoms, [-0.04] * 10)
    bumps = smoothness.reversal_bumps(TIME, acceleration, HEAVE.velocity(TIME), HEAVE.acceleration(TIME), start_s=2.0)
    assert len(bumps) == 18
    for bump in bumps:
        height = 0.10 if bump.end == "top" else 0.04
        assert bump.bump_pp == pytest.approx(height, rel=0.03)  # the pulses shift the estimated delay by some 0.1 ms
        assert bump.commanded_acceleration == pytest.approx(-AMPLITUDE if bump.end == "top" else AMPLITUDE, rel=1e-6)
        assert bump.delay_s == pytest.approx(delay, abs=2e-3)
    assert [b.time_s for b in bumps if b.end == "top"] == pytest.approx(tops[1:], abs=2e-3)


def test_bumps_of_constant_acceleration_reversals():
    """Bumps of 0.02 + 0.5 |a| at every clean reversal of the standard profile, each with its own |a| and end."""
    signal = signals.ConstantAccelerationReversals()
    time = np.arange(0.0, signal.period_s, 1e-3)
    reversals, levels = signal.reversals()
    command = signal.acceleration(time)
    acceleration = command + pulses(time, reversals, np.sign(levels) * (0.02 + 0.5 * np.abs(levels)))
    bumps = smoothness.reversal_bumps(time, acceleration, signal.velocity(time), command, delay_s=0.0)
    clean = [b for b in bumps if np.min(np.abs(reversals - b.time_s)) < 1e-3]
    assert len(clean) == len(reversals)
    assert [sum(b.end == end for b in clean) for end in ("top", "bottom")] == [15, 10]
    asked = np.array([abs(b.commanded_acceleration) for b in clean])
    assert np.array([b.bump_pp for b in clean]) == pytest.approx(0.02 + 0.5 * asked, rel=0.02)


def test_peaks_keep_to_their_window():
    """A pulse 0.3 s from a reversal is not its peak; a window that reaches out of the record is left out."""
    reversals = smoothness.reversals_of_velocity(TIME, HEAVE.velocity(TIME))
    peaks = smoothness.peaks_at_reversals(TIME, pulses(TIME, [0.6, 1.8], [-0.1, 0.5]), reversals)
    assert len(peaks) == 20
    assert peaks[0].signed == pytest.approx(-0.1)
    assert peaks[1].peak < 1e-5  # what the Gaussian of 20 ms has left 0.1 s away: exp(-12.5) of 0.5
    assert len(smoothness.peaks_at_reversals(TIME, TIME, reversals, window_s=0.6)) == 18


def test_deviation_from_command_is_zero_for_a_delayed_copy():
    """A response that is the command 0.06 s late and offset: nothing is left, raw or in the band."""
    part = smoothness.deviation_from_command(
        TIME, HEAVE.acceleration(TIME - 0.06) + 0.2, HEAVE.acceleration(TIME), start_s=2.0
    )
    assert part.delay_s == pytest.approx(0.06, abs=2e-5)
    assert part.time_s[0] == pytest.approx(2.0)
    assert np.max(np.abs(part.raw)) < 1e-4
    assert np.max(np.abs(part.band)) < 1e-4


# ---- summary ---------------------------------------------------------------------------------------------------------

FIGURES = {
    "fundamental_{}",
    "peak_raw_{}",
    "peak_band_{}",
    "noise_rms_{}",
    "ratio_n",
    "ratio_lf",
    "ratio_hf",
    "bump_pp_{}",
}


def heave_motion(**changes):
    given = {
        "acceleration": HEAVE.acceleration(TIME) + 0.02 * np.sin(2.0 * W * TIME),
        "commanded_velocity": HEAVE.velocity(TIME),
        "commanded_acceleration": HEAVE.acceleration(TIME),
        "frequency_Hz": 0.5,
    }
    return smoothness.AxisMotion(**(given | changes))


def test_summary_of_a_sine_run():
    """The driven axis has every figure, the same as `half_hertz_noise` gives; the others no ratios; units by axis."""
    axes = {"x": smoothness.AxisMotion(acceleration=0.01 * np.sin(W * TIME)), "z": heave_motion()}
    axes |= {"roll": smoothness.AxisMotion(acceleration=np.zeros_like(TIME))}
    summary = smoothness.summary_axes(TIME, axes, start_s=6.0)
    for axis, unit in (("x", "m_s2"), ("z", "m_s2"), ("roll", "rad_s2")):
        assert set(summary[axis]) == {name.format(unit) for name in FIGURES}
    noise = smoothness.half_hertz_noise(TIME, heave_motion().acceleration, 0.5, start_s=6.0)
    assert summary["z"]["fundamental_m_s2"] == noise.fundamental == pytest.approx(AMPLITUDE)
    assert summary["z"]["peak_band_m_s2"] == noise.peak_band == pytest.approx(0.02, rel=1e-3)
    assert summary["z"]["ratio_n"] == noise.ratio_n == pytest.approx(0.02 / AMPLITUDE, rel=1e-3)
    assert summary["x"]["fundamental_m_s2"] == pytest.approx(0.01)
    assert summary["x"]["peak_band_m_s2"] == pytest.approx(0.0, abs=1e-5)
    assert [summary["x"][name] for name in ("ratio_n", "ratio_lf", "ratio_hf")] == [None] * 3
    assert summary["roll"]["peak_band_rad_s2"] == 0.0
    assert json.loads(json.dumps(summary)) == summary


def test_summary_of_any_other_motion_is_against_the_command():
    """No single sine: fundamental and ratios are null, peaks and noise those of a - a_commanded."""
    acceleration = HEAVE.acceleration(TIME - 0.05) + pulses(TIME, [10.55], [0.1])
    motion = heave_motion(acceleration=acceleration, frequency_Hz=None)
    summary = smoothness.summary_axes(TIME, {"leg": motion}, start_s=6.0)["leg"]
    assert [summary[name] for name in ("fundamental_m_s2", "ratio_n", "ratio_lf", "ratio_hf")] == [None] * 4
    for name in ("peak_band_m_s2", "peak_raw_m_s2", "bump_pp_m_s2"):
        assert summary[name] == pytest.approx(0.1, rel=0.02)
    energy = 0.1**2 * 0.02 * np.sqrt(np.pi)  # integral of the squared pulse
    assert summary["noise_rms_m_s2"] == pytest.approx(np.sqrt(energy / 14.0), rel=0.02)


def test_summary_of_a_run_shorter_than_its_period_is_against_the_command():
    """1.5 s of a 2 s sine, a delayed copy: no fundamental, and nothing is left of it."""
    motion = heave_motion(acceleration=HEAVE.acceleration(TIME - 0.05))
    summary = smoothness.summary_axes(TIME, {"leg": motion}, start_s=18.5)["leg"]
    assert summary["fundamental_m_s2"] is None
    assert summary["peak_raw_m_s2"] < 1e-3
    assert summary["peak_band_m_s2"] < 1e-3


def test_summary_with_nothing_driven():
    """A run at rest: no fundamental, no reversal, and the peaks are the acceleration itself about its mean."""
    summary = smoothness.summary_axes(
        TIME, {"z": smoothness.AxisMotion(acceleration=0.01 * np.sin(20.0 * TIME) + 0.3)}
    )["z"]
    assert summary["peak_raw_m_s2"] == pytest.approx(0.01, rel=0.02)
    assert summary["bump_pp_m_s2"] is None
    assert summary["fundamental_m_s2"] is None
