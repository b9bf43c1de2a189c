"""Checks of logs before anything is fitted."""
