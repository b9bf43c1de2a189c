"""Each block of the controller against its closed form; tick by tick, without a plant."""

import math

import numpy as np
import pytest
from scipy import signal

from hexsim import HexsimError
from hexsim.machine.files import changed
from hexsim.motion_computer import controller, loop_model
from hexsim.motion_computer.position_loop import PositionLoop

T = 1 / 500
FREQUENCIES = np.array([0.5, 2.0, 7.0, 20.0, 60.0, 120.0])


def declared(bench, **keys):
    return PositionLoop(changed(bench, {f"controller.{key}": value for key, value in keys.items()}), (), None).control


def play(control, setpoint, position=None, pressure=None):
    """Volts (n,) of one leg for setpoints, positions and pressures (n,); it begins at rest at the first ones."""
    n = len(setpoint)
    columns = [np.zeros(n) if x is None else np.asarray(x, float) for x in (setpoint, position, pressure)]
    memory, volts = controller.new_memory(1), np.zeros((n, 1))
    controller.begin(control, memory, *(c[:1] for c in columns))
    for k in range(n):
        controller.tick(control, memory, *(c[k : k + 1] for c in columns), volts[k])
    return volts[:, 0]


def answer(control, frequency_Hz, mass=40.0):
    """(setpoint, position, pressure) to volts at the frequencies: (n, 3)."""
    return loop_model.transfer(
        loop_model.reduced(loop_model.controller_matrices(control, mass)), np.exp(2j * np.pi * frequency_Hz * T)
    )[:, 0]


def test_gain_alone_is_the_proportional_loop_of_the_report(bench):
    """u = sat(Kp (r - y)), to the bit, whatever else the memory holds."""
    rng = np.random.default_rng(3)
    setpoint, position = 0.1 + 0.2 * rng.standard_normal((2, 200))
    volts = play(declared(bench), setpoint, position, 1e6 * rng.standard_normal(200))
    assert np.array_equal(volts, np.clip(bench.controller.gain_V_per_m * (setpoint - position), -10.0, 10.0))
    assert np.abs(volts).max() == 10.0


def test_integral_of_a_constant_error_is_a_ramp(bench):
    """u_k = Kp e (1 + k T/T_i)."""
    volts = play(declared(bench, integral_time_s=0.5), np.full(400, 0.01))
    assert volts == pytest.approx(50 * 0.01 * (1 + np.arange(400) * T / 0.5), rel=1e-12)


@pytest.mark.parametrize("sign", (1.0, -1.0))
def test_windup_ends_at_what_back_calculation_says(bench, sign):
    """Saturated for long, u_d/T_i + (sat - u)/T_t = 0: I = sat - u_d (1 - T_t/T_i). After it the volts come back at once."""
    error = sign * np.r_[np.full(2000, 0.5), np.full(200, -0.001)]
    control = declared(bench, integral_time_s=1.0, anti_windup_s=0.05)
    volts = play(control, error)
    integral = 10.0 - 25.0 * (1 - 0.05)
    assert sign * volts[:2000] == pytest.approx(np.full(2000, 10.0))
    assert sign * volts[2000] == pytest.approx(max(integral - 0.05, -10.0), abs=1e-9)
    wound = sign * play(declared(bench, integral_time_s=1.0, anti_windup_s=1e4), error)
    assert wound[2000] == 10.0 and wound[-1] == 10.0  # without it the volts stay saturated


@pytest.mark.parametrize("ticks", (0.0, 1.0, 2.0, 0.25, 3.6, 8.0))
def test_computing_delay_is_exact(bench, ticks):
    """Whole ticks shift the volts; of a fraction f the mean over the tick is kept: (1 - f) u_n + f u_(n+1)."""
    setpoint = 0.1 * np.sin(0.3 * np.arange(100))
    at_once = play(declared(bench), setpoint)
    late = play(declared(bench, computing_delay_ticks=ticks), setpoint)
    padded = np.r_[np.zeros(10), at_once]
    whole, part = int(ticks), ticks % 1
    expected = (1 - part) * padded[10 - whole : 110 - whole] + part * padded[9 - whole : 109 - whole]
    assert late == pytest.approx(expected, abs=1e-15)


