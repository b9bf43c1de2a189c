"""Measured data held against the model: what is missing, and how much."""
