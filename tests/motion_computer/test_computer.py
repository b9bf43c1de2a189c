"""The motion computer on an ideal machine: legs that follow their volts as v = K_v u, no oil, no mass."""

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer import monitors, states
from hexsim.motion_computer.computer import MotionComputer
from hexsim.motion_computer.errors import Error

MACHINE = load_machine("micro_motion_system")
SUPPLY = 7.0e6
TICK = 0.002


class IdealMachine:
    """Six integrators behind the motion computer; transducer noise of 3 um; pressures that carry the load."""

    def __init__(self, state=states.State.NEUTRAL, machine=MACHINE, **options):
        self.computer = MotionComputer(machine, state=state, **options)
        start = 0.1 if state == states.State.NEUTRAL else 0.004
        self.positions = np.full(6, start)
        self.pressures = np.full(6, 4.0e6)
        self.supply, self.time = SUPPLY, 0.0
        self.setpoints, self.volts = [], []
        self.random = np.random.default_rng(0)
        self.gain = monitors.velocity_gain(machine)

    def run(self, seconds, wanted=None, reading=lambda y: y):
        for _ in range(round(seconds / TICK)):
            rows = None if wanted is None else np.tile(wanted(self.time), (self.computer.preview, 1))
            volts = self.computer.tick(
                self.time, rows, reading(self.positions + self.random.normal(0, 3e-6, 6)), self.pressures, self.supply
            )
            self.setpoints.append(self.computer.setpoint.copy())
            self.volts.append(volts.copy())
            self.positions = np.clip(self.positions + TICK * self.gain * volts, 0.004, 0.196)
            self.time += TICK


def derivatives(setpoints):
    y = np.array(setpoints)
    velocity = np.diff(y, axis=0) / TICK
    return y, velocity, np.diff(velocity, axis=0) / TICK


def heave(time):
    return 0.1 + 0.05 * np.sin(np.pi * time) * min(time, 1.0) * np.ones(6)


def test_start_neutral_manual_and_back_to_rest() -> None:
    """off, starting, neutral, manual, neutral, settling, off: in this order, and at rest where it says so."""
    machine = IdealMachine(states.State.OFF)
    computer = machine.computer
    machine.run(0.1)
    assert computer.state == states.State.OFF and not computer.pump_on and not np.any(machine.volts)
    computer.command("start", machine.time)
    assert computer.pump_on
    machine.run(8.0)
    assert computer.state == states.State.NEUTRAL and computer.arrived
    assert machine.positions == pytest.approx(np.full(6, 0.1), abs=1e-4)
    computer.command("run_manual", machine.time)
    begin = machine.time
    machine.run(3.0, lambda t: heave(t - begin))
    computer.command("return_neutral", machine.time)
    machine.run(4.0)
    assert computer.arrived and machine.positions == pytest.approx(np.full(6, 0.1), abs=1e-3)
    computer.command("settle", machine.time)
    machine.run(10.0)
    assert computer.state == states.State.OFF and not computer.pump_on
    assert machine.positions == pytest.approx(np.full(6, 0.004))
    assert [after for _, _, _, after in computer.events] == [
        "starting",
        "neutral",
        "manual",
        "neutral",
        "settling",
        "off",
    ]


@pytest.mark.parametrize(
    ("command", "after"), [("return_neutral", states.State.NEUTRAL), ("settle", states.State.SETTLING)]
)
def test_guidance_keeps_its_limits_from_any_motion(command, after) -> None:
    """Out of the middle of a fast heave: velocity and acceleration of the setpoints stay within those of the guidance
    (braking: within the stop's), and neither jumps."""
    machine = IdealMachine()
    guidance = machine.computer.guidance
    machine.computer.command("run_manual", 0.0)
    machine.run(2.1, heave)
    machine.computer.command(command, machine.time)
    before = len(machine.setpoints)
    machine.run(7.0)
    assert machine.computer.state in (after, states.State.OFF)
    _, velocity, acceleration = derivatives(machine.setpoints[before - 3 :])
    assert np.abs(acceleration).max() <= guidance.stop_acceleration_m_s2 * 1.02  # of a tick's chord
    assert np.abs(np.diff(velocity, axis=0)).max() <= guidance.stop_acceleration_m_s2 * TICK * 1.02
    moving = slice(400, None)  # the stop is over after 0.3 s
    speed, change = (
        (guidance.neutral_velocity_m_s, guidance.neutral_acceleration_m_s2)
        if after == states.State.NEUTRAL
        else (guidance.settle_velocity_m_s, guidance.settle_acceleration_m_s2)
    )
    assert np.abs(velocity[moving]).max() <= speed * 1.001
    assert np.abs(acceleration[moving]).max() <= change * 1.01


def test_commands_out_of_turn_are_refused() -> None:
    """What the table forbids, what must wait, what happens by itself and what does not exist: a sentence each."""
    machine = IdealMachine()
    computer = machine.computer
    with pytest.raises(HexsimError, match="'start' is not possible in state neutral; possible: "):
        computer.command("start", 0.0)
    with pytest.raises(HexsimError, match="unknown command 'ready'; give one of start, run_manual"):
        computer.command("ready", 0.0)
    computer.command("run_manual", 0.0)
    machine.run(1.0, heave)
    computer.command("return_neutral", machine.time)
    with pytest.raises(HexsimError, match="run_manual must wait until the platform has reached neutral"):
        computer.command("run_manual", machine.time)
    machine.computer.mains = False
    machine.run(0.1)
    with pytest.raises(HexsimError, match="reset must wait until the platform is at rest"):
        computer.command("reset", machine.time)