def test_velocity_is_a_filtered_derivative(bench):
    """Derivative action on the position: -K_d w s/(s + w) by the bilinear rule; a ramp gives K_d times its speed."""
    control = declared(bench, velocity_gain_V_s_per_m=3.0, velocity_filter_Hz=40.0)
    omega = 2 * math.pi * 40.0
    b, a = signal.bilinear([3.0 * omega, 0.0], [1.0, omega], 1 / T)
    expected = signal.freqz(b, a, 2 * math.pi * FREQUENCIES * T)[1]
    assert answer(control, FREQUENCIES)[:, 1] == pytest.approx(-50.0 - expected, rel=1e-9)
    ramp = 0.2 * np.arange(200) * T
    assert play(control, ramp, ramp)[-1] == pytest.approx(-3.0 * 0.2, rel=1e-9)


def test_cascade_is_a_velocity_loop_inside_the_position_loop(bench):
    """u = K_d (Kp/K_d (r - y) + r' - v_m): a piston that follows the ramp asks for nothing, one that stands for K_d r'."""
    control = declared(bench, structure="cascade", velocity_gain_V_s_per_m=3.0, velocity_filter_Hz=40.0)
    ramp = 0.2 * np.arange(300) * T
    assert play(control, ramp, ramp)[-1] == pytest.approx(0.0, abs=1e-9)
    assert play(control, ramp)[-1] == pytest.approx(50.0 * ramp[-1] + 3.0 * 0.2, rel=1e-9)
    with_integral = declared(bench, structure="cascade", velocity_gain_V_s_per_m=3.0, integral_time_s=0.4)
    behind = play(with_integral, ramp, ramp - 0.001)  # position 1 mm behind at the same speed from the first tick on
    assert behind[-1] - behind[-2] == pytest.approx(T * 50.0 * 0.001 / 0.4, rel=1e-6)


def test_pressure_feedback_is_a_high_pass(bench):
    """-K_p s/(s + w_p) of the pressure: nothing at rest, all of it above the corner; falling pressure opens the valve."""
    control = declared(bench, pressure_feedback_V_per_Pa=2e-7, pressure_high_pass_Hz=3.0)
    omega = 2 * math.pi * 3.0
    b, a = signal.bilinear([2e-7, 0.0], [1.0, omega], 1 / T)
    assert answer(control, FREQUENCIES)[:, 2] == pytest.approx(-signal.freqz(b, a, 2 * math.pi * FREQUENCIES * T)[1])
    step = play(control, np.zeros(2000), pressure=np.r_[3e6, np.full(1999, 4e6)])
    assert step[1] == pytest.approx(-0.2, rel=0.02) and abs(step[-1]) < 1e-9
    assert play(control, np.zeros(2), pressure=np.array([4e6, 3e6]))[1] > 0.19


def test_missing_pressure_changes_nothing(bench):
    """A pressure that is not a number leaves the position controller at work, and the high pass as it was."""
    control = declared(bench, pressure_feedback_V_per_Pa=2e-7)
    pressure = np.full(100, 3e6)
    pressure[40:60] = np.nan
    assert play(control, np.full(100, 0.01), pressure=pressure) == pytest.approx(np.full(100, 0.5))


