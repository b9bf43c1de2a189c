"""Accelerations of an IMU that sits off the platform's origin, taken to the origin where the balances are written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.machine.geometry import machine_kinematics
from hexsim.mechanics.points import origin_motion
from hexsim.signals.log import Log
from hexsim.signals.weak_form import WIDE_S, Window


def at_origin(log: Log, machine: Machine) -> Log:
    """The log with its accelerations at the origin and along the axes of the platform's frame.

    The angular velocity, in the small centripetal part, is that of the legs. Unchanged where the IMU sits at the origin, or
    where the log lacks a channel for it.
    """
    imu, positions = machine.sensors, log.signal("position")
    is_off = any(imu.imu_position_m) or any(imu.imu_orientation_deg)
    if not is_off or log.acceleration is None or log.angular is None or positions is None:
        return log
    legs, look = machine_kinematics(machine), Window(log.rate, WIDE_S)
    try:
        pose = legs.forward(np.ascontiguousarray(look.mean(positions).T))
    except HexsimError:  # the checks say what is wrong with these positions
        return log
    omega = legs.to_platform_frame(pose, legs.twist(pose, look.rate(pose.T).T))[:, 3:]
    linear, angular = origin_motion(
        log.acceleration.T, log.angular.T, omega, imu.imu_position_m, imu.imu_orientation_deg
    )
    return replace(log, acceleration=linear.T, angular=angular.T)
