"""Sensors against each other: r_m = d2y/dt2 - a  [m/s2].

Of a hexapod six numbers: the platform's accelerations by forward kinematics of the legs' positions less what the IMU reads
where it is mounted. A common rigid motion of all joints of the base, or of the platform with the IMU, leaves them alike.
"""

from __future__ import annotations

import numpy as np

from hexsim.declaration import Machine
from hexsim.hydraulics.resolved import Resolved
from hexsim.signals.log import Log
from hexsim.signals.weak_form import WIDE_S, Window
from hexsim.tracing.balances.balance import Balance, position_settings, resolved_machine, sensed_leg, sensor_settings
from hexsim.tracing.balances.platform import ROWS, felt_by_imu, platform_motion
from hexsim.tracing.memory import latest

Array = np.ndarray


class Sensor(Balance):
    """Position differentiated twice against the accelerometer of a bench."""

    name = "sensor"
    unit = "m/s2"
    caption = "position differentiated twice = acceleration, but for the ripple between the controller's ticks"
    order = 10
    signals = ("position_m", "velocity_m_s", "acceleration_m_s2", "time_s", "pressure_bottom_Pa", "valve_V")
    usual_signal = "acceleration_m_s2"
    spoils_others = True

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        return () if machine.is_hexapod else (("acceleration",),)

    def residual_at(self, log: Log, machine: Machine, at: slice) -> Array:
        resolved, place = resolved_machine(machine), ("disagreement", at.start, at.stop, at.step)
        sensed = sensed_leg(log, resolved, 0)
        return latest(log, place, sensor_settings(resolved, 0), lambda: sensed.disagreement(at))[None]

    def noise_gains(self, resolved: Resolved) -> Array:
        """Both are about as noisy."""
        return np.sqrt(np.array([position_settings(resolved, 0)[1] * resolved.sensors.acceleration_gain]))

    def sampling(self, log: Log, machine: Machine) -> Array:
        return sensed_leg(log, resolved_machine(machine), 0).between_ticks()[None]


class Imu(Balance):
    """The legs' positions through the declared joints against the accelerometers of the platform."""

    name = "sensor"
    unit = "m/s2, rad/s2"
    caption = "acceleration by the legs' positions = what the IMU reads where it is mounted"
    order = 10
    signals = ("acceleration_m_s2", "time_s", "position_m", "velocity_m_s")
    usual_signal = "acceleration_m_s2"
    one_cause = True

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        return (("acceleration", "angular_acceleration"),) if machine.is_hexapod else ()

    def places(self, log: Log) -> list[str]:
        return [f"platform {row}" for row in ROWS]

    def residual_at(self, log: Log, machine: Machine, at: slice) -> Array:
        resolved = resolved_machine(machine)
        sensors, built = resolved.sensors, resolved.mechanics
        read = (sensors.acceleration_offset_m_s2, sensors.acceleration_gain, sensors.acceleration_delay_s)
        arrays = (
            built.base_joints,
            built.platform_joints,
            built.retracted_length_m,
            resolved.imu_turn_rad,
            resolved.imu_place_m,
        )
        key = (
            read, tuple(position_settings(resolved, i) for i in range(6)), *(np.asarray(x).tobytes() for x in arrays),
        )  # fmt: skip
        return latest(log, ("imu", at.start, at.stop, at.step), key, lambda: self.compared(log, resolved, at))

    @staticmethod
    def compared(log: Log, resolved: Resolved, at: slice) -> Array:
        """The residual of the sensors' settings and the joints of a machine."""
        look, window = Window(log.rate, WIDE_S, at), Window(log.rate)
        motion = platform_motion(log, resolved, [sensed_leg(log, resolved, i) for i in range(6)])
        legs, poses = resolved.mechanics, motion.poses.T
        pose, rate, second = look.mean(poses).T, look.rate(poses).T, look.second_rate(poses).T
        moved = legs.to_platform_frame(pose, legs.twist_rate(pose, rate, second))
        residual = moved.T - look.mean(window.mean(felt_by_imu(log, resolved, motion.omega).T))
        seen_whole = np.arange(log.n)[at] < log.n - look.half - window.half
        residual[:, ~seen_whole] = 0.0
        return residual


BALANCES = (Sensor(), Imu())
