"""The sensors of a machine: one file each, found by name. See `hexsim.signals.sensor` for what a sensor is."""
