"""Rigid-body mechanics of the hexapod: kinematics and loads."""
