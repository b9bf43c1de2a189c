"""The motion computer: setpoint signals, modes and states, position control."""
