"""A part of a hexapod's payload that swings along an axis of the platform: one effect, its axis read off the forces."""

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import geometry, load_machine
from hexsim.machine.files import changed
from hexsim.signals.log import Log
from hexsim.tracing import balances, signature
from hexsim.tracing.fitting import parameters
from hexsim.tracing.steps import shapes

RATE_Hz = 1000.0
SURGE = {"mass_kg": 60.0, "frequency_Hz": 4.5, "tilt_rad": np.pi / 2, "azimuth_rad": 0.0, "height_m": 0.2}
SWAY = {"mass_kg": 60.0, "frequency_Hz": 6.0, "tilt_rad": np.pi / 2, "azimuth_rad": np.pi / 2}
ASKEW = {"mass_kg": 80.0, "frequency_Hz": 5.0, "tilt_rad": 0.8, "azimuth_rad": -1.1}


def log_with(machine, **payload):
    """6 s without noise in which all axes move at several frequencies."""
    t = np.arange(6000) / RATE_Hz
    fade, poses = np.clip(t, 0.0, 1.0), np.zeros((len(t), 6))
    for k, reach in enumerate((0.008, 0.008, 0.008, 0.01, 0.01, 0.01)):
        poses[:, k] = reach * fade * sum(np.sin(2 * np.pi * f * (1 + 0.07 * k) * t + k * f) for f in (0.4, 1.3, 3.1))
    setpoint = geometry.machine_kinematics(machine).piston_positions(poses).T
    asked = Log(name="swing", kind="hexapod", time=t, rate=RATE_Hz, setpoint=setpoint, position=setpoint)
    return signature.simulated(changed(machine, {"effects": {"flexible_payload": payload}}), asked)


@pytest.mark.parametrize("payload", [SURGE, SWAY, ASKEW])
def test_the_platform_balance_holds_with_the_mode_and_shows_its_axis_without(payload):
    """With the mode no row is more than 10 % above what the samples leave of a machine without one, and without it the forces
    of one row are 1.5 times that; the axis, either end of it, is read off them within 0.2 rad, its frequency within a step of the scan
    (15 %)."""
    machine = load_machine("micro_motion_system")
    log, with_mode = log_with(machine, **payload), changed(machine, {"effects": {"flexible_payload": payload}})
    pairs = ((log_with(machine, mass_kg=0.0), machine), (log, machine), (log, with_mode))
    platform = balances.balance_named("platform", machine)
    bare, without, left = (platform.residual(own, one)[:, 1500:-500].std(axis=1) for own, one in pairs)
    assert np.all(left < 1.1 * bare)
    assert np.max(without[:3] / bare[:3]) > 1.5
    shape = shapes.proposed_shapes(machine, [log])["flexible_payload"]
    assert shape["frequency_Hz"] == pytest.approx(payload["frequency_Hz"], rel=0.15)

    def axis(tilt_rad, azimuth_rad, **_):
        return np.array(
            [np.sin(tilt_rad) * np.cos(azimuth_rad), np.sin(tilt_rad) * np.sin(azimuth_rad), np.cos(tilt_rad)]
        )

    assert abs(axis(**shape) @ axis(**payload)) > np.cos(0.2)


def test_the_axis_of_a_bench_is_its_own():
    """A bench has no tilt to look for, and a file that gives one is refused."""
    found = [c for c in parameters.candidates(load_machine("bench")) if c.effect.name == "flexible_payload"]
    assert [[number.name for number in one.free()] for one in found] == [["mass_kg", "frequency_Hz", "damping_ratio"]]
    with pytest.raises(HexsimError, match="a bench moves along its axis only"):
        resolve(changed(load_machine("bench"), {"effects": {"flexible_payload": {"mass_kg": 4.0, "tilt_rad": 1.0}}}))


def test_the_platform_balance_has_the_legs_own_mass_in_surge():
    """Neither payload on a spring, noise nor dry friction, whose jolts samples miss: of the surge force nothing is left that goes
    with the acceleration, within a fifth of what legs resist less in surge than the body of heave's mass; without their
    own matrix three quarters."""
    dry = {f"friction.{kind}_{way}_N": 0.0 for kind in ("coulomb", "static") for way in ("extend", "retract")}
    machine = changed(load_machine("micro_motion_system"), dry)
    log = log_with(machine, mass_kg=0.0)
    inner = slice(1500, -500)
    surge, force = (
        log.acceleration[0, inner],
        balances.balance_named("platform", machine).residual(log, machine)[0, inner],
    )
    beyond_kg = geometry.legs_beyond_body(resolve(machine))[0, 0]
    assert abs(beyond_kg) > 1.0
    assert abs(surge @ force / (surge @ surge)) < 0.2 * abs(beyond_kg)
