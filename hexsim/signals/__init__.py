"""Measured and simulated signals: the log and what is read off it."""
