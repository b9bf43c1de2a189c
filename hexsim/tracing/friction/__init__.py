"""Friction identified from a log."""
