"""Measured data compared with the model: what is missing, and how much."""