@pytest.mark.parametrize(
    ("what", "error"),
    [
        (lambda m: setattr(m, "supply", 0.7 * SUPPLY), Error.PRESSURE_LOW),
        (lambda m: setattr(m, "supply", np.nan), Error.SENSOR),
        (lambda m: setattr(m.computer, "oil_temperature_degC", 66.0), Error.OIL_HOT),
        (lambda m: setattr(m.computer, "mains", False), Error.POWER),
        (lambda m: setattr(m.computer, "pump_running", False), Error.PRESSURE_LOW),
        (lambda m: m.pressures.__setitem__(2, 1.0e5), Error.PRESSURE_LOW),
        (lambda m: setattr(m, "gain", 0.0), Error.LEG_ERROR),
    ],
    ids=["supply low", "supply signal", "oil hot", "mains", "pump", "leg pressure", "legs locked"],
)
def test_each_monitor_leads_to_fault_and_down(what, error) -> None:
    """One thing goes wrong in mid motion: its error is latched, the state is fault, setpoints go down smoothly."""
    machine = IdealMachine()
    machine.computer.command("run_manual", 0.0)
    machine.run(1.0, heave)
    assert machine.computer.errors == Error.NONE
    what(machine)
    machine.run(1.0, heave)
    assert machine.computer.state == states.State.FAULT
    assert machine.computer.errors & error
    machine.run(7.0)
    assert machine.computer.arrived and not machine.computer.pump_on
    assert np.allclose(machine.setpoints[-1], 0.0)
    _, _, acceleration = derivatives(machine.setpoints)
    assert np.abs(acceleration[500:]).max() < 1.6  # 0.05 m at 0.5 Hz: 0.5 m/s2; braking: 1 m/s2
    machine.computer.command("reset", machine.time)
    assert machine.computer.state == states.State.OFF and machine.computer.errors == Error.NONE


def test_one_bad_reading_is_bridged_and_three_are_a_fault() -> None:
    """A single NaN or jump does not reach the valves and is no error; three in a row are."""
    for bad, times, state in (
        (np.nan, 1, states.State.MANUAL),
        (0.15, 2, states.State.MANUAL),
        (np.nan, 3, states.State.FAULT),
        (0.15, 3, states.State.FAULT),
    ):
        machine = IdealMachine()
        machine.computer.command("run_manual", 0.0)
        machine.run(1.0, heave)
        before = machine.volts[-1].copy()

        def reading(y, bad=bad):
            y[3] = bad
            return y

        machine.run(times * TICK, heave, reading)
        machine.run(TICK, heave)
        assert machine.computer.state == state, (bad, times)
        assert np.abs(np.array(machine.volts[-times - 1 :]) - before).max() < 0.2  # a jump of 50 mm would be 2.5 V


def test_a_frozen_reading_is_found_only_in_motion() -> None:
    """Equal readings for 0.1 s while the leg is driven are a fault; at rest they are natural."""
    machine = IdealMachine()
    machine.run(1.0)
    assert machine.computer.state == states.State.NEUTRAL
    machine.computer.command("run_manual", machine.time)
    begin = machine.time
    machine.run(1.0, lambda t: heave(t - begin))
    held = machine.positions[0]

    def reading(y):
        y[0] = held
        return y

    machine.run(0.15, lambda t: heave(t - begin), reading)
    assert machine.computer.state == states.State.FAULT and machine.computer.errors == Error.SENSOR


def test_the_lag_of_the_loop_is_no_error() -> None:
    """A machine whose velocity gain is a third off the data sheet's, either way, follows 0.05 m at 0.5 Hz without
    error; the lag itself, 20 mm and more, is larger than the tolerance of 12 mm."""
    for share in (0.67, 1.33):
        machine = IdealMachine()
        machine.gain *= share
        machine.computer.command("run_manual", 0.0)
        machine.run(4.0, heave)
        assert not machine.computer.findings
        lag = np.abs(np.array(machine.setpoints[-500:])[:, 0] - machine.positions[0]).max()
        assert lag > monitors.Tolerances().leg_error_m


def test_a_lost_transducer_is_replaced_by_the_model() -> None:
    """Leg 1 lost in a fault: it is driven by the model, corrected by the other legs, and comes down with them."""
    machine = IdealMachine()
    machine.gain *= 0.8
    machine.computer.command("run_manual", 0.0)
    machine.run(1.3, heave)

    def reading(y):
        y[0] = np.nan
        return y

    apart = []  # of legs 1 and 2, on the way down
    for _ in range(300):
        machine.run(0.01, heave, reading)
        if not machine.computer.arrived:
            apart.append(abs(machine.positions[0] - machine.positions[1]))
    assert len(apart) > 50 and max(apart) < 1e-3
    assert machine.computer.state == states.State.FAULT


def test_without_supply_pressure_no_valve_is_opened_upwards() -> None:
    """Pressure low in a fault: within the lift fade the volts upwards go to zero, without a step."""
    machine = IdealMachine()
    machine.computer.command("run_manual", 0.0)
    machine.run(2.1, heave)
    machine.supply = 3.0e6
    machine.run(2.0, heave)
    volts = np.array(machine.volts)[:, 0]
    fade = round(machine.computer.guidance.lift_fade_s / TICK)
    first = round(machine.computer.events[-1][0] / TICK)
    assert (volts[first + fade + 1 :] <= 1e-12).all()
    assert np.abs(np.diff(volts[1000:])).max() < 0.05  # V a tick


def test_a_bench_has_a_motion_computer_too() -> None:
    """One leg: same states, no load monitor."""
    bench = changed(load_machine("bench"), {})
    computer = MotionComputer(bench)
    assert computer.tick(0.0, None, np.array([0.1]), np.array([3e6]), SUPPLY) == pytest.approx([0.0])
    assert computer.state == states.State.NEUTRAL