def test_notch_takes_its_frequency_away(bench):
    """(s^2 + d b s + w^2)/(s^2 + b s + w^2): depth d in the middle exactly, 1 at rest, width b."""
    control = declared(bench, notch_Hz=30.0, notch_width=0.8, notch_depth=0.2)
    gain = np.abs(answer(control, np.array([1e-3, 30.0, 200.0]))[:, 0]) / 50.0
    assert gain[0] == pytest.approx(1.0, abs=1e-6) and gain[1] == pytest.approx(0.2, rel=1e-6) and gain[2] > 0.95
    omega = 2 * math.pi * 30.0
    b, a = signal.bilinear(
        [1, 0.2 * 0.8 * omega, omega**2], [1, 0.8 * omega, omega**2], omega / (2 * math.tan(omega * T / 2))
    )
    expected = 50.0 * signal.freqz(b, a, 2 * math.pi * FREQUENCIES * T)[1]
    assert answer(control, FREQUENCIES)[:, 0] == pytest.approx(expected, rel=1e-9)


def test_setpoint_filter_is_scipys_butterworth(bench):
    """The same response as scipy's digital Butterworth; no kick at the start; the preview is of before it."""
    control = declared(bench, setpoint_filter_Hz=20.0)
    b, a = signal.butter(2, 20.0, fs=1 / T)
    setpoint = 0.1 + 0.01 * np.sin(np.arange(300) * 0.1)
    smooth = signal.lfilter(b, a, setpoint, zi=signal.lfilter_zi(b, a) * setpoint[0])[0]
    assert play(control, setpoint, np.full(300, 0.1)) == pytest.approx(50.0 * (smooth - 0.1), abs=1e-12)
    memory, ahead, followed, path = controller.new_memory(1), np.empty((10, 1)), np.empty(1), []
    controller.begin(control, memory, setpoint[:1], setpoint[:1], np.zeros(1))
    for k in range(200):
        controller.leg_path(control, memory, setpoint[k : k + 10, None], ahead)
        controller.smoothed(control, memory, ahead[0], followed)
        assert np.array_equal(ahead[:, 0], setpoint[k : k + 10])
        path.append(followed[0])
    assert path == pytest.approx(smooth[:200], abs=1e-12)


def test_slow_setpoints_are_joined_by_straight_lines(bench):
    """125 Hz into 500 Hz: at each setpoint the path is where the last one was, and in between on the line; so is the
    preview, as far as it knows the setpoints."""
    control = declared(bench, setpoint_rate_Hz=125.0)
    setpoint = 0.1 + 0.01 * np.sin(np.arange(200) * 0.05)
    path = 0.1 + play(control, setpoint, np.full(200, 0.1)) / 50.0
    expected = np.interp(np.arange(200) - 4.0, np.arange(0, 200, 4), setpoint[::4])
    assert path == pytest.approx(expected, abs=1e-12)
    memory, ahead = controller.new_memory(1), np.empty((10, 1))
    controller.begin(control, memory, setpoint[:1], setpoint[:1], np.zeros(1))
    for k in range(151):
        controller.leg_path(control, memory, setpoint[k : k + 10, None], ahead)
    assert ahead[:, 0] == pytest.approx(expected[150:160], abs=1e-12)


def test_feed_forward_of_a_parabola_and_a_cubic(bench):
    """r = c t^3/6: k_v r' + k_a r'' with differences of the past; the oil spring adds k_v m r'''/k, friction k_v b r''/k."""
    k = np.arange(60)
    parabola, cubic = 0.5 * (k * T) ** 2, (k * T) ** 3 / 6
    plain = declared(
        bench, velocity_feed_forward_V_s_per_m=8.0, acceleration_feed_forward_V_s2_per_m=0.05, gain_V_per_m=1e-3
    )
    t = k[-1] * T
    assert play(plain, parabola, parabola)[-1] == pytest.approx(8.0 * (t - T / 2) + 0.05, rel=1e-9)
    with_load = declared(bench, velocity_feed_forward_V_s_per_m=8.0, load_feed_forward=True, gain_V_per_m=1e-3)
    row, memory = with_load.rows[0], controller.new_memory(1)
    difference = play(with_load, cubic, cubic)[-1] - 8.0 * np.diff(cubic)[-1] / T
    m, b, flexible = bench.load.moving_mass_kg, row[controller.C.VISCOUS], row[controller.C.FLEXIBILITY]
    assert with_load.inertia[0, 0] == pytest.approx(m)
    assert memory.shape == (1, controller.N_MEMORY)
    # F = m r'' + b r' + F_c tanh(r'/TURN) from differences; its own difference over one tick
    speed = np.diff(cubic)[-2:] / T
    dry = bench.friction.coulomb_extend_N * np.diff(np.tanh(speed / controller.TURN_m_s))[0] / T
    assert difference == pytest.approx(8.0 * flexible * (m + b * (t - T) + dry), rel=1e-6)


