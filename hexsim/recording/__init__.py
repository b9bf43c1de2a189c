"""Outputs of a run: log files, Rerun recording, figures, report."""