def test_pressure_feedback_leaves_the_demanded_pressure_alone(bench):
    """With the load fed forward, a pressure F/A1 that the motion asks for is not fed back."""
    control = declared(bench, load_feed_forward=True, pressure_feedback_V_per_Pa=2e-7, gain_V_per_m=1e-3)
    path = 0.01 * np.sin(0.05 * np.arange(400))
    memory, volts, demanded = controller.new_memory(1), np.zeros((400, 1)), 3e6
    controller.begin(control, memory, path[:1], path[:1], np.array([demanded]))
    for k in range(400):
        ahead = memory.copy()
        controller.tick(control, ahead, path[k : k + 1], path[k : k + 1], np.zeros(1), volts[k])
        demanded = 3e6 + ahead[0, controller.M.FORCE] / control.rows[0, controller.C.AREA]
        controller.tick(control, memory, path[k : k + 1], path[k : k + 1], np.array([demanded]), volts[k])
    assert np.abs(volts).max() < 1e-6


def test_lost_position_shuts_the_valve_and_leaves_the_memory(bench):
    """NaN gives 0 V, and the controller goes on from its last reading when the transducer comes back."""
    control = declared(bench, velocity_gain_V_s_per_m=3.0, integral_time_s=0.5)
    position = np.full(50, 0.001)
    position[20:30] = np.nan
    volts = play(control, np.zeros(50), position)
    assert np.all(volts[20:30] == 0.0) and volts[30] == pytest.approx(volts[19] + (volts[19] - volts[18]), rel=1e-9)


def test_filters_converge_to_the_analogue_ones_with_second_order(bench):
    """Half the tick, a quarter of the error: pressure high pass and measured velocity at 20 Hz."""
    errors = []
    for rate in (500.0, 1000.0, 2000.0):
        control = declared(
            bench,
            rate_Hz=rate,
            pressure_feedback_V_per_Pa=1e-7,
            pressure_high_pass_Hz=10.0,
            velocity_gain_V_s_per_m=1.0,
            velocity_filter_Hz=30.0,
            gain_V_per_m=1e-3,
        )
        found = loop_model.transfer(
            loop_model.reduced(loop_model.controller_matrices(control, 40.0)), np.exp([2j * np.pi * 20.0 / rate])
        )[0, 0]
        s = 2j * math.pi * 20.0
        high = -1e-7 * s / (s + 2 * math.pi * 10.0)
        slope = -1e-3 - 2 * math.pi * 30.0 * s / (s + 2 * math.pi * 30.0)
        errors.append([abs(found[2] / high - 1), abs(found[1] / slope - 1)])
    orders = np.diff(np.log2(np.array(errors)), axis=0)
    assert orders == pytest.approx(np.full((2, 2), -2.0), abs=0.05)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    (
        ({"notch_Hz": 300.0}, "notch_Hz = 300 must be below half of rate_Hz = 500"),
        ({"setpoint_rate_Hz": 300.0}, "whole multiple of setpoint_rate_Hz"),
        ({"structure": "cascade"}, "needs velocity_gain_V_s_per_m"),
        ({"computing_delay_ticks": 9.0}, "computing_delay_ticks"),
    ),
)
def test_what_no_controller_can_do_is_refused(bench, keys, sentence):
    """A sentence names the key."""
    with pytest.raises(HexsimError, match=sentence):
        declared(bench, **keys)
